// Burt, Adelson 1983, "The Laplacian pyramid as a compact image code" (the pyramid).
// Greene, Heckbert 1986, "Creating raster Omnimax images from multiple perspective views using the
// elliptical weighted average filter" (the sum over an ellipse, and picking a level for it).

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include <surfel/base/elementary.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/gaussian_pyramid.h>

namespace surfel {
namespace {

/// Reach of the filter from one level to the next, in its standard deviations: exp(-8) is left out.
constexpr double kStepReach = 4;
constexpr std::size_t kRowGrain = 4;
/// The number of rows that are filtered together from one level in memory into the next.
constexpr int kBandRows = 64;

/// Remainder in [0, period).
int wrapped(int i, int period) {
  const int remainder = i % period;
  return remainder < 0 ? remainder + period : remainder;
}

/// Without SSE 4.1, which not every x86-64 has, std::floor is a function of some twenty steps.
int floor_to_int(double x) {
  const int i = static_cast<int>(x);
  return i - (x < i ? 1 : 0);
}
int ceil_to_int(double x) {
  const int i = static_cast<int>(x);
  return i + (x > i ? 1 : 0);
}

/// Standard deviation, in texels of `fine`, of the filter that leads from it to a level of that
/// pitch. Level 0 has not been filtered.
double step_sigma(const TexelAxis& fine, double coarse_pitch, bool from_image) {
  const double before = from_image ? 0 : portable::squared(fine.pitch);
  return std::sqrt(GaussianPyramid::kPrefilter * (portable::squared(coarse_pitch) - before)) /
         fine.pitch;
}

/// The next level's texels. Periodic images keep whole periods. Other images grow by the filter's
/// reach, so that their outermost texels see only the continuation beyond the image (clamp: the
/// border, none: nothing).
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
  int offset;  ///< Offset of the stored texel.
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
      weights.push_back(portable::exp(-portable::squared((i - center) / sigma) / 2));
      sum += weights.back();
    }
    for (int i = begin; i <= end; ++i) {
      const int offset = stored_offset(i, fine, wrap);
      if (offset >= 0) taps[j].push_back({offset, static_cast<float>(weights[i - begin] / sum)});
    }
  }
  return taps;
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

/// A kernel cut along a row: exp(-exponent) at a texel, with the factor to the next texel. The
/// exponential is carried on by products, two texels at a time; in double their error stays below
/// 1e-9 over the longest row.
struct RowKernel {
  /// \param d         from the kernel's centre in the row to the centre of the first texel.
  /// \param decay     1 / (2 variance) along the row. \param step  exp(-2 decay).
  /// \param exponent  at the kernel's centre in the row.
  RowKernel(double d, double decay, double step, double exponent) {
    const double first = portable::exp(-d * d * decay - exponent);
    const double next = portable::exp(-(2 * d + 1) * decay);
    value = {first, first * next};
    const double skip_one = next * next * step;
    ratio = {skip_one, skip_one * step * step};
    ratio_step = (step * step) * (step * step);
  }
  void advance() {
    value *= ratio;
    ratio *= ratio_step;
  }
  Eigen::Array2d value;  ///< At this texel and at the next.
  Eigen::Array2d ratio;  ///< The factor to the values two texels further on.
  double ratio_step;
};

/// Adds kernel times texel over `count` texels of a row.
void add_row(const float* texels, int count, RowKernel kernel, GaussianPyramid::Sum& total) {
  const auto texel = [&](int i) {
    return Eigen::Map<const Eigen::Array4f>(texels + static_cast<std::ptrdiff_t>(i) * 4);
  };
  Eigen::Array4f even = Eigen::Array4f::Zero();
  Eigen::Array4f odd = Eigen::Array4f::Zero();
  Eigen::Array2d weight = Eigen::Array2d::Zero();
  int i = 0;
  for (; i + 1 < count; i += 2) {
    even += static_cast<float>(kernel.value[0]) * texel(i);
    odd += static_cast<float>(kernel.value[1]) * texel(i + 1);
    weight += kernel.value;
    kernel.advance();
  }
  if (i < count) {
    even += static_cast<float>(kernel.value[0]) * texel(i);
    weight[0] += kernel.value[0];
  }
  total.texels += (even + odd).cast<double>();
  total.kernel += weight.sum();
}

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

