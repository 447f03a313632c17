// OpenEXR pictures. OpenImageIO reads and writes them too, but takes 60 to 90 times as long to load
// as OpenEXR itself.

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <exception>
#include <memory>
#include <mutex>
#include <numeric>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfMatrixAttribute.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <ImfTileDescription.h>
#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/parallel.h>
#include <surfel/base/types.h>
#include <surfel/io/exr_header.h>
#include <surfel/io/image_decoding.h>
#include <surfel/io/image_encoding.h>
#include <surfel/io/image_io.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/input_file.h>

namespace surfel {
namespace {

/// OpenEXR's threads, which the whole process and so the program shares: there are as many as
/// Surfelkit has while this object lives, and as many as before after that.
class WorkingThreads {
 public:
  WorkingThreads() : lock_(mutex()), before_(Imf::globalThreadCount()) {
    try {
      Imf::setGlobalThreadCount(thread_count() > 1 ? thread_count() : 0);
    } catch (const std::exception&) {
      // Where no thread can be started, the calling one does the work.
    }
  }
  ~WorkingThreads() {
    try {
      Imf::setGlobalThreadCount(before_);
    } catch (const std::exception&) {
      // The program has fewer threads from here on, which is no error of the picture.
    }
  }
  WorkingThreads(const WorkingThreads&) = delete;
  WorkingThreads& operator=(const WorkingThreads&) = delete;

 private:
  static std::mutex& mutex() {
    static std::mutex instance;
    return instance;
  }

  std::lock_guard<std::mutex> lock_;
  int before_;
};

/// OpenEXR's message up to the end of its first line, without a full stop.
std::string cause(const std::exception& error) {
  const std::string_view text = error.what();
  std::string_view line = text.substr(0, text.find('\n'));
  while (line.ends_with('.')) line.remove_suffix(1);
  return line.empty() ? "unknown cause" : std::string(line);
}

// ---------------------------------------------------------------------------------------------
// Reading

class FileStream final : public Imf::IStream {
 public:
  explicit FileStream(const InputFile& file) : Imf::IStream(file.name().c_str()), file_(file) {}

  bool read(char* to, int count) override {
    const auto size = static_cast<std::size_t>(count);
    if (at_ > file_.size() || size > file_.size() - at_) {
      throw Iex::InputExc("the file ends too early");
    }
    std::memcpy(to, file_.read_at(at_, size, scratch_), size);
    at_ += size;
    return at_ < file_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t position) override { at_ = position; }

 private:
  const InputFile& file_;
  Array<std::byte> scratch_;
  std::uint64_t at_ = 0;
};

/// Throws Error(kInput) where the picture is larger than may be read, or than the file can hold:
/// OpenEXR takes memory for rows that are compressed together when it opens the file.
void check_header(const InputFile& file) {
  const std::optional<ExrSize> exr = exr_size(file);
  if (!exr) return;
  if (exr->damaged) {
    throw_input(file.name(),
                "damaged image: an attribute of its header has another length than its value; "
                "export it again");
  }
  check_pixel_count(exr->pixels, file.name());
  check_promise(exr->pixels, exr->pixel_bytes, exr->best_ratio, file.size(), file.name());
}

/// Where a channel stands among the others: by its layer, within a layer R G B A first, and grey Y
/// before its A.
auto channel_order(const std::string& name) {
  const std::size_t dot = name.rfind('.');
  const std::string layer = dot == std::string::npos ? "" : name.substr(0, dot);
  const std::string last = dot == std::string::npos ? name : name.substr(dot + 1);
  const std::string_view first = layer.empty() ? "RGBYA" : "RGBA";
  const std::size_t rank = last.size() == 1 ? first.find(last) : std::string_view::npos;
  return std::tuple(layer, rank, last);
}

/// The pixels of an EXR file's first picture.
class ExrFile {
 public:
  explicit ExrFile(InputFile file) : file_(std::make_unique<InputFile>(std::move(file))) {
    check_header(*file_);
    try {
      stream_ = std::make_unique<FileStream>(*file_);
      input_ = std::make_unique<Imf::InputFile>(*stream_, thread_count());
    } catch (const Iex::BaseExc& error) {
      throw_input(name(), "cannot be read as an image: " + cause(error));
    }
    const Imf::ChannelList& channels = header().channels();
    for (auto i = channels.begin(); i != channels.end(); ++i) {
      if (i.channel().xSampling != 1 || i.channel().ySampling != 1) {
        throw_input(name(), fmt::format("its channel {} has fewer pixels than the picture; export "
                                        "it as R, G and B",
                                        i.name()));
      }
      names_.emplace_back(i.name());
    }
    std::sort(names_.begin(), names_.end(), [](const std::string& a, const std::string& b) {
      return channel_order(a) < channel_order(b);
    });
    if (names_.empty()) throw_input(name(), "has no channels");
    check_pixel_count(size(), name());
  }

