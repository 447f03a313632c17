#pragma once

#include <surfel/base/output_file.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Reads a .splat file: 32 bytes a Gaussian and no header, so that only the size tells whether it
/// is one. Internal to the io module.
GaussianCloud read_splat(const InputFile& input, const GaussianReadOptions& options);

/// Writes a .splat file. Colours lose what depends on the direction. Internal to the io module.
void write_splat(const GaussianCloud& cloud, OutputFile& file);

}  // namespace surfel
