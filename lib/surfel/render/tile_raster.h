#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <surfel/render/a_buffer.h>
#include <surfel/render/splat.h>

namespace surfel {

/// The rules by which splats of a list become fragments, in all tiles of all pictures.
struct FragmentRules {
  float cutoff = 1;
  float lowpass2 = 1;  ///< Variance of the low-pass filter, pixels^2.
  /// Contributions whose depths differ by less than so many depth ranges are of one surface.
  float depth_epsilon = 1;
  bool opaque = true;  ///< Every splat has alpha 1.
};

/// The sums over many splats of one surface in a patch of a tile (sheet.h): the channels kWeight to
/// kAlpha, kSheetEpsilon and, in shaded pictures, the normal, kPatchPixels floats each.
struct SheetPatch {
  /// Of the whole sheet, to sort by: a depth in the patch would make the order in a pixel depend on
  /// where patches lie.
  float depth;
  std::uint32_t tag;    ///< Splat::tag of all splats.
  std::uint32_t sums;   ///< Place of the sums, in steps of kPatchPixels floats.
  std::uint32_t patch;  ///< Which one of the tile.
};
inline constexpr int kSheetEpsilon = kTag;  ///< Sum of rho * epsilon.

/// How one of a tile's splats is drawn again as it was drawn among the others.
struct RasterReplay {
  float hidden;  ///< Depth behind which nothing of the pixel in question was seen.
  /// rho of the least contribution that merges two surfaces; infinity: none does, nor is added to
  /// merged ones.
  float least_to_merge;
  float* epsilon;  ///< Null, or gets the splat's epsilons in the pixels of its patches.
};

/// Splats of one tile, in the order in which they are to be drawn: nearest first.
struct TileJob {
  const FragmentRules* rules = nullptr;
  const Splat* splats = nullptr;
  const SplatNormal* normals = nullptr;  ///< Parallel to `splats`; null in unshaded pictures.
  const ExactSplat* exact = nullptr;     ///< Parallel to `splats`; read where k is kExactKernel.
  /// Parallel to `splats`, read where kClippedTag is set; null if it is set nowhere in the tile.
  const SplatClip* clips = nullptr;
  const std::uint16_t* groups = nullptr;  ///< Parallel to `splats`; null where they do not matter.
  /// Indices into `splats`; kTileSize more places can be read.
  const std::uint32_t* order = nullptr;
  std::size_t count = 0;
  int box_x = 0, box_y = 0;  ///< First pixel of the tile as Splat::box counts.
  /// FrameStatistics::fragments of the thread that draws the tile.
  std::uint64_t* fragments = nullptr;
  /// Null: the tile has no sheets. Else the sheets of patch p are [sheets_begin[p],
  /// sheets_begin[p + 1]), nearest first.
  const SheetPatch* sheets = nullptr;
  const std::uint32_t* sheets_begin = nullptr;
  const float* sheet_sums = nullptr;
  /// Number of the worker's splats: with the same number an index stands for the same splat.
  std::uint64_t load = 0;
  const RasterReplay* replay = nullptr;  ///< Null: the splats are drawn for the first time.
};

/// Splats that are drawn before it is found anew what hides others.
inline constexpr std::size_t kHiddenEvery = 256;
/// Splats that meet a patch that are offered to its layers before what no layer has taken is
/// merged.
inline constexpr std::size_t kOfferedTogether = 32;
/// Share of a pixel that a contribution must have to be worth merging two surfaces for.
inline constexpr float kMergingShare = 1e-3F;
/// The least share in the largest kernel around, where kernels are so many that none has
/// kMergingShare of a pixel.
inline constexpr float kMergingShareOfLargest = 3e-2F;

/// A depth, as Splat::depth, for every pixel of a tile.
using PixelDepths = std::array<float, kTilePixels>;

/// The depths of the nearest surfaces that cover pixels, see covers(); minus infinity: none.
struct CoveringDepths {
  PixelDepths nearest;
  /// The nearest one among the surfaces whose edges are not looked for, since lines tell what they
  /// cover, or their splats are larger than the pixel filter.
  PixelDepths alone;
};

/// The depths behind which splats are not drawn: TileABuffer::hidden_behind() of the pixel's patch,
/// and surfaces whose edges are not looked for; infinity outside of the picture.
PixelDepths hidden_in_patches(const TileABuffer& tile, const CoveringDepths& covering);
PixelDepths find_hidden(const TileABuffer& tile);

/// Drops the fragments of a tile that are not seen: behind hidden_in_patches(), as it depends on
/// how splats come how many of these have been drawn, and behind what goes on around the pixel.
void drop_hidden(TileABuffer& tile);

/// Adds splats to a tile's A-buffer (SS01 sections 4 and 6): evaluates rho where beta < cutoff, and
/// for every pixel accumulates it to the fragment of its surface (the same side faces the eye,
/// depths agree within epsilon) or separates it. Contributions that find_hidden() says are not seen
/// are skipped. SIMD over a tile's rows, chosen at run time; exp() is a
/// polynomial of relative error below 3e-6.
void rasterize_tile(const TileJob& job, TileABuffer& tile);

}  // namespace surfel
