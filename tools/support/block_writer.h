#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include <surfel/base/checkpoints.h>
#include <surfel/base/peers.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/io/row_file.h>
#include <surfel/scene/surfel_sink.h>

#include "tools/support/tool.h"

namespace surfel::tool {

struct BlockWriterOptions {
  std::string job = {};    ///< RowFileOptions::job.
  Peers* peers = nullptr;  ///< RowFileOptions::peers.
  /// Of all blocks, by which coordinates get their types; unset: blocks have the types already.
  std::optional<CloudSurvey> survey = {};
};

/// Writes surfels that a tool makes block by block, as write_result() writes them at once: binary
/// PLY to their places, other formats in their order.
class BlockWriter final : public SurfelSink {
 public:
  /// Throws Error(kUsage) where blocks are kept or shared in a file that is no PLY.
  BlockWriter(const Tool& tool, std::string path, BlockWriterOptions options = {});

  void begin(const SurfelCloud& like, std::size_t count) override;
  void put(SurfelCloud surfels, std::size_t at) override;
  /// Completes the file.
  void commit();

  /// Keeps the blocks that are finished; null without a job.
  Checkpoints* checkpoints() { return options_.job.empty() ? nullptr : &*rows_; }
  std::size_t surfels() const { return count_; }

 private:
  void settle(SurfelCloud& surfels) const;

  const Tool& tool_;
  std::string path_;
  BlockWriterOptions options_;
  std::size_t count_ = 0;
  std::optional<RowFile> rows_;
  std::optional<CloudWriter> text_;
};

}  // namespace surfel::tool
