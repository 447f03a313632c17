#pragma once

#include <memory>
#include <optional>
#include <vector>

#include <surfel/render/legend.h>
#include <surfel/store/cloud_loader.h>

#include "tools/render/settings.h"
#include "tools/render/views.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

/// Reads the files that the settings name, makes surfels of what is none, and tells what was done
/// and how many surfels cannot be used.
/// \param views   as asked for: they say how finely meshes are sampled.
/// \param legend  set where colours stand for something.
std::unique_ptr<LoadedCloud> load_surfels(tool::Tool& tool, const Settings& s,
                                          const std::vector<AskedView>& views,
                                          std::optional<Legend>& legend);

}  // namespace surfel::render_tool
