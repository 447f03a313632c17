#include <algorithm>
#include <array>
#include <bit>
#include <filesystem>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/io/geo_tiff.h>
#include <surfel/io/image_decoding.h>
#include <surfel/io/image_encoding.h>
#include <surfel/io/image_io.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/input_file.h>
#include <surfel/io/png_writer.h>
#include <surfel/io/record_table.h>

namespace surfel {
namespace {

/// More than any picture needs; a damaged header may claim thousands.
constexpr int kMostChannels = 256;
constexpr std::uint64_t kMegabyte = 1 << 20;

/// Bytes of pixels that a byte of a file may stand for, and bytes of pixels that any file may have:
/// LZW makes 10,240 bytes of R G B A of a byte, and deflate of 1-bit pixels 8256. Formats that
/// compress one colour without bound (WebP, CCITT's) keep to it where there is a picture.
constexpr double kBestRatio = 16384;
constexpr double kSmallPicture = 0x1p24;

/// As check_promise(), for any format.
void check_claim(PixelSize size, double pixel_bytes, const InputFile& file) {
  const double bytes =
      static_cast<double>(size.width) * static_cast<double>(size.height) * pixel_bytes;
  if (bytes > kSmallPicture) check_promise(size, pixel_bytes, kBestRatio, file.size(), file.name());
}

/// Most megabytes of pixels of an image that is read as a whole.
std::uint64_t most_megabytes() {
  return std::min<std::uint64_t>(available_memory_bytes() / kMegabyte, 32768);
}

/// Sets OpenImageIO's limits and OpenEXR's number of threads while a file is opened, which is when
/// they count, and restores them after that: these settings belong to the whole process, and so to
/// the program. The number of threads of a reader or writer is set on the reader or writer.
class OpeningSettings {
 public:
  explicit OpeningSettings(std::uint64_t most_megabytes) : lock_(mutex()) {
    set(0, "exr_threads", thread_count());
    set(1, "limits:channels", kMostChannels);
    set(2, "limits:imagesize_MB", static_cast<int>(std::max<std::uint64_t>(1, most_megabytes)));
  }
  ~OpeningSettings() {
    for (const auto& [name, value] : before_) OIIO::attribute(name, value);
  }
  OpeningSettings(const OpeningSettings&) = delete;
  OpeningSettings& operator=(const OpeningSettings&) = delete;

 private:
  static std::mutex& mutex() {
    static std::mutex one;
    return one;
  }
  void set(std::size_t i, const char* name, int value) {
    before_[i] = {name, OIIO::get_int_attribute(name)};
    OIIO::attribute(name, value);
  }

