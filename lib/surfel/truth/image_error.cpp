#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/truth/image_error.h>

namespace surfel {
namespace {

constexpr std::size_t kRowsPerRange = 16;  ///< A range of a loop: tens of microseconds' work.
constexpr float kSolid = 0.99F;            ///< Alpha of a pixel inside the silhouette.
constexpr float kEmpty = 0.5F;             ///< Where less of a solid pixel is there, it is a hole.

using RgbaArray = std::array<float, 4>;

/// R G B A of a picture by name.
class ColorReader {
 public:
  explicit ColorReader(const Image& image) : image_(image) {
    const std::array<const char*, 4> names{"R", "G", "B", "A"};
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto found = std::find(image.channels.begin(), image.channels.end(), names[i]);
      channel_[i] = found == image.channels.end() ? -1 : found - image.channels.begin();
    }
    if (std::min({channel_[0], channel_[1], channel_[2]}) < 0) {
      throw_input("", "only pictures with the channels R, G and B can be compared");
    }
  }

  RgbaArray operator()(int x, int y) const {
    const float* p = image_.pixel(x, y);
    return {p[channel_[0]], p[channel_[1]], p[channel_[2]], channel_[3] < 0 ? 1 : p[channel_[3]]};
  }

 private:
  const Image& image_;
  std::array<std::ptrdiff_t, 4> channel_{};
};

/// What some rows of pixels add to an ImageError.
struct Differences {
  std::size_t compared = 0;
  std::size_t nonfinite = 0;
  std::size_t beyond = 0;
  std::size_t solid = 0;  ///< Solid pixels of the truth.
  std::size_t holes = 0;
  double squares = 0;  ///< Sum over the compared pixels' R G B.
  double absolutes = 0;
  double alpha_squares = 0;  ///< Sum over all pixels.
  double maximum = 0;
  int x = 0, y = 0, channel = 0;  ///< Place of the first maximum.

  /// Adds what the rows below add.
  Differences& operator+=(const Differences& below) {
    compared += below.compared;
    nonfinite += below.nonfinite;
    beyond += below.beyond;
    solid += below.solid;
    holes += below.holes;
    squares += below.squares;
    absolutes += below.absolutes;
    alpha_squares += below.alpha_squares;
    take_maximum(below.maximum, below.x, below.y, below.channel);
    return *this;
  }

  void take_maximum(double difference, int at_x, int at_y, int at_channel) {
    if (!(difference > maximum)) return;
    maximum = difference;
    x = at_x;
    y = at_y;
    channel = at_channel;
  }
};

RgbaArray over(const RgbaArray& p, const RgbaArray& background) {
  RgbaArray out = p;
  const float through = (1 - p[3]) * background[3];
  for (std::size_t i = 0; i < 3; ++i) out[i] += through * background[i];
  return out;
}

bool finite_difference(const RgbaArray& a, const RgbaArray& b) {
  for (std::size_t i = 0; i < 4; ++i) {
    if (!std::isfinite(a[i] - b[i])) return false;
  }
  return true;
}

RgbaArray encoded(RgbaArray p, ImageEncoding encoding) {
  if (encoding == ImageEncoding::kLinear) return p;
  for (std::size_t i = 0; i < 3; ++i) p[i] = linear_to_srgb(std::clamp(p[i], 0.0F, 1.0F));
  return p;
}

/// A pixel of both pictures as it is compared: R G B laid over the background and encoded, A as
/// given. Colours that are not compared are equal.
struct PixelPair {
  RgbaArray tested;
  RgbaArray truth;
  bool compared = true;
  bool finite = true;
};

PixelPair prepared(RgbaArray tested, RgbaArray truth, const ImageErrorOptions& options) {
  const bool inside = std::min(tested[3], truth[3]) >= kSolid;
  tested = over(tested, options.background);
  truth = over(truth, options.background);
  if (!finite_difference(tested, truth)) return {{1, 1, 1, 1}, {0, 0, 0, 0}, true, false};
  if (options.inside_only && !inside) {
    return {{0, 0, 0, tested[3]}, {0, 0, 0, truth[3]}, false, true};
  }
  return {encoded(tested, options.encoding), encoded(truth, options.encoding), true, true};
}

void add_pixel(const PixelPair& pixel, int x, int y, double threshold, Differences& sums) {
  bool beyond = false;
  for (int i = 0; i < 4; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double difference = std::abs(static_cast<double>(pixel.tested[k]) - pixel.truth[k]);
    if (i == 3) {
      sums.alpha_squares += difference * difference;
      break;
    }
    sums.squares += difference * difference;
    sums.absolutes += difference;
    sums.take_maximum(difference, x, y, i);
    beyond = beyond || difference > threshold;
  }
  sums.compared += pixel.compared ? 1 : 0;
  sums.nonfinite += pixel.finite ? 0 : 1;
  sums.beyond += beyond ? 1 : 0;
}

/// Two pictures that can be compared, read by channel names. Throws as image_error() does.
class PicturePair {
 public:
  PicturePair(const Image& tested, const Image& truth, const ImageErrorOptions& options)
      : tested_(tested), truth_(truth), width_(tested.width), height_(tested.height) {
    if (const auto problems = options.problems(); !problems.empty()) {
      throw_usage(fmt::format("{}", fmt::join(problems, "; ")));
    }
    if (width_ == truth.width && height_ == truth.height) return;
    throw_input("", fmt::format("the tested picture has {} x {} pixels and the truth {} x {}; "
                                "render both at the same size",
                                width_, height_, truth.width, truth.height));
  }

