#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): Algorithm 2,
// a tile at a time, with layers that all groups tell together.

#include <cstdint>
#include <vector>

#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/joint_layers.h>
#include <surfel/sp06/picture_layers.h>

namespace surfel {

/// The discs of a tile.
struct JointJobs {
  const TileJob* discs = nullptr;     ///< The surface, with the pixel filter of the picture.
  const TileJob* enlarged = nullptr;  ///< Discs with the enlarged radii; null where there are none.
};

/// Memory of one worker, kept from tile to tile.
struct JointScratch {
  /// Last layer of a group's pixel, which is blended when the next layer comes, over the layers
  /// before.
  struct GroupImage {
    JointLayers::Member last;
    bool used = false;
    Rgba behind;
    float touched = 0;  ///< Share of the pixel that the layers before cover.
  };
  JointLayers layers;
  std::vector<DiscFragment> fragments;            ///< Of the tile, as they come.
  std::vector<std::uint16_t> pixels;              ///< Parallel to `fragments`.
  std::vector<DiscFragment> sorted;               ///< By pixel.
  std::vector<GroupImage> images;                 ///< Of the pixel at hand.
  std::vector<PictureLayers::GroupPixel> groups;  ///< Of all pixels, one pixel after the other.
  std::vector<Fragment> merged;  ///< By pixel: its layers; of pixels at_border() still to come.
};

/// Blends layers back to front into an image for each group, and merges the images into
/// scratch.merged. Every group has one fragment of each layer at most (JointLayers), and a layer
/// covers its pixel as far as its kernels add up to tau, as in the A-buffer, so that rims are
/// antialiased in the way in which depth peeling does it.
/// \param masked  the nearest layer of every pixel: it is culled with all fragments in front of it;
///     pixels without one are culled whole. Null: nothing is culled.
/// \param tile  the tile's place in the picture, its weights and its shader.
/// \return fragments culled as of a layer that their group has already.
std::uint64_t blend_joint_layers(const JointJobs& jobs, PictureLayers& picture,
                                 const NearestLayer* masked, const TileABuffer& tile,
                                 JointScratch& scratch);

}  // namespace surfel