  std::lock_guard<std::mutex> lock_;
  std::array<std::pair<const char*, int>, 3> before_;
};

/// Last line of OpenImageIO's message without trailing punctuation; the first lines often repeat
/// the same for each reader that was tried.
std::string cause(std::string message) {
  const auto is_junk = [](char c) { return c == '\n' || c == ' ' || c == '.' || c == ':'; };
  while (!message.empty() && is_junk(message.back())) message.pop_back();
  const std::size_t line = message.rfind('\n');
  if (line != std::string::npos) message.erase(0, line + 1);
  return message.empty() ? "unknown cause" : message;
}

// ---------------------------------------------------------------------------------------------
// Reading

/// Whether the reader hands out colours multiplied by alpha although it was asked not to, as TIFF
/// files may be stored.
bool has_associated_alpha(const OIIO::ImageInput& input, const ColorChannels& c) {
  if (c.alpha < 0 || c.alpha == c.red) return false;
  return std::string(input.format_name()) == "tiff" &&
         input.spec().get_int_attribute("oiio:UnassociatedAlpha") == 0;
}

/// Reads the channels [c_begin, c_end) of the rows [y_begin, y_end), counted from the first, of a
/// picture without tiles. False after an error.
template <class T>
bool read_rows(OIIO::ImageInput& input, int y_begin, int y_end, int c_begin, int c_end, T* to) {
  constexpr OIIO::TypeDesc kType = OIIO::BaseTypeFromC<T>::value;
  const OIIO::ImageSpec& spec = input.spec();
  if (std::string(input.format_name()) != "tiff") {
    return input.read_scanlines(0, 0, spec.y + y_begin, spec.y + y_end, spec.z, c_begin, c_end,
                                kType, to);
  }
  // OpenImageIO hides errors of whole strips, which it inflates itself. Where single rows are asked
  // for, libtiff inflates them and tells.
  const auto stride = static_cast<std::size_t>(spec.nchannels);
  const auto wanted = static_cast<std::size_t>(c_end - c_begin);
  Array<T> row(static_cast<std::size_t>(spec.width) * stride);
  for (int y = y_begin; y < y_end; ++y) {
    if (!input.read_scanline(spec.y + y, spec.z, kType, row.data())) return false;
    for (const T* from = row.data() + c_begin; from < row.data() + row.size(); from += stride) {
      to = std::copy_n(from, wanted, to);
    }
  }
  return true;
}

/// Reads the pixels as T and converts them.
template <class T>
Image read_pixels(OIIO::ImageInput& input, const std::string& name, ImageForm form) {
  const OIIO::ImageSpec& spec = input.spec();
  const auto channels = static_cast<std::size_t>(spec.nchannels);
  const PixelSize size{static_cast<std::size_t>(spec.width), static_cast<std::size_t>(spec.height)};
  Array<T> pixels(size.width * size.height * channels);
  const bool good =
      spec.tile_width > 0
          ? input.read_image(0, 0, 0, spec.nchannels, OIIO::BaseTypeFromC<T>::value, pixels.data())
          : read_rows(input, 0, spec.height, 0, spec.nchannels, pixels.data());
  if (!good || input.has_error()) {
    throw_input(name, "damaged image: " + cause(input.geterror()));
  }
  const ColorChannels c = color_channels(spec.channelnames, spec.alpha_channel);
  return decoded_image(pixels.data(), {size, channels, c, has_associated_alpha(input, c)},
                       spec.channelnames, form);
}

/// Checks a JPEG stream before libjpeg opens it: libjpeg completes a cut one in grey and says
/// nothing, and takes memory for all pixels of a progressive one at once. In the coded data between
/// segments a 0xff is followed by 0, a restart marker or fill.
void check_jpeg(const InputFile& file) {
  // Markers, ITU-T T.81 table B.1.
  constexpr int kTemporary = 0x01, kFrame0 = 0xc0, kTables = 0xc4, kFrame15 = 0xcf,
                kRestart0 = 0xd0, kStart = 0xd8, kEnd = 0xd9, kFill = 0xff;
  const std::span<const std::byte> bytes = file.bytes();
  const auto at = [&](std::size_t i) { return std::to_integer<unsigned>(bytes[i]); };
  const auto number = [&](std::size_t i) { return std::size_t{at(i) << 8 | at(i + 1)}; };
  for (std::size_t i = 0; i + 1 < bytes.size();) {
    const auto marker = static_cast<int>(at(i + 1));
    if (at(i) != kFill || marker == kFill) {
      ++i;
    } else if (marker == kEnd) {
      return;
    } else if (marker <= kTemporary || (marker >= kRestart0 && marker <= kStart)) {
      i += 2;
    } else {
      if (i + 3 >= bytes.size()) break;
      // A frame's header: length, bits, height, width, components.
      const bool frame = marker >= kFrame0 && marker <= kFrame15 && marker != kTables;
      if (frame && i + 9 < bytes.size())
        check_claim({number(i + 7), number(i + 5)}, at(i + 9), file);
      i += 2 + number(i + 2);
    }
  }
  throw_input(file.name(), "damaged image: the JPEG data ends too early");
}

/// What the first box of JPEG 2000, and its codestream, begin with.
constexpr std::string_view kBoxOfJpeg2000("\0\0\0\x0cjP  ", 8);
constexpr std::string_view kStartOfJpeg2000 = "\xff\x4f\xff\x51";

/// Checks the codestream of JPEG 2000, which OpenImageIO decodes as it opens it: the whole file, or
/// the first box of its type, ITU-T T.800 annex I. It starts with SOC and SIZ: length and profile,
/// width, height, six more numbers and the components.
void check_jpeg_2000(const InputFile& file) {
  constexpr bool kSwapped = std::endian::native == std::endian::little;
  const std::span<const std::byte> bytes = file.bytes();
  std::size_t at = 0;
  bool found = as_text(bytes).starts_with(kStartOfJpeg2000);
  while (!found && bytes.size() - at >= 16) {
    std::uint64_t length = load_scalar<std::uint32_t, kSwapped>(bytes.data() + at);
    const bool wide = length == 1;
    if (wide) length = load_scalar<std::uint64_t, kSwapped>(bytes.data() + at + 8);
    found = as_text(bytes).substr(at + 4, 4) == "jp2c";
    if (!found && (length < 8 || length > bytes.size() - at)) break;
    at += found ? (wide ? 16 : 8) : length;
  }
  if (!found || !as_text(bytes).substr(at).starts_with(kStartOfJpeg2000) ||
      bytes.size() - at < 42) {
    throw_input(file.name(), "damaged image: the JPEG 2000 data does not begin with its size");
  }
  const std::byte* const size = bytes.data() + at;
  check_claim({load_scalar<std::uint32_t, kSwapped>(size + 8),
               load_scalar<std::uint32_t, kSwapped>(size + 12)},
              load_scalar<std::uint16_t, kSwapped>(size + 40), file);
}

/// Checks what OpenImageIO does not before it takes memory as it opens a file.
void check_content(const InputFile& file) {
  constexpr std::size_t kHead = 4096;
  constexpr bool kBigEndian = std::endian::native == std::endian::big;
  const std::string_view head = as_text(file.head(kHead));
  const auto* const bytes = reinterpret_cast<const std::byte*>(head.data());
  if (head.starts_with("\xff\xd8")) return check_jpeg(file);
  if (head.starts_with("GIF8") && head.size() >= 10) {
    check_claim({load_scalar<std::uint16_t, kBigEndian>(bytes + 6),
                 load_scalar<std::uint16_t, kBigEndian>(bytes + 8)},
                4, file);
  }
  if (head.starts_with(kBoxOfJpeg2000) || head.starts_with(kStartOfJpeg2000)) check_jpeg_2000(file);
  // HEIF, AVIF and films: OpenImageIO decodes them as it opens them, whatever they claim, and hands
  // out what lies behind the pixels where a box claims more of them than are coded.
  if (head.size() >= 8 && head.substr(4, 4) == "ftyp") {
    throw_input(file.name(),
                "is HEIF, AVIF or a film, which are not read; export it as PNG or JPEG");
  }
}

/// OpenImageIO's name of the format of bytes in memory, which it does not find out by itself; empty
/// for a format that is not known here.
std::string format_of(std::span<const std::byte> bytes) {
  const std::string_view start(reinterpret_cast<const char*>(bytes.data()),
                               std::min<std::size_t>(bytes.size(), 12));
  const std::string_view magic = start.substr(0, 4);
  if (magic == std::string_view("II*\0", 4) || magic == std::string_view("MM\0*", 4)) return "tiff";
  // A container of chunks, each after its length: WebP is the kind.
  if (magic == "RIFF" && start.ends_with("WEBP")) return "webp";
  if (start.starts_with("\xff\xd8")) return "jpeg";
  return start.starts_with("#?") ? "hdr" : "";
}

/// Opens standard input, a pipe or a file in memory, whose bytes `memory` reads.
std::unique_ptr<OIIO::ImageInput> open_piped(const InputFile& file, const OIIO::ImageSpec& hints,
                                             OIIO::Filesystem::IOMemReader& memory) {
  const std::string format = format_of(file.bytes());
  if (format.empty()) throw_input(file.name(), "is no PNG, EXR, TIFF, JPEG, WebP or HDR image");
  auto input = OIIO::ImageInput::create(format);
  OIIO::ImageSpec spec;
  if (!input || !input->set_ioproxy(&memory) || !input->open("memory", spec, hints)) {
    throw_input(file.name(), "cannot be read as an image: " +
                                 cause(input ? input->geterror() : OIIO::geterror()));
  }
  return input;
}

/// Opens a file by name.
std::unique_ptr<OIIO::ImageInput> open_file(const std::string& path, const OIIO::ImageSpec& hints) {
  auto input = OIIO::ImageInput::open(path, &hints);
  if (!input) {
    const std::string message = OIIO::geterror();
    const bool unknown = message.find("find a format reader") != std::string::npos;
    throw_input(path, unknown ? "is no image of a known format; use PNG, EXR, TIFF, JPEG or HDR"
                              : "cannot be read as an image: " + cause(message));
  }
  return input;
}

void check_flat(const OIIO::ImageSpec& spec, const std::string& path) {
  if (spec.width <= 0 || spec.height <= 0 || spec.nchannels <= 0 || spec.depth > 1) {
    throw_input(path, fmt::format("has {} x {} x {} pixels of {} channels; only flat pictures are "
                                  "read",
                                  spec.width, spec.height, spec.depth, spec.nchannels));
  }
}

/// A file that has been found to be a flat picture.
struct OpenedImage {
  OpenedImage(InputFile opened, const std::string& path, std::uint64_t most_megabytes)
      : file(std::move(opened)) {
    check_content(file);
    const OpeningSettings settings(most_megabytes);
    OIIO::ImageSpec hints;
    hints.attribute("oiio:UnassociatedAlpha", 1);
    // A pipe, which has been read, cannot be opened a second time.
    const bool named = path != "-" && file.regular();
    if (!named) memory.emplace(file.bytes().data(), file.bytes().size());
    input = named ? open_file(path, hints) : open_piped(file, hints, *memory);
    input->threads(thread_count());
    const OIIO::ImageSpec& spec = input->spec();
    check_flat(spec, file.name());
    const PixelSize size{static_cast<std::size_t>(spec.width),
                         static_cast<std::size_t>(spec.height)};
    check_pixel_count(size, file.name());
    check_claim(size, static_cast<double>(spec.pixel_bytes(true)), file);
  }

