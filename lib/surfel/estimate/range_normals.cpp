#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/median.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/neighborhood_plane.h>
#include <surfel/estimate/range_normals.h>
#include <surfel/estimate/window_moments.h>

namespace surfel {
namespace {

constexpr std::size_t kRangeGrain = 1 << 14;
constexpr std::size_t kWindowGrain = 64;
/// A pixel has four neighbours: the fourth is no further than this many times the first.
constexpr double kSquareness = 1.6;
/// Least distance that all but a twentieth of the pixels keep, by the median.
constexpr double kEvenness = 0.6;
/// Windows that the noise is told from, and their points.
constexpr std::size_t kNoiseWindows = 4096;
constexpr std::size_t kNoiseWindow = 64;
constexpr std::size_t kRangeGroups = 16;
/// Residuals below this share of the range are rounding of floats, which a quantised flat wall
/// consists of.
constexpr double kRangeRounding = 1e-5;
constexpr double kMostExponent = 2;
/// Largest noise of the range, in ranges. No camera has as much; shells around the sensor, some
/// behind the others, have any.
constexpr double kMostNoise = 0.5;
/// Standard error that windows are made for, radians.
constexpr double kWindowError = 0.05;
constexpr std::size_t kLeastWindow = 16;
constexpr std::size_t kMostWindow = 512;
/// Pixels share a window if they lie no further than this apart, in radii of the window, ...
constexpr double kPixelReach = 0.2;
/// ... and if the larger of the windows that they need is at most this factor larger.
constexpr double kSharedSize = 1.25;
/// Fits, and the residual from which on a point has no weight in the last of them, in standard
/// deviations of the noise.
constexpr int kFits = 4;
constexpr double kLastScale = 5;
/// Slope up to which a surface may recede from the point before it counts as a residual.
constexpr double kMostSlope = 4;
/// Standard deviation of the slopes that surfaces have towards the sensor.
constexpr double kPriorSlope = 2;

/// The plane q = inverse + slope_u u + slope_w w in a window of pixels (u, w, q): u and w are their
/// place in the image at depth 1 along the window's axis, and q their inverse depth in units of a
/// pixel's in the middle, less one.
struct InversePlane {
  double inverse = 0;
  double slope_u = 0, slope_w = 0;
  double spread = 0;    ///< Trace of the inverse of the slopes' normal matrix.
  double residual = 0;  ///< Sum of the weighted squares of the residuals.
};

/// The weighted least squares fit to pixels that have these moments. `ridge` is added to the
/// diagonal of the slopes' matrix.
InversePlane fit_inverse(const Moments& m, double ridge) {
  const double uu = m.xx - m.x * m.x / m.n + ridge;
  const double ww = m.yy - m.y * m.y / m.n + ridge;
  const double uw = m.xy - m.x * m.y / m.n;
  const double uq = m.xz - m.x * m.z / m.n;
  const double wq = m.yz - m.y * m.z / m.n;
  const double qq = m.zz - m.z * m.z / m.n;
  const double determinant = uu * ww - uw * uw;
  InversePlane plane;
  plane.slope_u = (uq * ww - wq * uw) / determinant;
  plane.slope_w = (wq * uu - uq * uw) / determinant;
  plane.inverse = (m.z - plane.slope_u * m.x - plane.slope_w * m.y) / m.n;
  plane.spread = (uu + ww) / determinant;
  const double slopes2 = plane.slope_u * plane.slope_u + plane.slope_w * plane.slope_w;
  plane.residual = std::max(0.0, qq - plane.slope_u * uq - plane.slope_w * wq - ridge * slopes2);
  return plane;
}

/// Relative noise of the range: factor r^exponent.
struct RangeNoise {
  double factor = 0;
  double exponent = 0;

