#pragma once

#include <vector>

#include <surfel/io/image.h>

namespace surfel {

/// zlib's. Half the time of its default, 6, for files that are 2 to 3 % larger.
inline constexpr int kPngCompressionLevel = 5;

/// The bytes of a PNG file as write_image() describes it: those that OpenImageIO 2.4 makes at that
/// level, without loading it (which takes longer than most pictures). Internal to the io module.
std::vector<unsigned char> encode_png(const Image& image, const ImageWriteOptions& options);

}  // namespace surfel
