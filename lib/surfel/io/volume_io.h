#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/volume.h>

namespace surfel {

/// Reads a volume: NRRD (.nrrd, .nhdr) or MetaImage (.mha, .mhd), told by their first bytes, three
/// dimensions of scalars, raw or compressed by gzip. Voxels whose value is not finite get the least
/// value (Volume::not_finite). Throws Error (kIo, kInput) naming the file and what is wrong.
SURFEL_API Volume read_volume(const std::string& path);
SURFEL_API Volume read_volume(const InputFile& input);

/// Reads a volume from images of one size, one for each z, in the order of their names, in which
/// numbers count as numbers: slice-9.png comes before slice-10.png. The first channel gives the
/// values, of integers as shares of full scale. Row 0 is at the top, so that y points down.
/// \param images   Paths of the images, one at least.
/// \param spacing  Distances of pixels along x and y, and of images, scene units.
///
/// Throws Error (kIo, kInput) naming the first image that is of another size or cannot be read.
SURFEL_API Volume read_image_stack(std::vector<std::string> images, const Vec3d& spacing);

/// Has a name the extension of a volume's format (.nrrd, .nhdr, .mha, .mhd)?
SURFEL_API bool is_volume_name(const std::string& path);

}  // namespace surfel
