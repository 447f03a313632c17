#pragma once

#include <memory>
#include <string>

#include <surfel/base/export.h>
#include <surfel/scene/level_sink.h>

namespace surfel {

/// Writes levels of detail to binary PLY as write_cloud() would, without holding them in memory.
class SURFEL_API LevelsWriter final : public LevelSink {
 public:
  /// Opens a file, as OutputFile does; "-" is standard output.
  /// \param provenance  a line for SurfelCloud::provenance; empty: none
  LevelsWriter(std::string path, std::string provenance, bool no_clobber = false);
  ~LevelsWriter() override;

  void begin(const SurfelCloud& like, std::size_t surfels, std::size_t clusters) override;
  void put(const SurfelCloud& part, std::size_t begin, std::size_t end, std::size_t at) override;
  void finish(ClusterTree tree) override;
  /// Completes the file: until then there is none.
  void commit();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
