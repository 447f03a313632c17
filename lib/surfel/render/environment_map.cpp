// The mean cosines of von Mises-Fisher lobes: Mardia, Jupp, "Directional Statistics", 2000, 9.3.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/image_io.h>
#include <surfel/io/named_file.h>
#include <surfel/render/environment_map.h>
#include <surfel/sample/procedural_sky.h>
#include <surfel/scene/lat_long.h>

namespace surfel {
namespace {

/// Standard deviation of a level by the distance of its rows: bilinear interpolation between texels
/// takes up to 10 % from the peak of the narrowest spot that there can be; at 3/4 it took 35 %.
constexpr double kDeviationPerRow = 1.5;
constexpr int kFewestRows = 32;  ///< Rows of the last level: more than kWidest needs.
/// From this variance on all directions see nearly the same: mean cosine 0.02.
constexpr float kWidest = 4;
/// Lobes end where they have fallen to exp(-8) of their peak.
constexpr double kReach = 8;
/// Width of the procedural sky: at common fields of view its edges are as sharp as the picture's.
constexpr int kSkyWidth = 2048;
constexpr std::size_t kMostPixels = std::size_t{1} << 27;  ///< 16384 x 8192: 2 GB of floats.

/// exp(-x) for 0 <= x <= kReach, to 5e-7 of itself: filtering spends most of its time on it.
class Decay {
 public:
  Decay() {
    for (std::size_t i = 0; i < value_.size(); ++i) {
      value_[i] = portable::exp(-static_cast<double>(i) / kSteps);
    }
  }
  double operator()(double x) const {
    const double place = x * kSteps;
    const auto i = std::min(static_cast<std::size_t>(place), value_.size() - 2);
    const double part = place - static_cast<double>(i);
    return value_[i] + part * (value_[i + 1] - value_[i]);
  }

 private:
  static constexpr double kSteps = 512;  ///< To a unit.
  std::array<double, static_cast<std::size_t>(kReach* kSteps) + 2> value_{};
};

/// Concentration of the von Mises-Fisher lobe whose mean cosine coth k - 1 / k is exp(-variance).
double concentration_of(double variance) {
  const double wanted = -portable::expm1(-variance);
  double low = portable::log(1e-9);
  double high = portable::log(1e12);
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    const double k = portable::exp(middle);
    // 1 - mean cosine, falling with k; written so that it does not cancel where k is large.
    const double spread = k < 1e-3 ? 1 - k / 3 : 1 / k - 2 / portable::expm1(2 * k);
    (spread > wanted ? low : high) = middle;
  }
  return portable::exp((low + high) / 2);
}

}  // namespace

void EnvironmentMap::Level::add_ring(int count) {
  const std::size_t begin =
      rings.empty() ? 0 : rings.back().begin + static_cast<std::size_t>(rings.back().count);
  rings.push_back({begin, count});
}

double EnvironmentMap::Level::colatitude(int ring) const {
  return std::clamp((ring - 0.5) / rows, 0.0, 1.0) * std::numbers::pi;
}

double EnvironmentMap::Level::solid_angle(int ring) const {
  if (ring == 0 || ring == rows + 1) return 0;
  // The strip's, 2 pi (cos a - cos b), as a product.
  const double strip = 4 * std::numbers::pi * portable::sin(colatitude(ring)) *
                       portable::sin(std::numbers::pi / (2 * rows));
  return strip / rings[static_cast<std::size_t>(ring)].count;
}

