#pragma once

#include <string>

#include <surfel/scene/surfel_cloud.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// Decides what was left to be chosen of shading and relief by what is drawn, and says so where it
/// is not plain to see. Only for pictures of surfels or of --mesh.
/// \param name         The file, for notes.
/// \param colors       What its colours are; kUnsaid: it has none that are shown.
/// \param transparent  Some of its surfaces can be seen through.
void choose_light(tool::Tool& tool, Settings& s, const std::string& name, ColorLight colors,
                  bool transparent);

}  // namespace surfel::render_tool
