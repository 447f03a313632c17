#include <surfel/io/cloud_comments.h>
#include <surfel/io/cloud_ply_header.h>
#include <surfel/io/ply.h>
#include <surfel/io/tree_records.h>

namespace surfel {

std::string cloud_ply_header(const SurfelCloud& cloud, const std::vector<RecordColumn>& columns,
                             std::size_t count, std::size_t clusters, bool ascii) {
  std::string header = "ply\n";
  header += ascii ? "format ascii 1.0\n" : "format binary_little_endian 1.0\n";
  for (const std::string& comment : file_comments(cloud, false)) {
    header += "comment " + comment + "\n";
  }
  header += ply_element("vertex", columns, count);
  if (clusters > 0) header += ply_element(kTreeElement, tree_columns(), clusters);
  return header + "end_header\n";
}

}  // namespace surfel
