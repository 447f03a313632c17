#pragma once

#include <surfel/io/gaussian_io.h>
#include <surfel/io/ply.h>
#include <surfel/scene/gaussian_cloud.h>

namespace surfel {

/// Has the header the packed Gaussians of a compressed PLY file? Internal to the io module.
bool has_packed_gaussians(const PlyHeader& header);

/// Reads a compressed PLY file of Gaussians: four words each, in chunks of 256 with the bounds of
/// their values. Internal to the io module.
GaussianCloud read_compressed_ply(PlyFile& ply, const GaussianReadOptions& options);

}  // namespace surfel
