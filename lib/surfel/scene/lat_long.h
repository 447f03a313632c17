#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/base/types.h>

namespace surfel {

// Lat-long pictures of all directions, as OpenEXR defines them (ImfEnvmap.h): +y is up and lies on
// the top row, +z in the middle of the picture, +x a quarter of its width to the left of that, -z
// on the left and right borders. (u, v) runs from (0, 0) at the top left to (1, 1).

/// The unit direction at (u, v).
inline Vec3d lat_long_direction(double u, double v) {
  const double longitude = std::numbers::pi * (1 - 2 * u);
  const double colatitude = std::numbers::pi * v;
  const double horizontal = portable::sin(colatitude);
  return {horizontal * portable::sin(longitude), portable::cos(colatitude),
          horizontal * portable::cos(longitude)};
}

/// (u, v) of a direction, each in [0, 1]. The direction's length is neither so small nor so large
/// that its square is no number above zero.
inline Vec2f lat_long_place(const Vec3f& direction) {
  constexpr float kPi = std::numbers::pi_v<float>;
  const float longitude = portable::atan2(direction.x(), direction.z());
  const float colatitude = portable::atan2(
      std::sqrt(direction.x() * direction.x() + direction.z() * direction.z()), direction.y());
  return {std::clamp(0.5F - longitude / (2 * kPi), 0.0F, 1.0F),
          std::clamp(colatitude / kPi, 0.0F, 1.0F)};
}

}  // namespace surfel
