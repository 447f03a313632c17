#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/support/tool.h"

namespace surfel::tool {

/// Declares --resume.
void add_resume(CommandLine& app, bool& value);

/// What a run makes of which files, by which a later run knows that it may go on with what this one
/// left: the options that matter, and the files' sizes, times and checksums. Empty without
/// --resume. Throws Error(kUsage) for standard input, which cannot be read again.
/// \param output  The result, beside which parts are kept: Error(kUsage) for standard output.
/// \param together  Several processes that mpirun has started make the result together;
///                  Error(kUsage) where they have been started and do not.
std::string job(const Tool& tool, bool resume, const std::vector<std::string>& inputs,
                const std::string& output, bool together = false);

/// Throws Error(kUsage) where --resume is given and the result is standard output.
void check_resume(bool resume, const std::string& output);

/// Throws Error(kInput) for an input that is not read in ranges, as a run that keeps blocks does.
[[noreturn]] void refuse_resume(const std::string& input);

/// Tells how much of a result earlier runs have made, if they have.
void tell_resumed(const Tool& tool, const std::string& path, std::uint64_t kept,
                  std::uint64_t rows);

}  // namespace surfel::tool
