#pragma once

#include <functional>
#include <string>

#include <CLI/CLI.hpp>
#include <nlohmann/json_fwd.hpp>

namespace surfel::tool {

/// Process exit codes of every tool.
enum ExitCode : int { kDone = 0, kFailed = 1, kWrongUsage = 2 };

/// Options that every tool has.
struct CommonOptions {
  int threads = 0;  ///< 0 = one per core.
  bool quiet = false;
  bool verbose = false;
  bool no_clobber = false;
  std::string stats;  ///< JSON report; empty = none.
};

/// One executable: the common options (--threads, --config, --print-config, --quiet, --verbose,
/// --no-clobber, --stats, --help, --version), the configuration file, errors to exit codes,
/// signals, the JSON report. A tool's main() declares its options on app() bound to the members of
/// its options structs (whose initialisers are the defaults), then returns run().
class Tool {
 public:
  Tool(std::string name, std::string summary);
  ~Tool();

  CLI::App& app();
  const CommonOptions& common() const;

  /// The report that --stats writes; a tool adds what it measured. `tool`, `version`, `options`,
  /// `threads`, `total_ms` and `peak_memory_bytes` are filled in by run().
  nlohmann::json& report();

  /// Message on standard error: note() unless --quiet, detail() with --verbose only. Prefixed with
  /// the tool's name.
  void note(const std::string& message) const;
  void detail(const std::string& message) const;
  /// Progress 0..1 on standard error: a bar on a terminal only, none with --quiet.
  void progress(const std::string& what, double fraction) const;

  /// "surfel-x --spacing 0.01 ..." for provenance comments: tool, version and the options given.
  std::string provenance() const;

  /// Parses, runs the body, reports; returns the exit code.
  int run(int argc, char** argv, const std::function<void()>& body);

 private:
  struct Impl;
  Impl* impl_;
};

}  // namespace surfel::tool
