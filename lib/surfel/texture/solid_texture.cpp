// Perlin 1985, "An image synthesizer", and Peachey 1985, "Solid texturing of complex surfaces":
// noise, marble and wood in space. Their filters are the library's own.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/base/option_check.h>
#include <surfel/base/random.h>
#include <surfel/texture/filtered_checker.h>
#include <surfel/texture/filtered_noise.h>
#include <surfel/texture/named_frequency.h>
#include <surfel/texture/solid_texture.h>

namespace surfel {
namespace {

using std::numbers::pi;

/// Colours of one pattern, and how many features the diagonal has.
struct PatternDefaults {
  const char* name;
  SolidPattern pattern;
  double frequency;
  Vec3f dark, light;
};

const std::array<PatternDefaults, 4>& pattern_defaults() {
  static const std::array<PatternDefaults, 4> defaults{{
      {"checker", SolidPattern::kChecker, 16, {0, 0, 0}, {1, 1, 1}},
      {"noise", SolidPattern::kNoise, 12, {0, 0, 0}, {1, 1, 1}},
      {"marble", SolidPattern::kMarble, 9, {0.06F, 0.07F, 0.09F}, {0.82F, 0.80F, 0.76F}},
      {"wood", SolidPattern::kWood, 32, {0.13F, 0.045F, 0.015F}, {0.55F, 0.30F, 0.125F}},
  }};
  return defaults;
}

const PatternDefaults& defaults_of(SolidPattern pattern) {
  return pattern_defaults()[static_cast<std::size_t>(pattern)];
}

constexpr double kLeastSolidFrequency = 0.01;
constexpr double kLargestSolidFrequency = 1e6;

constexpr double kFurthest = 0x1p52;    ///< Features; doubles beyond have no fractions left.
constexpr double kLargestKernel = 1e9;  ///< Features; what is larger has the mean of all space.

/// A function of position with a normal distribution over a Gaussian.
struct SolidPhase {
  double mean = 0;
  Vec3d gradient{0, 0, 0};
  double variance = 0;  ///< Beside the variance that the gradient explains.

