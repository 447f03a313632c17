#pragma once

#include <surfel/store/cloud_loader.h>

#include "tools/render/settings.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// Decides what was left to be chosen of shading and relief by what the surfels are, and says so
/// where it is not plain to see. Only for pictures of surfels.
/// \param by_attribute  The surfels show an attribute in place of colours of their own.
void choose_light(tool::Tool& tool, Settings& s, const LoadedCloud& loaded, bool by_attribute);

}  // namespace surfel::render_tool
