#pragma once

#include <surfel/io/input_file.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Is the file a point set of Expe (.pts), surfels of an early point renderer? Text of the same
/// extension (PTS) is another format.
bool is_expe(const InputFile& file);

/// Reads a binary Expe point set: text lines "property NAME BYTES" and "nofpoints COUNT", then the
/// records behind the line "data". Read are position, normal, radius (floats) and color (three
/// bytes, sRGB, the surface's own; the fourth byte, which is 0 where surfels are opaque, too, is
/// not used). Other properties are skipped. Throws Error(kInput) naming the file. Internal to the
/// io module.
SurfelCloud read_expe(const InputFile& file);

}  // namespace surfel
