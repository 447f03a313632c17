#pragma once

#include <vector>

#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>

namespace surfel {

/// zlib's. At level 6 files are 1 to 4 % smaller for two to three times the time; at level 3 they
/// are 4 % larger for a tenth less.
inline constexpr int kPngCompressionLevel = 4;
/// libpng's PNG_FILTER_AVG: pixels less the mean of those on the left and above. To try all filters
/// on every row takes nearly twice the time, for files of shaded surfaces that are as large within
/// 2 %, of flat colours a tenth smaller.
inline constexpr int kPngFilter = 0x40;

/// Encodes a PNG file as write_image() describes it. The bytes are equal to those that OpenImageIO
/// 2.4 makes with the settings above; OpenImageIO is not used because loading it takes longer than
/// encoding most pictures. For this library's own sources.
std::vector<unsigned char> encode_png(const Image& image, const ImageWriteOptions& options);

}  // namespace surfel
