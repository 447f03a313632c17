// Portable Network Graphics, ISO/IEC 15948.

#include <algorithm>
#include <bit>
#include <csetjmp>
#include <cstring>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <png.h>
#include <surfel/base/error.h>
#include <surfel/io/image_decoding.h>
#include <surfel/io/png_errors.h>
#include <surfel/io/png_reader.h>
#include <surfel/io/record_table.h>

namespace surfel {
namespace {

constexpr std::size_t kSignature = 8;  ///< Bytes by which PNG files are known.

/// Deflate makes of two bits a match of 258 bytes at most.
constexpr double kBestDeflate = 1032;

/// All objects that libpng uses while it reads. They are made before, because libpng's errors jump
/// over destructors.
struct PngReadJob {
  std::span<const std::byte> bytes;
  png_structp png = nullptr;
  png_infop info = nullptr;
  std::size_t at = 0;              ///< Next byte to read.
  int pixel_bits = 0;              ///< Of a pixel in the file.
  std::vector<std::byte> skipped;  ///< A row that nobody wants.
  PngErrors errors;

  explicit PngReadJob(std::span<const std::byte> file) : bytes(file) {}
  PngReadJob(const PngReadJob&) = delete;
  PngReadJob& operator=(const PngReadJob&) = delete;
  ~PngReadJob() { png_destroy_read_struct(&png, &info, nullptr); }
};

void take(png_structp png, png_bytep data, std::size_t size) {
  auto& job = *static_cast<PngReadJob*>(png_get_io_ptr(png));
  if (size > job.bytes.size() - job.at) png_error(png, "the file ends too early");
  std::memcpy(data, job.bytes.data() + job.at, size);
  job.at += size;
}

/// Reads the header, and asks for pixels of 8 or 16 bits, grey or R G B, with alpha where the file
/// has any transparency. False if libpng reports an error. Holds nothing that has a destructor.
bool start(PngReadJob& job) {
  if (setjmp(png_jmpbuf(job.png)) != 0) return false;  // NOLINT: libpng's way.
  png_set_read_fn(job.png, &job, take);
  png_read_info(job.png, job.info);
  job.pixel_bits = png_get_channels(job.png, job.info) * png_get_bit_depth(job.png, job.info);
  png_set_expand(job.png);
  if constexpr (std::endian::native == std::endian::little) png_set_swap(job.png);
  png_set_interlace_handling(job.png);
  png_read_update_info(job.png, job.info);
  return true;
}

/// Reads `count` rows to `to`, or over one another where `to` is null. False if libpng reports an
/// error. Holds nothing that has a destructor.
bool read_rows(PngReadJob& job, std::size_t count, std::byte* to, std::size_t row_bytes) {
  if (setjmp(png_jmpbuf(job.png)) != 0) return false;  // NOLINT: libpng's way.
  for (std::size_t y = 0; y < count; ++y) {
    std::byte* const row = to ? to + y * row_bytes : job.skipped.data();
    png_read_row(job.png, reinterpret_cast<png_bytep>(row), nullptr);
  }
  return true;
}

/// Throws Error(kInput) where a chunk before the first pixels is longer than the file: libpng would
/// take and fill memory of that size.
void check_chunks(std::span<const std::byte> bytes, const std::string& name) {
  constexpr bool kSwapped = std::endian::native == std::endian::little;
  constexpr std::size_t kHead = 8;           // Bytes of a chunk's length and type ...
  constexpr std::size_t kFrame = kHead + 4;  // ... and of its checksum.
  for (std::size_t at = kSignature; at + kHead <= bytes.size();) {
    const std::uint64_t length = load_scalar<std::uint32_t, kSwapped>(bytes.data() + at);
    if (std::memcmp(bytes.data() + at + 4, "IDAT", 4) == 0) return;
    if (kFrame + length > bytes.size() - at) {
      throw_input(
          name,
          fmt::format(
              "damaged image: a chunk claims {} bytes, more than the file has; export it again",
              length));
    }
    at += kFrame + length;
  }
}

/// The pixels of a PNG file, decoded row by row.
class PngPixels {
 public:
  explicit PngPixels(InputFile file) : file_(std::move(file)) {
    check_chunks(file_.bytes(), file_.name());
    restart();
    png_const_structp png = job_->png;
    png_const_infop info = job_->info;
    size_ = {png_get_image_width(png, info), png_get_image_height(png, info)};
    check_promise(size_, job_->pixel_bits / 8.0, kBestDeflate, file_.size(), name());
    channels_ = png_get_channels(png, info);
    wide_ = png_get_bit_depth(png, info) == 16;
    interlaced_ = png_get_interlace_type(png, info) != PNG_INTERLACE_NONE;
  }

  const std::string& name() const { return file_.name(); }
  PixelSize size() const { return size_; }
  int channels() const { return channels_; }
  bool has_alpha() const { return channels_ % 2 == 0; }
  bool wide() const { return wide_; }  ///< Values have 16 bits.
  std::size_t pixel_bytes() const { return static_cast<std::size_t>(channels_) * (wide_ ? 2 : 1); }
  std::size_t row_bytes() const { return size_.width * pixel_bytes(); }
  /// OpenImageIO's names of the channels.
  std::vector<std::string> names() const {
    std::vector<std::string> out{"Y"};
    if (channels_ > 2) out = {"R", "G", "B"};
    if (has_alpha()) out.emplace_back("A");
    return out;
  }
  /// Layout of the pixels of `width` columns and `height` rows.
  StoredPixels stored(std::size_t width, std::size_t height) const {
    return {{width, height},
            static_cast<std::size_t>(channels_),
            color_channels(names(), has_alpha() ? channels_ - 1 : -1),
            false};
  }

