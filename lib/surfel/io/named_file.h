#pragma once

#include <string>
#include <string_view>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>

namespace surfel {

// Names that stand in files: a mesh's materials and images, a volume's values, a scene's
// environment, a glTF file's buffers. Whoever sends a file chooses them, so that they must not
// reach what he has no right to. Every file that a file names is opened by open_named().

/// May names in files lead out of the folders of these files? False, unless it is set.
SURFEL_API bool outside_allowed() noexcept;
/// Sets outside_allowed() for all threads of the process.
SURFEL_API void allow_outside(bool allowed) noexcept;

/// The path that a name in a file means. It is the first of these that exists: the name as it is
/// written, seen from the file's folder; the name with a Windows path's backslashes turned; its
/// last part beside the file; the last two with letters of another case in the file's name. An
/// absolute name, or one that leads out of the folder, comes from another machine more often than
/// not: its last part beside the file comes first, and the name as it is written counts last, if it
/// leads into the folder or outside_allowed(). If none exists, the name as seen from the folder.
/// \param naming  Path of the file that holds the name.
/// \param name    The name, as the file has it.
SURFEL_API std::string named_path(const std::string& naming, std::string_view name);

/// What keeps open_named() from opening a path, as the end of a sentence about it ("is not there");
/// empty if nothing does. Nothing outside of the folder is looked at unless outside_allowed().
/// \param naming  Path of the file that holds the name.
/// \param path    From named_path().
SURFEL_API std::string named_problem(const std::string& naming, const std::string& path);

/// Opens a file that another file names: a regular file in the other's folder or below it, where
/// symbolic links count as what they lead to, or, if outside_allowed(), anywhere. Throws
/// Error(kInput) that names both, and says what to do.
/// \param naming  Path of the file that holds the name.
/// \param path    From named_path().
SURFEL_API InputFile open_named(const std::string& naming, const std::string& path);

}  // namespace surfel
