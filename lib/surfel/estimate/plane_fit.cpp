#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cstdint>

#include <surfel/estimate/plane_fit.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/estimate/plane_fit.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/vec3-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<double, 8>;
using V = hn::Vec<D>;

using Vec3 = HWY_NAMESPACE::Vec3<V>;

/// Fits one vector of the batch. Returns, as bits, the lanes whose residual is too large.
HWY_INLINE std::uint32_t fit(std::size_t at, PlaneBatch& batch) {
  /// Four digits are right after the first few steps unless two eigenvalues nearly agree, and each
  /// further step doubles the digits.
  constexpr int kSteps = 6;
  constexpr double kLargestResidual = 1e-9;
  const D d;
  const V one = hn::Set(d, 1.0);
  const V half = hn::Set(d, 0.5);
  const V zero = hn::Zero(d);
  // Divided by the trace, so that the eigenvalues' sum is one.
  V xx = hn::Load(d, batch.xx + at);
  V yy = hn::Load(d, batch.yy + at);
  V zz = hn::Load(d, batch.zz + at);
  const V trace = hn::Add(xx, hn::Add(yy, zz));
  const V scale = hn::Div(one, trace);
  xx = hn::Mul(xx, scale);
  yy = hn::Mul(yy, scale);
  zz = hn::Mul(zz, scale);
  const V xy = hn::Mul(hn::Load(d, batch.xy + at), scale);
  const V xz = hn::Mul(hn::Load(d, batch.xz + at), scale);
  const V yz = hn::Mul(hn::Load(d, batch.yz + at), scale);

  // lambda^3 - lambda^2 + minors lambda - determinant = 0.
  const V minor_x = neg_mul_add(yz, yz, hn::Mul(yy, zz));
  const V minor_y = neg_mul_add(xz, xz, hn::Mul(xx, zz));
  const V minor_z = neg_mul_add(xy, xy, hn::Mul(xx, yy));
  const V minors = hn::Add(minor_x, hn::Add(minor_y, minor_z));
  const V determinant = mul_add(
      xx, minor_x,
      mul_add(xy, mul_sub(xz, yz, hn::Mul(xy, zz)), hn::Mul(xz, mul_sub(xy, yz, hn::Mul(xz, yy)))));
  V lowest = zero;
  for (int step = 0; step < kSteps; ++step) {
    const V value = mul_sub(mul_add(hn::Sub(lowest, one), lowest, minors), lowest, determinant);
    const V slope = mul_add(mul_sub(hn::Set(d, 3.0), lowest, hn::Set(d, 2.0)), lowest, minors);
    lowest = hn::Sub(lowest, hn::Div(value, slope));
  }

  const Vec3 row_x{hn::Sub(xx, lowest), xy, xz};
  const Vec3 row_y{xy, hn::Sub(yy, lowest), yz};
  const Vec3 row_z{xz, yz, hn::Sub(zz, lowest)};
  Vec3 n = cross(row_x, row_y);
  V length2 = dot(n, n);
  for (const Vec3& other : {cross(row_x, row_z), cross(row_y, row_z)}) {
    const V other2 = dot(other, other);
    const auto longer = hn::Gt(other2, length2);
    n = {hn::IfThenElse(longer, other.x, n.x), hn::IfThenElse(longer, other.y, n.y),
         hn::IfThenElse(longer, other.z, n.z)};
    length2 = hn::Max(length2, other2);
  }
  const V normalize = hn::Div(one, hn::Sqrt(length2));
  n = {hn::Mul(n.x, normalize), hn::Mul(n.y, normalize), hn::Mul(n.z, normalize)};

  // The Rayleigh quotient has twice as many digits as the vector.
  const Vec3 image{dot({xx, xy, xz}, n), dot({xy, yy, yz}, n), dot({xz, yz, zz}, n)};
  lowest = dot(n, image);
  const Vec3 residual{neg_mul_add(lowest, n.x, image.x), neg_mul_add(lowest, n.y, image.y),
                      neg_mul_add(lowest, n.z, image.z)};
  // Sum and product of the two larger eigenvalues.
  const V sum = hn::Sub(one, lowest);
  const V product = neg_mul_add(lowest, sum, minors);
  const V mean = hn::Mul(half, sum);
  const V highest = hn::Add(mean, hn::Sqrt(hn::Max(zero, mul_sub(mean, mean, product))));
  const V middle = hn::Max(zero, hn::Div(product, highest));

  hn::Store(n.x, d, batch.normal[0] + at);
  hn::Store(n.y, d, batch.normal[1] + at);
  hn::Store(n.z, d, batch.normal[2] + at);
  hn::Store(hn::Mul(trace, hn::Max(zero, lowest)), d, batch.lambda[0] + at);
  hn::Store(hn::Mul(trace, middle), d, batch.lambda[1] + at);
  hn::Store(hn::Mul(trace, highest), d, batch.lambda[2] + at);

  const V allowed = hn::Mul(hn::Set(d, kLargestResidual), hn::Max(zero, hn::Sub(middle, lowest)));
  // Asked this way, NaN counts as too large.
  const auto good = hn::Le(dot(residual, residual), hn::Mul(allowed, allowed));
  std::uint8_t bits[8] = {};
  hn::StoreMaskBits(d, hn::Not(good), bits);
  return bits[0];
}

}  // namespace

std::uint32_t fit_all(PlaneBatch& batch) {
  std::uint32_t poor = 0;
  for (std::size_t i = 0; i < PlaneBatch::kSize; i += hn::Lanes(D())) poor |= fit(i, batch) << i;
  return poor;
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(fit_all);

}  // namespace

void fit_planes(std::size_t count, PlaneBatch& batch) {
  const std::uint32_t poor = HWY_DYNAMIC_DISPATCH(fit_all)(batch);
  for (std::size_t i = 0; i < count; ++i) {
    if ((poor >> i & 1) == 0) continue;
    Eigen::Matrix3d c;
    c << batch.xx[i], batch.xy[i], batch.xz[i], batch.xy[i], batch.yy[i], batch.yz[i], batch.xz[i],
        batch.yz[i], batch.zz[i];
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(c);
    for (int k = 0; k < 3; ++k) {
      batch.normal[k][i] = solver.eigenvectors()(k, 0);
      batch.lambda[k][i] = std::max(0.0, solver.eigenvalues()[k]);
    }
  }
}

}  // namespace surfel
#endif
