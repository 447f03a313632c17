#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06), sections
// 4.2.1 and 4.2.2, with layers that all groups tell together.

#include <cstdint>

#include <surfel/sp06/layer_stack.h>

namespace surfel {

/// Tells the layers of a tile's pixels by the discs of all groups.
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
/// \param masked  see is_seen().
/// \param stacks  are empty.
/// \return fragments culled as of a layer that their group has already.
std::uint64_t tell_joint_layers(const LayerSplats& splats, const NearestLayer* masked,
                                const TileABuffer& tile, LayerStacks& stacks);

}  // namespace surfel