  const std::string& name() const { return file_->name(); }
  const Imf::Header& header() const { return input_->header(); }
  const std::vector<std::string>& names() const { return names_; }
  PixelSize size() const {
    const Imath::Box2i& window = header().dataWindow();
    return {static_cast<std::size_t>(std::int64_t{window.max.x} - window.min.x + 1),
            static_cast<std::size_t>(std::int64_t{window.max.y} - window.min.y + 1)};
  }
  /// Rows that are stored together.
  int piece_height() const {
    return header().hasTileDescription() ? static_cast<int>(header().tileDescription().ySize) : 1;
  }
  ColorChannels colors() const {
    const auto alpha = std::find_if(names_.begin(), names_.end(), [](const std::string& n) {
      return n == "A" || n.ends_with(".A");
    });
    return color_channels(names_,
                          alpha == names_.end() ? -1 : static_cast<int>(alpha - names_.begin()));
  }

  /// Those channels of the rows [begin, end), pixel by pixel; row 0 is the first that is stored.
  Array<float> rows(std::size_t begin, std::size_t end, const std::vector<int>& channels) {
    Array<float> pixels((end - begin) * size().width * channels.size());
    const Imath::Box2i& window = header().dataWindow();
    const int first = window.min.y + static_cast<int>(begin);
    const int last = window.min.y + static_cast<int>(end) - 1;
    const Imath::Box2i box({window.min.x, first}, {window.max.x, last});
    Imf::FrameBuffer buffer;
    for (std::size_t i = 0; i < channels.size(); ++i) {
      const std::string& channel = names_[static_cast<std::size_t>(channels[i])];
      buffer.insert(channel, Imf::Slice::Make(Imf::FLOAT, pixels.data() + i, box,
                                              channels.size() * sizeof(float),
                                              channels.size() * sizeof(float) * size().width));
    }
    try {
      const WorkingThreads threads;
      input_->setFrameBuffer(buffer);
      input_->readPixels(first, last);
    } catch (const Iex::BaseExc& error) {
      throw_input(name(), "damaged image: " + cause(error));
    }
    return pixels;
  }

  Image read(ImageForm form) {
    const PixelSize all = size();
    check_fits(all, static_cast<int>(names_.size()), name());
    std::vector<int> channels(names_.size());
    std::iota(channels.begin(), channels.end(), 0);
    const Array<float> pixels = rows(0, all.height, channels);
    const ColorChannels c = colors();
    return decoded_image(pixels.data(), {all, names_.size(), c, is_associated(c)}, names_, form);
  }

  /// Colours are multiplied by alpha, where there are both.
  static bool is_associated(const ColorChannels& c) { return c.alpha >= 0 && c.alpha != c.red; }

 private:
  std::unique_ptr<InputFile> file_;  ///< The stream keeps its address.
  std::unique_ptr<FileStream> stream_;
  std::unique_ptr<Imf::InputFile> input_;
  std::vector<std::string> names_;
};

class ExrReader final : public ImageReader {
 public:
  explicit ExrReader(InputFile file) : file_(std::move(file)) {
    check_streamable(file_.size(), file_.names().size() * sizeof(float), file_.name());
    const ColorChannels c = file_.colors();
    colors_ = {taken(c.red), taken(c.green), taken(c.blue), c.alpha < 0 ? -1 : taken(c.alpha)};
    layout_ = {.name = file_.name(),
               .width = static_cast<int>(file_.size().width),
               .height = static_cast<int>(file_.size().height),
               .alpha = c.alpha >= 0,
               .coded = false,
               .piece_height = file_.piece_height()};
  }

  const Layout& layout() const override { return layout_; }

  void read(const Box& box, void* rgba) override {
    Array<float> pixels = file_.rows(static_cast<std::size_t>(box.y_begin),
                                     static_cast<std::size_t>(box.y_end), channels_);
    const std::size_t stride = channels_.size();
    const float* from = pixels.data() + static_cast<std::size_t>(box.x_begin) * stride;
    for (std::size_t y = 0; y < box.height(); ++y, from += file_.size().width * stride) {
      std::copy_n(from, box.width() * stride, pixels.data() + y * box.width() * stride);
    }
    const StoredPixels stored{
        {box.width(), box.height()}, stride, colors_, ExrFile::is_associated(colors_)};
    convert_to_rgba(pixels.data(), stored, false, static_cast<float*>(rgba));
  }

 private:
  /// Where a channel of the file stands among the channels that are read.
  int taken(int channel) {
    auto found = std::find(channels_.begin(), channels_.end(), channel);
    if (found == channels_.end()) found = channels_.insert(channels_.end(), channel);
    return static_cast<int>(found - channels_.begin());
  }

  ExrFile file_;
  std::vector<int> channels_;  ///< The channels that are read.
  ColorChannels colors_{};     ///< Counted among channels_.
  Layout layout_;
};

// ---------------------------------------------------------------------------------------------
// Writing

/// The bytes of a file. They are kept in memory, so that OutputFile writes them, which notices a
/// full disk.
class MemoryStream final : public Imf::OStream {
 public:
  explicit MemoryStream(const std::string& name) : Imf::OStream(name.c_str()) {}

