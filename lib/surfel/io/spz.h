#pragma once

#include <surfel/io/gaussian_io.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Does the file start as .spz files do, compressed (versions 1 to 3 with that extension) or not?
/// Internal to the io module.
bool is_spz(const InputFile& input);

/// Reads a .spz file of versions 1 to 4. Its y axis points up; the cloud has the axes of the PLY
/// files of 3D Gaussian splatting, y down and z forwards, and says so (`up`). Internal to the io
/// module.
GaussianCloud read_spz(const InputFile& input, const GaussianReadOptions& options);

}  // namespace surfel
