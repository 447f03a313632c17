#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/sample/noise.h>
#include <surfel/sample/procedural_image.h>

namespace surfel {
namespace {

ProceduralTexture checker(const ProceduralTextureOptions& options) {
  return [options](double u, double v) -> Vec3f {
    const double square = std::floor(u * options.frequency) + std::floor(v * options.frequency);
    return std::fmod(square, 2) == 0 ? options.dark : options.light;
  };
}

ProceduralTexture siemens(const ProceduralTextureOptions& options) {
  const double spokes = std::max(1.0, std::round(options.frequency));
  return [options, spokes](double u, double v) -> Vec3f {
    const double x = u - std::floor(u) - 0.5;
    const double y = v - std::floor(v) - 0.5;
    const bool inside = x * x + y * y < 0.25;
    return inside && portable::sin(spokes * portable::atan2(y, x)) > 0 ? options.light
                                                                       : options.dark;
  };
}

ProceduralTexture noise(const ProceduralTextureOptions& options) {
  const FractalNoise spectrum{6, options.frequency, 0.6};
  return [spectrum, seed = options.seed](double u, double v) -> Vec3f {
    Vec3f color;
    for (int channel = 0; channel < 3; ++channel) {
      const std::uint64_t stream = seed * 64 + static_cast<std::uint64_t>(channel) * 16;
      const double value = fractal_noise<2, false>(Vec2d(u, v), spectrum, stream).value;
      color[channel] = static_cast<float>(std::clamp(0.5 + 0.8 * value, 0.0, 1.0));
    }
    return color;
  };
}

}  // namespace

std::vector<std::string> ProceduralTextureOptions::problems() const {
  std::vector<std::string> found;
  check_positive(found, "frequency", frequency);
  return found;
}

const std::vector<std::string>& procedural_texture_names() {
  static const std::vector<std::string> names{"checker", "siemens", "noise"};
  return names;
}

ProceduralTexture procedural_texture(const std::string& name,
                                     const ProceduralTextureOptions& options) {
  require_usable(options);
  if (name == "checker") return checker(options);
  if (name == "siemens") return siemens(options);
  if (name == "noise") return noise(options);
  throw_usage(fmt::format("no procedural texture is called '{}'; there are {}{}", name,
                          fmt::join(procedural_texture_names(), ", "),
                          did_you_mean(name, procedural_texture_names())));
}

Image rasterize(const ProceduralTexture& texture, int width, int height, int samples) {
  if (width < 1 || height < 1 || samples < 1) {
    throw_usage(
        fmt::format("a picture of {}x{} pixels of {} samples cannot be made; each must be positive",
                    width, height, samples));
  }
  Image image = rgba_image(width, height);
  parallel_for(static_cast<std::size_t>(height), 8, [&](std::size_t begin, std::size_t end, int) {
    for (int y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
      for (int x = 0; x < width; ++x) {
        Vec3f sum = Vec3f::Zero();
        for (int s = 0; s < samples * samples; ++s) {
          const int row = s / samples;
          const double u = (x + (s % samples + 0.5) / samples) / width;
          const double v = 1 - (y + (row + 0.5) / samples) / height;
          sum += texture(u, v);
        }
        float* pixel = image.pixel(x, y);
        Eigen::Map<Vec3f>{pixel} = sum / static_cast<float>(samples * samples);
        pixel[3] = 1;
      }
    }
  });
  return image;
}

}  // namespace surfel
