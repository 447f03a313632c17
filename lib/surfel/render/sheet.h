#pragma once

// Sums over the splats of one surface (sheet_search.h) that are made before they meet the A-buffer:
// SS01 section 6 compares them with a pixel's fragments once instead of splat by splat.

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/splat.h>
#include <surfel/render/splat_setup.h>
#include <surfel/render/tile_raster.h>

namespace surfel {

/// Sums over the splats of sheets, patch by patch. The memory is kept from block to block.
struct SheetSums {
  /// A patch of a sheet, in pixels of the block.
  struct Patch {
    std::uint8_t x, y;
    SheetPatch sheet;
  };

  Array<float> sums;            ///< Of all patches.
  std::size_t used = 0;         ///< Floats of `sums` in use.
  std::vector<Patch> patches;   ///< Of the sheets that have been added since this was cleared.
  std::uint64_t fragments = 0;  ///< FrameStatistics::fragments.
  Array<float> picture;         ///< Scratch: the sums of a sheet, pixel by pixel.
};

/// The splats of a sheet in a block: all show one surface (sheet_search.h) and have the same tag.
struct SheetSplats {
  const Splat* splats;
  const SplatNormal* normals;    ///< Parallel to `splats`; null in unshaded pictures.
  const std::uint32_t* members;  ///< Places of the sheet's splats.
  std::size_t count = 0;         ///< Number of members, at least 1.
  float depth;                   ///< The sheet's, SheetPatch::depth.
};

/// Adds the sums over a sheet's splats; SIMD, chosen at run time. They do not depend on the number
/// of threads nor on the width of vectors.
/// \param view  its clip rectangle is the block.
void add_sheet(const FragmentRules& rules, const SplatView& view, const SheetSplats& sheet,
               SheetSums& sums);

}  // namespace surfel
