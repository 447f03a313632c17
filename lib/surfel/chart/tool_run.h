#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <surfel/chart/chart_result.h>
#include <surfel/chart/journal.h>

namespace surfel {

/// The outcome of a tool's run.
struct ToolRun {
  int exit_code = 0;
  std::string message;  ///< The tool's error, where the exit code is not 0.
  double ms = 0;        ///< Time of its work, without reading and writing.
  std::vector<StageTime> stages;
  std::uint64_t memory = 0;
  std::size_t surfels = 0;
  int groups = 0;

  /// The tool refused its options: they contradict each other, or do not fit the input.
  bool wrong_usage() const { return exit_code == 2; }
  /// Throws Error(kUsage), or kInput for other failures, with the message.
  void require_success() const;
};

/// Runs tools in a folder, one process at a time. They read images of as many pixels as this
/// process does (set_most_image_pixels()), unless their options say otherwise, and files that it
/// may read because others name them (allow_outside()).
class ToolRunner {
 public:
  /// \param tools    Folder of the tools.
  /// \param folder   Folder that they run in.
  /// \param journal  Keeps the runs; it must outlive the runner.
  ToolRunner(std::string tools, std::string folder, Journal& journal)
      : tools_(std::move(tools)), folder_(std::move(folder)), journal_(journal) {}

  /// Runs a tool, unless the journal has its run on that occasion and its output is still there.
  /// \param words   The tool's name and arguments.
  /// \param output  File that it makes, relative to the folder; may be empty.
  /// \param occasion  Tells runs of equal words apart that must not stand for one another.
  ToolRun run(const std::vector<std::string>& words, const std::string& output,
              const std::string& occasion);

 private:
  std::string tools_;
  std::string folder_;
  Journal& journal_;
};

}  // namespace surfel
