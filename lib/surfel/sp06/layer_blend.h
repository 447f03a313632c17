#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): sections
// 3.3, 4.2.1 and 5.2, a tile at a time.

#include <cstdint>
#include <limits>
#include <vector>

#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/group_raster.h>

namespace surfel {

/// What the layers of a pixel come to: the mean of the groups' images.
struct BlendedPixel {
  Rgba color;          ///< Premultiplied.
  float layers = 0;    ///< Mean number of layers, alpha_total / alpha of SP06 section 5.2.3, of the
                       ///< groups but those with the fewest and the most.
  Fragment nearest{};  ///< Sums over the groups' nearest fragments, weighted by how
                       ///< near to their splats' centres they are.

  /// As a merged fragment: what it takes to see the environment through the layers.
  Fragment merged() const;
};

/// Memory of one worker, kept from tile to tile.
class LayerScratch {
 public:
  /// Most recent layer of one side of the surface in a group's pixel. It is blended when the next
  /// begins: until then a fragment nearer to its splat's centre may take its place.
  struct Pending {
    float depth;
    float key;  ///< sqrt(beta / cutoff).
    std::int64_t splat = -1;
    float blended = -std::numeric_limits<float>::infinity();  ///< Depth of the layer before.
    bool any_blended = false;
  };
  /// A pixel of a group's image.
  struct State {
    Pending side[2];
    Rgba color;
    int layers = 0;
  };
  std::vector<State> states;           ///< Groups x kTilePixels.
  std::vector<BlendedPixel> pixels;    ///< kTilePixels.
  std::vector<BlendedPixel> filtered;  ///< The same, while they are made.
  std::vector<Vec3f> normals;          ///< kTilePixels.
  std::vector<int> counts;             ///< Layers of a pixel by groups.
  std::vector<std::uint32_t> order;    ///< Splats of the tile, farthest first.
};

/// Algorithm 3's nearest layer, before it is shaded: the pixel filter for its normals, as far as
/// the tile reaches. Where groups are few their splats are cut, and the mean of the few that a
/// pixel has is not smooth enough to mirror or refract an environment. Where there is nothing in a
/// pixel next to it, or another surface, a pixel's own normal counts the more. The A-buffer is
/// unmerged and has normals.
void filter_normals(TileABuffer& tile, LayerScratch& scratch);

/// SP06's Algorithm 2: blends splats, whose discs have the enlarged radii, back to front into an
/// image for each group, and averages the images into scratch.pixels.
///
/// Fragment culling (6): of the fragments that lie in one layer, show the same side and belong to
/// one group, a single one is blended. SP06 takes the first to arrive; we take the one nearest to
/// its splat's centre as in rasterize_groups(), since software can put off blending until the
/// layer is over. Layers are told apart by `rule`: kQuantised by the steps of (6), kWindowed by
/// epsilon, and kOff blends every fragment.
///
/// Order: the splats of a tile are sorted by the depth of their centres (SP06 traverses a BSP-tree,
/// which yields the same order but for splats of different leaves, at a cost that sorting short
/// lists does not have; the sort is stable over an order that depends on the surfels alone). Where
/// fragments come in another order than their splats, one that lies behind its side's most recent
/// layer is blended beneath it.
///
/// \param masked  of every pixel its nearest layer, which is culled, with all in front of it: of
///     pixels without one everything is. Null: nothing is culled.
/// \param weights  the tile's place in the picture, and its shader.
/// \return fragments culled as of a layer that is there already.
std::uint64_t blend_layers(const TileJob& job, const LayerRule& rule, int groups,
                           const NearestLayer* masked, const TileABuffer& weights,
                           LayerScratch& scratch);

}  // namespace surfel
