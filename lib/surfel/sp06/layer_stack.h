#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06), sections
// 3.3, 4.2.1 and 5.2: the layers of a tile's pixels, which one of two rules tells (joint_layers.h,
// group_layers.h) and layer_blend.h blends.

#include <array>
#include <cstdint>
#include <vector>

#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/tile_fragments.h>

namespace surfel {

/// A layer in a pixel.
struct PixelLayer {
  std::uint32_t side;         ///< kFrontTag or 0.
  float depth;                ///< Sum of rho * depth while tell_joint_layers() tells layers.
  float sum = 0;              ///< Sum of rho; group layers have none.
  float place = 0;            ///< Layers are blended in ascending order of it.
  float share = 1;            ///< The share of each sample that the layer covers ...
  std::uint32_t samples = 1;  ///< ... and the samples that it covers any of, as bits.
};

/// The fragment that stands for a layer in the image of a group.
struct GroupMember {
  std::uint32_t layer;  ///< Index into LayerStack::layers.
  std::uint32_t splat;  ///< Index into TileJob::splats.
  std::uint16_t group;
  bool added;  ///< The splat is one of LayerSplats::added.
  float key;   ///< sqrt(beta / cutoff).
};

/// The layers of a pixel.
struct LayerStack {
  std::vector<PixelLayer> layers;
  std::vector<GroupMember> members;

  /// A group's fragment in a layer; null: it has none.
  GroupMember* find(std::uint32_t layer, std::uint16_t group) {
    for (GroupMember& member : members) {
      if (member.layer == layer && member.group == group) return &member;
    }
    return nullptr;
  }
  /// Adds a layer and returns its index.
  std::uint32_t add(const PixelLayer& layer) {
    layers.push_back(layer);
    return static_cast<std::uint32_t>(layers.size() - 1);
  }
};
using LayerStacks = std::array<LayerStack, kTilePixels>;

/// The splats of a tile.
struct LayerSplats {
  const TileJob* discs = nullptr;
  /// Discs that close holes of their groups: copies of discs, and discs with enlarged radii. Null
  /// where there are none, or where `discs` has them.
  const TileJob* added = nullptr;

  const TileJob& job(const GroupMember& member) const { return member.added ? *added : *discs; }
};

/// Whether a fragment lies behind the nearest layer of its pixel, which is hidden with all in front
/// of it.
/// \param masked  the nearest layers of all pixels; pixels without one are hidden whole. Null:
///     nothing is hidden.
inline bool is_seen(const NearestLayer* masked, const SplatFragment& f, std::uint32_t side) {
  if (!masked) return true;
  const NearestLayer& near = masked[f.pixel];
  return f.depth < near.depth && (near.front != (side != 0) || f.reach() < near.depth);
}

}  // namespace surfel
