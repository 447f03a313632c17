#include <filesystem>
#include <utility>

#include <surfel/io/coordinate_file.h>
#include <surfel/io/input_file.h>
#include <surfel/io/las_header.h>
#include <surfel/io/las_projection.h>
#include <surfel/io/pcd.h>
#include <surfel/io/ply.h>

namespace surfel {

std::optional<CoordinateSystem> read_coordinate_system(const std::string& path) {
  std::error_code unknown;
  if (!std::filesystem::is_regular_file(path, unknown)) return std::nullopt;
  InputFile input(path);
  if (LasHeader::matches(input.head(4))) {
    return las_projection(LasHeader(input).storage.records);
  }
  if (PlyFile::matches(input.head(4))) {
    return coordinate_system(PlyFile(std::move(input)).header().comments);
  }
  if (PcdFile::matches(input.head(PcdFile::kMatched))) {
    return coordinate_system(PcdFile(std::move(input)).comments());
  }
  return std::nullopt;
}

}  // namespace surfel