/// Filters one level into the next.
class PyramidStream::Step {
 public:
  Step(const TexelAxis& x, const TexelAxis& y, WrapMode wrap, bool from_image, bool keep)
      : keep_(keep) {
    coarse_.x = coarser(x, wrap, from_image);
    coarse_.y = coarser(y, wrap, from_image);
    x_taps_ = taps_between(x, coarse_.x, wrap, from_image);
    const auto y_taps = taps_between(y, coarse_.y, wrap, from_image);
    parts_.resize(static_cast<std::size_t>(y.count));
    missing_.resize(y_taps.size());
    rows_.resize(y_taps.size());
    for (int j = 0; j < coarse_.y.count; ++j) {
      for (const Tap& tap : y_taps[j]) parts_[tap.offset].push_back({j, tap.weight});
      missing_[j] = y_taps[j].size();
      if (missing_[j] == 0) empty_.push_back(j);
    }
  }

  const PyramidLevel& level() const { return coarse_; }
  bool is_kept() const { return keep_; }
  void keep() { keep_ = true; }

  /// Adds rows of the finer level. \return the rows of this level that are complete with them,
  /// which stay where they are until release().
  std::vector<TexelRow> add(std::span<const TexelRow> fine) {
    start();
    filter_rows(fine);
    // The rows' contributions, by the row that gets them; each row adds them in the order of
    // `fine`.
    std::vector<Part> parts;
    for (std::size_t i = 0; i < fine.size(); ++i) {
      for (const Tap& tap : parts_[fine[i].offset]) parts.push_back({tap.offset, i, tap.weight});
    }
    std::stable_sort(parts.begin(), parts.end(),
                     [](const Part& a, const Part& b) { return a.coarse < b.coarse; });
    std::vector<std::size_t> begin;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      if (i == 0 || parts[i].coarse != parts[i - 1].coarse) begin.push_back(i);
    }
    begin.push_back(parts.size());
    parallel_for(begin.size() - 1, kRowGrain, [&](std::size_t first, std::size_t last, int) {
      for (std::size_t i = begin[first]; i < begin[last]; ++i) {
        Eigen::Map<Eigen::ArrayXf>(row(parts[i].coarse), floats()) +=
            parts[i].weight * filtered_.col(static_cast<Eigen::Index>(parts[i].fine));
      }
    });
    std::vector<TexelRow> complete;
    for (const int j : std::exchange(empty_, {})) complete.push_back({j, row(j)});
    for (const Part& part : parts) {
      if (--missing_[part.coarse] == 0) complete.push_back({part.coarse, row(part.coarse)});
    }
    return complete;
  }

  void release(std::span<const TexelRow> complete) {
    if (keep_) return;
    for (const TexelRow& row : complete) rows_[row.offset] = Array<float>();
  }

  PyramidLevel take() { return std::move(coarse_); }

 private:
  /// `weight` times a row of the finer level, part of a row of this one.
  struct Part {
    int coarse;
    std::size_t fine;
    float weight;
  };

  Eigen::Index floats() const { return static_cast<Eigen::Index>(coarse_.x.count) * 4; }

  void start() {
    if (!keep_ || !coarse_.texels.empty()) return;
    coarse_.texels.assign(static_cast<std::size_t>(floats()) * coarse_.y.count, 0.0F);
  }

  /// A row of this level as far as it is added up.
  float* row(int j) {
    if (keep_) return coarse_.texels.data() + static_cast<std::size_t>(j) * floats();
    if (rows_[j].empty()) rows_[j].assign(static_cast<std::size_t>(floats()), 0.0F);
    return rows_[j].data();
  }

  /// Filters along the rows.
  void filter_rows(std::span<const TexelRow> fine) {
    if (filtered_.cols() < static_cast<Eigen::Index>(fine.size())) {
      filtered_.resize(floats(), static_cast<Eigen::Index>(fine.size()));
    }
    parallel_for(fine.size(), kRowGrain, [&](std::size_t begin, std::size_t end, int) {
      using Texel = Eigen::Map<const Eigen::Array4f>;
      for (std::size_t i = begin; i < end; ++i) {
        float* out = filtered_.col(static_cast<Eigen::Index>(i)).data();
        for (const std::vector<Tap>& taps : x_taps_) {
          Eigen::Array4f sum = Eigen::Array4f::Zero();
          for (const Tap& tap : taps) {
            sum += tap.weight * Texel(fine[i].texels + static_cast<std::ptrdiff_t>(tap.offset) * 4);
          }
          std::copy_n(sum.data(), 4, out);
          out += 4;
        }
      }
    });
  }

  bool keep_;
  PyramidLevel coarse_;
  std::vector<std::vector<Tap>> x_taps_;  ///< On the finer level, of each texel of a row.
  std::vector<std::vector<Tap>>
      parts_;  ///< The rows of this level that each row of the finer level contributes to.
  std::vector<std::size_t> missing_;  ///< Taps that each row still waits for.
  std::vector<int> empty_;            ///< Rows that nothing reaches.
  std::vector<Array<float>> rows_;    ///< Rows of a level that is not kept.
  Eigen::ArrayXXf filtered_;
};

