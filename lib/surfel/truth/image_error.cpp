#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/plugin.h>
#include <surfel/io/image_plugin.h>
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

struct Counts {
  std::size_t compared = 0;
  std::size_t nonfinite = 0;
  std::size_t solid = 0;  ///< Solid pixels of the truth.
  std::size_t holes = 0;

  Counts& operator+=(const Counts& other) {
    compared += other.compared;
    nonfinite += other.nonfinite;
    solid += other.solid;
    holes += other.holes;
    return *this;
  }
};

/// Two pictures whose values settle everything that OpenImageIO's compare() does not know, so that
/// it fits: it knows no masks, and pixels that are not compared are made equal. It takes two NaN
/// for equal, leaves the first NaN against a number out of its counts and has NaN for a mean from
/// the second on: no NaN is left. Its PSNR is relative to the largest value that it meets: rms is
/// taken from it, and PSNR from rms.
struct PreparedPair {
  Image tested;  ///< R G B as compared, A as given.
  Image truth;
  Counts counts;
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

Counts prepare_pixel(RgbaArray& a, RgbaArray& b, const ImageErrorOptions& options) {
  Counts counts;
  counts.solid = b[3] >= kSolid ? 1 : 0;
  counts.holes = b[3] >= kSolid && !(a[3] >= kEmpty) ? 1 : 0;
  const bool inside = std::min(a[3], b[3]) >= kSolid;
  a = over(a, options.background);
  b = over(b, options.background);
  if (!finite_difference(a, b)) {
    a = {1, 1, 1, 1};
    b = {0, 0, 0, 0};
    counts.nonfinite = 1;
  } else if (options.inside_only && !inside) {
    a = {0, 0, 0, a[3]};
    b = {0, 0, 0, b[3]};
    return counts;
  } else {
    a = encoded(a, options.encoding);
    b = encoded(b, options.encoding);
  }
  counts.compared = 1;
  return counts;
}

PreparedPair prepare(const Image& tested, const Image& truth, const ImageErrorOptions& options) {
  if (const auto problems = options.problems(); !problems.empty()) {
    throw_usage(fmt::format("{}", fmt::join(problems, "; ")));
  }
  if (tested.width != truth.width || tested.height != truth.height) {
    throw_input("", fmt::format("the tested picture has {} x {} pixels and the truth {} x {}; "
                                "render both at the same size",
                                tested.width, tested.height, truth.width, truth.height));
  }
  const ColorReader read_tested(tested);
  const ColorReader read_truth(truth);
  const int width = tested.width;
  PreparedPair pair{rgba_image(width, tested.height), rgba_image(width, tested.height), {}};
  const auto rows = static_cast<std::size_t>(tested.height);
  std::vector<Counts> partial((rows + kRowsPerRange - 1) / kRowsPerRange);
  parallel_for(rows, kRowsPerRange, [&](std::size_t begin, std::size_t end, int) {
    for (int y = static_cast<int>(begin); y < static_cast<int>(end); ++y) {
      for (int x = 0; x < width; ++x) {
        RgbaArray a = read_tested(x, y);
        RgbaArray b = read_truth(x, y);
        partial[begin / kRowsPerRange] += prepare_pixel(a, b, options);
        std::copy(a.begin(), a.end(), pair.tested.pixel(x, y));
        std::copy(b.begin(), b.end(), pair.truth.pixel(x, y));
      }
    }
  });
  for (const Counts& counts : partial) pair.counts += counts;
  return pair;
}

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
  const auto [a, b, counts] = prepare(tested, truth, options);
  if (counts.compared == 0) {
    throw_input("", options.inside_only
                        ? "no pixel has an alpha of 0.99 in both pictures; compare all pixels"
                        : "the pictures have no pixels");
  }
  const auto compare =
      reinterpret_cast<CompareImagesFunction*>(plugin_symbol("image", kCompareImagesSymbol));
  const auto threshold = static_cast<float>(options.threshold);
  ChannelDifference color;
  ChannelDifference alpha;
  compare(a, b, 0, 3, threshold, color);
  compare(a, b, 3, 4, threshold, alpha);

  // The means are over all pixels; pixels that are not compared are equal and count 0.
  const auto compared = static_cast<double>(counts.compared);
  const double all_per_compared = static_cast<double>(a.width) * a.height / compared;
  ImageError error;
  error.pixels = counts.compared;
  error.nonfinite = counts.nonfinite;
  error.rmse = color.rms * std::sqrt(all_per_compared);
  error.psnr = decibels(error.rmse);
  error.mean_absolute = color.mean_absolute * all_per_compared;
  error.maximum = color.maximum;
  error.x = color.x;
  error.y = color.y;
  error.channel = color.channel;
  error.beyond = static_cast<double>(color.beyond) / compared;
  const auto solid = static_cast<double>(std::max<std::size_t>(counts.solid, 1));
  error.holes = static_cast<double>(counts.holes) / solid;
  error.alpha_psnr = decibels(alpha.rms);
  return error;
}

Image difference_image(const Image& tested, const Image& truth, const ImageErrorOptions& options,
                       double scale) {
  if (!(std::isfinite(scale) && scale > 0)) {
    throw_usage(fmt::format("`scale` is {}; it must be finite and greater than 0", scale));
  }
  const auto [a, b, counts] = prepare(tested, truth, options);
  Image out = rgba_image(a.width, a.height);
  const auto factor = static_cast<float>(scale);
  const bool decode = options.encoding == ImageEncoding::kSrgb;
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    const float value = factor * std::abs(a.data[i] - b.data[i]);
    out.data[i] = i % 4 == 3 ? 1.0F : decode ? srgb_to_linear(value) : value;
  }
  return out;
}

}  // namespace surfel
