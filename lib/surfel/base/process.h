#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

struct ProcessResult {
  int exit_code = -1;  ///< -1 where a signal ended the process.
  std::string errors;  ///< Text that the process wrote to standard error.
};

/// Runs a program in `folder` and waits for its end; its standard output is thrown away. words[0]
/// is its path, or a name to look for in PATH. An interrupt that is requested meanwhile
/// (base/parallel.h) ends the process, too, and throws Error(kInterrupted). Throws Error(kIo) where
/// the program cannot be started.
SURFEL_API ProcessResult run_process(const std::vector<std::string>& words,
                                     const std::string& folder);

/// Path of a program that PATH leads to; empty if there is none.
SURFEL_API std::string find_program(const std::string& name);

}  // namespace surfel
