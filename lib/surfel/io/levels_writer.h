#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/io/row_file.h>
#include <surfel/scene/level_sink.h>

namespace surfel {

/// Writes levels of detail to binary PLY as write_cloud() would, without holding them in memory.
class SURFEL_API LevelsWriter final : public LevelSink {
 public:
  /// Opens a file, as RowFile does.
  /// \param path        The file to write.
  /// \param provenance  A line for SurfelCloud::provenance; empty: none.
  /// \param options     Whether an older file is kept, and which job a later run resumes.
  LevelsWriter(const std::string& path, std::string provenance, const RowFileOptions& options = {});

  void begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) override;
  void put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::size_t at) override;
  void finish(ClusterTree tree) override;
  /// Completes the file: until then there is none.
  void commit() { file_.commit(); }
  /// The file, which keeps what has been finished.
  RowFile& file() { return file_; }

 private:
  std::string provenance_;
  RowFile file_;
};

}  // namespace surfel