  double at(double range) const { return factor * portable::pow(range, exponent); }
};

class RangeImage {
 public:
  RangeImage(const Array<Vec3f>& points, const Vec3d& sensor) : points_(points), sensor_(sensor) {
    direction_.resize(points.size());
    parallel_each(points.size(), kRangeGrain,
                  [&](std::size_t i) { direction_[i] = direction_from(sensor_, points_[i]); });
    search_ = make_neighbor_search(direction_);
    order_ = morton_order(direction_);
  }

  /// Are the directions spread as evenly as pixels are?
  bool even() const {
    std::vector<Neighbor> near;
    return seen_as_pixels(points_.size(), sample_places(points_, kPixelSample), sensor_,
                          [&](const Vec3f& direction, std::size_t k, std::vector<float>& out) {
                            search_->nearest(direction, k, near);
                            out.clear();
                            for (const Neighbor& n : near) out.push_back(n.distance2);
                          });
  }

  /// Finds the pitch of the pixels.
  void measure_pitch() {
    const std::size_t count = std::min(kPixelSample, points_.size());
    std::vector<double> pitch(count);
    for_windows(count, [&](std::size_t s, std::size_t i, Worker& w) {
      search_->nearest(direction_[i], kLeastWindow, w.near);
      pitch[s] = std::sqrt(static_cast<double>(w.near.back().distance2) * std::numbers::pi /
                           static_cast<double>(w.near.size()));
    });
    pitch_ = median(pitch);
  }

  /// False where the residuals are too large to be noise.
  bool measure_noise() {
    struct Residual {
      double range, relative;
    };
    const std::size_t count = std::min(kNoiseWindows, points_.size());
    std::vector<Residual> found(count);
    for_windows(count, [&](std::size_t s, std::size_t i, Worker& w) {
      look(direction_[i], ray(i).norm(), kNoiseWindow, w);
      Moments moments;
      for (std::size_t k = 0; k < w.window.size(); ++k) {
        moments.add({w.window.x[k], w.window.y[k], w.window.z[k]});
      }
      const InversePlane plane = fit_inverse(moments, 0);
      found[s] = {ray(i).norm(), std::sqrt(plane.residual / (moments.n - 3))};
    });
    std::sort(found.begin(), found.end(), [](const Residual& a, const Residual& b) {
      return std::pair(a.range, a.relative) < std::pair(b.range, b.relative);
    });
    std::vector<Vec2d> groups;  // Logarithms of range and relative noise.
    for (std::size_t g = 0; g < kRangeGroups; ++g) {
      std::vector<double> relative;
      const std::size_t begin = g * count / kRangeGroups;
      const std::size_t end = (g + 1) * count / kRangeGroups;
      for (std::size_t s = begin; s < end; ++s) relative.push_back(found[s].relative);
      const double middle = median(relative);
      if (!(middle > kRangeRounding)) continue;
      groups.emplace_back(portable::log(found[(begin + end) / 2].range), portable::log(middle));
    }
    noise_ = {kRangeRounding, 0};
    if (groups.empty()) return true;
    std::vector<double> slopes;
    for (std::size_t a = 0; a < groups.size(); ++a) {
      for (std::size_t b = a + 1; b < groups.size(); ++b) {
        const Vec2d step = groups[b] - groups[a];
        if (step.x() > 0.02) slopes.push_back(step.y() / step.x());  // Nearer ones tell little.
      }
    }
    if (!slopes.empty()) noise_.exponent = std::clamp(median(slopes), 0.0, kMostExponent);
    std::vector<double> heights;
    for (const Vec2d& g : groups) heights.push_back(g.y() - noise_.exponent * g.x());
    noise_.factor = portable::exp(median(heights));
    return noise_.at(found[count / 2].range) <= kMostNoise;
  }

  void remake(NormalEstimate& out) {
    parallel_for(points_.size(), kWindowGrain, [&](std::size_t begin, std::size_t end, int worker) {
      std::size_t i = begin;
      while (i < end) i += remake(i, end, workers_[worker], out);
    });
  }

 private:
  struct Worker {
    std::vector<Neighbor> near;
    SharedWindow window;
    WindowPoints points;
    WindowMoments moments;
  };

