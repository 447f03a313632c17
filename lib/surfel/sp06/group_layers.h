#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06), sections 3.3
// and 4.2.1, with layers that each group tells by itself.

#include <cstdint>

#include <surfel/sp06/layer_rule.h>
#include <surfel/sp06/layer_stack.h>

namespace surfel {

/// How far beyond a kernel's rim its disc may cover a part of a pixel, pixels.
inline constexpr double kLayerMargin = 0.5;

/// Places of a pixel where discs are sampled. With four the rims of four groups have the steps of
/// 16 samples, as each group has another pattern.
inline constexpr int kLayerSamples = 4;

/// Tells the layers of a tile's pixels, of each group by its splats alone, whose discs have the
/// enlarged radii.
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
/// \param masked  see is_seen().
/// \param stacks  are empty.
/// \return fragments culled as of a layer that is there already.
std::uint64_t tell_group_layers(const TileJob& job, const LayerRule& rule, int groups,
                                const NearestLayer* masked, const TileABuffer& tile,
                                LayerStacks& stacks);

}  // namespace surfel
