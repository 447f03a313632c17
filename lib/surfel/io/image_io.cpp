#include <algorithm>
#include <atomic>
#include <filesystem>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/base/plugin.h>
#include <surfel/io/image_io.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/input_file.h>
#include <surfel/io/png_reader.h>
#include <surfel/io/png_writer.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

std::atomic<std::uint64_t> g_most_pixels{std::uint64_t{1} << 31};

/// Of a file that is written as PNG, without a plug-in: so are pipes and devices (/dev/null) whose
/// names tell no format.
bool is_png_name(const std::string& path) {
  const std::string extension = lower_extension(path);
  std::error_code error;
  return path == "-" || extension == ".png" ||
         (extension.empty() && std::filesystem::is_other(path, error));
}

bool is_exr_name(const std::string& path) { return lower_extension(path) == ".exr"; }

/// The plug-in that reads the file.
const char* plugin_of(const InputFile& file) { return is_exr(file) ? "exr" : "image"; }

Image read_form(InputFile file, const std::string& path, ImageForm form) {
  if (is_png(file)) return read_png(std::move(file), form);
  Image image;
  const auto read =
      reinterpret_cast<ReadImageFunction*>(plugin_symbol(plugin_of(file), kReadImageSymbol));
  read(file, path, form, image);
  return image;
}

std::shared_ptr<ImageReader> open_any(InputFile file, const std::string& path) {
  if (is_png(file)) return open_png(std::move(file));
  const auto open =
      reinterpret_cast<OpenImageFunction*>(plugin_symbol(plugin_of(file), kOpenImageSymbol));
  std::shared_ptr<ImageReader> reader;
  open(file, path, reader);
  return reader;
}

}  // namespace

std::uint64_t most_image_pixels() noexcept { return g_most_pixels; }

void set_most_image_pixels(std::uint64_t pixels) noexcept {
  g_most_pixels = std::max<std::uint64_t>(1, pixels);
}

Image read_image(const std::string& path, bool raw) {
  return read_form(InputFile(path), path, raw ? ImageForm::kRaw : ImageForm::kStraight);
}

Image read_image(InputFile file, bool raw) {
  const std::string name = file.name();
  return read_form(std::move(file), name, raw ? ImageForm::kRaw : ImageForm::kStraight);
}

Image read_data_image(const std::string& path) {
  return read_form(InputFile(path), path, ImageForm::kData);
}

Image read_data_image(InputFile file) {
  const std::string name = file.name();
  return read_form(std::move(file), name, ImageForm::kData);
}

Image read_premultiplied_image(const std::string& path) {
  return read_form(InputFile(path), path, ImageForm::kPremultiplied);
}

std::shared_ptr<ImageReader> open_image(const std::string& path) {
  return open_any(InputFile(path), path);
}

std::shared_ptr<ImageReader> open_image(InputFile file) {
  const std::string name = file.name();
  return open_any(std::move(file), name);
}

void write_image(const Image& image, const std::string& path, const ImageWriteOptions& options) {
  const std::size_t values = static_cast<std::size_t>(std::max(0, image.width)) *
                             static_cast<std::size_t>(std::max(0, image.height)) *
                             image.channels.size();
  if (values == 0 || values != image.data.size()) {
    throw_usage(path + ": an image without pixels cannot be written");
  }
  if (is_png_name(path)) {
    // Opened before the work, so that a target that cannot be written is found at once.
    OutputFile file(path, options.no_clobber);
    const std::vector<unsigned char> bytes = encode_png(image, options);
    file.write(bytes.data(), bytes.size());
    file.commit();
    return;
  }
  const char* const plugin = is_exr_name(path) ? "exr" : "image";
  const auto write =
      reinterpret_cast<WriteImageFunction*>(plugin_symbol(plugin, kWriteImageSymbol));
  write(image, path, options);
}

bool image_format_has_alpha(const std::string& path) {
  if (is_png_name(path) || is_exr_name(path)) return true;
  const auto ask = reinterpret_cast<ImageAlphaFunction*>(plugin_symbol("image", kImageAlphaSymbol));
  bool alpha = false;
  ask(path, alpha);
  return alpha;
}

}  // namespace surfel