  void write(const char* from, int count) override {
    const auto size = static_cast<std::size_t>(count);
    if (bytes.size() < at_ + size) bytes.resize(at_ + size);
    std::memcpy(bytes.data() + at_, from, size);
    at_ += size;
  }
  std::uint64_t tellp() override { return at_; }
  void seekp(std::uint64_t position) override { at_ = position; }

  std::vector<char> bytes;

 private:
  std::uint64_t at_ = 0;
};

/// OpenEXR's matrices act on row vectors: the attribute is the transpose of our matrix.
constexpr char kWorldToCamera[] = "worldToCamera";

Imf::Header header_of(const Image& image, const ImageWriteOptions& options) {
  const RowsOfPicture rows = options.rows_of.value_or(RowsOfPicture{0, image.height});
  const Imath::Box2i display({0, 0}, {image.width - 1, rows.height - 1});
  const Imath::Box2i data({0, rows.first_row},
                          {image.width - 1, rows.first_row + image.height - 1});
  Imf::Header header(display, data);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [key, value] : options.metadata) {
    header.insert(key, Imf::StringAttribute(value));
  }
  if (options.world_to_camera.size() == 16) {
    Imath::M44f matrix;
    for (int k = 0; k < 16; ++k) {
      matrix[k % 4][k / 4] = options.world_to_camera[static_cast<std::size_t>(k)];
    }
    header.insert(kWorldToCamera, Imf::M44fAttribute(matrix));
  }
  for (const std::string& channel : image.channels) {
    header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
  }
  return header;
}

std::vector<char> encode_exr(const Image& image, const std::string& path,
                             const ImageWriteOptions& options) {
  try {
    const Imf::Header header = header_of(image, options);
    Imf::FrameBuffer buffer;
    const std::size_t stride = image.channels.size() * sizeof(float);
    for (std::size_t i = 0; i < image.channels.size(); ++i) {
      buffer.insert(image.channels[i],
                    Imf::Slice::Make(Imf::FLOAT, image.data.data() + i, header.dataWindow(), stride,
                                     stride * static_cast<std::size_t>(image.width)));
    }
    MemoryStream stream(path);
    {
      const WorkingThreads threads;
      Imf::OutputFile output(stream, header, thread_count());
      output.setFrameBuffer(buffer);
      output.writePixels(image.height);
    }
    return std::move(stream.bytes);
  } catch (const Iex::BaseExc& error) {
    throw_io(path, "cannot be written: " + cause(error));
  }
}

}  // namespace
}  // namespace surfel

extern "C" {

SURFEL_API void surfel_image_plugin_read(surfel::InputFile& file, const std::string& /*path*/,
                                         surfel::ImageForm form, surfel::Image& image) {
  image = surfel::ExrFile(std::move(file)).read(form);
}

SURFEL_API void surfel_image_plugin_read_window(surfel::InputFile& file, surfel::ExrWindow& window,
                                                surfel::Image& image) {
  using namespace surfel;
  ExrFile exr(std::move(file));
  const Imf::Header& header = exr.header();
  const Imath::Box2i& data = header.dataWindow();
  const Imath::Box2i& display = header.displayWindow();
  if (data.min.x != display.min.x || data.max.x != display.max.x || data.min.y < display.min.y ||
      data.max.y > display.max.y) {
    throw_input(exr.name(), "its data window is not some of the rows of its display window");
  }
  window.first_row = data.min.y - display.min.y;
  window.height = display.max.y - display.min.y + 1;
  check_pixel_count({exr.size().width, static_cast<std::size_t>(window.height)}, exr.name());
  for (auto i = header.begin(); i != header.end(); ++i) {
    const std::string key = i.name();
    if (const auto* text = dynamic_cast<const Imf::StringAttribute*>(&i.attribute())) {
      // OpenEXR gives every picture a type as it reads it.
      if (key != "type") window.metadata.emplace_back(key, text->value());
    } else if (key == kWorldToCamera) {
      const auto* matrix = dynamic_cast<const Imf::M44fAttribute*>(&i.attribute());
      if (!matrix) continue;
      for (int k = 0; k < 16; ++k) {
        window.world_to_camera.push_back(matrix->value()[k % 4][k / 4]);
      }
    }
  }
  image = exr.read(ImageForm::kRaw);
}

SURFEL_API void surfel_image_plugin_open(surfel::InputFile& file, const std::string& /*path*/,
                                         std::shared_ptr<surfel::ImageReader>& reader) {
  reader = std::make_shared<surfel::ExrReader>(std::move(file));
}

SURFEL_API void surfel_image_plugin_write(const surfel::Image& image, const std::string& path,
                                          const surfel::ImageWriteOptions& options) {
  using namespace surfel;
  // Before the work is done, so that a target that cannot be written is found at once.
  OutputFile file(path, options.no_clobber);
  const std::vector<char> bytes = encode_exr(image, path, options);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

}  // extern "C"
