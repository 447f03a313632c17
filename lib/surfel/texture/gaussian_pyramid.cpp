// Burt, Adelson 1983, "The Laplacian pyramid as a compact image code" (the pyramid).
// Greene, Heckbert 1986, "Creating raster Omnimax images from multiple perspective views using the
// elliptical weighted average filter" (the sum over an ellipse, and picking a level for it).

#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/base/parallel.h>
#include <surfel/texture/gaussian_pyramid.h>

namespace surfel {
namespace {

/// Reach of the filter from one level to the next, in its standard deviations: exp(-8) is left out.
constexpr double kStepReach = 4;
constexpr std::size_t kRowGrain = 16;

/// Remainder in [0, period).
int wrapped(int i, int period) {
  const int remainder = i % period;
  return remainder < 0 ? remainder + period : remainder;
}

double squared(double x) { return x * x; }

/// Standard deviation, in texels of `fine`, of the filter that leads from it to a level of that
/// pitch. Level 0 has not been filtered.
double step_sigma(const TexelAxis& fine, double coarse_pitch, bool from_image) {
  const double before = from_image ? 0 : squared(fine.pitch);
  return std::sqrt(GaussianPyramid::kPrefilter * (squared(coarse_pitch) - before)) / fine.pitch;
}

/// The next level's texels. Periodic images keep whole periods. Others grow by the filter's reach,
/// so that their outermost texels see nothing but what continues beyond (clamp: the border, none:
/// nothing).
TexelAxis coarser(const TexelAxis& fine, WrapMode wrap, bool from_image) {
  if (wrap == WrapMode::kRepeat || wrap == WrapMode::kMirror) {
    const int count = (fine.count + 1) / 2;
    return {0, count, fine.pitch * fine.count / count};
  }
  const double pitch = 2 * fine.pitch;
  const double reach = kStepReach * step_sigma(fine, pitch, from_image);
  const int last_fine = fine.first + fine.count - 1;
  const int first = static_cast<int>(std::floor((fine.first - 0.5 - reach) / 2));
  const int last = static_cast<int>(std::ceil((last_fine - 0.5 + reach) / 2));
  return {first, last - first + 1, pitch};
}

struct Tap {
  int offset;  ///< Of the stored texel.
  float weight;
};

/// Taps of each texel of the coarse axis on the fine one.
std::vector<std::vector<Tap>> taps_between(const TexelAxis& fine, const TexelAxis& coarse,
                                           WrapMode wrap, bool from_image) {
  const double sigma = step_sigma(fine, coarse.pitch, from_image);
  std::vector<std::vector<Tap>> taps(static_cast<std::size_t>(coarse.count));
  for (int j = 0; j < coarse.count; ++j) {
    const double center = (coarse.first + j + 0.5) * coarse.pitch / fine.pitch - 0.5;
    const int begin = static_cast<int>(std::ceil(center - kStepReach * sigma));
    const int end = static_cast<int>(std::floor(center + kStepReach * sigma));
    if (begin >= end) {  // A single texel: nothing was filtered along this axis.
      taps[j].push_back({stored_offset(static_cast<int>(std::lround(center)), fine, wrap), 1});
      continue;
    }
    double sum = 0;
    std::vector<double> weights;
    for (int i = begin; i <= end; ++i) {
      weights.push_back(std::exp(-squared((i - center) / sigma) / 2));
      sum += weights.back();
    }
    for (int i = begin; i <= end; ++i) {
      const int offset = stored_offset(i, fine, wrap);
      if (offset >= 0) taps[j].push_back({offset, static_cast<float>(weights[i - begin] / sum)});
    }
  }
  return taps;
}

PyramidLevel coarser_level(const PyramidLevel& fine, WrapMode wrap, bool from_image) {
  PyramidLevel coarse;
  coarse.x = coarser(fine.x, wrap, from_image);
  coarse.y = coarser(fine.y, wrap, from_image);
  coarse.texels.resize(static_cast<std::size_t>(coarse.x.count) * coarse.y.count * 4);
  const auto x_taps = taps_between(fine.x, coarse.x, wrap, from_image);
  const auto y_taps = taps_between(fine.y, coarse.y, wrap, from_image);
  using Row = Eigen::Map<Eigen::ArrayXf>;
  using ConstRow = Eigen::Map<const Eigen::ArrayXf>;
  const Eigen::Index fine_floats = static_cast<Eigen::Index>(fine.x.count) * 4;

  parallel_for(coarse.y.count, kRowGrain, [&](std::size_t begin, std::size_t end, int) {
    Eigen::ArrayXf column_sums(fine_floats);
    for (std::size_t y = begin; y < end; ++y) {
      column_sums.setZero();
      for (const Tap& tap : y_taps[y]) {
        column_sums += tap.weight * ConstRow(fine.row(tap.offset), fine_floats);
      }
      float* out = coarse.texels.data() + y * coarse.x.count * 4;
      for (const std::vector<Tap>& taps : x_taps) {
        Eigen::Array4f sum = Eigen::Array4f::Zero();
        for (const Tap& tap : taps) sum += tap.weight * column_sums.segment<4>(tap.offset * 4);
        Row(out, 4) = sum;
        out += 4;
      }
    }
  });
  return coarse;
}

/// A coordinate, in texels of the level, to where indices are small: periods are taken off, and
/// beyond the border, where a clamped image does not change any more, it stops.
double reduced(double center, double reach, const TexelAxis& axis, WrapMode wrap) {
  if (wrap == WrapMode::kRepeat || wrap == WrapMode::kMirror) {
    const double period = wrap == WrapMode::kRepeat ? axis.count : 2.0 * axis.count;
    return std::fmod(center, period);  // Exact, however far away.
  }
  return std::clamp(center, axis.first - reach - 1, axis.first + axis.count + reach + 1);
}

/// One row's sum of exp(-(i + 1/2 - center)^2 / (2 variance)) times texel i. The exponential is
/// carried from texel to texel by two products; in double their error stays below 1e-9 over the
/// longest row.
class RowSum {
 public:
  RowSum(int begin, double center, double variance) {
    const double d = begin + 0.5 - center;
    value_ = std::exp(-d * d / (2 * variance));
    ratio_ = std::exp(-(2 * d + 1) / (2 * variance));
    ratio_step_ = std::exp(-1 / variance);
  }
  void add(const float* texel) {
    sum += static_cast<float>(value_) * Eigen::Map<const Eigen::Array4f>(texel);
    kernel += value_;
    skip();
  }
  void skip() {
    value_ *= ratio_;
    ratio_ *= ratio_step_;
  }
  Eigen::Array4f sum{0, 0, 0, 0};
  double kernel = 0;

