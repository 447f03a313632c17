#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): Algorithm 2,
// sections 3.3 and 5.2, a tile at a time.

#include <array>
#include <cstdint>
#include <vector>

#include <surfel/render/a_buffer.h>
#include <surfel/sp06/layer_rule.h>
#include <surfel/sp06/layer_stack.h>
#include <surfel/sp06/picture_layers.h>

namespace surfel {

/// Colours of splats that reflect an environment.
struct ShadedSplats {
  std::vector<Rgba> colors;          ///< By the splats' indices ...
  std::vector<std::uint64_t> loads;  ///< ... and the TileJob::load of each.

  /// Makes room for the job's splats.
  void reserve(const TileJob& job);
};

/// Memory of one worker, kept from tile to tile.
struct LayerScratch {
  LayerStacks stacks;
  ShadedSplats shaded, shaded_added;
  /// The groups that have a layer, by pixel.
  std::array<std::vector<PictureLayers::GroupPixel>, kTilePixels> groups;
  std::vector<Fragment> merged;  ///< By pixel: its layers; of pixels at_border() still to come.
};

/// Blends layers back to front into an image for each group, and merges the images into
/// scratch.merged. The layers are told by tell_joint_layers() or tell_group_layers().
/// \param rule  The rule by which each group tells its layers; null: all tell them together.
/// \param masked  the nearest layer of every pixel: it is culled with all fragments in front of it;
///     pixels without one are culled whole. Null: nothing is culled.
/// \param tile  the tile's place in the picture, its weights and its shader.
/// \return fragments culled as of a layer that their group has already.
std::uint64_t blend_layers(const LayerSplats& splats, const LayerRule* rule, PictureLayers& picture,
                           const NearestLayer* masked, const TileABuffer& tile,
                           LayerScratch& scratch);

}  // namespace surfel
