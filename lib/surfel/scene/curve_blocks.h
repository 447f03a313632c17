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
  std::size_t begin = 0;  ///< Surfels of the cloud; also surfels that cannot be drawn.
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

/// Cuts a cloud into blocks of at most `most` surfels that can be drawn, and of a quarter as many
/// at least (the last may have fewer). Within these bounds a block ends where the curve crosses the
/// border of the largest cells, at the last such place: blocks are as compact as the cells of an
/// octree, however unlike the scales of the cloud. The blocks depend on the surfels that can be
/// drawn, and on the grid, alone. Reads the surfels once; at a time some 100,000 of them are in
/// memory, and `most` positions.
SURFEL_API CurveBlocks curve_blocks(const SurfelRanges& ranges, std::size_t most);

}  // namespace surfel
