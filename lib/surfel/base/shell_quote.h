#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// A word as a POSIX shell reads it back: in single quotes unless all its characters are plain.
/// Words with control characters are written as $'\033', which POSIX has since 2024, so that no
/// terminal obeys them.
SURFEL_API std::string shell_quoted(const std::string& word);

/// The name of a file as an argument of a command, for a shell: quoted, and "./-x" instead of "-x",
/// which the command would take for an option. "-" stays, as it stands for the standard streams.
SURFEL_API std::string shell_file(const std::string& path);

/// A command of these words, for a shell.
SURFEL_API std::string shell_command(const std::vector<std::string>& words);

}  // namespace surfel
