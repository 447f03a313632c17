#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/scene/exact_coordinates.h>

namespace surfel {
namespace {

/// The power of ten that a number is, if it is one of few digits.
std::optional<double> whole_power_of_ten(double value) {
  for (int decimals = 0; decimals < kManyDecimals; ++decimals) {
    const double power = power_of_ten(decimals);
    if (std::abs(value - power) <= 1e-9 * power) return power;
  }
  return std::nullopt;
}

}  // namespace

bool tells_apart(const Bounds& box, const Vec3d& origin, double step) {
  const double reach = std::max((box.max - origin).maxCoeff(), (origin - box.min).maxCoeff());
  return reach * 0x1p-23 < step;
}

/// The multiple next to a coordinate if they differ by no more than `rounding` and what a sum and a
/// product in double precision round, else the coordinate itself.
double ExactCoordinates::Grid::nearest(double x, double rounding) const {
  constexpr double kSumOfProduct = 4 * std::numeric_limits<double>::epsilon();
  // Doubles this large have no digits behind the decimals, and the product would round them.
  if (per_unit > 0 && std::abs(x) * per_unit >= 0x1p53) return x;
  const double multiple = per_unit > 0 ? std::round(x * per_unit) / per_unit
                                       : std::round((x - offset) / step) * step + offset;
  const double tolerance = rounding + kSumOfProduct * (std::abs(x) + std::abs(offset));
  return std::abs(multiple - x) <= tolerance ? multiple : x;
}

ExactCoordinates::ExactCoordinates(const SurfelCloud& cloud, bool for_text) : cloud_(cloud) {
  const bool rounded = cloud.exact.empty();
  for (int axis = 0; axis < 3; ++axis) {
    std::optional<Grid>& grid = grid_[static_cast<std::size_t>(axis)];
    if (!cloud.las) {
      if (cloud.decimals && rounded) grid = Grid{.per_unit = power_of_ten(*cloud.decimals)};
      continue;
    }
    Grid steps{.step = cloud.las->scale[axis], .offset = cloud.las->offset[axis]};
    const auto per_unit = whole_power_of_ten(1 / steps.step);
    const bool decimal =
        for_text && per_unit && steps.offset * *per_unit == std::round(steps.offset * *per_unit);
    if (decimal) steps.per_unit = *per_unit;
    if (decimal || rounded) grid = steps;
  }
}

double ExactCoordinates::operator()(std::size_t i, int axis) const {
  const double x = cloud_.world(i, axis);
  const std::optional<Grid>& grid = grid_[static_cast<std::size_t>(axis)];
  if (!grid) return x;
  const auto offset = static_cast<double>(cloud_.position[i][axis]);
  return grid->nearest(x, cloud_.exact.empty() ? std::abs(offset) * 0x1p-23 : 0);
}

}  // namespace surfel