EnvironmentMap::Level EnvironmentMap::image_level(const Image& image, const std::string& name) {
  if (image.width != 2 * image.height || image.height < 1) {
    throw_input(name, fmt::format("is {}x{} pixels; a lat-long environment map is twice as wide as "
                                  "high",
                                  image.width, image.height));
  }
  if (static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height) >
      kMostPixels) {
    throw_input(name, fmt::format("is {}x{} pixels; environment maps may have 16384x8192",
                                  image.width, image.height));
  }
  Level level;
  level.rows = image.height;
  level.add_ring(1);
  for (int y = 0; y < image.height; ++y) level.add_ring(image.width);
  level.add_ring(1);
  level.texels.resize(level.rings.back().begin + 1);
  Vec3f* out = level.texels.data() + 1;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x, ++out) {
      *out = Eigen::Map<const Vec3f>(image.pixel(x, y));
      if (!out->allFinite()) {
        throw_input(name,
                    fmt::format("pixel ({}, {}) is not finite; environment maps must be", x, y));
      }
    }
  }
  const auto mean_of_ring = [&](int ring) -> Vec3f {
    Vec3d sum(0, 0, 0);
    const Vec3f* texel = level.texels.data() + level.rings[static_cast<std::size_t>(ring)].begin;
    for (int i = 0; i < image.width; ++i) sum += texel[i].cast<double>();
    return (sum / image.width).cast<float>();
  };
  level.texels.front() = mean_of_ring(1);
  level.texels.back() = mean_of_ring(level.rows);
  return level;
}

/// The same level with texels as many as a ring's circumference asks for, each the mean over its
/// part of the ring: the texels are about as fine along rings as across, so that a lobe meets
/// equally many texels everywhere. Of many rows two are made one, and two columns: lobes reach over
/// three of the rows at one standard deviation, and have four times as few texels to add up.
EnvironmentMap::Level EnvironmentMap::thinned(const Level& level) {
  constexpr int kManyRows = 128;  // Rows of a level from which on two are made one.
  const int step = level.rows >= kManyRows && level.rows % 2 == 0 ? 2 : 1;
  Level out;
  out.rows = level.rows / step;
  // The variance of the mean of two neighbours, along each axis: a quarter of their distance
  // squared.
  if (step == 2)
    out.variance = static_cast<float>(portable::squared(std::numbers::pi / level.rows) / 4);
  const int columns = level.rings[1].count;
  for (int k = 0; k <= out.rows + 1; ++k) {
    const bool pole = k == 0 || k == out.rows + 1;
    const int most = pole ? 1 : columns / step;
    const int wanted = static_cast<int>(std::ceil(most * portable::sin(out.colatitude(k))));
    out.add_ring(std::clamp(wanted, std::min(4, most), most));
  }
  out.texels.resize(out.rings.back().begin + 1);
  out.texels.front() = level.texels.front();
  out.texels.back() = level.texels.back();
  // Sum over the texels of one ring from `left` on, in texels, each by its part.
  const auto add = [&](int ring, double left, double right, double weight, Vec3d& sum) {
    const Vec3f* from = level.texels.data() + level.rings[static_cast<std::size_t>(ring)].begin;
    for (int i = static_cast<int>(left); i < right; ++i) {
      const double part = std::min(right, i + 1.0) - std::max<double>(left, i);
      sum += weight * part * from[i].cast<double>();
    }
  };
  parallel_for(
      static_cast<std::size_t>(out.rows), 16, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t row = begin; row < end; ++row) {
          const Ring& ring = out.rings[row + 1];
          const double ratio = static_cast<double>(columns) / ring.count;
          const int first = static_cast<int>(row) * step + 1;
          for (int j = 0; j < ring.count; ++j) {
            const double left = j * ratio;
            const double right = std::min<double>((j + 1) * ratio, columns);
            Vec3d sum(0, 0, 0);
            double total = 0;
            for (int k = first; k < first + step; ++k) {
              const double weight = portable::sin(level.colatitude(k));
              add(k, left, right, weight, sum);
              total += weight * (right - left);
            }
            out.texels[ring.begin + static_cast<std::size_t>(j)] = (sum / total).cast<float>();
          }
        }
      });
  return out;
}

