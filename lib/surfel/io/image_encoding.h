#pragma once

// Conversion between pictures and the pixels that files store. Internal to the io module.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/image.h>

namespace surfel {

/// Rows that one thread converts at a time: enough to hide the cost of handing out work.
constexpr std::size_t kRowsPerRange = 16;

/// Which stored channels become R, G, B and A; alpha is -1 where there is none.
struct ColorChannels {
  int red, green, blue, alpha;
};

inline int find_channel(const std::vector<std::string>& names, const char* name) {
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

/// Finds R, G and B by name. If a name is missing, three or more colour channels are taken in their
/// order; one or two are grey.
inline ColorChannels color_channels(const std::vector<std::string>& names, int alpha) {
  ColorChannels c{find_channel(names, "R"), find_channel(names, "G"), find_channel(names, "B"),
                  alpha >= 0 ? alpha : find_channel(names, "A")};
  if (c.red >= 0 && c.green >= 0 && c.blue >= 0) return c;
  std::vector<int> colors;
  for (int i = 0; i < static_cast<int>(names.size()); ++i) {
    if (i != c.alpha) colors.push_back(i);
  }
  if (colors.empty()) colors.push_back(c.alpha);
  const bool grey = colors.size() < 3;
  c.red = colors[0];
  c.green = grey ? colors[0] : colors[1];
  c.blue = grey ? colors[0] : colors[2];
  return c;
}

inline ColorChannels color_channels(const Image& image) {
  return color_channels(image.channels, find_channel(image.channels, "A"));
}

/// Alpha as a byte; NaN becomes 0.
inline std::uint8_t alpha8(float alpha) {
  return static_cast<std::uint8_t>((alpha > 0 ? std::min(alpha, 1.0f) : 0.0f) * 255.0f + 0.5f);
}

inline bool is_opaque(const Image& image, int alpha) {
  if (alpha < 0) return true;
  const std::size_t stride = image.channels.size();
  for (std::size_t i = static_cast<std::size_t>(alpha); i < image.data.size(); i += stride) {
    if (alpha8(image.data[i]) != 255) return false;
  }
  return true;
}

/// Width and height in pixels.
struct PixelSize {
  std::size_t width, height;
};

/// Calls convert(in, out) for every pixel. A pixel takes `in_stride` values of In and `out_stride`
/// values of Out.
template <class In, class Out, class Convert>
void for_each_pixel(PixelSize size, const In* in, std::size_t in_stride, Out* out,
                    std::size_t out_stride, const Convert& convert) {
  parallel_for(size.height, kRowsPerRange, [&](std::size_t begin, std::size_t end, int) {
    const In* pixel = in + begin * size.width * in_stride;
    Out* to = out + begin * size.width * out_stride;
    const In* const stop = in + end * size.width * in_stride;
    for (; pixel != stop; pixel += in_stride, to += out_stride) convert(pixel, to);
  });
}

/// The pixels of an image, converted to `channels` values of T each by convert(pixel, out).
template <class T, class Convert>
std::vector<T> convert_pixels(const Image& image, std::size_t channels, const Convert& convert) {
  const PixelSize size{static_cast<std::size_t>(image.width),
                       static_cast<std::size_t>(image.height)};
  std::vector<T> result(size.width * size.height * channels);
  for_each_pixel(size, image.data.data(), image.channels.size(), result.data(), channels, convert);
  return result;
}

inline std::vector<std::uint8_t> encode_straight8(const Image& image, bool with_alpha) {
  const ColorChannels c = color_channels(image);
  return convert_pixels<std::uint8_t>(image, with_alpha ? 4 : 3,
                                      [&](const float* in, std::uint8_t* out) {
                                        const float alpha = c.alpha < 0 ? 1.0f : in[c.alpha];
                                        const float scale = alpha > 0 ? 1 / alpha : 0.0f;
                                        out[0] = linear_to_srgb8(in[c.red] * scale);
                                        out[1] = linear_to_srgb8(in[c.green] * scale);
                                        out[2] = linear_to_srgb8(in[c.blue] * scale);
                                        if (with_alpha) out[3] = alpha8(alpha);
                                      });
}

}  // namespace surfel
