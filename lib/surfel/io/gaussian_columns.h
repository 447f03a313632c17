#pragma once

// What the readers of all splat formats share. Internal to the io module.

#include <cstddef>
#include <string>

#include <surfel/io/gaussian_io.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Gaussians that one thread decodes or encodes at a time.
inline constexpr std::size_t kGaussianGrain = std::size_t{1} << 12;

/// Opacity of the number that training optimises, 1 / (1 + exp(-x)).
float opacity_of_logit(float x);
/// The reverse, of opacities clamped to 1e-6..1 - 1e-6, so that it is finite.
float logit_of_opacity(float opacity);

/// The highest degree of spherical harmonics with so many coefficients above degree 0, three
/// numbers each; throws Error(kInput) naming the file where no degree has as many.
int degree_of_coefficients(std::size_t numbers, const std::string& file);

/// Makes all columns of a cloud, whose degree is set, so long, if the options accept it. Throws
/// Error(kInput) naming the file where memory is short.
void allocate_gaussians(GaussianCloud& cloud, std::size_t count, const std::string& file,
                        const GaussianReadOptions& options = {});

/// What is done last to the Gaussians of any format, as read_gaussians() says: quaternions become
/// unit, scales get their absolute values, Gaussians that cannot be drawn are left out. Throws
/// Error(kInput) naming the file if none is left.
void finish_gaussians(GaussianCloud& cloud, const std::string& file);

}  // namespace surfel
