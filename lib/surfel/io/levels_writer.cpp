#include <utility>

#include <surfel/io/levels_writer.h>

namespace surfel {

LevelsWriter::LevelsWriter(const std::string& path, std::string provenance,
                           const RowFileOptions& options)
    : provenance_(std::move(provenance)), file_(path, options) {}

void LevelsWriter::begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) {
  SurfelCloud described = like;
  if (!provenance_.empty()) described.provenance.push_back(provenance_);
  file_.begin(described, surfels, clusters);
}

void LevelsWriter::put(const SurfelCloud& part, std::size_t begin, std::size_t end,
                       std::size_t at) {
  file_.put(part, begin, end, at);
}

void LevelsWriter::finish(ClusterTree tree) { file_.put_tree(tree); }

}  // namespace surfel
