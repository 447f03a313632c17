#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/render/relief.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/render/relief.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/elementary.h>
#include <surfel/base/fused-inl.h>

// Defined once for all targets.
#ifndef SURFEL_RENDER_RELIEF_TAPS_
#define SURFEL_RENDER_RELIEF_TAPS_
namespace surfel {
namespace {

/// A pixel that another one looks at.
struct Tap {
  std::ptrdiff_t offset;  ///< In a NearnessPicture.
  float slope;            ///< Slope for a relative change of the nearness by 1.
};

/// All pixels that a pixel looks at.
struct ReliefTaps {
  int rings = 0;
  /// For each pair of directions, for each ring, the taps on both sides of the pixel.
  std::vector<Tap> tap;
  float reach = 0;  ///< Reaches in depth for a relative change of the nearness by 1.
  bool orthographic = false;
};

}  // namespace
}  // namespace surfel
#endif

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

/// Share of the light along a row of the picture that the horizons leave.
void occlude_row(const ReliefTaps& taps, const float* from, std::size_t count, float* to) {
  const D d;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1);
  const V two = hn::Set(d, 2);
  // Steeper slopes hide no more, or no less.
  const V steepest = hn::Set(d, 8);
  const V lowest = hn::Neg(steepest);
  const V level = hn::Set(d, 1e-4F);  // Horizons that make up less hide nothing.
  const V reach = hn::Set(d, taps.reach);
  const std::size_t pairs = taps.tap.size() / (2 * taps.rings);
  for (std::size_t x = 0; x < count; x += hn::Lanes(d)) {
    const V here = hn::LoadU(d, from + x);
    const auto surface = hn::Gt(here, hn::Set(d, NearnessPicture::kNothing));
    const V center = hn::IfThenElse(surface, here, one);
    const V unit = taps.orthographic ? one : hn::Div(one, center);
    const auto change = [&](const Tap& tap) HWY_ATTR {
      return hn::Mul(hn::Sub(hn::LoadU(d, from + x + tap.offset), center), unit);
    };
    const auto slope = [&](V by, const Tap& tap) HWY_ATTR {
      return hn::Min(steepest, hn::Max(lowest, hn::Mul(by, hn::Set(d, tap.slope))));
    };
    V open = zero;
    const Tap* tap = taps.tap.data();
    for (std::size_t pair = 0; pair < pairs; ++pair) {
      // The cotangent of the sum of both horizons' angles, which falls from 0 to pi. Taps opposite
      // to each other lie at the same distance, so that the tilt of a plane cancels out.
      V least = hn::Set(d, 1e6F);
      for (int ring = 0; ring < taps.rings; ++ring, tap += 2) {
        const V change_a = change(tap[0]);
        const V change_b = change(tap[1]);
        const V a = slope(change_a, tap[0]);
        const V b = slope(change_b, tap[1]);
        const V product = hn::Mul(a, b);
        const V sum = hn::Add(a, b);
        // What is nearer by one to two reaches counts less and less.
        const V step = hn::Mul(reach, hn::Max(change_a, change_b));
        const V share = hn::Min(one, hn::Max(zero, hn::Sub(two, step)));
        const V without = hn::Mul(hn::Sub(one, share), hn::Add(one, hn::Abs(product)));
        const V adjacent = mul_add(share, hn::Sub(one, product), without);
        const V opposite = hn::Max(level, hn::Mul(share, sum));
        const V cotangent = hn::Div(adjacent, opposite);
        least = hn::IfThenElse(hn::Gt(sum, zero), hn::Min(least, cotangent), least);
      }
      open = hn::Add(open, hn::Div(least, hn::Sqrt(mul_add(least, least, one))));
    }
    // A horizon at the angle e above a plane leaves cos^2 e = (1 + cos 2e) / 2 of its light.
    const V half = hn::Set(d, 0.5F);
    const V share = mul_add(open, hn::Set(d, 0.5F / static_cast<float>(pairs)), half);
    HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)];
    hn::Store(hn::IfThenElse(surface, share, one), d, value);
    std::copy_n(value, std::min(hn::Lanes(d), count - x), to + x);
  }
}

