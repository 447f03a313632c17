#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <surfel/io/image_io.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Form of the pixels that are read: R G B A with straight or with premultiplied alpha, or the
/// channels that the file stores.
enum class ImageForm { kStraight, kPremultiplied, kRaw, kData };

/// What an EXR file says of its picture beside the pixels.
struct ExrWindow {
  int first_row = 0;  ///< Of the data window, from the display window's first row on.
  int height = 0;     ///< Rows of the display window.
  std::vector<float> world_to_camera;  ///< As in ImageWriteOptions; or empty.
  std::vector<std::pair<std::string, std::string>> metadata;  ///< Texts that write_image() wrote.
};

/// Functions of the plug-ins libsurfel_exr.so and libsurfel_image.so, which keep OpenEXR and
/// OpenImageIO, with its load time, away from tools that see no image but PNG. The first three have
/// the contracts of read_image(), open_image() and write_image(); reading takes over the file at
/// `path`. The fourth, of `image`, has the contract of image_format_has_alpha(). The fifth, of
/// `exr`, reads a file with ImageForm::kRaw, and its windows, of one width.
using ReadImageFunction = void(InputFile& file, const std::string& path, ImageForm form,
                               Image& image);
using OpenImageFunction = void(InputFile& file, const std::string& path,
                               std::shared_ptr<ImageReader>& reader);
using WriteImageFunction = void(const Image& image, const std::string& path,
                                const ImageWriteOptions& options);
using ImageAlphaFunction = void(const std::string& path, bool& alpha);
using ReadWindowFunction = void(InputFile& file, ExrWindow& window, Image& image);

inline constexpr char kReadImageSymbol[] = "surfel_image_plugin_read";
inline constexpr char kOpenImageSymbol[] = "surfel_image_plugin_open";
inline constexpr char kWriteImageSymbol[] = "surfel_image_plugin_write";
inline constexpr char kImageAlphaSymbol[] = "surfel_image_plugin_alpha";
inline constexpr char kReadWindowSymbol[] = "surfel_image_plugin_read_window";

/// Does the content start as an EXR file does?
inline bool is_exr(const InputFile& file) {
  constexpr std::string_view kMagic = "\x76\x2f\x31\x01";
  return as_text(file.head(kMagic.size())).starts_with(kMagic);
}

}  // namespace surfel
