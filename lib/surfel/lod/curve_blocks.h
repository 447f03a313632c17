#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/usable_surfels.h>

namespace surfel {

/// Neighbouring surfels of a cloud in the order of morton_order().
struct CurveBlock {
  std::size_t begin = 0;  ///< Surfels of the cloud, those that cannot be drawn among them.
  std::size_t end = 0;
  std::uint32_t count = 0;  ///< Surfels that can be drawn; one at least.
  /// Box around the positions of the surfels that can be drawn.
  Vec3f min{0, 0, 0};
  Vec3f max{0, 0, 0};
};

struct CurveBlocks {
  std::vector<CurveBlock> blocks;  ///< Along the curve.
  UnusableSurfels dropped;
  bool in_order = true;  ///< False: the cloud is in another order, and there are no blocks.
};

/// Cuts a cloud into blocks of `most` surfels that can be drawn, and of a quarter as many at least
/// (the last may have fewer). Each is cut off where the curve, within these bounds, enters the
/// largest of its cells anew, at the last such place: blocks are as compact as cells of an octree
/// are, however unlike the scales of the cloud. The blocks depend on the
/// surfels that can be drawn, and on the grid, alone. Reads the surfels once, a few blocks at a
/// time.
SURFEL_API CurveBlocks curve_blocks(const SurfelRanges& ranges, std::size_t most);

}  // namespace surfel