/// The same by eye-dome lighting.
void shade_row(const ReliefTaps& taps, const float* from, std::size_t count, float* to) {
  constexpr float kStrength = 0.3F;  // Outlines are dark, and slopes are not.
  const D d;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1);
  const float scale = -kStrength / static_cast<float>(taps.tap.size());
  for (std::size_t x = 0; x < count; x += hn::Lanes(d)) {
    const V here = hn::LoadU(d, from + x);
    const auto surface = hn::Gt(here, hn::Set(d, NearnessPicture::kNothing));
    const V center = hn::IfThenElse(surface, here, one);
    const V unit = taps.orthographic ? one : hn::Div(one, center);
    V sum = zero;
    for (const Tap& tap : taps.tap) {
      const V change = hn::Mul(hn::Sub(hn::LoadU(d, from + x + tap.offset), center), unit);
      sum = hn::Add(sum, hn::Max(zero, hn::Mul(change, hn::Set(d, tap.slope))));
    }
    HWY_ALIGN float value[HWY_MAX_BYTES / sizeof(float)];
    hn::Store(hn::IfThenElse(surface, sum, zero), d, value);
    const std::size_t lanes = std::min(hn::Lanes(d), count - x);
    for (std::size_t i = 0; i < lanes; ++i) to[x + i] = portable::exp(scale * value[i]);
  }
}

}  // namespace