  InputFile file;
  std::optional<OIIO::Filesystem::IOMemReader> memory;  ///< Reads the bytes of no regular file.
  std::unique_ptr<OIIO::ImageInput> input;
};

class PluginReader final : public ImageReader {
 public:
  PluginReader(InputFile file, const std::string& path)
      : image_(std::move(file), path, kMostStreamedMegabytes),
        spec_(image_.input->spec()),
        channel_(color_channels(spec_.channelnames, spec_.alpha_channel)),
        associated_(has_associated_alpha(*image_.input, channel_)) {
    // Not every reader of OpenImageIO keeps to its limit.
    check_streamable(
        {static_cast<std::size_t>(spec_.width), static_cast<std::size_t>(spec_.height)},
        spec_.pixel_bytes(true), image_.file.name());
    const int alpha = channel_.alpha < 0 ? channel_.red : channel_.alpha;
    const auto [first, last] = std::minmax({channel_.red, channel_.green, channel_.blue, alpha});
    first_channel_ = first;
    channel_count_ = last + 1 - first;
    for (int* c : {&channel_.red, &channel_.green, &channel_.blue}) *c -= first;
    if (channel_.alpha >= 0) channel_.alpha -= first;
    layout_ = {.name = image_.file.name(),
               .width = spec_.width,
               .height = spec_.height,
               .alpha = channel_.alpha >= 0,
               .coded = !spec_.format.is_floating_point() && spec_.format.size() == 1,
               .piece_height = std::max(1, spec_.tile_width > 0 ? spec_.tile_height : 1)};
  }

