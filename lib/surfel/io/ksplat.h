#pragma once

#include <surfel/io/gaussian_io.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Reads a .ksplat file of version 0.1, of any of its three compression levels. Internal to the io
/// module.
GaussianCloud read_ksplat(const InputFile& input, const GaussianReadOptions& options);

}  // namespace surfel
