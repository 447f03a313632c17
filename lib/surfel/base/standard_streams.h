#pragma once

#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// Gives /dev/null to each of the descriptors 0, 1 and 2 that the process was started without, so
/// that no file that it opens later takes their place: what is written to standard output would go
/// to that file. Standard input and output are opened in the wrong direction, so that their use is
/// still an error; messages to a closed standard error are lost. A program calls it first thing.
SURFEL_API void hold_standard_descriptors() noexcept;

/// Throws Error(kIo) if standard input cannot be read, because it is closed or open for writing
/// only.
SURFEL_API void require_standard_input();
/// Whether a file's name stands for standard output: "-", or a link to this process's descriptor
/// 1, as /dev/stdout is.
SURFEL_API bool is_standard_output(const std::string& path);
/// As require_standard_input(), for standard output.
SURFEL_API void require_standard_output();

}  // namespace surfel
