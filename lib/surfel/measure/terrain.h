#pragma once

#include <surfel/base/export.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/surface_sample.h>

namespace surfel {

/// Is a scene terrain, whose elevation says more than a plain colour? It is if it has coordinates
/// of a map, or if it is a height field: lower than it is wide, with one height at a place and one
/// side, as seen along `guess.up`. Scans that a sensor saw from a known place, or a camera in the
/// origin, are none, and neither are planes.
/// \param sample  Points of the scene, as sample_surface() chooses them.
/// \param guess   The view that guess_view() finds for this sample.
SURFEL_API bool is_terrain(const SurfaceSample& sample, const ViewGuess& guess);

}  // namespace surfel
