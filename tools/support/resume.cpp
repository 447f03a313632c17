#include "tools/support/resume.h"

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/resume_journal.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/ranks/ranks.h>

namespace surfel::tool {

void add_resume(CommandLine& app, bool& value) {
  app.add_flag(
      "--resume", value,
      "Keep what an interrupted run has made, as FILE.unfinished beside the result, and go "
      "on with it: the same command again ends with the same bytes");
}

void check_resume(bool resume, const std::string& output) {
  if (resume && output == "-") {
    throw_usage("--resume keeps what it has made beside the result; name a file");
  }
}

void refuse_resume(const std::string& input) {
  if (input == "-") throw_usage("--resume reads its input again; name a file");
  CloudReader(input, {}).first();  // Says why no file is read.
  throw_input(input,
              "--resume keeps blocks of files that are read in parts; " + range_advice(input));
}

std::string job(const Tool& tool, bool resume, const std::vector<std::string>& inputs,
                const std::string& output, bool together) {
  check_resume(resume, output);
  if (!resume) return {};
  if (started_rank().count > 1 && !together) {
    throw_usage("--resume is for one process; leave it out, or start the tool without mpirun");
  }
  std::string job = tool.provenance();
  for (const std::string& input : inputs) {
    if (input == "-") throw_usage("--resume reads its input again; name a file");
    job += "\n" + input + " " + file_mark(input);
  }
  return job;
}

void tell_resumed(const Tool& tool, const std::string& path, std::uint64_t kept,
                  std::uint64_t rows) {
  if (kept == 0) return;
  tool.note(fmt::format("{}: going on where an earlier run stopped, which made {} of {} surfels",
                        path, kept, rows));
}

}  // namespace surfel::tool
