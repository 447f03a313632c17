#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Surfels that cannot be drawn, by the reason.
struct UnusableSurfels {
  std::size_t position = 0;  ///< Not finite.
  std::size_t variance = 0;  ///< Variance or enlarged radius not finite, or not positive.
  std::size_t color = 0;     ///< Colour, alpha or area not finite.
  std::size_t total() const { return position + variance + color; }
  void add(const UnusableSurfels& other) {
    position += other.position;
    variance += other.variance;
    color += other.color;
  }
};

/// Takes those out of `order` that cannot be drawn, and counts them. `group_radius`: that column
/// matters. The cloud has variances.
SURFEL_API UnusableSurfels remove_unusable(const SurfelCloud& cloud, bool group_radius,
                                           Array<std::uint32_t>& order);

}  // namespace surfel
