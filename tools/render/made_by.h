#pragma once

#include <string>

#include <surfel/io/image_io.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// The command without what has no effect on pictures, and the content of the files that it names.
/// Throws Error(kUsage) where --skip-existing asks for the content of a pipe.
std::string made_by(tool::Tool& tool, const Settings& s);

/// Do pictures say what they were made by? Those of a sequence do, and a single one where
/// --skip-existing may find it later: others have the bytes of any command that makes the picture.
bool says_made_by(const Settings& s);

/// What a film says that it was made by, as a text that files hold as it is.
std::string film_mark(const Settings& s);

/// Has the file of a picture of this number been made by the same command of the same content? A
/// part is looked at as a whole, and is to be made again where it was not. Throws Error(kInput)
/// with the difference where there is another picture, which may be anybody's.
bool picture_is_made(const Settings& s, const std::string& file, std::size_t number);
/// The same of the film.
bool film_is_made(const Settings& s);

/// Adds what the picture of this number was made by to the texts that go into its file.
void mark_picture(const Settings& s, std::size_t number, ImageWriteOptions& options);

}  // namespace surfel::render_tool