  /// Reads the rows [begin, end) as the file's type of values.
  void read(std::size_t begin, std::size_t end, std::byte* to) {
    if (interlaced_) {
      if (whole_.empty()) read_interlaced();
      std::copy_n(whole_.data() + begin * row_bytes(), (end - begin) * row_bytes(), to);
      return;
    }
    if (begin < next_) restart();
    // After an error libpng begins anew.
    const std::size_t at = std::exchange(next_, std::numeric_limits<std::size_t>::max());
    rows(begin - at, nullptr);
    rows(end - begin, to);
    next_ = end;
  }

 private:
  void restart() {
    job_ = std::make_unique<PngReadJob>(file_.bytes());
    PngReadJob& job = *job_;
    job.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &job.errors, PngErrors::fail,
                                     PngErrors::ignore);
    job.info = job.png ? png_create_info_struct(job.png) : nullptr;
    if (!job.info || !start(job)) {
      throw_input(file_.name(), "cannot be read as an image: " + job.errors.message);
    }
    next_ = 0;
  }
  void rows(std::size_t count, std::byte* to) {
    job_->skipped.resize(row_bytes());
    if (!read_rows(*job_, count, to, row_bytes())) {
      throw_input(file_.name(), "damaged image: " + job_->errors.message);
    }
  }
  /// Every pass over the rows adds the pixels that the passes before have left out.
  void read_interlaced() {
    check_fits(size_, channels_, file_.name());
    whole_.resize(size_.height * row_bytes());
    for (int pass = 0; pass < PNG_INTERLACE_ADAM7_PASSES; ++pass) rows(size_.height, whole_.data());
  }

  InputFile file_;
  std::unique_ptr<PngReadJob> job_;
  PixelSize size_{};
  int channels_ = 0;
  bool wide_ = false, interlaced_ = false;
  std::size_t next_ = 0;    ///< Row that libpng reads next.
  Array<std::byte> whole_;  ///< All rows of an interlaced file, once they have been read.
};

class PngReader final : public ImageReader {
 public:
  explicit PngReader(InputFile file) : pixels_(std::move(file)) {
    const auto [width, height] = pixels_.size();
    check_streamable(pixels_.size(), pixels_.pixel_bytes(), pixels_.name());
    layout_ = {.name = pixels_.name(),
               .width = static_cast<int>(width),
               .height = static_cast<int>(height),
               .alpha = pixels_.has_alpha(),
               .coded = !pixels_.wide(),
               .piece_height = 1};
  }

  const Layout& layout() const override { return layout_; }

  void read(const Box& box, void* rgba) override {
    Array<std::byte> rows(box.height() * pixels_.row_bytes());
    pixels_.read(static_cast<std::size_t>(box.y_begin), static_cast<std::size_t>(box.y_end),
                 rows.data());
    const std::size_t first = static_cast<std::size_t>(box.x_begin) * pixels_.pixel_bytes();
    const std::size_t wanted = box.width() * pixels_.pixel_bytes();
    for (std::size_t y = 0; y < box.height(); ++y) {
      std::memmove(rows.data() + y * wanted, rows.data() + y * pixels_.row_bytes() + first, wanted);
    }
    const StoredPixels stored = pixels_.stored(box.width(), box.height());
    if (layout_.coded) {
      convert_to_coded(reinterpret_cast<const std::uint8_t*>(rows.data()), stored,
                       static_cast<std::uint8_t*>(rgba));
    } else {
      convert_to_rgba(reinterpret_cast<const std::uint16_t*>(rows.data()), stored, false,
                      static_cast<float*>(rgba));
    }
  }

 private:
  PngPixels pixels_;
  Layout layout_;
};

}  // namespace

bool is_png(const InputFile& file) {
  const std::span<const std::byte> head = file.head(kSignature);
  return head.size() == kSignature &&
         png_sig_cmp(reinterpret_cast<png_const_bytep>(head.data()), 0, kSignature) == 0;
}

Image read_png(InputFile file, ImageForm form) {
  PngPixels pixels(std::move(file));
  const auto [width, height] = pixels.size();
  check_fits(pixels.size(), pixels.channels(), pixels.name());
  Array<std::byte> rows(height * pixels.row_bytes());
  pixels.read(0, height, rows.data());
  const StoredPixels stored = pixels.stored(width, height);
  if (pixels.wide()) {
    return decoded_image(reinterpret_cast<const std::uint16_t*>(rows.data()), stored,
                         pixels.names(), form);
  }
  return decoded_image(reinterpret_cast<const std::uint8_t*>(rows.data()), stored, pixels.names(),
                       form);
}

std::shared_ptr<ImageReader> open_png(InputFile file) {
  return std::make_shared<PngReader>(std::move(file));
}

}  // namespace surfel