void relief_row(const ReliefTaps& taps, Relief relief, const float* from, std::size_t count,
                float* to) {
  if (relief == Relief::kOcclusion) {
    occlude_row(taps, from, count, to);
  } else {
    shade_row(taps, from, count, to);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(relief_row);

/// How far horizons are looked for, as a share of the picture's shorter side. Hollows of this size
/// read as such in pictures of whole objects; twice as far costs the details and gains little.
constexpr double kReliefReach = 0.06;
/// Rings of taps, each at half the distance of the next, and pairs of opposite directions.
constexpr int kRings = 5;
constexpr int kPairs = 6;
/// Rings of eye-dome lighting, the first 1 / 512 of the shorter side away, and pairs of directions.
constexpr int kDomeRings = 3;
constexpr int kDomePairs = 4;
double shorter_side(const Camera& camera) { return std::min(camera.width, camera.height); }

/// Distance of the outermost ring, pixels.
double reach_px(Relief relief, const Camera& camera) {
  const double first = std::ldexp(1, kDomeRings - 1) / 512;
  return std::max(1.0, (relief == Relief::kEyeDome ? first : kReliefReach) * shorter_side(camera));
}

ReliefTaps make_taps(const Camera& camera, Relief relief, std::ptrdiff_t stride) {
  ReliefTaps out;
  const double most = reach_px(relief, camera);
  const double focal = 0.5 * (camera.focal_x + camera.focal_y);
  out.reach = static_cast<float>(focal / most);
  out.orthographic = camera.orthographic;
  out.rings = relief == Relief::kEyeDome ? kDomeRings : kRings;
  const int pairs = relief == Relief::kEyeDome ? kDomePairs : kPairs;
  for (int pair = 0; pair < pairs; ++pair) {
    for (int ring = 0; ring < out.rings; ++ring) {
      for (const double sign : {1.0, -1.0}) {
        // Rings are turned against one another, so that edges leave no pattern of few directions.
        const double angle = std::numbers::pi / pairs * (pair + (ring % 2) * 0.5);
        const double radius = std::ldexp(most, ring + 1 - out.rings);
        const double x = std::round(radius * portable::cos(angle));
        const double y = std::round(radius * portable::sin(angle));
        // In small pictures inner rings fall on the pixel itself, which has no slope.
        const double length = std::max(1.0, portable::hypot(x, y));
        out.tap.push_back(
            {static_cast<std::ptrdiff_t>(sign * y) * stride + static_cast<std::ptrdiff_t>(sign * x),
             static_cast<float>(focal / length)});
      }
    }
  }
  return out;
}

constexpr std::size_t kRowGrain = 8;

float median(float a, float b, float c) {
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

/// Lifts every share to the median of the 3 x 3 pixels around it. At a silhouette a pixel may show
/// the depth of what lies behind it, close to the edge that hides it: such pixels would be dark
/// dots along the edge, while hollows are wider than a pixel.
Array<float> without_dots(const Array<float>& shares, std::size_t width, std::size_t height) {
  Array<float> lifted(shares.size());
  parallel_for(height, kRowGrain, [&](std::size_t begin, std::size_t end, int) {
    // The pixels of a column, sorted, with a column more at either end.
    std::vector<float> low(width + 2);
    std::vector<float> middle(width + 2);
    std::vector<float> high(width + 2);
    for (std::size_t y = begin; y < end; ++y) {
      const float* here = shares.data() + y * width;
      const float* above = y == 0 ? here : here - width;
      const float* below = y + 1 == height ? here : here + width;
      for (std::size_t x = 0; x < width; ++x) {
        low[x + 1] = std::min(std::min(above[x], here[x]), below[x]);
        middle[x + 1] = median(above[x], here[x], below[x]);
        high[x + 1] = std::max(std::max(above[x], here[x]), below[x]);
      }
      for (std::vector<float>* row : {&low, &middle, &high}) {
        row->front() = (*row)[1];
        row->back() = (*row)[width];
      }
      float* to = lifted.data() + y * width;
      for (std::size_t x = 0; x < width; ++x) {
        const float lows = std::max(std::max(low[x], low[x + 1]), low[x + 2]);
        const float middles = median(middle[x], middle[x + 1], middle[x + 2]);
        const float highs = std::min(std::min(high[x], high[x + 1]), high[x + 2]);
        to[x] = std::max(here[x], median(lows, middles, highs));
      }
    }
  });
  return lifted;
}

}  // namespace

void NearnessPicture::reset(int width, const RowRange& rows, int margin) {
  width_ = width;
  rows_ = rows;
  margin_ = margin;
  // Vectors may reach beyond the last pixel that a row's last pixel looks at.
  constexpr int kSpare = 64;
  stride_ = width + 2 * margin + kSpare;
  value_.resize(static_cast<std::size_t>(stride_) * (rows.end - rows.begin + 2 * margin) + kSpare);
  std::fill(value_.begin(), value_.end(), kNothing);
}

int relief_margin(Relief relief, const Camera& camera) {
  if (relief == Relief::kNone) return 0;
  return static_cast<int>(std::ceil(reach_px(relief, camera))) + 1;
}

Array<float> relief_shares(const NearnessPicture& nearness, const Camera& camera, Relief relief) {
  const std::size_t width = nearness.width();
  const RowRange& rows = nearness.rows();
  const auto height = static_cast<std::size_t>(rows.end - rows.begin);
  Array<float> shares(width * height);
  const ReliefTaps taps = make_taps(camera, relief, nearness.stride());
  parallel_for(height, kRowGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t y = begin; y < end; ++y) {
      HWY_DYNAMIC_DISPATCH(relief_row)
      (taps, relief, nearness.at(0, rows.begin + static_cast<int>(y)), width,
       shares.data() + y * width);
    }
  });
  // Eye-dome lighting is there for lines.
  return relief == Relief::kOcclusion ? without_dots(shares, width, height) : shares;
}

void add_relief(Image& image, const NearnessPicture& nearness, const Camera& camera, Relief relief,
                const Rgba& background) {
  const Array<float> shares = relief_shares(nearness, camera, relief);
  const std::size_t channels = image.channels.size();
  const float behind[4] = {background.red, background.green, background.blue, background.alpha};
  const RowRange rows = camera.drawn_rows();
  parallel_for(rows.end - rows.begin, kRowGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t row = begin; row < end; ++row) {
      const int y = rows.begin + static_cast<int>(row);
      float* pixel = image.pixel(0, y);
      const float* share =
          shares.data() + static_cast<std::size_t>(y - nearness.rows().begin) * image.width;
      for (int x = 0; x < image.width; ++x, pixel += channels, ++share) {
        const float left = 1 - pixel[3];
        for (int c = 0; c < 3; ++c) pixel[c] = pixel[c] * *share + left * behind[c];
        pixel[3] += left * behind[3];
      }
    }
  });
}

}  // namespace surfel
#endif
