#pragma once

#include <optional>

#include <surfel/base/types.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

struct JudgedSurface;

/// What a sensor saw, if it looked at the scene; not set where it looked all around.
/// \param up  becomes what the sensor's axes say is up, unit, where they say it.
std::optional<SensorView> find_sensor_view(const JudgedSurface& s, const Viewpoint& viewpoint,
                                           Vec3d& up);

}  // namespace surfel
