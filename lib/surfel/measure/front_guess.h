#pragma once

#include <array>

#include <surfel/base/types.h>
#include <surfel/measure/judged_surface.h>

namespace surfel {

/// From where a scene is best looked at.
struct FrontGuess {
  Vec3d front;       ///< Unit, across up: from the scene's middle to who looks at it.
  double azimuth;    ///< The eye stands that far to the right of the front,
  double elevation;  ///< and that far above the middle; radians.
};

/// Horizontal direction from which a scene is looked at by convention: +z where y is up, -y where z
/// is, and what the least turn between them makes of these elsewhere.
Vec3d conventional_front(const Vec3d& up);

/// Guesses by the surface alone: see guess_view().
/// \param up  unit.
/// \param symmetry  JudgedSurface::mirrored() of the three axes.
FrontGuess guess_front(const JudgedSurface& s, const Vec3d& up,
                       const std::array<double, 3>& symmetry);

}  // namespace surfel