  void add(double factor, const NoiseMoments& noise) {
    mean += factor * noise.mean;
    gradient += factor * noise.gradient;
    variance += factor * factor * noise.variance;
  }
  double total_variance(const KernelAxes& axes) const {
    return variance + (axes.transpose() * gradient).squaredNorm();
  }
};

/// Mean of the normal distribution function over N(mean, variance).
double soft_step(double mean, double variance) {
  return 0.5 * portable::erfc(-mean / std::sqrt(2 * (1 + variance)));
}

/// Mean, over N(mean, variance), of Gaussian lines of height 1 and standard deviation `width` about
/// all whole numbers, width < 1/4.
double filtered_lines(double mean, double variance, double width) {
  const double wide2 = width * width + variance;
  const double x = mean - std::round(mean);
  // Beyond, the first harmonic has the rest: exp(-2 pi^2 (0.5^2) 4) = 3e-9.
  if (wide2 > 0.25) {
    const double level = width * std::sqrt(2 * pi);
    return level * (1 + 2 * portable::exp(-2 * pi * pi * wide2) * portable::cos(2 * pi * x));
  }
  double sum = 0;
  for (int k = -3; k <= 3; ++k) sum += portable::exp(-(x - k) * (x - k) / (2 * wide2));
  return width / std::sqrt(wide2) * sum;
}

/// Standard deviation, in rings, of the blur that a ring's border has of its own.
constexpr double kRingBorder = 0.04;

/// Mean, over N(mean, variance), of the tone of a ring that grows as the square of the way through
/// it, from 0 to 1, by its Fourier series: 1/3 + sum_n cos(2 pi n x) / (pi n)^2 - sin(2 pi n x) /
/// (pi n).
double filtered_rings(double mean, double variance) {
  constexpr int kTerms = 18;  // exp(-2 pi^2 18^2 kRingBorder^2) = 4e-5.
  const double exponent = 2 * pi * pi * (variance + kRingBorder * kRingBorder);
  const double angle = 2 * pi * (mean - std::round(mean));
  const double c = portable::cos(angle), s = portable::sin(angle);
  double cosine = 1, sine = 0;
  double sum = 1.0 / 3;
  for (int n = 1; n <= kTerms && exponent * n * n < 12; ++n) {
    const double turned = cosine * c - sine * s;
    sine = sine * c + cosine * s;
    cosine = turned;
    sum += portable::exp(-exponent * n * n) * (cosine / (pi * n) - sine) / (pi * n);
  }
  return sum;
}

/// Points and weights of the Gauss-Hermite rule of three points for the standard normal
/// distribution.
constexpr std::array<double, 3> kPartNode{-std::numbers::sqrt3, 0, std::numbers::sqrt3};
constexpr std::array<double, 3> kPartWeight{1.0 / 6, 2.0 / 3, 1.0 / 6};

/// Variance of a part by the variance of the whole Gaussian along each axis. Parts lie 1.34
/// standard deviations of the whole apart and have 0.63 of one, so that they fill it without gaps.
constexpr double kPartVariance = 0.4;

}  // namespace

/// A share of the light colour, in units of features about the block's centre.
class SolidTexture::Pattern {
 public:
  Pattern() = default;
  Pattern(const Pattern&) = delete;
  Pattern& operator=(const Pattern&) = delete;
  virtual ~Pattern() = default;
  virtual double filtered(const Vec3d& point, const KernelAxes& axes) const = 0;
  virtual double mean() const = 0;
};

namespace {

class CheckerPattern : public SolidTexture::Pattern {
 public:
  double filtered(const Vec3d& point, const KernelAxes& axes) const override {
    return 0.5 + 0.5 * filtered_checker(point + Vec3d::Constant(0.5), axes);
  }
  double mean() const override { return 0.5; }
};

/// The most noises that a pattern is made of.
constexpr std::size_t kMostNoises = 3;
using Noises = std::array<FilteredNoise, kMostNoises>;

/// A pattern made of noises: the mean over nine parts of a Gaussian.
class NoisyPattern : public SolidTexture::Pattern {
 public:
  explicit NoisyPattern(std::vector<SolidNoise> noises) : noises_(std::move(noises)) {}
  double filtered(const Vec3d& point, const KernelAxes& axes) const override {
    if (axes.isZero(0)) return part(filter(axes), axes, point);
    const KernelAxes small = std::sqrt(kPartVariance) * axes;
    const KernelAxes step = std::sqrt(1 - kPartVariance) * axes;
    const Noises noises = filter(small);
    double sum = 0;
    for (std::size_t i = 0; i < kPartNode.size(); ++i) {
      for (std::size_t j = 0; j < kPartNode.size(); ++j) {
        const Vec3d at = point + kPartNode[i] * step.col(0) + kPartNode[j] * step.col(1);
        sum += kPartWeight[i] * kPartWeight[j] * part(noises, small, at);
      }
    }
    return sum;
  }

 private:
  Noises filter(const KernelAxes& axes) const {
    Noises noises;
    for (std::size_t k = 0; k < noises_.size(); ++k) noises[k] = FilteredNoise(noises_[k], axes);
    return noises;
  }
  /// Mean over a Gaussian that the noises are filtered for.
  virtual double part(const Noises& noises, const KernelAxes& axes, const Vec3d& point) const = 0;

  std::vector<SolidNoise> noises_;
};

/// A noise of its own for each of a pattern's uses.
SolidNoise make_noise(const SolidTextureOptions& options, std::uint64_t use, double gain,
                      const Vec3d& frequency) {
  return {options.octaves, gain, frequency, random_bits(options.seed, use)};
}

class NoisePattern : public NoisyPattern {
 public:
  explicit NoisePattern(const SolidTextureOptions& options)
      : NoisyPattern({make_noise(options, 0, 0.6, Vec3d::Ones())}) {}
  double mean() const override { return 0.5; }

