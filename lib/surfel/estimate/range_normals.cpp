#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include <surfel/base/median.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/neighborhood_plane.h>
#include <surfel/estimate/range_normals.h>

namespace surfel {
namespace {

constexpr std::size_t kRangeGrain = 1 << 14;
constexpr std::size_t kWindowGrain = 32;
/// Points whose nearest directions tell whether they are pixels; below a tenth of them not even a
/// range image shows it.
constexpr std::size_t kPixelLook = 1024;
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
/// Standard error that windows are made for, radians.
constexpr double kWindowError = 0.07;
constexpr std::size_t kLeastWindow = 16;
constexpr std::size_t kMostWindow = 512;
/// Fits, and the residual from which on a point has no weight in the last of them, in standard
/// deviations of the noise.
constexpr int kFits = 4;
constexpr double kLastScale = 5;
/// Slope up to which a surface may recede from the point before it counts as a residual.
constexpr double kMostSlope = 4;
/// Standard deviation of the slopes that surfaces have towards the sensor.
constexpr double kPriorSlope = 2;

/// A point in a window, beside the line of sight through the window's middle.
struct Pixel {
  double u, w;     ///< Place in the image at depth 1.
  double inverse;  ///< Inverse depth.
};

/// 1 / z = inverse + slope_u u + slope_w w.
struct InversePlane {
  double inverse = 0;
  double slope_u = 0, slope_w = 0;
  double spread = 0;  ///< Trace of the inverse of the slopes' normal matrix.

  double residual(const Pixel& p) const {
    return p.inverse - inverse - slope_u * p.u - slope_w * p.w;
  }
};

/// The weighted least squares fit. `ridge` is added to the diagonal of the slopes' matrix.
template <class Weight>
InversePlane fit_inverse(std::span<const Pixel> pixels, double ridge, const Weight& weight) {
  double n = 0, u = 0, w = 0, q = 0;
  double uu = 0, uw = 0, ww = 0, uq = 0, wq = 0;
  for (const Pixel& p : pixels) {
    const double g = weight(p);
    n += g, u += g * p.u, w += g * p.w, q += g * p.inverse;
    uu += g * p.u * p.u, uw += g * p.u * p.w, ww += g * p.w * p.w;
    uq += g * p.u * p.inverse, wq += g * p.w * p.inverse;
  }
  uu += ridge - u * u / n;
  ww += ridge - w * w / n;
  uw -= u * w / n;
  uq -= u * q / n;
  wq -= w * q / n;
  const double determinant = uu * ww - uw * uw;
  InversePlane plane;
  plane.slope_u = (uq * ww - wq * uw) / determinant;
  plane.slope_w = (wq * uu - uq * uw) / determinant;
  plane.inverse = (q - plane.slope_u * u - plane.slope_w * w) / n;
  plane.spread = (uu + ww) / determinant;
  return plane;
}

/// Relative noise of the range: factor r^exponent.
struct RangeNoise {
  double factor = 0;
  double exponent = 0;

  double at(double range) const { return factor * std::pow(range, exponent); }
};

class RangeImage {
 public:
  RangeImage(const Array<Vec3f>& points, const Vec3d& sensor) : points_(points), sensor_(sensor) {
    direction_.resize(points.size());
    parallel_each(points.size(), kRangeGrain,
                  [&](std::size_t i) { direction_[i] = ray(i).normalized().cast<float>(); });
    search_ = make_neighbor_search(direction_);
  }

  /// Are the directions spread as evenly as pixels are? Notes the pitch of the pixels.
  bool even() {
    const std::size_t count = std::min(kPixelLook, points_.size());
    if (10 * count < kPixelLook) return false;
    std::vector<double> nearest(count), fourth(count), pitch(count);
    for_windows(count, [&](std::size_t s, std::size_t i, Worker& w) {
      search_->nearest(direction_[i], kLeastWindow, w.near);
      nearest[s] = std::sqrt(static_cast<double>(w.near[1].distance2));
      fourth[s] = std::sqrt(static_cast<double>(w.near[4].distance2));
      pitch[s] = std::sqrt(static_cast<double>(w.near.back().distance2) * std::numbers::pi /
                           static_cast<double>(w.near.size()));
    });
    pitch_ = median(pitch);
    const auto twentieth = nearest.begin() + static_cast<std::ptrdiff_t>(count / 20);
    std::nth_element(nearest.begin(), twentieth, nearest.end());
    const double low = *twentieth;
    const double middle = median(nearest);
    return low > kEvenness * middle && median(fourth) < kSquareness * middle;
  }

