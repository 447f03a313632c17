#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/gaussian_cloud.h>
#include <surfel/scene/transfer_function.h>
#include <surfel/scene/volume.h>

namespace surfel {

/// How close gaussians_of_volume() comes to the volume, and its light.
struct GaussiansOfVolumeOptions {
  /// Standard deviation of the Gaussians across the gradient, edges of a voxel, 0.4..2: sums of
  /// kernels ripple by 8 % at 0.4, 1.4 % at 0.5 and 0.2 % at 0.6 along an axis, and larger ones
  /// blur the volume.
  double deviation = 0.5;
  /// Voxels of a block of 2, 4 or 8 cubed become one Gaussian where neither the opacity of a ray
  /// through the block nor the colours that it adds differ by more than this among them, 0..1; 0:
  /// only where all of them are the same.
  double max_error = 0.01;
  /// Voxels whose optical depth is below this are left out, >= 0.
  double least_depth = 1e-4;
  /// How much the colours depend on the angle between the line of sight and the gradient, 0..1: a
  /// surface seen edge-on has 1 - shading of the colour of one that faces the eye.
  double shading = 0.6;
  /// Multiplies densities, > 0.
  double density = 1;

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// What became of the voxels.
struct GaussiansOfVolumeReport {
  std::size_t voxels = 0;
  std::size_t empty = 0;   ///< Voxels that are left out, as they can hardly be seen ...
  std::size_t merged = 0;  ///< ... and those that share a Gaussian with others.
};

/// Gaussians whose densities add up to the densities of a volume: one for each voxel that can be
/// seen, or for a block of voxels.
///
/// The transfer function is evaluated at 3 x 3 x 3 places in a voxel, with values that are
/// interpolated linearly. A Gaussian has the mass, the centre and the mean colour of the densities
/// there, and along the gradient of the values their variance; across the gradient it has
/// `deviation`, so that it overlaps its neighbours. Surfaces at which densities jump within a voxel
/// are as sharp as the values tell. A voxel's optical depth is 3 at most, by which it is opaque:
/// kernels of more would be opaque beyond the voxel. Blocks are merged as isotropic Gaussians where
/// what is around them, as far as these reach, is as dense.
///
/// Colours have spherical harmonics of degree 1, by which they depend on the line of sight v and
/// the normal n, the direction in which values fall: c (1 - shading (1 - n.v) / 2). Where the
/// values hardly change there is no normal, and colours depend on it less and less.
///
/// \param volume    The values.
/// \param function  Colour and opacity of absolute values.
/// \param name      Name of the volume, for messages.
/// \param options   Size of the Gaussians, and when voxels are merged.
/// \param report    If not null, filled.
///
/// Throws Error(kUsage) for bad options, and Error(kInput) if no voxel can be seen.
SURFEL_API GaussianCloud gaussians_of_volume(const Volume& volume, const TransferFunction& function,
                                             const std::string& name,
                                             const GaussiansOfVolumeOptions& options = {},
                                             GaussiansOfVolumeReport* report = nullptr);

/// The name of the transfer function that suits a volume: "ct" where values below -500 tell that
/// they are Hounsfield units, air among them, else "mr".
SURFEL_API std::string likely_transfer_function(const Volume& volume);

/// How much a voxel's colours depend on its normal, 0..1.
/// \param gradient  length of the gradient, values per scene unit.
/// \param range     of the values.
/// \param edge      of a voxel, scene units.
double shading_weight(double gradient, double range, double edge);

}  // namespace surfel
