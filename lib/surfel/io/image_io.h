#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/io/input_file.h>
#include <surfel/scene/image.h>
#include <surfel/scene/map_place.h>

namespace surfel {

/// Pixels that an image may have to be read, 2^31 unless set: a header of a few bytes can claim any
/// number, for which libraries take memory before they look at the pixels.
SURFEL_API std::uint64_t most_image_pixels() noexcept;
/// Sets it for the whole process, to 1 at least.
SURFEL_API void set_most_image_pixels(std::uint64_t pixels) noexcept;

/// Reads PNG, EXR and any format of OpenImageIO but HEIF and AVIF ("-" is standard input) as linear
/// R G B A with straight (not premultiplied) alpha: integer files (8 and 16 bits, palette, grey)
/// are decoded from sRGB, float files (EXR, HDR) are linear. Colour profiles and gamma tags are
/// ignored. Grey is spread to R G B, a missing alpha is 1; where a premultiplied file has alpha 0,
/// its colour comes as stored. With `raw` channels come as stored: float files premultiplied and
/// with all their AOVs, integer files still decoded. Of files with several images the first, of EXR
/// the data window. Throws Error(kIo, kInput) naming file and cause.
SURFEL_API Image read_image(const std::string& path, bool raw = false);
/// Reads an image from a file that is open; in memory, PNG, EXR, TIFF, JPEG, WebP or HDR.
SURFEL_API Image read_image(InputFile file, bool raw = false);

/// Reads an image whose values are no colours, such as a normal map: channels come as stored,
/// integers as fractions of full scale and not decoded, under the names that read_image() gives
/// them with `raw`; grey is one channel. Throws as read_image() does.
SURFEL_API Image read_data_image(const std::string& path);
/// Reads such an image from a file that is open, or in memory.
SURFEL_API Image read_data_image(InputFile file);

/// Reads an image as linear R G B A with premultiplied alpha, as write_image() takes it. The values
/// of a premultiplied float file (EXR) are not changed, even light where alpha is 0.
SURFEL_API Image read_premultiplied_image(const std::string& path);

/// An image that is read piece by piece, so that it need not fit into memory.
class SURFEL_API ImageReader {
 public:
  /// Size and channels of a picture, as its header tells.
  struct Layout {
    std::string name;  ///< For messages.
    int width = 0;
    int height = 0;
    bool alpha = false;    ///< The file has an alpha channel.
    bool coded = false;    ///< Pixels are handed out as 8-bit sRGB codes.
    int piece_height = 1;  ///< Boxes whose rows start at multiples of it decode no row twice.
  };
  /// Columns [x_begin, x_end) of rows [y_begin, y_end).
  struct Box {
    int x_begin, x_end, y_begin, y_end;
    std::size_t width() const { return static_cast<std::size_t>(x_end - x_begin); }
    std::size_t height() const { return static_cast<std::size_t>(y_end - y_begin); }
    std::size_t pixels() const { return width() * height(); }
  };

  virtual ~ImageReader() = default;
  virtual const Layout& layout() const = 0;
  /// Pixels of a box that is not empty, as read_image() gives them: straight R G B A, four floats
  /// each, or, where the layout is `coded`, four bytes, R G B still encoded as sRGB. Formats
  /// without tiles are fast from top to bottom only. Throws Error(kInput) naming file and cause.
  virtual void read(const Box& box, void* rgba) = 0;
};

/// Opens any format that read_image() reads; the pixels may take more room than the machine has,
/// but not more than 256 GiB in the file's own format, and not more than most_image_pixels().
/// Throws as read_image() does.
SURFEL_API std::shared_ptr<ImageReader> open_image(const std::string& path);
/// Takes over a file that is open, or in memory.
SURFEL_API std::shared_ptr<ImageReader> open_image(InputFile file);

/// Where the rows of an image lie in a picture of its width.
struct RowsOfPicture {
  int first_row;
  int height;  ///< Of the picture.
};

/// What is written beside the pixels of a picture, and which rows they are.
struct ImageWriteOptions {
  bool no_clobber = false;
  /// String attributes for the file's metadata (formats without any ignore them).
  std::vector<std::pair<std::string, std::string>> metadata;
  /// Row-major 4x4 matrix that takes column vectors from world to camera, or empty. Written to EXR
  /// as `worldToCamera`, transposed as OpenEXR's matrices act on row vectors.
  std::vector<float> world_to_camera;
  /// Written to TIFF as the tags of GeoTIFF.
  std::optional<MapPlace> map = {};
  /// Set: the image is of some rows of a picture, and EXR gets its data window and the picture's
  /// display window; see picture_part.h.
  std::optional<RowsOfPicture> rows_of = {};
};

/// Writes by extension, whole or not at all: EXR (float, linear, premultiplied, all channels), TIFF
/// and PNG (8 bits, sRGB-encoded, straight alpha, which is left out where every pixel is opaque),
/// JPEG (8 bits, sRGB, quality 95, composited on nothing: alpha is dropped), Radiance HDR (linear
/// R G B), and what else OpenImageIO encodes in memory, like PNG. "-" is standard output, as PNG,
/// which pipes and devices without an extension get, too. The image is premultiplied linear R G B A
/// followed by any AOVs, found by name; formats other than EXR get R G B A only. The same image
/// gives the same bytes (no time stamps). Throws Error(kIo) naming file and cause; an extension
/// that cannot be written is kUsage.
SURFEL_API void write_image(const Image& image, const std::string& path,
                            const ImageWriteOptions& options = {});

/// Whether files of this name hold alpha as write_image() writes them: PNG and EXR do, JPEG and HDR
/// do not. Throws Error(kUsage) naming the extensions that are written, where this one is not.
SURFEL_API bool image_format_has_alpha(const std::string& path);

}  // namespace surfel
