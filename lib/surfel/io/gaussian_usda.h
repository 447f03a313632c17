#pragma once

#include <surfel/base/output_file.h>
#include <surfel/io/gaussian_io.h>

namespace surfel {

/// Writes the text of a USD stage (.usda) with one ParticleField: of Gaussian surflets where the
/// third scales are all zero, else of Gaussian ellipsoids. Internal to the io module.
void write_gaussian_usda(const GaussianCloud& cloud, OutputFile& file,
                         const GaussianWriteOptions& options);

}  // namespace surfel
