#include <surfel/estimate/dipole_energies.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/estimate/dipole_energies.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// A lane is a dipole, so that no energy depends on the width of the vectors.
void dipole_energies(std::size_t i, std::size_t first, std::size_t end, bool whole,
                     DipoleColumns& dipoles) {
  const hn::CappedTag<float, 16> d;
  constexpr float kFine = kDipoleBlur * kDipoleBlur;
  constexpr float kCoarse = 4 * kFine;
  const auto x = hn::Set(d, dipoles.x[i]);
  const auto y = hn::Set(d, dipoles.y[i]);
  const auto z = hn::Set(d, dipoles.z[i]);
  const auto p = hn::Set(d, dipoles.p[i]);
  const auto q = hn::Set(d, dipoles.q[i]);
  const auto r = hn::Set(d, dipoles.r[i]);
  for (std::size_t k = first; k < end; k += hn::Lanes(d)) {
    const auto dx = hn::Sub(hn::LoadU(d, dipoles.x.data() + k), x);
    const auto dy = hn::Sub(hn::LoadU(d, dipoles.y.data() + k), y);
    const auto dz = hn::Sub(hn::LoadU(d, dipoles.z.data() + k), z);
    const auto other_p = hn::LoadU(d, dipoles.p.data() + k);
    const auto other_q = hn::LoadU(d, dipoles.q.data() + k);
    const auto other_r = hn::LoadU(d, dipoles.r.data() + k);
    const auto distance2 = mul_add(dx, dx, mul_add(dy, dy, hn::Mul(dz, dz)));
    const auto product = mul_add(p, other_p, mul_add(q, other_q, hn::Mul(r, other_r)));
    const auto along = mul_add(dx, p, mul_add(dy, q, hn::Mul(dz, r)));
    const auto other_along = mul_add(dx, other_p, mul_add(dy, other_q, hn::Mul(dz, other_r)));
    const auto both_along = hn::Mul(hn::Set(d, 3.0F), hn::Mul(along, other_along));
    // R^-5 ((2 eps^2 - d^2) p . q + 3 (d . p) (d . q))
    const auto energy = [&](float eps2) HWY_ATTR {
      const auto inverse2 = hn::Div(hn::Set(d, 1.0F), hn::Add(distance2, hn::Set(d, eps2)));
      const auto inverse5 = hn::Mul(hn::Mul(inverse2, inverse2), hn::Sqrt(inverse2));
      const auto across = hn::Sub(hn::Set(d, 2 * eps2), distance2);
      return hn::Mul(inverse5, mul_add(across, product, both_along));
    };
    auto sum = energy(kFine);
    if (!whole) sum = hn::Sub(sum, energy(kCoarse));
    hn::StoreU(sum, d, dipoles.energy.data() + k);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(dipole_energies);

void dipole_energies(std::size_t i, std::size_t first, std::size_t end, bool whole,
                     DipoleColumns& dipoles) {
  HWY_DYNAMIC_DISPATCH(dipole_energies)(i, first, end, whole, dipoles);
}

}  // namespace surfel
#endif