 private:
  double part(const Noises& noises, const KernelAxes& axes, const Vec3d& point) const override {
    SolidPhase phase;
    phase.add(1, noises[0].at(point));
    return soft_step(phase.mean, phase.total_variance(axes));
  }
};

class MarblePattern : public NoisyPattern {
 public:
  explicit MarblePattern(const SolidTextureOptions& options)
      : NoisyPattern({make_noise(options, 0, 0.5, Vec3d::Constant(0.6)),
                      make_noise(options, 1, 0.5, Vec3d::Constant(1.1)),
                      make_noise(options, 2, 0.5, Vec3d::Constant(0.5))}) {}
  double mean() const override {
    const double line = std::sqrt(2 * pi);
    return 1 - line * (kCloud * kCloudWidth + (kVein * kVeinWidth + kThread * kThreadWidth) / 2);
  }

 private:
  // Heights of dark lines, whose sum is below 1, and their standard deviations, in features: clouds
  // about the veins, the veins, and threads in another direction. How dark veins and threads are
  // goes from 0 to 1 along them.
  static constexpr double kCloud = 0.2, kVein = 0.6, kThread = 0.2;
  static constexpr double kCloudWidth = 0.16, kVeinWidth = 0.055, kThreadWidth = 0.035;

  double part(const Noises& noises, const KernelAxes& axes, const Vec3d& point) const override {
    const NoiseMoments bend = noises[0].at(point);
    const SolidPhase vein = lines({0.80, 0.52, 0.30}, 0.45, bend, point);
    const SolidPhase thread = lines({-0.62, 1.05, 0.88}, 0.5, noises[1].at(point), point);
    SolidPhase strength;
    strength.add(1, noises[2].at(point));
    const double dark = soft_step(strength.mean, strength.total_variance(axes));
    const double variance = vein.total_variance(axes);
    return 1 - kCloud * filtered_lines(vein.mean, variance, kCloudWidth) -
           dark * kVein * filtered_lines(vein.mean, variance, kVeinWidth) -
           (1 - dark) * kThread *
               filtered_lines(thread.mean, thread.total_variance(axes), kThreadWidth);
  }
  /// Planes, `normal` to the feature, that noise bends by so many features.
  static SolidPhase lines(const Vec3d& normal, double bend, const NoiseMoments& noise,
                          const Vec3d& point) {
    SolidPhase phase{normal.dot(point), normal, 0};
    phase.add(bend, noise);
    return phase;
  }
};

class WoodPattern : public NoisyPattern {
 public:
  explicit WoodPattern(const SolidTextureOptions& options)
      : NoisyPattern({make_noise(options, 0, 0.3, Vec3d(0.1, 0.03, 0.1)),
                      make_noise(options, 1, 0.7, Vec3d(4, 0.12, 4))}) {}
  double mean() const override { return 1 - kRing / 3 - kFiber / 2; }

 private:
  static constexpr double kRing = 0.7, kFiber = 0.3;  ///< How dark; their sum is 1.

