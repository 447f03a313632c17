#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

/// Picture in linear light, float, channels interleaved, row 0 at the top.
struct Image {
  int width = 0;
  int height = 0;
  std::vector<std::string> channels;  ///< "R" "G" "B" "A", then AOVs: "Z", "Z.first", "N.X", ...
  Array<float> data;                  ///< width * height * channels.size().

  int channel_count() const { return static_cast<int>(channels.size()); }
  float* pixel(int x, int y) {
    return data.data() + (static_cast<std::size_t>(y) * width + x) * channels.size();
  }
  const float* pixel(int x, int y) const {
    return data.data() + (static_cast<std::size_t>(y) * width + x) * channels.size();
  }
};

/// A picture with the channels R G B A, whose values are not set.
inline Image rgba_image(int width, int height) {
  Image image{width, height, {"R", "G", "B", "A"}, {}};
  image.data.resize(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  return image;
}

}  // namespace surfel
