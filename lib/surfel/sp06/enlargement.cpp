// Zhang, Pajarola 2006, Single-Pass Point Rendering and Transparent Shading, section 4.2.2 (SP06).

#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/sp06/enlargement.h>

namespace surfel {
namespace {

/// Relative tolerance of the area and of the factor.
constexpr double kTolerance = 1e-6;
constexpr double kFixedPointTolerance = 1e-4;
/// Twice as many as bisection takes to come down to rounding.
constexpr int kMostEvaluations = 100;

}  // namespace

Enlargement enlarge_by_bracketing(const GroupCells& cells, std::span<const float> radius,
                                  double area) {
  Enlargement out;
  double full = 1;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    full = std::max(full, cells.reach(i) / static_cast<double>(radius[i]));
  }
  // The area that is missing, as a share of the whole; x is the factor's logarithm.
  const auto missing = [&](double x) {
    ++out.iterations;
    return 1 - cells.covered_area(radius, portable::exp(x)) / area;
  };
  double low = 0;
  double low_missing = area > 0 ? missing(low) : 0;
  if (low_missing <= 0) {
    out.converged = true;
    return out;
  }
  double high = portable::log(full);
  double high_missing = missing(high);
  out.factor = full;
  out.converged = high_missing <= kTolerance;
  if (high_missing >= 0) return out;
  int same_side = 0;
  while (high - low > kTolerance && out.iterations < kMostEvaluations) {
    // False position creeps where the curve is flat at one end: after two steps from one side the
    // bracket is halved.
    const double chord = (low * high_missing - high * low_missing) / (high_missing - low_missing);
    const double x = std::abs(same_side) >= 2 ? (low + high) / 2 : chord;
    const double value = missing(x);
    if (value > 0) {
      low = x;
      low_missing = value;
      same_side = std::max(0, same_side) + 1;
    } else {
      high = x;
      high_missing = value;
      same_side = std::min(0, same_side) - 1;
    }
    if (std::abs(value) <= kTolerance) {
      high = x;
      break;
    }
  }
  out.factor = portable::exp(high);
  out.converged = true;
  return out;
}

Enlargement enlarge_by_fixed_point(const GroupCells& cells, std::span<const float> radius,
                                   double area, int most_iterations) {
  Enlargement out;
  double discs = 0;
  for (const float r : radius) discs += std::numbers::pi * static_cast<double>(r) * r;
  while (!out.converged && discs > 0 && out.iterations < most_iterations) {
    // Sum of Clipped = area of the discs - covered area, so that A and the discs' area remain.
    const double missing = area - cells.covered_area(radius, out.factor);
    const double next = std::sqrt(std::max(0.0, out.factor * out.factor + missing / discs));
    ++out.iterations;
    out.converged = std::abs(next - out.factor) <= kFixedPointTolerance * out.factor;
    out.factor = std::max(1.0, next);
  }
  return out;
}

}  // namespace surfel
