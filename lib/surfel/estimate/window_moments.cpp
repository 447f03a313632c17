#include <surfel/estimate/window_moments.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/estimate/window_moments.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// A lane is a point, so that no sum depends on the width of the vectors.
template <bool kInImage>
HWY_INLINE void sum_window(std::size_t count, const SharedWindow& window,
                           const WindowPoints& points, WindowMoments& out) {
  const hn::CappedTag<double, 8> d;
  const auto zero = hn::Zero(d);
  const auto one = hn::Set(d, 1.0);
  for (std::size_t at = 0; at < count; at += hn::Lanes(d)) {
    const auto px = hn::Load(d, points.x + at);
    const auto py = hn::Load(d, points.y + at);
    const auto pz = hn::Load(d, points.z + at);
    const auto reach2 = hn::Load(d, points.reach2 + at);
    const auto slack = hn::Load(d, points.slack + at);
    const auto nx = hn::Load(d, points.normal_x + at);
    const auto ny = hn::Load(d, points.normal_y + at);
    const auto nz = hn::Load(d, points.normal_z + at);
    const auto offset = hn::Load(d, points.offset + at);
    const auto inverse_scale = hn::Load(d, points.inverse_scale + at);
    auto sum = zero, sum_x = zero, sum_y = zero, sum_z = zero;
    auto sum_xx = zero, sum_xy = zero, sum_xz = zero;
    auto sum_yy = zero, sum_yz = zero, sum_zz = zero;
    for (std::size_t k = 0; k < window.size(); ++k) {
      const auto x = hn::Set(d, window.x[k]);
      const auto y = hn::Set(d, window.y[k]);
      const auto z = hn::Set(d, window.z[k]);
      const auto dx = hn::Sub(x, px);
      const auto dy = hn::Sub(y, py);
      auto distance2 = mul_add(dx, dx, hn::Mul(dy, dy));
      auto off = hn::Abs(mul_add(nx, x, mul_add(ny, y, mul_sub(nz, z, offset))));
      if constexpr (kInImage) {
        off = hn::Max(zero, neg_mul_add(slack, hn::Sqrt(distance2), off));
      }
      const auto e = hn::Mul(off, inverse_scale);
      const auto inside = hn::Max(zero, neg_mul_add(e, e, one));
      auto weight = hn::Mul(inside, inside);
      if constexpr (!kInImage) {
        const auto dz = hn::Sub(z, pz);
        distance2 = mul_add(dz, dz, distance2);
        weight = hn::IfThenElseZero(hn::Le(distance2, reach2), weight);
      }
      const auto wx = hn::Mul(weight, x);
      const auto wy = hn::Mul(weight, y);
      const auto wz = hn::Mul(weight, z);
      sum = hn::Add(sum, weight);
      sum_x = hn::Add(sum_x, wx);
      sum_y = hn::Add(sum_y, wy);
      sum_z = hn::Add(sum_z, wz);
      sum_xx = mul_add(wx, x, sum_xx);
      sum_xy = mul_add(wx, y, sum_xy);
      sum_xz = mul_add(wx, z, sum_xz);
      sum_yy = mul_add(wy, y, sum_yy);
      sum_yz = mul_add(wy, z, sum_yz);
      sum_zz = mul_add(wz, z, sum_zz);
    }
    hn::Store(sum, d, out.n + at);
    hn::Store(sum_x, d, out.x + at);
    hn::Store(sum_y, d, out.y + at);
    hn::Store(sum_z, d, out.z + at);
    hn::Store(sum_xx, d, out.xx + at);
    hn::Store(sum_xy, d, out.xy + at);
    hn::Store(sum_xz, d, out.xz + at);
    hn::Store(sum_yy, d, out.yy + at);
    hn::Store(sum_yz, d, out.yz + at);
    hn::Store(sum_zz, d, out.zz + at);
  }
}

}  // namespace

void sum_space(std::size_t count, const SharedWindow& window, const WindowPoints& points,
               WindowMoments& out) {
  sum_window<false>(count, window, points, out);
}

void sum_image(std::size_t count, const SharedWindow& window, const WindowPoints& points,
               WindowMoments& out) {
  sum_window<true>(count, window, points, out);
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(sum_space);
HWY_EXPORT(sum_image);

}  // namespace

void sum_in_space(std::size_t count, const SharedWindow& window, const WindowPoints& points,
                  WindowMoments& out) {
  HWY_DYNAMIC_DISPATCH(sum_space)(count, window, points, out);
}

void sum_in_image(std::size_t count, const SharedWindow& window, const WindowPoints& points,
                  WindowMoments& out) {
  HWY_DYNAMIC_DISPATCH(sum_image)(count, window, points, out);
}

}  // namespace surfel
#endif
