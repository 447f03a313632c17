#pragma once

#include <string>

#include <surfel/io/image.h>

namespace surfel {

/// What libsurfel_image.so offers to the library: the two functions that need OpenImageIO, whose
/// own load time the tools that see no image must not pay. Same contract as read_image() and
/// write_image().
using ReadImageFunction = void(const std::string& path, bool raw, Image& image);
using WriteImageFunction = void(const Image& image, const std::string& path,
                                const ImageWriteOptions& options);

inline constexpr char kReadImageSymbol[] = "surfel_image_plugin_read";
inline constexpr char kWriteImageSymbol[] = "surfel_image_plugin_write";

}  // namespace surfel