  const Layout& layout() const override { return layout_; }

  void read(const Box& box, void* rgba) override {
    if (layout_.coded) {
      const Array<std::uint8_t> pixels = stored<std::uint8_t>(box);
      convert_to_coded(pixels.data(), layout_of(box), static_cast<std::uint8_t*>(rgba));
    } else if (spec_.format.is_floating_point()) {
      read_floats<float>(box, static_cast<float*>(rgba));
    } else {
      read_floats<std::uint16_t>(box, static_cast<float*>(rgba));
    }
  }

 private:
  StoredPixels layout_of(const Box& box) const {
    return {{box.width(), box.height()},
            static_cast<std::size_t>(channel_count_),
            channel_,
            associated_};
  }
  template <class T>
  void read_floats(const Box& box, float* rgba) {
    convert_to_rgba(stored<T>(box).data(), layout_of(box), false, rgba);
  }

  /// The box's channels from first_channel_ on. Tiles are read whole, and cut.
  template <class T>
  Array<T> stored(const Box& box) {
    const bool tiled = spec_.tile_width > 0;
    const int tile_width = tiled ? spec_.tile_width : spec_.width;
    const int tile_height = tiled ? spec_.tile_height : 1;
    const auto up = [](int i, int step, int most) {
      return static_cast<int>(
          std::min<std::int64_t>((i + std::int64_t{step} - 1) / step * step, most));
    };
    const Box whole{box.x_begin / tile_width * tile_width, up(box.x_end, tile_width, spec_.width),
                    box.y_begin / tile_height * tile_height,
                    up(box.y_end, tile_height, spec_.height)};
    const auto channels = static_cast<std::size_t>(channel_count_);
    Array<T> pixels(whole.pixels() * channels);
    const int channel_end = first_channel_ + channel_count_;
    constexpr OIIO::TypeDesc kType = OIIO::BaseTypeFromC<T>::value;
    OIIO::ImageInput& input = *image_.input;
    const bool good =
        tiled ? input.read_tiles(0, 0, spec_.x + whole.x_begin, spec_.x + whole.x_end,
                                 spec_.y + whole.y_begin, spec_.y + whole.y_end, spec_.z,
                                 spec_.z + 1, first_channel_, channel_end, kType, pixels.data())
              : read_rows(input, whole.y_begin, whole.y_end, first_channel_, channel_end,
                          pixels.data());
    if (!good || input.has_error())
      throw_input(layout_.name, "damaged image: " + cause(input.geterror()));
    const std::size_t row = box.width() * channels;
    const std::size_t whole_row = whole.width() * channels;
    if (row == whole_row && box.y_begin == whole.y_begin) return pixels;
    T* from = pixels.data() + static_cast<std::size_t>(box.y_begin - whole.y_begin) * whole_row +
              static_cast<std::size_t>(box.x_begin - whole.x_begin) * channels;
    for (std::size_t y = 0; y < box.height(); ++y) {
      std::copy_n(from + y * whole_row, row, pixels.data() + y * row);
    }
    return pixels;
  }

