#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/gaussian/gaussian_options.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Largest error, pixels, that levels of detail of Gaussians have unless another is asked for:
/// twice the standard deviation of merged Gaussians.
inline constexpr double kGaussianLodError = 1.5;

/// The clusters of a picture, in ascending order: of the clusters that may be seen, the coarsest
/// whose spacing is at most `error` pixels at the nearest of their Gaussians. Clusters that the
/// picture does not show are left out by bounds that hold for the kernels of every profile, so that
/// the picture does not change, not a bit.
/// \param head     A cloud with levels; its Gaussians are not needed.
/// \param camera   The camera of the picture.
/// \param options  The profile and the pixel filter that the picture is drawn with.
/// \param error    Largest spacing of Gaussians in the picture, pixels, > 0.
SURFEL_API std::vector<std::uint32_t> gaussian_cut(const GaussianCloud& head, const Camera& camera,
                                                   const GaussianOptions& options, double error);

/// Bytes that `count` Gaussians take while they are drawn: the columns of a cloud of the degree of
/// `cloud`, and what GaussianRenderer keeps of each Gaussian.
SURFEL_API std::uint64_t gaussian_memory(std::size_t count, const GaussianCloud& cloud,
                                         GaussianProfile profile);

}  // namespace surfel
