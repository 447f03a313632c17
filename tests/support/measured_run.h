#pragma once

#include <string>
#include <vector>

namespace surfel::test {

struct RunLimits {
  unsigned seconds = 20;        ///< Processor's time.
  unsigned long gigabytes = 6;  ///< Address space; 0: none.
};

/// What a process cost.
struct MeasuredRun {
  int exit_code = -1;    ///< -1 where a signal ended it.
  double seconds = 0;    ///< Processor's time, as other processes of the machine do not count then.
  double megabytes = 0;  ///< Most memory at a time.
  std::string message;   ///< First line of standard error.
};

/// Runs a program, with standard output thrown away, and measures it.
/// \param folder  where standard error is kept meanwhile, as the file `errors`, which is removed.
MeasuredRun measured_run(const std::vector<std::string>& command, const std::string& folder,
                         const RunLimits& limits = {});

/// The words of a text, parted by blanks.
std::vector<std::string> words_of(const std::string& text);

}  // namespace surfel::test
