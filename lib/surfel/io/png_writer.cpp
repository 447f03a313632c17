// Portable Network Graphics, ISO/IEC 15948.

#include <csetjmp>
#include <string>

#include <png.h>
#include <surfel/base/error.h>
#include <surfel/io/image_encoding.h>
#include <surfel/io/image_io.h>
#include <surfel/io/png_errors.h>
#include <surfel/io/png_writer.h>

namespace surfel {
namespace {

/// All objects that libpng uses while it writes. They are made before, because libpng's errors jump
/// over destructors.
struct PngJob {
  png_structp png = nullptr;
  png_infop info = nullptr;
  png_uint_32 width = 0;
  png_uint_32 height = 0;
  int color_type = 0;
  std::vector<png_text> text;
  std::vector<png_const_bytep> rows;
  std::vector<unsigned char> file;
  PngErrors errors;

  PngJob() = default;
  PngJob(const PngJob&) = delete;
  PngJob& operator=(const PngJob&) = delete;
  ~PngJob() { png_destroy_write_struct(&png, &info); }
};

void append(png_structp png, png_bytep data, std::size_t size) {
  auto& file = static_cast<PngJob*>(png_get_io_ptr(png))->file;
  file.insert(file.end(), data, data + size);
}

/// False if libpng reports an error. Holds nothing that has a destructor.
bool write(PngJob& job) {
  if (setjmp(png_jmpbuf(job.png)) != 0) return false;  // NOLINT: libpng's way.
  png_set_write_fn(job.png, &job, append, nullptr);
  png_set_IHDR(job.png, job.info, job.width, job.height, 8, job.color_type, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_sRGB_gAMA_and_cHRM(job.png, job.info, PNG_sRGB_INTENT_ABSOLUTE);
  png_set_oFFs(job.png, job.info, 0, 0, PNG_OFFSET_PIXEL);
  png_set_text(job.png, job.info, job.text.data(), static_cast<int>(job.text.size()));
  png_set_filter(job.png, PNG_FILTER_TYPE_BASE, kPngFilter);
  png_set_compression_level(job.png, kPngCompressionLevel);
  png_set_compression_strategy(job.png, 0);  // zlib's default, not that for filtered rows.
  png_write_info(job.png, job.info);
  for (const png_const_bytep row : job.rows) png_write_row(job.png, row);
  png_write_end(job.png, job.info);
  return true;
}

}  // namespace

std::vector<unsigned char> encode_png(const Image& image, const ImageWriteOptions& options) {
  const bool with_alpha = !is_opaque(image, color_channels(image).alpha);
  const std::vector<std::uint8_t> pixels = encode_straight8(image, with_alpha);
  PngJob job;
  job.width = static_cast<png_uint_32>(image.width);
  job.height = static_cast<png_uint_32>(image.height);
  job.color_type = with_alpha ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_RGB;
  const std::size_t stride = std::size_t{job.width} * (with_alpha ? 4 : 3);
  for (std::size_t y = 0; y < job.height; ++y) job.rows.push_back(pixels.data() + y * stride);
  std::vector<std::pair<std::string, std::string>> texts{{"oiio:ColorSpace", "sRGB"}};
  texts.insert(texts.end(), options.metadata.begin(), options.metadata.end());
  for (auto& [key, value] : texts) {
    png_text text{};
    text.compression = PNG_TEXT_COMPRESSION_NONE;
    text.key = key.data();
    text.text = value.data();
    job.text.push_back(text);
  }
  job.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &job.errors, PngErrors::fail,
                                    PngErrors::ignore);
  if (job.png) job.info = png_create_info_struct(job.png);
  if (!job.info) throw std::bad_alloc();
  if (!write(job)) throw Error(ErrorKind::kIo, "PNG cannot be encoded: " + job.errors.message);
  return std::move(job.file);
}

}  // namespace surfel
