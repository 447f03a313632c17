#pragma once

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Radiance of a made-up surrounding from a direction (any length but zero), linear R G B: a sky
/// that is bright at the horizon, a sun with a glow, a checkered floor below, and four rectangular
/// lights of different colours, as studios hang them around glass and metal. +y is up. Callable
/// from any thread.
SURFEL_API Vec3f procedural_sky_radiance(const Vec3d& direction);

/// The surrounding as a lat-long environment map (scene/lat_long.h), channels R G B A (opaque),
/// filtered with a tent of two pixels' width: interpolated linearly, edges have no steps. Throws
/// Error(kUsage) unless it is twice as wide as high.
SURFEL_API Image procedural_sky(int width, int height);

}  // namespace surfel
