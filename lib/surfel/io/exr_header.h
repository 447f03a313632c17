#pragma once

#include <cstdint>
#include <optional>

#include <surfel/io/image_decoding.h>
#include <surfel/io/input_file.h>

namespace surfel {

/// What the header of an OpenEXR file says of its size.
struct ExrSize {
  PixelSize pixels;        ///< Of the data window.
  double pixel_bytes = 0;  ///< Of all channels of a pixel.
  double best_ratio = 1;   ///< Bytes that a byte of the file can stand for.
  bool damaged = false;    ///< An attribute is longer than the rest of the file, or its value is
                           ///< not as long as the attribute.
};

/// Reads the header of a file's first picture, and looks through the headers of its further
/// pictures for damaged attributes; nullopt for what is no OpenEXR file, or has none of the
/// attributes that tell the size. OpenEXR takes memory for every attribute, and for the rows that
/// are compressed together, as soon as it opens a file, whatever the file holds; and it reads on
/// behind the end of a value, wherever the attribute ends. Internal to the io module.
std::optional<ExrSize> exr_size(const InputFile& file);

}  // namespace surfel