PyramidStream::PyramidStream(const TexelAxis& x, const TexelAxis& y, WrapMode wrap,
                             const LevelRange& wanted) {
  TexelAxis fine_x = x;
  TexelAxis fine_y = y;
  for (int l = 1; l <= std::min(wanted.coarsest, GaussianPyramid::kMaxLevel); ++l) {
    if (fine_x.count == 1 && fine_y.count == 1 && wrap != WrapMode::kNothing) break;
    steps_.push_back(std::make_unique<Step>(fine_x, fine_y, wrap, l == 1, l >= wanted.finest));
    fine_x = steps_.back()->level().x;
    fine_y = steps_.back()->level().y;
  }
  if (!steps_.empty()) steps_.back()->keep();  // All coarser levels would be that one texel.
}

PyramidStream::~PyramidStream() = default;
PyramidStream::PyramidStream(PyramidStream&&) noexcept = default;

double PyramidStream::bytes() const {
  double bytes = 0;
  for (const auto& step : steps_) {
    const PyramidLevel& level = step->level();
    if (step->is_kept()) bytes += 4.0 * sizeof(float) * level.x.count * level.y.count;
  }
  return bytes;
}

void PyramidStream::add(std::span<const TexelRow> rows) {
  std::vector<TexelRow> complete;
  for (std::size_t i = 0; i < steps_.size(); ++i) {
    std::vector<TexelRow> next = steps_[i]->add(i == 0 ? rows : complete);
    if (i > 0) steps_[i - 1]->release(complete);
    complete = std::move(next);
  }
  if (!steps_.empty()) steps_.back()->release(complete);
}

std::vector<PyramidLevel> PyramidStream::take() {
  std::vector<PyramidLevel> levels;
  for (const auto& step : steps_) levels.push_back(step->take());
  return levels;
}

GaussianPyramid::GaussianPyramid(PyramidLevel image, WrapMode wrap) : wrap_(wrap) {
  levels_.push_back(std::move(image));
}

GaussianPyramid::GaussianPyramid(PyramidLevel image, std::vector<PyramidLevel> levels,
                                 WrapMode wrap)
    : GaussianPyramid(std::move(image), wrap) {
  std::move(levels.begin(), levels.end(), std::back_inserter(levels_));
}

int GaussianPyramid::level_for(double minor) {
  // Every pitch is at most 2^l.
  const double ratio = minor / (kPrefilter + kResidual);
  if (!(ratio >= 4)) return 0;
  return std::min(kMaxLevel, std::ilogb(ratio) / 2);
}