  double part(const Noises& noises, const KernelAxes& axes, const Vec3d& point) const override {
    // The trunk leans and its axis passes a few rings from the centre, so that few surfaces are cut
    // along or across it.
    const Vec2d across(point.x() - 0.15 * point.y() + 4.3, point.z() + 0.1 * point.y() + 2.7);
    const double radius = across.norm();
    const Vec2d outward = radius > 0 ? Vec2d(across / radius) : Vec2d(0, 0);
    SolidPhase ring{radius, {outward.x(), -0.15 * outward.x() + 0.1 * outward.y(), outward.y()}, 0};
    ring.add(0.8, noises[0].at(point));
    SolidPhase fiber;
    fiber.add(1, noises[1].at(point));
    return 1 - kRing * filtered_rings(ring.mean, ring.total_variance(axes)) -
           kFiber * soft_step(fiber.mean, fiber.total_variance(axes));
  }
};

std::unique_ptr<const SolidTexture::Pattern> make_pattern(const SolidTextureOptions& options) {
  switch (options.pattern) {
    case SolidPattern::kChecker:
      return std::make_unique<CheckerPattern>();
    case SolidPattern::kNoise:
      return std::make_unique<NoisePattern>(options);
    case SolidPattern::kMarble:
      return std::make_unique<MarblePattern>(options);
    case SolidPattern::kWood:
      break;
  }
  return std::make_unique<WoodPattern>(options);
}

bool usable_solid_color(const std::optional<Vec3f>& color) {
  return !color || (color->allFinite() && color->minCoeff() >= 0);
}

}  // namespace

std::vector<std::string> SolidTextureOptions::problems() const {
  std::vector<std::string> found;
  check_option(
      found,
      !frequency || (*frequency >= kLeastSolidFrequency && *frequency <= kLargestSolidFrequency),
      "frequency", frequency.value_or(0),
      fmt::format("{} to {}", kLeastSolidFrequency, kLargestSolidFrequency));
  if (feature_size) check_positive(found, "feature_size", *feature_size);
  check_rule(found, !frequency || !feature_size,
             "`frequency` and `feature_size` both say how large a feature is; give one");
  check_rule(found, !center || center->allFinite(), "`center` must be three finite numbers");
  check_option(found, octaves >= 1 && octaves <= kMostOctaves, "octaves", octaves,
               fmt::format("1 to {}", kMostOctaves));
  check_rule(found, usable_solid_color(dark), "`dark` must be three numbers >= 0");
  check_rule(found, usable_solid_color(light), "`light` must be three numbers >= 0");
  return found;
}

const std::vector<std::string>& solid_texture_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const PatternDefaults& defaults : pattern_defaults()) all.emplace_back(defaults.name);
    return all;
  }();
  return names;
}

SolidTextureOptions solid_texture_options(const std::string& name) {
  const NamedFrequency named =
      parse_named_frequency("solid", name, kLeastSolidFrequency, kLargestSolidFrequency);
  for (const PatternDefaults& defaults : pattern_defaults()) {
    if (named.name != defaults.name) continue;
    SolidTextureOptions options;
    options.pattern = defaults.pattern;
    options.frequency = named.frequency;
    return options;
  }
  throw_usage(fmt::format("no solid texture is called '{}'; there are {}{}", named.name,
                          fmt::join(solid_texture_names(), ", "),
                          did_you_mean(named.name, solid_texture_names())));
}

SolidTexture::SolidTexture(const SolidTextureOptions& options, const Bounds& bounds) {
  require_usable(options);
  const PatternDefaults& defaults = defaults_of(options.pattern);
  const double diagonal = bounds.diagonal() > 0 ? bounds.diagonal() : 1;
  feature_size_ =
      options.feature_size.value_or(diagonal / options.frequency.value_or(defaults.frequency));
  center_ = options.center.value_or(bounds.empty() ? Vec3d::Zero() : bounds.center());
  dark_ = options.dark.value_or(defaults.dark);
  light_ = options.light.value_or(defaults.light);
  pattern_ = make_pattern(options);
}

SolidTexture::~SolidTexture() = default;
SolidTexture::SolidTexture(SolidTexture&&) noexcept = default;
SolidTexture& SolidTexture::operator=(SolidTexture&&) noexcept = default;

Vec3f SolidTexture::evaluate(const Vec3d& point) const {
  return filtered(point, KernelAxes::Zero());
}

Vec3f SolidTexture::filtered(const Vec3d& point, const KernelAxes& axes) const {
  const Vec3d place = (point - center_) / feature_size_;
  const KernelAxes kernel = axes / feature_size_;
  const bool usable = place.cwiseAbs().maxCoeff() < kFurthest &&
                      kernel.cwiseAbs().maxCoeff() < kLargestKernel && place.allFinite() &&
                      kernel.allFinite();
  return color(usable ? pattern_->filtered(place, kernel) : pattern_->mean());
}

Vec3f SolidTexture::mean() const { return color(pattern_->mean()); }

Vec3f SolidTexture::color(double share) const {
  return dark_ + static_cast<float>(std::clamp(share, 0.0, 1.0)) * (light_ - dark_);
}

}  // namespace surfel
