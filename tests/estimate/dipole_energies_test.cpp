#include <cmath>
#include <cstddef>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/base/types.h>
#include <surfel/estimate/dipole_energies.h>

namespace surfel::test {
namespace {

/// R^-5 ((2 eps^2 - d^2) p . q + 3 (d . p) (d . q)), R^2 = d^2 + eps^2.
double energy(const Vec3d& d, const Vec3d& p, const Vec3d& q, double eps) {
  const double r2 = d.squaredNorm() + eps * eps;
  return ((2 * eps * eps - d.squaredNorm()) * p.dot(q) + 3 * d.dot(p) * d.dot(q)) /
         std::pow(r2, 2.5);
}

/// Whatever number of them fills a vector, from whichever on.
TEST(DipoleEnergies, AreTheFormulas) {
  constexpr std::size_t kCount = 53;
  constexpr std::size_t kOne = 2;
  DipoleColumns dipoles;
  dipoles.resize(kCount);
  std::uint64_t key = 0;
  for (auto* column : {&dipoles.x, &dipoles.y, &dipoles.z, &dipoles.p, &dipoles.q, &dipoles.r}) {
    for (std::size_t i = 0; i < kCount; ++i, ++key) {
      (*column)[i] = static_cast<float>(4 * random_uniform(7, key, 0) - 2);
    }
  }
  const auto place = [&](std::size_t i) { return Vec3d(dipoles.x[i], dipoles.y[i], dipoles.z[i]); };
  const auto moment = [&](std::size_t i) {
    return Vec3d(dipoles.p[i], dipoles.q[i], dipoles.r[i]);
  };
  for (const bool whole : {true, false}) {
    for (const std::size_t first : {kOne + 1, kOne + 6, kCount - 1}) {
      dipole_energies(kOne, first, kCount, whole, dipoles);
      for (std::size_t k = first; k < kCount; ++k) {
        const Vec3d d = place(k) - place(kOne);
        const double eps = static_cast<double>(kDipoleBlur);
        double expected = energy(d, moment(kOne), moment(k), eps);
        if (!whole) expected -= energy(d, moment(kOne), moment(k), 2 * eps);
        // Single precision of terms that cancel: products of moments are up to 12, R^-5 up to 6.
        EXPECT_NEAR(dipoles.energy[k], expected, 1e-4) << whole << ' ' << first << ' ' << k;
      }
    }
  }
}

}  // namespace
}  // namespace surfel::test
