#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/scene/gaussian_mass.h>

namespace surfel {
namespace {

/// Carlson's symmetric elliptic integrals of the first and of the second kind (Carlson 1995,
/// "Numerical computation of real or complex elliptic integrals"), by duplication.
struct Carlson {
  double first;   ///< R_F(x, y, z).
  double second;  ///< R_D(x, y, z).
};

/// \param x, y  >= 0, at most one of them 0.
/// \param z     > 0.
Carlson carlson(double x, double y, double z) {
  double sum = 0;
  double power = 1;
  constexpr int kMostSteps = 64;
  constexpr double kClose = 1e-3;  // The series' next term is the sixth power.
  for (int k = 0; k < kMostSteps; ++k) {
    const double spread = std::max({x, y, z}) - std::min({x, y, z});
    if (spread <= kClose * z) break;
    const double root_x = std::sqrt(x);
    const double root_y = std::sqrt(y);
    const double root_z = std::sqrt(z);
    const double step = root_x * root_y + root_x * root_z + root_y * root_z;
    sum += power / (root_z * (z + step));
    power /= 4;
    x = (x + step) / 4;
    y = (y + step) / 4;
    z = (z + step) / 4;
  }
  Carlson out{};
  {
    const double mean = (x + y + z) / 3;
    const double a = 1 - x / mean;
    const double b = 1 - y / mean;
    const double c = -a - b;
    const double e2 = a * b - c * c;
    const double e3 = a * b * c;
    out.first = (1 - e2 / 10 + e3 / 14 + e2 * e2 / 24) / std::sqrt(mean);
  }
  const double mean = (x + y + 3 * z) / 5;
  const double a = 1 - x / mean;
  const double b = 1 - y / mean;
  const double c = -(a + b) / 3;
  const double e2 = a * b - 6 * c * c;
  const double e3 = (3 * a * b - 8 * c * c) * c;
  out.second =
      3 * sum + power / (mean * std::sqrt(mean)) * (1 - 3 * e2 / 14 + e3 / 6 + 9 * e2 * e2 / 88);
  return out;
}

}  // namespace

double mean_projection(const Vec3d& scale) {
  const double largest = scale.maxCoeff();
  if (!(largest > 0)) return 0;
  const Vec3d s = scale / largest;
  // Squares of the areas of the ellipses along the axes, without pi, ascending.
  double area2[] = {portable::squared(s[0] * s[1]), portable::squared(s[0] * s[2]),
                    portable::squared(s[1] * s[2])};
  std::sort(std::begin(area2), std::end(area2));
  const auto [x, y, z] = area2;
  double mean = std::sqrt(z) / 2;
  // Of a disc, two are 0; with a second one so small the integrals' logarithms tell nothing.
  constexpr double kFlat = 1e-24;
  if (y > kFlat * z) {
    const Carlson r = carlson(x, y, z);
    mean = (z * r.first - (x - z) * (y - z) * r.second / 3 + std::sqrt(x * y / z)) / 2;
  }
  return 2 * std::numbers::pi * portable::squared(largest) * mean;
}

double dilogarithm(double x) {
  if (x > 0.5) {
    // Euler's reflection formula: the series converges slowly near 1.
    const double sum = std::numbers::pi * std::numbers::pi / 6;
    return sum - portable::log(x) * portable::log(1 - x) - dilogarithm(1 - x);
  }
  double sum = 0;
  double power = x;
  for (int k = 1; power > 1e-17; ++k, power *= x) sum += power / (k * k);
  return sum;
}

double opacity_of_dilogarithm(double value, double most) {
  if (dilogarithm(most) <= value) return most;
  double low = 0;
  double high = most;
  constexpr int kSteps = 40;  // The last one moves by 1e-12.
  for (int k = 0; k < kSteps; ++k) {
    const double middle = (low + high) / 2;
    (dilogarithm(middle) < value ? low : high) = middle;
  }
  return (low + high) / 2;
}

}  // namespace surfel
