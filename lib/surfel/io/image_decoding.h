#pragma once

// Conversion from the pixels that files store to pictures. Internal to the io module.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/io/image_encoding.h>
#include <surfel/io/image_plugin.h>
#include <surfel/io/surfel_decoder.h>
#include <surfel/scene/image.h>

namespace surfel {

/// 256 GB of pixels: larger images are taken for damaged headers.
inline constexpr std::uint64_t kMostStreamedMegabytes = 1 << 18;

/// Throws Error(kInput) where an image has more pixels than may be read.
inline void check_pixel_count(PixelSize size, const std::string& name) {
  const std::uint64_t most = most_image_pixels();
  if (size.width == 0 || size.height <= most / size.width) return;
  throw_input(name, fmt::format("{} x {} pixels are more than the {} of `max_pixels`; scale the "
                                "picture down or raise `max_pixels`",
                                size.width, size.height, most));
}

/// Throws Error(kInput) where an image that is streamed has more pixels than the above, or
/// more than may be read.
inline void check_streamable(PixelSize size, std::size_t pixel_bytes, const std::string& name) {
  check_pixel_count(size, name);
  const double bytes = static_cast<double>(size.width) * static_cast<double>(size.height) *
                       static_cast<double>(pixel_bytes);
  if (bytes > 0x1p20 * static_cast<double>(kMostStreamedMegabytes)) {
    throw_input(name, fmt::format("{} x {} pixels of {} bytes are too many", size.width,
                                  size.height, pixel_bytes));
  }
}

/// Throws Error(kInput) where an image does not fit into memory, as the file stores it and as
/// floats.
inline void check_fits(PixelSize size, int channels, const std::string& name) {
  check_pixel_count(size, name);
  const double bytes = static_cast<double>(size.width) * static_cast<double>(size.height) *
                       std::max(4, channels) * 2 * sizeof(float);
  const auto wanted = static_cast<std::uint64_t>(std::min(bytes, 0x1p63));
  if (bytes > static_cast<double>(available_memory_for(wanted))) {
    throw_input(name, fmt::format("{} x {} pixels of {} channels do not fit into memory",
                                  size.width, size.height, channels));
  }
}

/// Throws Error(kInput) where a picture's header claims more bytes of pixels than its file can
/// hold, each byte of which stands for `best_ratio` at most.
inline void check_promise(PixelSize size, double pixel_bytes, double best_ratio,
                          std::size_t file_bytes, const std::string& name) {
  const double bytes =
      static_cast<double>(size.width) * static_cast<double>(size.height) * pixel_bytes;
  if (bytes <= best_ratio * static_cast<double>(file_bytes)) return;
  throw_input(name, fmt::format("damaged image: {} x {} pixels are more than {} bytes can hold; it "
                                "is truncated or its header is wrong",
                                size.width, size.height, file_bytes));
}

/// One value as a fraction of full scale, still encoded.
inline float fraction(std::uint8_t value) { return static_cast<float>(value) / 255.0f; }
inline float fraction(std::uint16_t value) { return static_cast<float>(value) / 65535.0f; }
inline float fraction(float value) { return value; }

/// One colour value in linear light.
inline float linear(std::uint8_t value) { return srgb8_to_linear(value); }
inline float linear(std::uint16_t value) {
  static const float* const table = srgb16_table();
  return table[value];
}
inline float linear(float value) { return value; }

template <class T>
T divided(T value, T alpha) {
  if constexpr (std::is_floating_point_v<T>) {
    return value / alpha;
  } else {
    constexpr unsigned kFull = std::numeric_limits<T>::max();
    return static_cast<T>(std::min(kFull, (value * kFull + alpha / 2u) / alpha));
  }
}

/// Colour with its alpha divided out, linear. Integer formats multiplied the encoded value, so they
/// are divided before they are decoded. Where alpha is zero the colour stays as stored: environment
/// maps come with an empty alpha channel.
template <class T>
float straight(T value, T alpha) {
  return linear(alpha > T{} ? divided(value, alpha) : value);
}

/// Layout of a file's pixels in memory.
struct StoredPixels {
  PixelSize size;
  std::size_t stride;  ///< Number of channels of a pixel.
  ColorChannels channel;
  bool associated;  ///< Colours are multiplied by alpha.
};

/// Converts pixels to R G B A.
template <class T>
void convert_to_rgba(const T* in, const StoredPixels& stored, bool premultiply, float* rgba) {
  const ColorChannels c = stored.channel;
  // Premultiplied floats are linear as they are: to divide and multiply them again would lose bits,
  // and the light where alpha is zero.
  const bool as_stored = premultiply && stored.associated && std::is_floating_point_v<T>;
  const bool divide = stored.associated && !as_stored;
  const bool multiply = premultiply && !as_stored;
  for_each_pixel(stored.size, in, stored.stride, rgba, 4, [&](const T* p, float* out) {
    const std::array<T, 3> rgb{p[c.red], p[c.green], p[c.blue]};
    out[3] = c.alpha >= 0 ? fraction(p[c.alpha]) : 1.0f;
    for (std::size_t i = 0; i < 3; ++i) {
      out[i] = divide ? straight(rgb[i], p[c.alpha]) : linear(rgb[i]);
      if (multiply) out[i] *= out[3];
    }
  });
}

/// Converts pixels to R G B A of 8 bits, R G B still encoded and straight.
inline void convert_to_coded(const std::uint8_t* in, const StoredPixels& stored,
                             std::uint8_t* rgba) {
  const ColorChannels c = stored.channel;
  const auto convert = [&](const std::uint8_t* p, std::uint8_t* out) {
    const std::array<std::uint8_t, 3> rgb{p[c.red], p[c.green], p[c.blue]};
    out[3] = c.alpha >= 0 ? p[c.alpha] : std::numeric_limits<std::uint8_t>::max();
    for (std::size_t i = 0; i < 3; ++i) {
      out[i] = stored.associated && out[3] > 0 ? divided(rgb[i], out[3]) : rgb[i];
    }
  };
  for_each_pixel(stored.size, in, stored.stride, rgba, 4, convert);
}

/// The picture of a file's pixels, in the form asked for. `names` are the names of the channels.
template <class T>
Image decoded_image(const T* pixels, const StoredPixels& stored,
                    const std::vector<std::string>& names, ImageForm form) {
  const auto width = static_cast<int>(stored.size.width);
  const auto height = static_cast<int>(stored.size.height);
  if (form == ImageForm::kStraight || form == ImageForm::kPremultiplied) {
    Image image = rgba_image(width, height);
    convert_to_rgba(pixels, stored, form == ImageForm::kPremultiplied, image.data.data());
    return image;
  }
  Image image{width, height, names, {}};
  image.data.resize(stored.size.width * stored.size.height * stored.stride);
  const int alpha = stored.channel.alpha;
  const auto decode = [&](const T* in, float* out) {
    for (int k = 0; k < static_cast<int>(stored.stride); ++k) {
      out[k] = form == ImageForm::kData || k == alpha ? fraction(in[k]) : linear(in[k]);
    }
  };
  for_each_pixel(stored.size, pixels, stored.stride, image.data.data(), stored.stride, decode);
  return image;
}

}  // namespace surfel
