#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): sections
// 3.3, 4.2.1 and 5.2, a tile at a time.

#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/layer_parts.h>
#include <surfel/sp06/layer_rule.h>
#include <surfel/sp06/picture_layers.h>

namespace surfel {

/// How far beyond a kernel's rim its disc may cover a part of a pixel, pixels.
inline constexpr double kLayerMargin = 0.5;

/// The images of a tile's groups, of several samples a pixel. Their patches have memory from the
/// first fragment on that they get.
class LayerImages {
 public:
  /// Places of a pixel where discs are sampled. With four the rims of four groups have the steps of
  /// 16 samples, as each group has another pattern.
  static constexpr int kSamples = 4;

  /// Planes of kPatchPixels floats. The first ones exist for the back and for the front side.
  /// A side's pending layer is its most recent one: it is blended when the next layer begins, and
  /// until then a fragment nearer to its splat's centre may take its place.
  enum Channel : int {
    kPendingDepth = 0,     ///< Depth of the pending layer.
    kKey = 2,              ///< Its sqrt(beta / cutoff).
    kEntry = 4,            ///< Its splat's index plus 1, as bits; 0: no layer is pending.
    kPendingSamples = 6,   ///< The samples that it covers, as bits.
    kBlended = 8,          ///< Depth of the layer before.
    kBlendedSamples = 10,  ///< The samples that the layer before covers; 0: there is none.
    kLayers = 12,          ///< Sum of the layers' shares of the pixel.
    kTouched = 13,         ///< The samples that some layer covers.
    kColors = 14,          ///< R G B A of each sample.
    kChannels = kColors + 4 * kSamples
  };

  /// Makes empty images for each of `groups` groups. Keeps its memory.
  void reset(int groups);
  int groups() const { return groups_; }
  /// Whether a group has fragments in the patch of a pixel.
  bool used(int group, std::size_t pixel) const { return used_[place(group, pixel)] != 0; }
  /// A pixel's first channel. The patch must be used.
  float* at(int group, std::size_t pixel) {
    return data_.data() + place(group, pixel) * kChannels * kPatchPixels + pixel % kPatchPixels;
  }
  /// A pixel's first channel; empties the patch if it is not used.
  float* use(int group, std::size_t pixel);

 private:
  std::size_t place(int group, std::size_t pixel) const {
    return pixel / kPatchPixels * static_cast<std::size_t>(groups_) +
           static_cast<std::size_t>(group);
  }

  int groups_ = 0;
  Array<float> data_;
  std::vector<std::uint8_t> used_;  ///< By patch and group.
};

/// Memory of one worker, kept from tile to tile.
struct LayerScratch {
  LayerImages images;
  HiddenLayers hidden;
  ShadedSplats shaded;
  TileGroups groups;
  std::vector<Fragment> merged;      ///< By pixel: its layers; of pixels at_border() still to come.
  std::vector<float> counts;         ///< Layers of a pixel by groups.
  std::vector<std::uint32_t> order;  ///< Splats of the tile, farthest first.
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
/// Edges: SP06's discs have none. Here a layer covers each of a pixel's samples that some disc of
/// the layer covers (Carpenter, "The A-buffer, an Antialiased Hidden Surface Method", 1984), and is
/// shaded once: discs that meet leave no seam, and what a surface hides of another is right where
/// both end. Splats need boxes with kLayerMargin around them.
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