/// Sum over a lobe exp(-concentration (1 - cos)), weighted by solid angle, over its weight.
Vec3f EnvironmentMap::filtered_texel(const Level& from, double colatitude, double u,
                                     double concentration) {
  static const Decay decay;
  const double reach = std::min(2.0, kReach / concentration);  // A reach of 1 - cos.
  const double angle = 2 * portable::asin(std::sqrt(reach / 2));
  const auto row_of = [&](double at) { return at / std::numbers::pi * from.rows + 0.5; };
  const int first = std::max(1, static_cast<int>(std::ceil(row_of(colatitude - angle))));
  const int last = std::min(from.rows, static_cast<int>(std::floor(row_of(colatitude + angle))));
  Vec3d sum(0, 0, 0);
  double total = 0;
  for (int k = first; k <= last; ++k) {
    const Ring& ring = from.rings[static_cast<std::size_t>(k)];
    const double other = from.colatitude(k);
    // 1 - cos = 2 sin^2(difference of latitude / 2) + 2 sin sin sin^2(of longitude / 2): nothing
    // cancels.
    const double across = 2 * portable::squared(portable::sin((colatitude - other) / 2));
    const double along = 2 * portable::sin(colatitude) * portable::sin(other);
    if (across > reach) continue;
    const double half_sine2 = along > 0 ? (reach - across) / along : 1;
    int begin = 0;
    int count = ring.count;
    if (half_sine2 < 1) {
      const double columns = portable::asin(std::sqrt(half_sine2)) / std::numbers::pi * ring.count;
      begin = static_cast<int>(std::ceil(u * ring.count - 0.5 - columns));
      count = static_cast<int>(std::floor(u * ring.count - 0.5 + columns)) - begin + 1;
      count = std::min(count, ring.count);
    }
    const double solid_angle = from.solid_angle(k);
    const double half = std::numbers::pi * ((begin + 0.5) / ring.count - u);
    const double step_sine = portable::sin(std::numbers::pi / ring.count);
    const double step_cosine = portable::cos(std::numbers::pi / ring.count);
    double sine = portable::sin(half);
    double cosine = portable::cos(half);
    const Vec3f* texels = from.texels.data() + ring.begin;
    int column = ((begin % ring.count) + ring.count) % ring.count;
    for (int i = 0; i < count; ++i) {
      const double w = solid_angle * decay(concentration * (across + along * sine * sine));
      sum += w * texels[column].cast<double>();
      total += w;
      const double turned = sine * step_cosine + cosine * step_sine;
      cosine = cosine * step_cosine - sine * step_sine;
      sine = turned;
      if (++column == ring.count) column = 0;
    }
  }
  return (sum / total).cast<float>();
}

EnvironmentMap::Level EnvironmentMap::filtered(const Level& from, int rows, float variance) {
  Level to;
  to.rows = rows;
  to.variance = variance;
  for (int k = 0; k <= rows + 1; ++k) {
    const double circumference = 2 * rows * portable::sin(to.colatitude(k));
    to.add_ring(k == 0 || k == rows + 1 ? 1
                                        : std::max(4, static_cast<int>(std::ceil(circumference))));
  }
  to.texels.resize(to.rings.back().begin + 1);
  const double concentration =
      concentration_of(static_cast<double>(variance) - static_cast<double>(from.variance));
  parallel_for(to.rings.size(), 1, [&](std::size_t k, std::size_t, int) {
    const Ring& ring = to.rings[k];
    for (int i = 0; i < ring.count; ++i) {
      to.texels[ring.begin + static_cast<std::size_t>(i)] = filtered_texel(
          from, to.colatitude(static_cast<int>(k)), (i + 0.5) / ring.count, concentration);
    }
  });
  // The rest that sampling has left undone, some 10^-4 of the whole.
  const Vec3d wanted = mean(from);
  const Vec3d is = mean(to);
  Vec3f scale(1, 1, 1);
  for (int c = 0; c < 3; ++c) {
    if (is[c] > 0 && wanted[c] > 0) scale[c] = static_cast<float>(wanted[c] / is[c]);
  }
  for (Vec3f& texel : to.texels) texel = texel.cwiseProduct(scale);
  return to;
}

