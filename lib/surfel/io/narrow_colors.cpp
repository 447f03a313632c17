#include <cmath>

#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/io/narrow_colors.h>

namespace surfel {

void narrow_colors(SurfelCloud& cloud, int brightest) {
  if (cloud.color_encoding != ColorEncoding::kUint16Srgb || brightest > 255) return;
  cloud.color_encoding = ColorEncoding::kUint8Srgb;
  if (brightest == 0) {
    cloud.color = {};
    return;
  }
  // Values up to 255 of 65,535 lie on the linear part of the sRGB curve, where they are told apart
  // by their size.
  const float darkest = srgb16_to_linear(1);
  const auto code = [&](float linear) {
    return static_cast<std::uint8_t>(std::lround(linear / darkest));
  };
  constexpr std::size_t kGrain = std::size_t{1} << 15;
  parallel_each(cloud.size(), kGrain, [&](std::size_t i) {
    for (float& channel : cloud.color[i]) channel = srgb8_to_linear(code(channel));
  });
}

}  // namespace surfel