  OpenedImage image_;
  const OIIO::ImageSpec spec_;
  ColorChannels channel_;  ///< Counted from first_channel_.
  bool associated_;
  int first_channel_ = 0;
  int channel_count_ = 0;
  Layout layout_;
};

// ---------------------------------------------------------------------------------------------
// Writing

/// Pixels that a format stores.
enum class Encoding {
  kFloatColor,  ///< Linear, premultiplied, R G B.
  kStraight8,   ///< sRGB, straight alpha; the alpha is left out where it is 1 everywhere.
  kColor8       ///< sRGB of the premultiplied colour: the picture over black.
};

Encoding encoding_of(const OIIO::ImageOutput& output) {
  const std::string format = output.format_name();
  if (format == "hdr") return Encoding::kFloatColor;
  return output.supports("alpha") ? Encoding::kStraight8 : Encoding::kColor8;
}

std::vector<std::uint8_t> encode_color8(const Image& image) {
  const ColorChannels c = color_channels(image);
  return convert_pixels<std::uint8_t>(image, 3, [&](const float* in, std::uint8_t* out) {
    out[0] = linear_to_srgb8(in[c.red]);
    out[1] = linear_to_srgb8(in[c.green]);
    out[2] = linear_to_srgb8(in[c.blue]);
  });
}

std::vector<float> select_color(const Image& image) {
  const ColorChannels c = color_channels(image);
  return convert_pixels<float>(image, 3, [&](const float* in, float* out) {
    out[0] = in[c.red];
    out[1] = in[c.green];
    out[2] = in[c.blue];
  });
}

void describe(OIIO::ImageSpec& spec, Encoding encoding, const ImageWriteOptions& options) {
  spec.attribute("oiio:ColorSpace", encoding == Encoding::kFloatColor ? "Linear" : "sRGB");
  if (encoding == Encoding::kStraight8) spec.attribute("oiio:UnassociatedAlpha", 1);
  for (const auto& [key, value] : options.metadata) spec.attribute(key, value);
  spec.attribute("png:compressionLevel", kPngCompressionLevel);
  spec.attribute("png:filter", kPngFilter);
  // Without it, OpenImageIO stamps the current time.
  spec.attribute("DateTime", "");
  // libtiff has to read a file back to append Exif tags, which output in memory does not allow.
  spec.attribute("tiff:write_exif", 0);
}

/// The writer for a path's extension. Only writers into memory are taken:
/// the bytes then go through OutputFile, which notices a full disk (libjpeg would end the process).
std::unique_ptr<OIIO::ImageOutput> make_output(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  auto output = extension.size() > 1 ? OIIO::ImageOutput::create(extension.substr(1)) : nullptr;
  const bool exr = output && output->format_name() == std::string_view("openexr");
  if (!output || exr || !output->supports("ioproxy")) {
    OIIO::geterror();
    const std::string as =
        extension.empty() ? "to a name without extension" : "as '" + extension + "'";
    throw_usage(path + ": images are not written " + as +
                "; use .png, .exr, .tif, .jpg, .hdr, .bmp, .tga, .webp or .ppm");
  }
  return output;
}

/// Encodes pixels of T into the bytes of a file.
template <class T>
std::vector<unsigned char> encode_file(OIIO::ImageOutput& output, OIIO::ImageSpec spec,
                                       const T* pixels, const std::string& path) {
  OIIO::Filesystem::IOVecOutput memory;
  spec.set_format(OIIO::BaseTypeFromC<T>::value);
  bool written = output.set_ioproxy(&memory);
  {
    const OpeningSettings settings(most_megabytes());
    written = written && output.open("memory", spec);
  }
  written = written && output.write_image(OIIO::BaseTypeFromC<T>::value, pixels);
  // libtiff's failures at the end are known by the message alone.
  if (!output.close() || !written || output.has_error()) {
    throw_io(path, "cannot be written: " + cause(output.geterror()));
  }
  return memory.buffer();
}

std::vector<unsigned char> encode_image(OIIO::ImageOutput& output, const Image& image,
                                        const std::string& path, const ImageWriteOptions& options) {
  const Encoding encoding = encoding_of(output);
  const bool with_alpha =
      encoding == Encoding::kStraight8 && !is_opaque(image, color_channels(image).alpha);
  OIIO::ImageSpec spec(image.width, image.height, with_alpha ? 4 : 3);
  describe(spec, encoding, options);
  switch (encoding) {
    case Encoding::kFloatColor:
      return encode_file(output, spec, select_color(image).data(), path);
    case Encoding::kStraight8:
      return encode_file(output, spec, encode_straight8(image, with_alpha).data(), path);
    case Encoding::kColor8:
      spec.attribute("CompressionQuality", 95);
      spec.attribute("jpeg:subsampling", "4:4:4");
      return encode_file(output, spec, encode_color8(image).data(), path);
  }
  return {};
}

}  // namespace
}  // namespace surfel

