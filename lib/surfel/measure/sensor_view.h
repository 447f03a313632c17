#pragma once

#include <optional>

#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

struct JudgedSurface;

/// How a sensor saw a scene.
struct SensorView {
  Vec3d eye;      ///< World coordinates.
  Vec3d forward;  ///< Unit: the middle of what it saw.
  Vec3d up;       ///< Unit, across `forward`.
  double tan_x;   ///< Tangents of half the angles that hold what it saw, to either side and
  double tan_y;   ///< up and down; > 0.
};

/// What a sensor saw, if it looked at the scene; not set where it looked all around.
/// \param up  becomes what the sensor's axes say is up, unit, where they say it.
std::optional<SensorView> find_sensor_view(const JudgedSurface& s, const Viewpoint& viewpoint,
                                           Vec3d& up);

}  // namespace surfel