void GaussianPyramid::build(int level) {
  if (level < level_count()) return;
  const PyramidLevel& image = levels_.front();
  PyramidStream stream(image.x, image.y, wrap_, {1, level});
  std::vector<TexelRow> rows;
  for (int begin = 0; begin < image.y.count; begin += kBandRows) {
    rows.clear();
    for (int y = begin; y < std::min(begin + kBandRows, image.y.count); ++y) {
      rows.push_back({y, image.row(y)});
    }
    stream.add(rows);
  }
  levels_.resize(1);
  for (PyramidLevel& made : stream.take()) levels_.push_back(std::move(made));
}

GaussianPyramid::Box GaussianPyramid::reach(const TexelKernel& kernel) const {
  const auto range = [&](double center, double variance, const TexelAxis& axis) {
    const double reach = std::sqrt(2 * kExponentCutoff * variance);
    center = reduced(center, reach, axis, wrap_);
    // A texel more on each side, for rounding.
    return std::pair(floor_to_int(center - reach) - 1, ceil_to_int(center + reach) + 1);
  };
  const auto [x_begin, x_end] = range(kernel.center.x(), kernel.variance(0, 0), image().x);
  const auto [y_begin, y_end] = range(kernel.center.y(), kernel.variance(1, 1), image().y);
  return {x_begin, x_end, y_begin, y_end};
}

void GaussianPyramid::add_lookup(const Vec2d& place, double weight, Sum& sum) const {
  const PyramidLevel& level = image();
  const Vec2d at(reduced(place.x(), 1, level.x, wrap_) - 0.5,
                 reduced(place.y(), 1, level.y, wrap_) - 0.5);
  const int x = floor_to_int(at.x());
  const int y = floor_to_int(at.y());
  const int columns[] = {stored_offset(x, level.x, wrap_), stored_offset(x + 1, level.x, wrap_)};
  const double shares[] = {1 - (at.x() - x), at.x() - x};
  for (const int down : {0, 1}) {
    const int row = stored_offset(y + down, level.y, wrap_);
    const double row_weight = weight * (down == 1 ? at.y() - y : 1 - (at.y() - y));
    for (const int right : {0, 1}) {
      if (row < 0 || columns[right] < 0) continue;
      const double share = row_weight * shares[right];
      sum.texels += share * level.texel(columns[right], row).cast<double>();
      sum.kernel += share;
    }
  }
}

/// The mean of lookups at places that have the variance which is left to the Gaussian: of three
/// along an axis of less than half a texel (Gauss and Hermite's), of more along a longer one.
GaussianPyramid::Sum GaussianPyramid::interpolate(const TexelKernel& kernel) const {
  constexpr double kShort = 0.5;
  const Mat2d& v = kernel.variance;
  const PrincipalVariances principal = principal_variances(v);
  const auto deviation = [](double variance) {
    return std::sqrt(std::max(0.0, variance - kBilinearVariance));
  };
  const double major = deviation(principal.major);
  Vec2d axis = v(0, 0) < v(1, 1) ? Vec2d(v(0, 1), principal.major - v(0, 0))
                                 : Vec2d(principal.major - v(1, 1), v(0, 1));
  axis = axis.isZero() ? Vec2d::UnitX() : Vec2d(axis.normalized());
  const Vec2d across = std::sqrt(3.0) * deviation(principal.minor) * Vec2d(-axis.y(), axis.x());
  const int count = major <= kShort ? 1 : ceil_to_int(3 * major / kShort);
  const double step = (major <= kShort ? std::sqrt(3.0) : 3.0 / count) * major;
  Sum sum;
  for (int i = -count; i <= count; ++i) {
    const double t = i * step / major;
    const double along = count == 1 ? (i == 0 ? 4 : 1) : portable::exp(-t * t / 2);
    const Vec2d middle = kernel.center + i * step * axis;
    add_lookup(middle - across, along, sum);
    add_lookup(middle, 4 * along, sum);
    add_lookup(middle + across, along, sum);
  }
  return sum;
}

