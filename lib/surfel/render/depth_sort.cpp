#include <algorithm>
#include <array>
#include <utility>

#include <surfel/render/depth_sort.h>
#include <surfel/render/splat.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/depth_sort.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Keys of depths: 0 is the largest, 65535 the least. Writes whole vectors.
void make_depth_keys_simd(const float* depths, std::size_t count, std::uint32_t* keys) {
  const hn::CappedTag<float, kTileSize> d;
  const hn::RebindToUnsigned<decltype(d)> du;
  const hn::RebindToSigned<decltype(d)> di;
  const std::size_t lanes = hn::Lanes(d);
  auto least = hn::Set(d, depths[0]);
  auto most = least;
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto depth = hn::LoadU(d, depths + i);
    least = hn::Min(least, depth);
    most = hn::Max(most, depth);
  }
  float lo = hn::GetLane(hn::MinOfLanes(d, least));
  float hi = hn::GetLane(hn::MaxOfLanes(d, most));
  for (; i < count; ++i) {
    lo = std::min(lo, depths[i]);
    hi = std::max(hi, depths[i]);
  }
  const auto nearest = hn::Set(d, hi);
  const auto last = hn::Set(d, 65535.0F);
  const auto scale = hn::Set(d, hi > lo ? 65535.0F / (hi - lo) : 0.0F);
  for (i = 0; i < count; i += lanes) {
    const auto place = hn::Mul(hn::Sub(nearest, hn::LoadU(d, depths + i)), scale);
    hn::StoreU(hn::BitCast(du, hn::ConvertTo(di, hn::Min(place, last))), du, keys + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(make_depth_keys_simd);

void sort_front_to_back(const float* depths, const std::uint32_t* splats, std::size_t count,
                        DepthSortScratch& scratch, std::uint32_t* order) {
  if (count == 0) return;
  if (scratch.keys.size() < count + kTileSize) {
    scratch.keys.resize(2 * count + kTileSize);
    scratch.by_low_byte.resize(2 * count + kTileSize);
  }
  std::uint32_t* const keys = scratch.keys.data();
  std::uint64_t* const by_low_byte = scratch.by_low_byte.data();
  HWY_DYNAMIC_DISPATCH(make_depth_keys_simd)(depths, count, keys);
  // Two stable passes of counting.
  std::array<std::uint32_t, 256> low{};
  std::array<std::uint32_t, 256> high{};
  for (std::size_t i = 0; i < count; ++i) {
    ++low[keys[i] & 255];
    ++high[keys[i] >> 8];
  }
  const auto to_starts = [](std::array<std::uint32_t, 256>& histogram) {
    std::uint32_t sum = 0;
    for (std::uint32_t& entry : histogram) sum += std::exchange(entry, sum);
  };
  to_starts(low);
  to_starts(high);
  for (std::size_t i = 0; i < count; ++i) {
    by_low_byte[low[keys[i] & 255]++] = std::uint64_t{splats[i]} << 8 | keys[i] >> 8;
  }
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t entry = by_low_byte[i];
    order[high[entry & 255]++] = static_cast<std::uint32_t>(entry >> 8);
  }
}

}  // namespace surfel
#endif
