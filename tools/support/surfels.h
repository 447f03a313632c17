#pragma once

#include <string>

#include <surfel/scene/surfel_cloud.h>

#include "tools/support/tool.h"

namespace surfel::tool {

/// Reads surfels for a tool that works on the finest level alone; tells where a file has levels of
/// detail, as they will be missing from what is written.
SurfelCloud read_finest(const Tool& tool, const std::string& path);

}  // namespace surfel::tool
