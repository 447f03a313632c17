#pragma once

// Up by support, stability and symmetry: Fu, Cohen-Or, Dror, Sheffer, "Upright orientation of
// man-made objects", SIGGRAPH 2008, without its learning.

#include <array>

#include <surfel/base/types.h>
#include <surfel/measure/judged_surface.h>

namespace surfel {

/// Which way is up.
struct UprightGuess {
  Vec3d up;            ///< Unit.
  double margin;       ///< How far ahead of the second best `up` is; about 0.5 is clear.
  const char* reason;  ///< What the guess rests on, in words.
};

/// Guesses by the surface alone: see guess_view().
/// \param symmetry  JudgedSurface::mirrored() of the three axes.
UprightGuess guess_upright(const JudgedSurface& s, const std::array<double, 3>& symmetry);

}  // namespace surfel