  Vec3d ray(std::size_t i) const { return points_[i].cast<double>() - sensor_; }

  /// Calls body(s, point, worker) for s below count and points spread evenly.
  template <class Body>
  void for_windows(std::size_t count, const Body& body) {
    parallel_for(count, kWindowGrain, [&](std::size_t begin, std::size_t end, int worker) {
      for (std::size_t s = begin; s < end; ++s) {
        body(s, s * points_.size() / count, workers_[worker]);
      }
    });
  }

  /// The pixel (u, w, q) of a point in a frame whose last axis is the window's.
  Vec3d pixel(std::size_t i, const Eigen::Matrix3d& frame, double range) const {
    const Vec3d p = frame.transpose() * ray(i);
    return {p.x() / p.z(), p.y() / p.z(), range / p.z() - 1};
  }

  /// The window of the `size` points that are nearest to a direction; returns the frame that its
  /// pixels are in. Their inverse depths are in units of that at `range`.
  Eigen::Matrix3d look(const Vec3f& direction, double range, std::size_t size, Worker& w) const {
    // Where the image has no gap the points lie within this reach, and are found sooner.
    const double reach = 1.1 * pitch_ * std::sqrt(static_cast<double>(size) / std::numbers::pi);
    search_->within(direction, static_cast<float>(reach), size, w.near);
    if (w.near.size() < size) search_->nearest(direction, size, w.near);
    Eigen::Matrix3d frame;
    frame.col(2) = direction.cast<double>().normalized();
    frame.col(0) = frame.col(2).unitOrthogonal();
    frame.col(1) = frame.col(2).cross(frame.col(0));
    w.window.clear();
    for (const Neighbor& n : w.near) w.window.add(pixel(n.index, frame, range));
    return frame;
  }

  /// Pixels that the noise at a range asks for.
  double window_size(double range) const {
    // A disc of n pixels of this pitch has the variance n pitch^2 / (4 pi) along each axis.
    const double size =
        2 * std::sqrt(std::numbers::pi) * noise_.at(range) / (kWindowError * pitch_);
    return std::clamp(size, double(kLeastWindow), double(kMostWindow));
  }

  /// How many points, from order_[first] on and before order_[end], can share a window of this
  /// size.
  std::size_t group_size(std::size_t first, std::size_t end, double size) const {
    const std::size_t most = std::min(end, first + WindowPoints::kSize);
    const double reach2 = kPixelReach * kPixelReach * size * pitch_ * pitch_ / std::numbers::pi;
    std::size_t i = first + 1;
    for (; i < most; ++i) {
      const double other = window_size(ray(order_[i]).norm());
      if (std::max(other / size, size / other) > kSharedSize) break;
      const Vec3f step = direction_[order_[i]] - direction_[order_[first]];
      if (static_cast<double>(step.squaredNorm()) > reach2) break;
    }
    return i - first;
  }

  /// Makes the normals of a group of points, from order_[first] on and before order_[end]; returns
  /// how many there are.
  std::size_t remake(std::size_t first, std::size_t end, Worker& w, NormalEstimate& out) const {
    const double first_range = ray(order_[first]).norm();
    const double size = window_size(first_range);
    const std::size_t count = group_size(first, end, size);
    Vec3f middle(0, 0, 0);
    for (std::size_t k = 0; k < count; ++k) middle += direction_[order_[first + k]];
    const Eigen::Matrix3d frame =
        look(middle.normalized(), first_range, static_cast<std::size_t>(size), w);
    std::array<double, WindowPoints::kSize> relative{}, scale{};
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t i = order_[first + k];
      const Vec3d p = pixel(i, frame, first_range);
      w.points.x[k] = p.x();
      w.points.y[k] = p.y();
      w.points.slack[k] = kMostSlope * (1 + p.z());
      w.points.set_plane(k, Vec3d(0, 0, 1), p.z());
      relative[k] = noise_.at(ray(i).norm());
      scale[k] = kLastScale * relative[k] * (1 + p.z()) * (1 << (kFits - 2));
      w.points.inverse_scale[k] = 1 / scale[k];
    }
    std::array<InversePlane, WindowPoints::kSize> planes;
    for (int fit = 0; fit < kFits; ++fit) {
      sum_in_image(count, w.window, w.points, w.moments);
      for (std::size_t k = 0; k < count; ++k) {
        const double ridge = relative[k] * relative[k] / (kPriorSlope * kPriorSlope);
        planes[k] = fit_inverse(w.moments.of(k), ridge);
        const InversePlane& plane = planes[k];
        w.points.slack[k] = 0;
        w.points.set_plane(k, Vec3d(-plane.slope_u, -plane.slope_w, 1), plane.inverse);
        w.points.inverse_scale[k] = std::ldexp(1 / scale[k], std::min(fit + 1, kFits - 2));
      }
    }
    for (std::size_t k = 0; k < count; ++k) {
      store(order_[first + k], frame, planes[k], w.moments.of(k), relative[k], w.window.size(),
            out);
    }
    return count;
  }

