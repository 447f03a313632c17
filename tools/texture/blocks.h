#pragma once

#include <cstdint>
#include <optional>

#include "tools/support/tool.h"
#include "tools/texture/settings.h"

namespace surfel::texture_tool {

/// Bytes that surfels take while they are textured in memory, of which there may be more than have
/// been counted.
std::uint64_t least_bytes(std::size_t surfels, const SurfelCloud& first, const Settings& s);

/// Textures a file block by block that is larger than the memory, or whose blocks are kept for a
/// later run, if that can be done. False if the file fits; unset if that is not known of a file
/// that has to.
std::optional<bool> texture_in_blocks(tool::Tool& tool, Settings& s, std::uint64_t memory);

}  // namespace surfel::texture_tool
