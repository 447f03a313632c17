#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/texture/filtered_checker.h>

namespace surfel {
namespace {

using std::numbers::pi;

constexpr double kLargestCube = 0x1p52;   ///< Doubles beyond have no fractions left.
constexpr double kSeriesDeviation = 0.4;  ///< Narrowest kernel, in cubes, of the Fourier series.
constexpr double kLongestDeviation = 8;   ///< Of kernels that are cut into lines, in cubes.
constexpr double kLineReach = 4;          ///< Standard deviations; 6e-5 lies beyond.
constexpr int kLargestHarmonic = 63;      ///< Terms fall with the product of three harmonics.
constexpr double kLeastDamping = 12;      ///< exp(-12) = 6e-6.

double normal_distribution(double x) { return 0.5 * portable::erfc(-x * std::numbers::sqrt2 / 2); }

/// Turns the axes, which leaves their Gaussian as it is, until they are orthogonal, the longer one
/// first.
KernelAxes principal_axes(const KernelAxes& axes) {
  const double uu = axes.col(0).squaredNorm();
  const double vv = axes.col(1).squaredNorm();
  const double angle = 0.5 * portable::atan2(2 * axes.col(0).dot(axes.col(1)), uu - vv);
  KernelAxes turned;
  turned.col(0) = portable::cos(angle) * axes.col(0) + portable::sin(angle) * axes.col(1);
  turned.col(1) = -portable::sin(angle) * axes.col(0) + portable::cos(angle) * axes.col(1);
  return turned;
}

double checker_series(const Vec3d& point, const KernelAxes& axes) {
  // The axis along which the kernel's plane is steepest goes last: few of its harmonics survive.
  int last = 0;
  axes.rowwise().squaredNorm().maxCoeff(&last);
  const Vec2d g0 = axes.row((last + 1) % 3);
  const Vec2d g1 = axes.row((last + 2) % 3);
  const Vec2d g2 = axes.row(last);
  const double p0 = point[(last + 1) % 3], p1 = point[(last + 2) % 3], p2 = point[last];
  const double largest2 = 2 * kLeastDamping / (pi * pi);
  double sum = 0;
  for (int l = 1; l <= kLargestHarmonic; l += 2) {
    for (int m = -kLargestHarmonic; m <= kLargestHarmonic; m += 2) {
      const Vec2d base = l * g0 + m * g1;
      const double best = -base.dot(g2) / g2.squaredNorm();
      const double beside2 = (base + best * g2).squaredNorm();
      if (beside2 > largest2) continue;
      const double range = std::sqrt((largest2 - beside2) / g2.squaredNorm());
      // Odd numbers within [best - range, best + range].
      for (double n = 2 * std::ceil((best - range - 1) / 2) + 1; n <= best + range; n += 2) {
        const double damping = pi * pi / 2 * (base + n * g2).squaredNorm();
        sum +=
            portable::sin(pi * (l * p0 + m * p1 + n * p2)) * portable::exp(-damping) / (l * m * n);
      }
    }
  }
  return -16 / (pi * pi * pi) * sum;
}

/// Direction in the kernel's plane that is furthest from parallel to any of the families of lines.
Vec2d crossing_direction(const KernelAxes& axes) {
  int longest = 0;
  axes.rowwise().squaredNorm().maxCoeff(&longest);
  std::array<double, 3> angle{};
  for (int k = 0; k < 3; ++k) {
    // A family parallel to the plane has no lines in it: another one counts twice.
    const auto row = axes.row(axes.row(k).isZero(0) ? longest : k);
    const double along = portable::atan2(row[0], -row[1]);
    angle[k] = along < 0 ? along + pi : along;
  }
  if (angle[0] > angle[1]) std::swap(angle[0], angle[1]);
  if (angle[1] > angle[2]) std::swap(angle[1], angle[2]);
  if (angle[0] > angle[1]) std::swap(angle[0], angle[1]);
  double widest = -1;
  double middle = 0;
  for (int k = 0; k < 3; ++k) {
    const double next = k < 2 ? angle[k + 1] : angle[0] + pi;
    if (next - angle[k] <= widest) continue;
    widest = next - angle[k];
    middle = (next + angle[k]) / 2;
  }
  return {portable::cos(middle), portable::sin(middle)};
}

/// Average along t of the checker at start + t step under the standard normal distribution.
double checker_along_line(const Vec3d& start, const Vec3d& step, std::vector<double>& borders) {
  borders.clear();
  double cubes = 0;
  for (int k = 0; k < 3; ++k) {
    const double from = start[k] - kLineReach * step[k];
    cubes += std::floor(from);
    const double to = start[k] + kLineReach * step[k];
    if (step[k] == 0) continue;
    const double low = std::min(from, to);
    const double high = std::max(from, to);
    for (double border = std::floor(low) + 1; border <= high; ++border) {
      borders.push_back((border - start[k]) / step[k]);
    }
  }
  std::sort(borders.begin(), borders.end());
  double sign = std::fmod(cubes, 2) == 0 ? 1 : -1;
  double sum = 0;
  double before = 0;
  for (const double t : borders) {
    const double below = normal_distribution(t);
    sum += sign * (below - before);
    before = below;
    sign = -sign;
  }
  return sum + sign * (1 - before);
}

/// Families of borders that come within the kernel's reach.
int families_met(const Vec3d& point, const Vec3d& reach, int& last) {
  int met = 0;
  for (int k = 0; k < 3; ++k) {
    if (std::floor(point[k] - reach[k]) == std::floor(point[k] + reach[k])) continue;
    ++met;
    last = k;
  }
  return met;
}

double checker_by_lines(const Vec3d& point, const KernelAxes& axes) {
  const Vec2d along = crossing_direction(axes);
  const Vec2d across(-along.y(), along.x());
  const Vec3d step = axes * along;
  const Vec3d next = axes * across;
  // A sixth of a standard deviation, and a quarter of a cube.
  const int half =
      std::max(24, static_cast<int>(std::ceil(4 * kLineReach * next.cwiseAbs().maxCoeff())));
  const double spacing = kLineReach / half;
  std::vector<double> borders;
  double sum = 0;
  double weights = 0;
  for (int j = -half; j < half; ++j) {
    const double x = (j + 0.5) * spacing;
    const double weight = portable::exp(-0.5 * x * x);
    sum += weight * checker_along_line(point + x * next, step, borders);
    weights += weight;
  }
  return sum / weights;
}

}  // namespace

double filtered_checker(const Vec3d& point, const KernelAxes& axes) {
  if (!(point.cwiseAbs().maxCoeff() < kLargestCube) || !axes.allFinite()) return 0;
  KernelAxes principal = principal_axes(axes);
  if (principal.col(1).norm() >= kSeriesDeviation) return checker_series(point, principal);
  const double longest = principal.col(0).norm();
  if (longest > kLongestDeviation) principal.col(0) *= kLongestDeviation / longest;
  const Vec3d deviation = principal.rowwise().norm();
  int family = 0;
  const int met = families_met(point, kLineReach * deviation, family);
  if (met > 1) return checker_by_lines(point, principal);
  // One family of parallel borders, or none: what lies along them does not matter.
  std::vector<double> borders;
  return checker_along_line(point, met * deviation[family] * Vec3d::Unit(family), borders);
}

}  // namespace surfel
