#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/volume.h>

namespace surfel {

/// Reads a volume of the formats NRRD (.nrrd; the values in the file) and NHDR (.nhdr; the values
/// in a file beside it): three axes of scalars, encodings raw and gzip. Throws Error (kIo, kInput)
/// naming file, line and field. Internal to the io module. Source: teem's definition of the format.
Volume read_nrrd(const InputFile& input);

}  // namespace surfel
