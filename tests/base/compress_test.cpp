#include <algorithm>
#include <cstdint>
#include <string>

#include <gtest/gtest.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/compress_test.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

/// What is wrong with the lanes of every mask; empty if nothing is.
std::string wrong_masks() {
  const hn::CappedTag<float, 16> d;
  const hn::RebindToUnsigned<decltype(d)> du;
  const std::size_t lanes = hn::Lanes(d);
  float value[16], chosen[16], moved[16];
  std::uint32_t number[16];
  for (std::uint32_t bits = 0; bits < 1U << lanes; ++bits) {
    std::uint32_t expected[16];
    std::size_t count = 0;
    for (std::uint32_t i = 0; i < lanes; ++i) {
      chosen[i] = static_cast<float>(bits >> i & 1);
      value[i] = static_cast<float>(100 + i);
      if (chosen[i] != 0) expected[count++] = 100 + i;
    }
    const auto mask = hn::Gt(hn::LoadU(d, chosen), hn::Zero(d));
    const Compressor<decltype(d)> compressor(mask);
    const auto v = hn::LoadU(d, value);
    compressor.store(v, d, moved);
    compressor.store(hn::BitCast(du, hn::ConvertTo(hn::RebindToSigned<decltype(d)>(), v)), du,
                     number);
    if (compressor.count() != count || !std::equal(expected, expected + count, moved) ||
        !std::equal(expected, expected + count, number)) {
      return std::string(hwy::TargetName(HWY_TARGET)) + ", mask " + std::to_string(bits);
    }
  }
  return {};
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(wrong_masks);

TEST(Compressor, MovesTheLanesOfEveryMaskToTheFront) {
  for (const std::int64_t target : {HWY_STATIC_TARGET, HWY_AVX2, HWY_AVX3}) {
    if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
    hwy::SetSupportedTargetsForTest(target);
    EXPECT_EQ(HWY_DYNAMIC_DISPATCH(wrong_masks)(), "");
    hwy::SetSupportedTargetsForTest(0);
  }
}

}  // namespace
}  // namespace surfel
#endif
