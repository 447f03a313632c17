#pragma once

#include <string>

#include <surfel/lod/level_store_writer.h>

#include "tools/support/tool.h"

namespace surfel::tool {

/// Does the name of an output stand for a store of levels of detail, which is a folder: does it end
/// in a slash, or is there one already?
bool names_store(const std::string& path);

/// Reports what was written to a store; returns it in words.
std::string tell_store(Tool& tool, const std::string& path, const LevelStoreReport& written);

}  // namespace surfel::tool