 private:
  double value_;
  double ratio_;
  double ratio_step_;
};

}  // namespace

int stored_offset(int i, const TexelAxis& axis, WrapMode wrap) {
  switch (wrap) {
    case WrapMode::kRepeat:
      return wrapped(i, axis.count);
    case WrapMode::kMirror: {
      const int m = wrapped(i, 2 * axis.count);
      return m < axis.count ? m : 2 * axis.count - 1 - m;
    }
    case WrapMode::kClamp:
      return std::clamp(i - axis.first, 0, axis.count - 1);
    case WrapMode::kNothing:
      break;
  }
  const int offset = i - axis.first;
  return offset >= 0 && offset < axis.count ? offset : -1;
}

GaussianPyramid::GaussianPyramid(PyramidLevel image, WrapMode wrap) : wrap_(wrap) {
  levels_.push_back(std::move(image));
}

int GaussianPyramid::level_for(double minor) {
  // Every pitch is at most 2^l.
  const double ratio = minor / (kPrefilter + kResidual);
  if (!(ratio >= 4)) return 0;
  return std::min(kMaxLevel, static_cast<int>(std::floor(std::log2(ratio) / 2)));
}

void GaussianPyramid::build(int level) {
  level = std::min(level, kMaxLevel);
  while (level_count() <= level) {
    const PyramidLevel& top = levels_.back();
    if (top.x.count == 1 && top.y.count == 1 && wrap_ != WrapMode::kNothing) break;
    levels_.push_back(coarser_level(top, wrap_, level_count() == 1));
  }
}

GaussianPyramid::Sum GaussianPyramid::filter(const TexelKernel& kernel, int max_level) const {
  const int l = std::min(
      {level_for(principal_variances(kernel.variance).minor), max_level, level_count() - 1});
  const PyramidLevel& level = levels_[static_cast<std::size_t>(l)];
  Sum total;
  if (level.x.count == 1 && level.y.count == 1 && wrap_ != WrapMode::kNothing) {
    total.texels = Eigen::Map<const Eigen::Array4f>(level.row(0)).cast<double>();
    total.kernel = 1;
    return total;
  }

  // The kernel in the level's texels, less what the level has been filtered by.
  const double prefilter = l > 0 ? kPrefilter : 0;
  const double xx = kernel.variance(0, 0) / squared(level.x.pitch) - prefilter;
  const double yy = kernel.variance(1, 1) / squared(level.y.pitch) - prefilter;
  const double xy = kernel.variance(0, 1) / (level.x.pitch * level.y.pitch);
  constexpr double kTwiceCutoff = 2 * kExponentCutoff;
  const double reach_x = std::sqrt(kTwiceCutoff * xx);
  const double reach_y = std::sqrt(kTwiceCutoff * yy);
  const double center_x = reduced(kernel.center.x() / level.x.pitch, reach_x, level.x, wrap_);
  const double center_y = reduced(kernel.center.y() / level.y.pitch, reach_y, level.y, wrap_);

  // A Gaussian is the product of its marginal in y and its conditional in x given y.
  const double conditional_variance = xx - xy * xy / yy;
  int y_begin = static_cast<int>(std::ceil(center_y - reach_y - 0.5));
  int y_end = static_cast<int>(std::floor(center_y + reach_y - 0.5)) + 1;
  if (wrap_ == WrapMode::kNothing) {
    y_begin = std::max(y_begin, level.y.first);
    y_end = std::min(y_end, level.y.first + level.y.count);
  }
  for (int y = y_begin; y < y_end; ++y) {
    const double dy = y + 0.5 - center_y;
    const double row_center = center_x + xy / yy * dy;
    const double row_reach =
        std::sqrt(std::max(0.0, (kTwiceCutoff - dy * dy / yy) * conditional_variance));
    int begin = static_cast<int>(std::ceil(row_center - row_reach - 0.5));
    int end = static_cast<int>(std::floor(row_center + row_reach - 0.5)) + 1;
    if (wrap_ == WrapMode::kNothing) {
      begin = std::max(begin, level.x.first);
      end = std::min(end, level.x.first + level.x.count);
    }
    if (begin >= end) continue;

    RowSum row(begin, row_center, conditional_variance);
    const float* texels = level.row(stored_offset(y, level.y, wrap_));
    if (begin >= level.x.first && end <= level.x.first + level.x.count) {
      const float* texel = texels + static_cast<std::size_t>(begin - level.x.first) * 4;
      for (int x = begin; x < end; ++x, texel += 4) row.add(texel);
    } else {
      for (int x = begin; x < end; ++x) {
        row.add(texels + static_cast<std::size_t>(stored_offset(x, level.x, wrap_)) * 4);
      }
    }
    const double marginal = std::exp(-dy * dy / (2 * yy));
    total.texels += marginal * row.sum.cast<double>();
    total.kernel += marginal * row.kernel;
  }
  return total;
}

}  // namespace surfel
