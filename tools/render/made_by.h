#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// The command without what has no effect on pictures, and the content of the files that it names.
/// Throws Error(kUsage) where --skip-existing asks for the content of a pipe.
std::string made_by(tool::Tool& tool, const Settings& s);

/// Do pictures say what they were made by? Those of a sequence do, and a single one where
/// --skip-existing may find it later: others have the bytes of any command that makes the picture.
bool says_made_by(const Settings& s);

/// What a picture, or the film, says that it was made by, as a text that files hold as it is.
std::string made_by_mark(const Settings& s, std::optional<std::size_t> picture);

/// Does the file hold the mark? Throws Error(kInput) with the difference where there is a file,
/// which may be anybody's, that does not.
bool is_marked(const std::string& path, const std::string& mark);

}  // namespace surfel::render_tool
