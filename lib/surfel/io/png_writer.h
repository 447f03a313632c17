#pragma once

#include <vector>

#include <surfel/io/image.h>

namespace surfel {

/// The bytes of a PNG file as write_image() describes it: filtered as OpenImageIO 2.4 does, without
/// loading it (which takes longer than most pictures), and compressed by all threads; the bytes do
/// not depend on their number. Keys of the metadata have at most 79 characters. Internal to the io
/// module.
std::vector<unsigned char> encode_png(const Image& image, const ImageWriteOptions& options);

}  // namespace surfel