Vec3d EnvironmentMap::mean(const Level& level) {
  Vec3d sum(0, 0, 0);
  for (int k = 1; k <= level.rows; ++k) {
    const Ring& ring = level.rings[static_cast<std::size_t>(k)];
    Vec3d row(0, 0, 0);
    for (int i = 0; i < ring.count; ++i) {
      row += level.texels[ring.begin + static_cast<std::size_t>(i)].cast<double>();
    }
    sum += level.solid_angle(k) * row;
  }
  return sum / (4 * std::numbers::pi);
}

EnvironmentMap::EnvironmentMap(const Image& image, const std::string& name) {
  levels_.push_back(image_level(image, name));
  while (levels_.back().variance < kWidest) {
    const Level& last = levels_.back();
    const int rows = std::max(kFewestRows, (last.rows + 1) / 2);
    // A picture of fewer rows than the level is not to be seen between.
    const double deviation =
        std::max(kDeviationPerRow * std::numbers::pi / std::min(rows, last.rows),
                 2 * std::sqrt(static_cast<double>(last.variance)));
    const auto variance = static_cast<float>(deviation * deviation);
    levels_.push_back(levels_.size() == 1 ? filtered(thinned(last), rows, variance)
                                          : filtered(last, rows, variance));
  }
}

Vec3f EnvironmentMap::sample(const Level& level, const Vec2f& place) {
  const float row = place.y() * static_cast<float>(level.rows) + 0.5F;
  const int k = std::min(static_cast<int>(row), level.rows);
  float part = row - static_cast<float>(k);
  // The poles are half a row from the rings next to them.
  if (k == level.rows) part = 2 * part;
  if (k == 0) part = 2 * part - 1;
  const auto at = [&](int number) -> Vec3f {
    const Ring& ring = level.rings[static_cast<std::size_t>(number)];
    const Vec3f* texels = level.texels.data() + ring.begin;
    if (ring.count == 1) return texels[0];
    const float x = place.x() * static_cast<float>(ring.count) - 0.5F;
    const float floor = std::floor(x);
    const float part_x = x - floor;
    const int left = floor < 0 ? ring.count - 1 : static_cast<int>(floor);
    const int right = left + 1 == ring.count ? 0 : left + 1;
    return (1 - part_x) * texels[left] + part_x * texels[right];
  };
  return (1 - part) * at(k) + part * at(k + 1);
}

Vec3f EnvironmentMap::radiance(const Vec3f& direction, float variance) const {
  const Vec2f place = lat_long_place(direction);
  std::size_t above = 1;  // The first level that is filtered more.
  while (above < levels_.size() && levels_[above].variance <= variance) ++above;
  const Level& fine = levels_[above - 1];
  Vec3f color = sample(fine, place);
  if (above == levels_.size() || !(variance > fine.variance)) return color;
  const Level& coarse = levels_[above];
  const float part = (variance - fine.variance) / (coarse.variance - fine.variance);
  return (1 - part) * color + part * sample(coarse, place);
}

std::uint64_t EnvironmentMap::memory_bytes() const {
  std::uint64_t bytes = 0;
  for (const Level& level : levels_) {
    bytes += level.texels.size() * sizeof(Vec3f) + level.rings.size() * sizeof(Ring);
  }
  return bytes;
}

void load_environment(Scene& scene) {
  if (!scene.environment || scene.environment->map) return;
  const std::string& image = scene.environment->image;
  const std::string& naming = scene.environment->named_by;
  scene.environment->map = std::make_shared<const EnvironmentMap>(
      image == kSkyName ? procedural_sky(kSkyWidth, kSkyWidth / 2)
      : naming.empty()  ? read_image(image)
                        : read_image(open_named(naming, image)),
      image);
}

}  // namespace surfel