  void measure_noise() {
    struct Residual {
      double range, relative;
    };
    const std::size_t count = std::min(kNoiseWindows, points_.size());
    std::vector<Residual> found(count);
    for_windows(count, [&](std::size_t s, std::size_t i, Worker& w) {
      look(i, kNoiseWindow, w);
      const InversePlane plane = fit_inverse(w.window, 0, [](const Pixel&) { return 1.0; });
      double sum = 0;
      for (const Pixel& p : w.window) sum += plane.residual(p) * plane.residual(p);
      const double range = ray(i).norm();
      found[s] = {range, range * std::sqrt(sum / static_cast<double>(w.window.size() - 3))};
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
      groups.emplace_back(std::log(found[(begin + end) / 2].range), std::log(middle));
    }
    noise_ = {kRangeRounding, 0};
    if (groups.empty()) return;
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
    noise_.factor = std::exp(median(heights));
  }

  void remake(NormalEstimate& out) {
    parallel_for(points_.size(), kWindowGrain, [&](std::size_t begin, std::size_t end, int worker) {
      for (std::size_t i = begin; i < end; ++i) remake(i, workers_[worker], out);
    });
  }

 private:
  struct Worker {
    std::vector<Neighbor> near;
    std::vector<Pixel> window;
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

  /// The window of the points nearest in the image; returns the frame that its pixels are in, the
  /// line of sight last.
  Eigen::Matrix3d look(std::size_t i, std::size_t size, Worker& w) const {
    search_->nearest(direction_[i], size, w.near);
    Eigen::Matrix3d frame;
    frame.col(2) = ray(i).normalized();
    frame.col(0) = frame.col(2).unitOrthogonal();
    frame.col(1) = frame.col(2).cross(frame.col(0));
    w.window.clear();
    for (const Neighbor& n : w.near) {
      const Vec3d p = frame.transpose() * ray(n.index);
      w.window.push_back({p.x() / p.z(), p.y() / p.z(), 1 / p.z()});
    }
    return frame;
  }

  void remake(std::size_t i, Worker& w, NormalEstimate& out) const {
    const double range = ray(i).norm();
    const double relative = noise_.at(range);
    // A disc of n pixels of this pitch has the variance n pitch^2 / (4 pi) along each axis.
    const double size = 2 * std::sqrt(std::numbers::pi) * relative / (kWindowError * pitch_);
    const Eigen::Matrix3d frame = look(
        i, static_cast<std::size_t>(std::clamp(size, double(kLeastWindow), double(kMostWindow))),
        w);
    const double noise = relative / range;  // Of the inverse depth.
    const double ridge = relative * relative / (kPriorSlope * kPriorSlope);
    InversePlane plane{1 / range, 0, 0, 0};
    double slack = kMostSlope / range;
    double scale = kLastScale * noise * (1 << (kFits - 2));
    const auto weight = [&](const Pixel& p) {
      const double free = slack > 0 ? slack * std::sqrt(p.u * p.u + p.w * p.w) : 0;
      const double e = std::max(0.0, std::abs(plane.residual(p)) - free) / scale;
      const double inside = std::max(0.0, 1 - e * e);
      return inside * inside;
    };
    for (int fit = 0; fit < kFits; ++fit) {
      plane = fit_inverse(w.window, ridge, weight);
      slack = 0;
      scale = std::max(scale / 2, kLastScale * noise);
    }
    const Vec3d normal(plane.slope_u, plane.slope_w, plane.inverse);
    Moments moments;
    for (std::size_t k = 0; k < w.window.size(); ++k) {
      moments.add(ray(w.near[k].index) - ray(i), weight(w.window[k]));
    }
    const Vec3d unit = (frame * normal).normalized();
    out.normal[i] = with_fixed_side(unit);
    // The noise is along the line of sight.
    out.noise[i] = static_cast<float>(range * relative * normal.z() / normal.norm());
    const double across = moments.variance_along(unit) / moments.variance();
    const double error = noise * std::sqrt(plane.spread) / normal.norm();
    out.quality[i] = {static_cast<float>(std::clamp(across, 0.0, 1.0 / 3)),
                      static_cast<float>(std::max(0.0, 1 - error)),
                      static_cast<std::uint16_t>(w.window.size()), PointFlag::kGood};
  }

  const Array<Vec3f>& points_;
  Vec3d sensor_;
  Array<Vec3f> direction_;
  std::unique_ptr<NeighborSearch> search_;
  PerWorker<Worker> workers_;
  double pitch_ = 0;  ///< Angle between neighbouring pixels.
  RangeNoise noise_;
};

}  // namespace

bool remake_range_normals(const Array<Vec3f>& points, const Vec3d& sensor, NormalEstimate& out) {
  for (const Vec3f& p : points) {
    if ((p.cast<double>() - sensor).isZero(0)) return false;
  }
  RangeImage image(points, sensor);
  if (!image.even()) return false;
  image.measure_noise();
  out.noise.resize(points.size());
  image.remake(out);
  out.remade = points.size();
  return true;
}

}  // namespace surfel
