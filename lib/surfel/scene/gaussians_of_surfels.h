#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/gaussian_cloud.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/usable_surfels.h>

namespace surfel {

/// Overlap of the kernels, which tells opacities, and the Gaussians' thickness.
struct GaussiansOfSurfelsOptions {
  /// Mean of the sum of all kernels, each 1 at its centre, over a place of the surface, > 0: 2 pi
  /// times the standard deviations, over the area of a surfel. Coverage::overlap of
  /// cloud_statistics() with cutoff 1 is this number. The default is what surfels of meshes have.
  double overlap = 3;
  /// Standard deviation across the surface, as a share of the smaller one along it, 0..1. With 0
  /// the Gaussians are flat, which .usda and 2D Gaussian splatting have; other programs' formats
  /// store its logarithm.
  double thickness = 0.01;

  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// What became of the surfels.
struct GaussiansOfSurfelsReport {
  UnusableSurfels left_out;
  /// Surfels whose centre one of their half-planes cuts off. They continue others up to a line,
  /// which Gaussians cannot have.
  std::size_t mirrored = 0;
  std::size_t clipped = 0;  ///< Surfels that are whole Gaussians now: they overhang their lines.
  double opacity = 0;       ///< Of a Gaussian of an opaque surfel.
};

/// Opacity at the centre of Gaussians of which `overlap` lie over a place in the mean
/// (GaussiansOfSurfelsOptions), so that together they hide the share `hidden` of what lies behind
/// them. Kernels of opacity o / exp(-r^2 / 2) let through, in the mean of the logarithms,
/// exp(-overlap * Li2(o)), with Li2 the dilogarithm. At most 0.99, as renderers cap it.
SURFEL_API double opacity_for(double overlap, double hidden);

/// Surfels as trained splats, so that viewers of splats show them.
///
/// Surfels are divided by the sum of their kernels, splats are laid over one another: where surfels
/// are opaque, the opacity of a splat must be such that all of them hide what lies behind.
/// They cannot hide all of it. 99 % are hidden, in the mean, which with the usual overlap of 3 asks
/// for an opacity of 0.98; wider kernels would hide more, and blur the colours.
/// A surfel of opacity `alpha` gets opacity_for(overlap, 0.99 alpha).
///
/// Colours are the surfels' (`coefficient` or `color`, else SurfelCloud::colorless()), as
/// displays take them; they are not lit. Surfels without a normal become spheres. Throws
/// Error(kUsage) for bad options, and Error(kInput), starting with `name`, for a cloud without
/// variances or without any usable surfel.
SURFEL_API GaussianCloud gaussians_of_surfels(const SurfelCloud& cloud, const std::string& name,
                                              const GaussiansOfSurfelsOptions& options = {},
                                              GaussiansOfSurfelsReport* report = nullptr);

}  // namespace surfel
