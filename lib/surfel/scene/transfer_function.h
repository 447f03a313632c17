#pragma once

#include <array>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

struct Volume;

/// What a volume's values look like: colour and density by value, linear between points, constant
/// before the first and after the last.
struct TransferFunction {
  /// Colour and density at a value.
  struct Point {
    double value = 0;
    Vec3f color{1, 1, 1};  ///< As displays take it (sRGB), 0..1.
    double density = 0;    ///< Optical depth per scene unit, >= 0.
  };
  /// At least one, in ascending order of values; two of the same value are a step.
  std::vector<Point> point;
  /// Values are shares of the range of the volume's values, from the value that 1 % of its voxels
  /// do not exceed (0) to the value that 99.9 % do not exceed (1).
  bool relative = false;

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
  /// Colour and density of a value.
  SURFEL_API Point operator()(double value) const;
  /// The least and the largest density of values from `low` to `high`.
  SURFEL_API std::array<double, 2> density_range(double low, double high) const;
};

/// The transfer functions that have names: "ct" (Hounsfield units; translucent skin, bone),
/// "ct-bone" and "mr" (relative values).
SURFEL_API const std::vector<std::string>& transfer_function_names();
/// Throws Error(kUsage) for other names.
SURFEL_API TransferFunction transfer_function(const std::string& name);

/// A relative transfer function in terms of a volume's values; others are returned as they are.
SURFEL_API TransferFunction absolute(const TransferFunction& function, const Volume& volume);

}  // namespace surfel
