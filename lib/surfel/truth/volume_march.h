#pragma once

#include <surfel/base/export.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/transfer_function.h>
#include <surfel/scene/volume.h>

namespace surfel {

/// Steps and rays of march_volume().
struct VolumeMarchOptions {
  double step = 0.25;       ///< Between samples along a ray, mean edges of a voxel, > 0.
  double lowpass = 0.5477;  ///< Standard deviation of the pixel filter, pixels, >= 0.
  int rays = 4;             ///< Along each axis of a pixel's filter, 1..16.
  double shading = 0.6;     ///< As GaussiansOfVolumeOptions::shading.
  double density = 1;       ///< As GaussiansOfVolumeOptions::density.
};

/// The truth that Gaussians of volumes are measured against: emission and absorption along rays,
/// step by step, with the transfer function of the values as these are interpolated linearly.
/// Voxels end half an edge beyond their centres. R G B A, premultiplied, as displays take it
/// (sRGB). Throws Error(kUsage) for orthographic cameras.
/// \param volume    The values.
/// \param function  Colour and opacity of absolute values.
/// \param camera    A camera with perspective.
/// \param options   Length of a step, rays of a pixel, shading and density.
SURFEL_API Image march_volume(const Volume& volume, const TransferFunction& function,
                              const Camera& camera, const VolumeMarchOptions& options = {});

}  // namespace surfel
