#include <surfel/render/patch_sample.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/patch_sample.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/render/kernel_raster-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

void sample_patch_simd(const TileJob& job, std::uint32_t splat, const PatchPlace& place,
                       PatchSample& out) {
  const D d;
  const SplatSampler sampler(job, place.x0, place.y0);
  for (std::size_t lane = 0; lane < kPatchPixels; lane += hn::Lanes(d)) {
    const auto pixel = static_cast<int>(place.pixel + lane);
    const auto center = [](int corner, int at, float offset) {
      return static_cast<float>(corner) + 0.5F + static_cast<float>(at) + offset;
    };
    const V x = hn::Add(hn::Load(d, kColumnOfLane),
                        hn::Set(d, center(place.x0, tile_pixel_x(pixel), place.right)));
    const V y = hn::Add(hn::Load(d, kRowOfLane),
                        hn::Set(d, center(place.y0, tile_pixel_y(pixel), place.down)));
    const Sample s = sampler.at(splat, x, y);
    hn::Store(s.beta, d, out.beta + lane);
    hn::Store(s.depth, d, out.depth + lane);
    hn::Store(s.epsilon, d, out.epsilon + lane);
    hn::Store(hn::Mul(s.amplitude, sampler.decay(s.beta)), d, out.rho + lane);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(sample_patch_simd);

void sample_patch(const TileJob& job, std::uint32_t splat, const PatchPlace& place,
                  PatchSample& out) {
  HWY_DYNAMIC_DISPATCH(sample_patch_simd)(job, splat, place, out);
}

}  // namespace surfel
#endif