  /// Calls visit(range, x, y, tested, truth) for each pixel, where ranges of rows run at once.
  template <class Visit>
  void for_each_pixel(const Visit& visit) const {
    const auto rows = static_cast<std::size_t>(height_);
    parallel_for(rows, kRowsPerRange, [&](std::size_t begin, std::size_t end, int) {
      for (int y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
        for (int x = 0; x < width_; ++x) {
          visit(begin / kRowsPerRange, x, y, tested_(x, y), truth_(x, y));
        }
      }
    });
  }

  Differences differences(const ImageErrorOptions& options) const {
    const auto rows = static_cast<std::size_t>(height_);
    std::vector<Differences> partial((rows + kRowsPerRange - 1) / kRowsPerRange);
    for_each_pixel(
        [&](std::size_t range, int x, int y, const RgbaArray& tested, const RgbaArray& truth) {
          Differences& sums = partial[range];
          if (truth[3] >= kSolid) {
            ++sums.solid;
            sums.holes += tested[3] >= kEmpty ? 0 : 1;
          }
          add_pixel(prepared(tested, truth, options), x, y, options.threshold, sums);
        });
    Differences sums;
    for (const Differences& range : partial) sums += range;
    return sums;
  }

 private:
  ColorReader tested_;
  ColorReader truth_;
  int width_;
  int height_;
};

double decibels(double rms) { return -20 * portable::log10(rms); }

}  // namespace

std::vector<std::string> ImageErrorOptions::problems() const {
  std::vector<std::string> out;
  check_option(out, threshold >= 0 && threshold < 1, "threshold", threshold,
               "at least 0 and less than 1");
  if (!std::all_of(background.begin(), background.end(),
                   [](float v) { return std::isfinite(v); })) {
    out.push_back(fmt::format("`background` is {}; it must be four finite numbers",
                              fmt::join(background, ",")));
  }
  return out;
}

ImageError image_error(const Image& tested, const Image& truth, const ImageErrorOptions& options) {
  const Differences sums = PicturePair(tested, truth, options).differences(options);
  if (sums.compared == 0) {
    throw_input("", options.inside_only
                        ? "no pixel has an alpha of 0.99 in both pictures; compare all pixels"
                        : "the pictures have no pixels");
  }
  const auto compared = static_cast<double>(sums.compared);
  ImageError error;
  error.pixels = sums.compared;
  error.nonfinite = sums.nonfinite;
  error.rmse = std::sqrt(sums.squares / (3 * compared));
  error.psnr = decibels(error.rmse);
  error.mean_absolute = sums.absolutes / (3 * compared);
  error.maximum = sums.maximum;
  error.x = sums.x;
  error.y = sums.y;
  error.channel = sums.channel;
  error.beyond = static_cast<double>(sums.beyond) / compared;
  const auto solid = static_cast<double>(std::max<std::size_t>(sums.solid, 1));
  error.holes = static_cast<double>(sums.holes) / solid;
  const double pixels = static_cast<double>(tested.width) * tested.height;
  error.alpha_psnr = decibels(std::sqrt(sums.alpha_squares / pixels));
  return error;
}

Image difference_image(const Image& tested, const Image& truth, const ImageErrorOptions& options,
                       double scale) {
  if (!(std::isfinite(scale) && scale > 0)) {
    throw_usage(fmt::format("`scale` is {}; it must be finite and greater than 0", scale));
  }
  const PicturePair pair(tested, truth, options);
  Image out = rgba_image(tested.width, tested.height);
  const auto factor = static_cast<float>(scale);
  const bool decode = options.encoding == ImageEncoding::kSrgb;
  pair.for_each_pixel(
      [&](std::size_t /*range*/, int x, int y, const RgbaArray& a, const RgbaArray& b) {
        const PixelPair pixel = prepared(a, b, options);
        float* const p = out.pixel(x, y);
        for (std::size_t i = 0; i < 3; ++i) {
          const float value = factor * std::abs(pixel.tested[i] - pixel.truth[i]);
          p[i] = decode ? srgb_to_linear(value) : value;
        }
        p[3] = 1;
      });
  return out;
}

}  // namespace surfel
