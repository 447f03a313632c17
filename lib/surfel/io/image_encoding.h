#pragma once

// From pictures to what files store of them. Internal to the io module.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/image.h>

namespace surfel {

constexpr std::size_t kRowsPerRange = 16;

/// Which stored channels become R, G, B and A; alpha is -1 where there is none.
struct ColorChannels {
  int red, green, blue, alpha;
};

inline int find_channel(const std::vector<std::string>& names, const char* name) {
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

/// R G B by name. Without those names, three or more colour channels are taken in their order, one
/// or two are grey.
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

inline std::uint8_t alpha8(float alpha) {
  return static_cast<std::uint8_t>(std::clamp(alpha, 0.0f, 1.0f) * 255.0f + 0.5f);
}

inline bool is_opaque(const Image& image, int alpha) {
  if (alpha < 0) return true;
  const std::size_t stride = image.channels.size();
  for (std::size_t i = static_cast<std::size_t>(alpha); i < image.data.size(); i += stride) {
    if (alpha8(image.data[i]) != 255) return false;
  }
  return true;
}

/// Calls convert(pixel, out) for every pixel, out being `channels` values of T further each time.
template <class T, class Convert>
std::vector<T> convert_pixels(const Image& image, std::size_t channels, const Convert& convert) {
  const std::size_t stride = image.channels.size();
  const auto width = static_cast<std::size_t>(image.width);
  std::vector<T> result(width * image.height * channels);
  parallel_for(image.height, kRowsPerRange, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin * width; i < end * width; ++i) {
      convert(image.data.data() + i * stride, result.data() + i * channels);
    }
  });
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
