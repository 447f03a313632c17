#pragma once

#include <surfel/base/output_file.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/ply.h>

namespace surfel {

/// Has the header the properties of trained Gaussians? Internal to the io module.
bool has_trained_gaussians(const PlyHeader& header);

/// Has it levels of detail, too? Internal to the io module.
bool has_gaussian_levels(const PlyHeader& header);

/// Reads the finest level of a PLY file of trained Gaussians: opacities as logits, scales as
/// logarithms, colours as spherical harmonics, the red coefficients first, then the green ones. See
/// read_gaussians(). Internal to the io module.
GaussianCloud read_gaussian_ply(PlyFile& ply, const GaussianReadOptions& options);

/// Writes the layout of 3D Gaussian splatting, and levels of detail as GaussianLevels has them.
/// Internal to the io module.
void write_gaussian_ply(const GaussianCloud& cloud, OutputFile& file,
                        const GaussianWriteOptions& options);

}  // namespace surfel
