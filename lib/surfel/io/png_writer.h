#pragma once

#include <vector>

#include <surfel/io/image.h>

namespace surfel {

/// The bytes of a PNG file as write_image() describes it: those that OpenImageIO 2.4 makes, without
/// loading it (which takes longer than most pictures). Internal to the io module.
std::vector<unsigned char> encode_png(const Image& image, const ImageWriteOptions& options);

}  // namespace surfel
