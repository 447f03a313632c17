#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// The largest magnitude of a value that can be drawn. A weight of kMostDensity times a colour of
/// this size, summed over thousands of surfels, is still a number of single precision.
inline constexpr float kMostMagnitude = 1e18F;

/// The largest area that can be drawn, in units of the product of both standard deviations. What
/// methods make is below 10; files of other programs may give areas in another unit of length.
inline constexpr float kMostDensity = 1e15F;

/// The largest area of a surfel of these deviations that can be drawn, unit^2.
inline float most_area(float deviation_u, float deviation_v) {
  constexpr float kMost = kMostMagnitude * kMostMagnitude;
  return std::min(kMost, kMostDensity * deviation_u * deviation_v);
}

/// Whether a surfel can be drawn, or else which of its attributes forbids it.
enum class Usability : std::uint8_t { kUsable, kPosition, kVariance, kColor };

/// Surfels that cannot be drawn, by the reason.
struct UnusableSurfels {
  std::size_t position = 0;  ///< Not finite, or beyond kMostMagnitude.
  std::size_t variance = 0;  ///< Deviation or enlarged radius the same, or not positive.
  std::size_t color = 0;     ///< Colour or alpha the same, or area beyond kMostDensity.
  std::size_t total() const { return position + variance + color; }
  /// Counts a surfel, unless it is usable.
  void add(Usability reason) {
    position += reason == Usability::kPosition;
    variance += reason == Usability::kVariance;
    color += reason == Usability::kColor;
  }
  void add(const UnusableSurfels& other) {
    position += other.position;
    variance += other.variance;
    color += other.color;
  }
};

/// The values of a surfel that decide whether it can be drawn; values of absent attributes keep
/// their default.
struct SurfelValues {
  Vec3f position;
  float deviation_u, deviation_v;  ///< Standard deviations, scene units.
  float group_radius = 1;
  Vec3f color{0, 0, 0};
  float alpha = 1, area = 1;
};
SURFEL_API Usability usability(const SurfelValues& surfel);

/// Removes the surfels that cannot be drawn from `order`, and counts them. The column
/// `group_radius` decides only where the parameter of this name is true. The cloud has variances.
SURFEL_API UnusableSurfels remove_unusable(const SurfelCloud& cloud, bool group_radius,
                                           Array<std::uint32_t>& order);

}  // namespace surfel
