#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Whether a surfel can be drawn, or else which of its attributes forbids it.
enum class Usability : std::uint8_t { kUsable, kPosition, kVariance, kColor };

/// Surfels that cannot be drawn, by the reason.
struct UnusableSurfels {
  std::size_t position = 0;  ///< Not finite.
  std::size_t variance = 0;  ///< Variance or enlarged radius not finite, or not positive.
  std::size_t color = 0;     ///< Colour, alpha or area not finite.
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
  float size_u, size_v = 1;  ///< Variances or standard deviations.
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
