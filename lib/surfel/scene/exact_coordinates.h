#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include <surfel/base/bounds.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Coordinates with so many decimals or more count as having no last one.
inline constexpr int kManyDecimals = 7;
/// 10^decimals, for decimals in 0..kManyDecimals.
constexpr double power_of_ten(int decimals) {
  double power = 1;
  for (int i = 0; i < decimals; ++i) power *= 10;
  return power;
}

/// Do float offsets from the origin tell multiples of a step apart everywhere in a box?
bool tells_apart(const Bounds& box, const Vec3d& origin, double step);

/// The coordinates of a cloud as a file gets them: those that were read, to the last bit. Internal
/// to the library.
class ExactCoordinates {
 public:
  /// Keeps a reference to the cloud.
  /// \param for_text  LAS defines a coordinate by a product and a sum, whose rounding shows as
  ///                  further digits: text gets the decimal number that is meant.
  explicit ExactCoordinates(const SurfelCloud& cloud, bool for_text = false);
  ExactCoordinates(SurfelCloud&& cloud, bool for_text = false) = delete;

  double operator()(std::size_t i, int axis) const;
  Vec3d operator()(std::size_t i) const { return {(*this)(i, 0), (*this)(i, 1), (*this)(i, 2)}; }

 private:
  /// What the file's coordinates were multiples of.
  struct Grid {
    double step = 1;
    double offset = 0;
    double per_unit = 0;  ///< Steps in a unit, where decimals are meant; `step` is unused then.

    double nearest(double x, double rounding) const;
  };

  const SurfelCloud& cloud_;
  std::array<std::optional<Grid>, 3> grid_;
};

}  // namespace surfel
