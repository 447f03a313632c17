#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06), sections
// 4.2.1 and 4.2.2: the layers of a tile's pixels, told by the splats of all groups together.

#include <array>
#include <cstddef>

#include <surfel/base/types.h>
#include <surfel/render/splat.h>

namespace surfel {

/// Layers of the pixels of a tile, and of each of them a fragment of every group. In each pixel the
/// layers are in the order in which they were found; where a pixel has fewer than others of its
/// patch, its last ones are free.
class JointLayers {
 public:
  /// Planes of kPatchPixels floats: of a layer, and for each group two more from kFirstGroup on.
  enum Channel : int {
    kLayerSum,    ///< Sum of rho of the layer's fragments.
    kLayerDepth,  ///< Sum of rho * depth; after end(): the mean depth.
    kLayerSide,   ///< 0: free; else kBackSide or kFrontSide.
    kFirstGroup,
    kMemberKey = 0,  ///< Of a group: sqrt(beta / cutoff) of its fragment, plus kAddedKey if the
                     ///< splat was added to close holes; kNoKey without a fragment.
    kMemberEntry =
        1  ///< Of a group: index of the splat plus 1, and kAddedEntry, as bits; 0 without one.
  };
  static constexpr float kBackSide = 1, kFrontSide = 2;
  static constexpr float kAddedKey = 1, kNoKey = 4;
  static constexpr std::uint32_t kAddedEntry = std::uint32_t{1} << 31;

  static constexpr int group_channel(int group) { return kFirstGroup + 2 * group; }
  static float side(std::uint32_t tag) { return (tag & kFrontTag) != 0 ? kFrontSide : kBackSide; }

  /// Begins a tile without layers. Keeps its memory.
  void reset(int groups) {
    groups_ = groups;
    counts_.fill(0);
  }
  int groups() const { return groups_; }
  /// The number of layers in the patch of a pixel.
  int count(std::size_t pixel) const { return counts_[pixel / kPatchPixels]; }
  /// A pixel's first channel in a layer; layers follow at distances of stride(). Valid until the
  /// next add().
  float* at(int layer, std::size_t pixel) {
    return data_.data() + static_cast<std::size_t>(layer) * stride() +
           pixel / kPatchPixels * patch_stride() + pixel % kPatchPixels;
  }
  std::size_t stride() const { return patch_stride() * (kTilePixels / kPatchPixels); }
  /// Adds a free layer to the patch of a pixel.
  void add(std::size_t pixel);

 private:
  std::size_t patch_stride() const {
    return static_cast<std::size_t>(group_channel(groups_)) * kPatchPixels;
  }

  int groups_ = 0;
  std::array<int, kTilePixels / kPatchPixels> counts_{};
  Array<float> data_;  ///< By layer and patch.
};

}  // namespace surfel
