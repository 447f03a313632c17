#include <algorithm>
#include <cstdint>
#include <limits>

#include <surfel/base/error.h>
#include <surfel/sp06/joint_layers.h>
namespace surfel {
namespace {

/// Places in a tile's layers fit 32 bits with a sign.
constexpr std::size_t kMostFloats = std::numeric_limits<std::int32_t>::max();

}  // namespace

void JointLayers::add(std::size_t pixel) {
  const int layer = counts_[pixel / kPatchPixels]++;
  const std::size_t needed = (static_cast<std::size_t>(layer) + 1) * stride();
  if (needed > kMostFloats) {
    throw Error(ErrorKind::kNumeric,
                "pixels have too many layers for so many groups; use `layers_by` group, or fewer "
                "groups");
  }
  if (data_.size() < needed) data_.resize(needed);
  float* const channels = at(layer, pixel) - pixel % kPatchPixels;
  std::fill_n(channels, patch_stride(), 0.0F);
  for (int group = 0; group < groups_; ++group) {
    std::fill_n(channels + (group_channel(group) + kMemberKey) * kPatchPixels, kPatchPixels,
                kNoKey);
  }
}

}  // namespace surfel
