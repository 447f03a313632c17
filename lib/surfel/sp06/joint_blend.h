#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): Algorithm 2,
// a tile at a time, with layers that all groups tell together.

#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/joint_layers.h>
#include <surfel/sp06/layer_parts.h>
#include <surfel/sp06/picture_layers.h>

namespace surfel {

/// The splats of a tile.
struct JointJobs {
  const TileJob* discs = nullptr;  ///< The surface: each disc once, with the picture's filter.
  /// Discs that close holes of their groups: copies of discs, and discs with enlarged radii. Null
  /// where there are none.
  const TileJob* added = nullptr;
};

/// Memory of one worker, kept from tile to tile.
struct JointScratch {
  JointLayers layers;
  HiddenLayers hidden;
  ShadedSplats shaded, shaded_added;
  std::vector<std::uint8_t> holes;  ///< Groups that lack a fragment in a vector of pixels.
  Array<float> left;                ///< Depths of a vector's layers that are still to be blended.
  Array<float> images;              ///< A vector of pixels of every group's image.
  TileGroups groups;
  std::vector<Fragment> merged;  ///< By pixel: its layers; of pixels at_border() still to come.
};

/// Blends layers back to front into an image for each group, and merges the images into
/// scratch.merged.
///
/// SP06 tells the layers of each group by that group's fragments alone. Enlarged and added discs
/// leave a bent surface, and what they show there would be further layers, which are worse than the
/// holes that they close. Here the discs of all groups, none enlarged, are the surface: they alone
/// make layers, in the way in which the A-buffer makes its fragments (SS01 section 6), and the
/// layers lie where all of them together are. Of each group the fragment nearest to its disc's
/// centre stands for a layer. Where a group has none, its nearest added disc fills the place, if
/// it lies within its epsilon of the layer.
///
/// A layer covers its pixel as far as its kernels add up to tau, so that rims are antialiased.
///
/// \param masked  the nearest layer of every pixel: it is culled with all fragments in front of it;
///     pixels without one are culled whole. Null: nothing is culled.
/// \param tile  the tile's place in the picture, its weights and its shader.
/// \return fragments culled as of a layer that their group has already.
std::uint64_t blend_joint_layers(const JointJobs& jobs, PictureLayers& picture,
                                 const NearestLayer* masked, const TileABuffer& tile,
                                 JointScratch& scratch);

}  // namespace surfel
