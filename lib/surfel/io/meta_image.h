#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/volume.h>

namespace surfel {

/// Reads a volume of the format MetaImage (.mha; the values in the file, or .mhd; in a file beside
/// it): three dimensions of scalars, plain or compressed by zlib. Throws Error (kIo, kInput) naming
/// file and key. Internal to the io module. Source: ITK's documentation of MetaIO.
Volume read_meta_image(const InputFile& input);

}  // namespace surfel
