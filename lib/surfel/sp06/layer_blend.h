#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): sections
// 3.3, 4.2.1 and 5.2, a tile at a time.

#include <cstdint>
#include <limits>
#include <vector>

#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/layer_rule.h>
#include <surfel/sp06/picture_layers.h>

namespace surfel {

/// Memory of one worker, kept from tile to tile.
class LayerScratch {
 public:
  /// Most recent layer of one side of the surface in a group's pixel. It is blended when the next
  /// layer begins: until then a fragment nearer to its splat's centre may take its place.
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
  std::vector<State> states;     ///< Groups x kTilePixels.
  std::vector<Fragment> merged;  ///< By pixel: its layers; of pixels at_border() still to come.
  std::vector<PictureLayers::GroupPixel> groups;  ///< Groups with a layer in the pixel at hand.
  std::vector<int> counts;                        ///< Layers of a pixel by groups.
  std::vector<std::uint32_t> order;               ///< Splats of the tile, farthest first.
};

/// Hands the normals of a tile's interpolated surfaces to the picture, and filters them as far as
/// pixels are not at_border(). The A-buffer is unmerged and has normals.
void filter_surfaces(TileABuffer& tile, PictureLayers& picture);

/// SP06's Algorithm 2: blends splats, whose discs have the enlarged radii, back to front into an
/// image for each group, and merges the images into scratch.merged.
///
/// Fragment culling (6): of the fragments that lie in one layer, show the same side and belong to
/// one group, a single one is blended. SP06 takes the first to arrive; we take the one nearest to
/// its splat's centre as in rasterize_groups(), since software can put off blending until the
/// layer is over. Layers are told apart by `rule`: kQuantised by the steps of (6), kWindowed by
/// epsilon, and kOff blends every fragment.
///
/// Order: the splats of a tile are sorted by the depth of their centres (SP06 traverses a BSP-tree,
/// which yields the same order except for splats of different leaves, at a cost that sorting short
/// lists does not have; the sort is stable over an order that depends on the surfels alone). Where
/// fragments come in another order than their splats, one that lies behind its side's most recent
/// layer is blended beneath it.
///
/// \param masked the nearest layer of every pixel: it is culled with all fragments in front of it;
///     pixels without one are culled whole. Null: nothing is culled.
/// \param tile  the tile's place in the picture, and its shader.
/// \return fragments culled as of a layer that is there already.
std::uint64_t blend_layers(const TileJob& job, const LayerRule& rule, PictureLayers& picture,
                           const NearestLayer* masked, const TileABuffer& tile,
                           LayerScratch& scratch);

}  // namespace surfel