  /// Notes the normal of point i, whose window has the plane and the moments.
  void store(std::size_t i, const Eigen::Matrix3d& frame, const InversePlane& plane,
             const Moments& moments, double relative, std::size_t size, NormalEstimate& out) const {
    const Vec3d normal(plane.slope_u, plane.slope_w, 1 + plane.inverse);
    const Vec3d unit = (frame * normal).normalized();
    const double range = ray(i).norm();
    const double across =
        std::abs(unit.dot(ray(i))) / range;  // The noise is along the line of sight.
    out.normal[i] = with_fixed_side(unit);
    out.noise[i] = static_cast<float>(range * relative * across);
    const double variation = plane.residual * across * across / (moments.n * moments.variance());
    const double error = relative * std::sqrt(plane.spread) / normal.norm();
    out.quality[i] = {static_cast<float>(std::clamp(variation, 0.0, 1.0 / 3)),
                      static_cast<float>(std::max(0.0, 1 - error)),
                      static_cast<std::uint16_t>(size), PointFlag::kGood};
  }

  const Array<Vec3f>& points_;
  Vec3d sensor_;
  Array<Vec3f> direction_;
  Array<std::uint32_t>
      order_;  ///< Points by direction, along a curve on which neighbours are near.
  std::unique_ptr<NeighborSearch> search_;
  PerWorker<Worker> workers_;
  double pitch_ = 0;  ///< Angle between neighbouring pixels.
  RangeNoise noise_;
};

}  // namespace

bool seen_as_pixels(std::size_t points, std::span<const Vec3f> sample, const Vec3d& sensor,
                    NearestDirections nearest) {
  // Below a tenth of the sample not even a range image shows it.
  if (10 * points < kPixelSample || sample.empty()) return false;
  constexpr std::size_t kRing = 5;  // The pixel itself and its four neighbours.
  std::vector<double> first, fourth;
  std::vector<float> distance2;
  for (const Vec3f& place : sample) {
    nearest(direction_from(sensor, place), kRing, distance2);
    first.push_back(std::sqrt(static_cast<double>(distance2[1])));
    fourth.push_back(std::sqrt(static_cast<double>(distance2[4])));
  }
  const auto twentieth = first.begin() + static_cast<std::ptrdiff_t>(first.size() / 20);
  std::nth_element(first.begin(), twentieth, first.end());
  const double low = *twentieth;
  const double middle = median(first);
  return low > kEvenness * middle && median(fourth) < kSquareness * middle;
}

bool remake_range_normals(const Array<Vec3f>& points, const Vec3d& sensor, NormalEstimate& out) {
  for (const Vec3f& p : points) {
    if ((p.cast<double>() - sensor).isZero(0)) return false;
  }
  RangeImage image(points, sensor);
  if (!image.even()) return false;
  image.measure_pitch();
  if (!image.measure_noise()) return false;
  out.noise.resize(points.size());
  image.remake(out);
  out.remade = points.size();
  return true;
}

}  // namespace surfel
