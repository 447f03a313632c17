#include <algorithm>
#include <array>
#include <bit>
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

/// Keys of depths: 0 is the largest, `most_key` the least. Writes whole vectors.
void make_depth_keys_simd(const float* depths, std::size_t count, float most_key,
                          std::uint32_t* keys) {
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
  const auto last = hn::Set(d, most_key);
  // Not 0, nor so little that the scale is infinite.
  const float range = std::max(hi - lo, 1e-30F);
  const auto scale = hn::Set(d, most_key / range);
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

namespace {

constexpr int kKeyBits = 11;  ///< A histogram of 2^11 counts stays in the first-level cache.
constexpr std::size_t kMostSteps = std::size_t{1} << kKeyBits;

/// A stable pass of counting: calls put(place, i) for the i of [0, count) with their places by
/// key_of(i) < steps <= kMostSteps.
template <class KeyOf, class Put>
void sort_by_counting(std::size_t count, std::size_t steps, const KeyOf& key_of, const Put& put) {
  std::array<std::uint32_t, kMostSteps> places;
  std::fill_n(places.begin(), steps, 0U);
  for (std::size_t i = 0; i < count; ++i) ++places[key_of(i)];
  std::uint32_t sum = 0;
  for (std::size_t step = 0; step < steps; ++step) sum += std::exchange(places[step], sum);
  for (std::size_t i = 0; i < count; ++i) put(places[key_of(i)]++, static_cast<std::uint32_t>(i));
}

}  // namespace

void sort_front_to_back(const float* depths, const std::uint32_t* splats, std::size_t count,
                        DepthOrder how, DepthSortScratch& scratch, std::uint32_t* order) {
  // Fewer steps save no time, as counting takes one pass in any case.
  constexpr std::size_t kLeastSteps = 512;
  if (count == 0) return;
  const bool fine = how == DepthOrder::kFine;
  const auto room = [&](Array<std::uint32_t>& array) {
    if (array.size() < count + kTileSize) array.resize(2 * count + kTileSize);
    return array.data();
  };
  std::uint32_t* const keys = room(scratch.keys);
  const std::size_t steps =
      fine ? kMostSteps * kMostSteps : std::clamp(std::bit_ceil(count), kLeastSteps, kMostSteps);
  HWY_DYNAMIC_DISPATCH(make_depth_keys_simd)(depths, count, static_cast<float>(steps - 1), keys);
  if (!fine) {
    sort_by_counting(
        count, steps, [&](std::size_t i) { return keys[i]; },
        [&](std::uint32_t place, std::uint32_t i) { order[place] = splats[i]; });
    return;
  }
  std::uint32_t* const by_low_bits = room(scratch.by_low_bits);
  sort_by_counting(
      count, kMostSteps, [&](std::size_t i) { return keys[i] & (kMostSteps - 1); },
      [&](std::uint32_t place, std::uint32_t i) { by_low_bits[place] = i; });
  sort_by_counting(
      count, kMostSteps, [&](std::size_t i) { return keys[by_low_bits[i]] >> kKeyBits; },
      [&](std::uint32_t place, std::uint32_t i) { order[place] = splats[by_low_bits[i]]; });
}

}  // namespace surfel
#endif
