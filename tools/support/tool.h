#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/timing.h>

#include "tools/support/files.h"
#include "tools/support/json.h"
#include "tools/support/options.h"

namespace surfel::tool {

/// Process exit codes of every tool.
enum ExitCode : int { kDone = 0, kFailed = 1, kWrongUsage = 2 };

enum class Progress { kAuto, kNone, kJson };

/// Options that every tool has.
struct CommonOptions {
  int threads = 0;  ///< 0 = one per core.
  bool quiet = false;
  bool verbose = false;
  Progress progress = Progress::kAuto;
  bool no_clobber = false;
  std::string stats;  ///< JSON report; empty = none.
};

/// One executable: the common options (--threads, --config, --print-config, --manual, --completion,
/// --quiet, --verbose, --progress, --no-clobber, --stats, --help, --help-all, --version), the
/// configuration file, errors to exit codes, signals, the JSON report. A tool's main() declares its
/// options on app() bound to the members of its options structs (whose initialisers are the
/// defaults), then returns run():
///
///     int main(int argc, char** argv) {
///       surfel::tool::Tool tool("surfel-thin", "Keeps every n-th surfel.");
///       std::string input;
///       std::string output;
///       surfel::ThinOptions options;
///       tool.app().add_option("surfels", input, "Surfels (PLY, PCD; - = standard input)")
///           ->required();
///       tool.app().add_option("-o,--output", output, "Surfels to write")->required();
///       tool.app().add_option("--step", options.step, "Keep one surfel in this many, >= 1");
///       tool.files().reads({"surfels"});
///       tool.files().writes("--output", surfel::tool::Writes::kSurfels);
///       return tool.run(argc, argv, [&] {
///         surfel::tool::require_valid(options.problems());
///         const surfel::SurfelCloud cloud = surfel::read_cloud(input);
///         surfel::SurfelCloud thinned = surfel::thin(cloud, options);
///         surfel::tool::write_result(tool, thinned, output);
///         tool.report()["surfels"] = thinned.size();
///         tool.wrote(output, fmt::format("{} surfels", thinned.size()));
///       });
///     }
///
/// Vectors, sizes and choices have helpers in options.h. Numbers keep the type name that
/// add_option() gives them (INT, FLOAT): by it --print-config and the report know them from text.
class Tool {
 public:
  Tool(std::string name, const std::string& summary);
  ~Tool();
  Tool(const Tool&) = delete;
  Tool& operator=(const Tool&) = delete;

  CommandLine& app();
  /// Names the options that set fields of the library's structs under another name than the
  /// field's: messages of the library are told with the options' names (with_option_names()).
  void name_fields(FieldNames names);
  /// The options that --help shows; --help-all shows all, in their groups. Each example is a
  /// command of this tool as it is typed, to stand below them.
  void everyday(std::vector<std::string> options, std::vector<std::string> examples);
  const CommonOptions& common() const;
  /// Makes this process one that helps another, which runs the same command: it says errors alone,
  /// and writes no report.
  void follow();
  /// The files that the options name. A tool declares which options are files beside its options;
  /// run() checks them before the body begins.
  RunFiles& files();

  /// Declares --max-pixels, for a tool that reads images, and keeps to it.
  void reads_images();
  /// Declares --allow-outside, for a tool that reads files that name others, and keeps to it.
  void reads_named_files();

  /// The report that --stats writes; a tool adds what it measured. `tool`, `version`, `options`,
  /// `threads`, `total_ms` and `peak_memory_bytes` are filled in by run(). A run that fails after
  /// its options were understood writes the report, too, with its message as `error`.
  Json& report();

  /// Message on standard error after the tool's name: note() unless --quiet, with the names of
  /// options (with_option_names()); detail() with --verbose only.
  void note(const std::string& message) const;
  void detail(const std::string& message) const;
  /// The one line that a successful run says of what it has written, unless --quiet: "dragon.ply:
  /// 300000 surfels, 14 MB, in 0.8 s".
  /// \param files  the files whose sizes count where the path is a pattern.
  void wrote(const std::string& path, const std::string& what,
             const std::vector<std::string>& files = {}) const;

  /// "surfel-x 0.1.0 --spacing 0.01 ..." for provenance comments: tool, version and the options
  /// given, for a shell. Options that cannot change the result (threads, output, reports) and the
  /// folders of input files are left out, so that equal work gives equal bytes.
  std::string provenance() const;

  /// " --size 512 -o ..." for a shell: the options given, but for some, with their values.
  std::string options_given(const std::vector<std::string>& without) const;

  /// Parses, runs the body, reports; returns the exit code.
  int run(int argc, char** argv, const std::function<void()>& body);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Writes the whole text to standard output. Throws Error(kIo) where it cannot (closed pipe, full
/// disk).
void print(const std::string& text);

/// Throws Error(kUsage) with all the problems of an options struct, if there are any.
void require_valid(const std::vector<std::string>& problems);

/// Adds `more` to the problems.
void append(std::vector<std::string>& problems, const std::vector<std::string>& more);

/// Adds the times of a run's stages to a report, as its "stages".
void add_stages(Json& report, const StageTimes& times);

}  // namespace surfel::tool