extern "C" {

SURFEL_API void surfel_image_plugin_read(surfel::InputFile& file, const std::string& path,
                                         surfel::ImageForm form, surfel::Image& image) {
  using namespace surfel;
  const OpenedImage opened(std::move(file), path, most_megabytes());
  OIIO::ImageInput& input = *opened.input;
  const std::string& name = opened.file.name();
  const OIIO::ImageSpec& spec = input.spec();
  check_fits({static_cast<std::size_t>(spec.width), static_cast<std::size_t>(spec.height)},
             spec.nchannels, name);
  if (spec.format.is_floating_point()) {
    image = read_pixels<float>(input, name, form);
  } else if (spec.format.size() == 1) {
    image = read_pixels<std::uint8_t>(input, name, form);
  } else {
    image = read_pixels<std::uint16_t>(input, name, form);
  }
}

SURFEL_API void surfel_image_plugin_open(surfel::InputFile& file, const std::string& path,
                                         std::shared_ptr<surfel::ImageReader>& reader) {
  reader = std::make_shared<surfel::PluginReader>(std::move(file), path);
}

SURFEL_API void surfel_image_plugin_write(const surfel::Image& image, const std::string& path,
                                          const surfel::ImageWriteOptions& options) {
  using namespace surfel;
  const auto output = make_output(path);
  output->threads(thread_count());
  // Before the work is done, so that a target that cannot be written is found at once.
  OutputFile file(path, options.no_clobber);
  std::vector<unsigned char> bytes = encode_image(*output, image, path, options);
  if (options.map && output->format_name() == std::string_view("tiff")) {
    add_geo_tags(bytes, *options.map, path);
  }
  file.write(bytes.data(), bytes.size());
  file.commit();
}

SURFEL_API void surfel_image_plugin_alpha(const std::string& path, bool& alpha) {
  using namespace surfel;
  alpha = encoding_of(*make_output(path)) == Encoding::kStraight8;
}

}  // extern "C"
