#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>

namespace surfel {

/// What read_image() hands out: R G B A with straight or with premultiplied alpha, or the stored
/// channels.
enum class ImageForm { kStraight, kPremultiplied, kRaw };

/// How two pictures differ in some of their channels, as OpenImageIO's compare() measures it.
struct ChannelDifference {
  double mean_absolute = 0;
  double rms = 0;
  double maximum = 0;
  int x = 0, y = 0, channel = 0;  ///< Where the maximum is met first, row by row.
  std::size_t beyond = 0;         ///< Pixels with a channel that differs by more than `threshold`.
};

/// What libsurfel_image.so offers to the library: the functions that need OpenImageIO, whose own
/// load time the tools that see no image must not pay. Same contract as read_image(),
/// open_image() and write_image(); the last compares the channels [first, last) of two pictures of
/// the same size and channels, all of whose values are finite.
using ReadImageFunction = void(const std::string& path, ImageForm form, Image& image);
using OpenImageFunction = void(const std::string& path, std::shared_ptr<ImageReader>& reader);
using WriteImageFunction = void(const Image& image, const std::string& path,
                                const ImageWriteOptions& options);
using CompareImagesFunction = void(const Image& a, const Image& b, int first, int last,
                                   float threshold, ChannelDifference& difference);

inline constexpr char kReadImageSymbol[] = "surfel_image_plugin_read";
inline constexpr char kOpenImageSymbol[] = "surfel_image_plugin_open";
inline constexpr char kWriteImageSymbol[] = "surfel_image_plugin_write";
inline constexpr char kCompareImagesSymbol[] = "surfel_image_plugin_compare";

}  // namespace surfel
