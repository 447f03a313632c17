#pragma once

#include <vector>

#include <surfel/io/image.h>

namespace surfel {

/// zlib's. Three quarters of the time of level 5 for files that are 1 % larger; at level 3 they are
/// 5 % larger, for hardly less time.
inline constexpr int kPngCompressionLevel = 4;

/// The bytes of a PNG file as write_image() describes it: those that OpenImageIO 2.4 makes at that
/// level, without loading it (which takes longer than most pictures). Internal to the io module.
std::vector<unsigned char> encode_png(const Image& image, const ImageWriteOptions& options);

}  // namespace surfel