GaussianPyramid::Sum GaussianPyramid::filter(const TexelKernel& kernel, int max_level) const {
  if (kernel.interpolates()) return interpolate(kernel);
  const int l = std::min(
      {level_for(principal_variances(kernel.variance).minor), max_level, level_count() - 1});
  const PyramidLevel& level = levels_[static_cast<std::size_t>(l)];
  Sum total;
  if (level.x.count == 1 && level.y.count == 1 && wrap_ != WrapMode::kNothing) {
    total.texels = level.texel(0, 0).cast<double>();
    total.kernel = 1;
    return total;
  }

  // The kernel in the level's texels, without the variance that the level has been filtered with.
  const double prefilter = l > 0 ? kPrefilter : 0;
  const double xx = kernel.variance(0, 0) / portable::squared(level.x.pitch) - prefilter;
  const double yy = kernel.variance(1, 1) / portable::squared(level.y.pitch) - prefilter;
  const double xy = kernel.variance(0, 1) / (level.x.pitch * level.y.pitch);
  const double reach_x = std::sqrt(2 * kExponentCutoff * xx);
  const double reach_y = std::sqrt(2 * kExponentCutoff * yy);
  const double center_x = reduced(kernel.center.x() / level.x.pitch, reach_x, level.x, wrap_);
  const double center_y = reduced(kernel.center.y() / level.y.pitch, reach_y, level.y, wrap_);

  // A Gaussian is the product of its marginal in y and its conditional in x given y.
  const double conditional_variance = xx - xy * xy / yy;
  const double decay = 1 / (2 * conditional_variance);
  const double step = portable::exp(-2 * decay);
  const double marginal_decay = 1 / (2 * yy);
  const double slope = xy / yy;
  int y_begin = ceil_to_int(center_y - reach_y - 0.5);
  int y_end = floor_to_int(center_y + reach_y - 0.5) + 1;
  if (wrap_ == WrapMode::kNothing) {
    y_begin = std::max(y_begin, level.y.first);
    y_end = std::min(y_end, level.y.first + level.y.count);
  }
  // A row's texels, where they are in tiles or beyond the image's border. To allocate it for each
  // kernel would take a tenth of the time.
  thread_local Eigen::Array<float, 4, Eigen::Dynamic> fetched;
  for (int y = y_begin; y < y_end; ++y) {
    const double dy = y + 0.5 - center_y;
    const double exponent = dy * dy * marginal_decay;
    const double row_center = center_x + slope * dy;
    const double row_reach =
        std::sqrt(std::max(0.0, 2 * (kExponentCutoff - exponent) * conditional_variance));
    int begin = ceil_to_int(row_center - row_reach - 0.5);
    int end = floor_to_int(row_center + row_reach - 0.5) + 1;
    if (wrap_ == WrapMode::kNothing) {
      begin = std::max(begin, level.x.first);
      end = std::min(end, level.x.first + level.x.count);
    }
    if (begin >= end) continue;

    const RowKernel row(begin + 0.5 - row_center, decay, step, exponent);
    const int stored_y = stored_offset(y, level.y, wrap_);
    const bool inside = begin >= level.x.first && end <= level.x.first + level.x.count;
    if (inside && !level.tiles) {
      const float* first =
          level.row(stored_y) + static_cast<std::ptrdiff_t>(begin - level.x.first) * 4;
      add_row(first, end - begin, row, total);
      continue;
    }
    if (fetched.cols() < end - begin) fetched.resize(4, end - begin);
    if (inside) {
      level.tiles->row(stored_y, begin - level.x.first, end - level.x.first, fetched.data());
    } else {
      for (int x = begin; x < end; ++x) {
        fetched.col(x - begin) = level.texel(stored_offset(x, level.x, wrap_), stored_y);
      }
    }
    add_row(fetched.data(), end - begin, row, total);
  }
  return total;
}

}  // namespace surfel
