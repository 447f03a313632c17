#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/render/exact_kernel.h>

namespace surfel {
namespace {

/// Corners of the polygon around a disc that stands for it in bounds.
constexpr int kCorners = 12;
/// Planes seen under a smaller cosine than this are edge-on: less than a millionth of the disc is
/// seen.
constexpr double kEdgeOn = 1e-6;
/// A disc that is nearer to the eye plane than this share of its radius is not bounded: the eye
/// would have to be as near to the disc for it to be in the picture.
constexpr double kNearest = 1e-6;
/// As in splat_setup.cpp: below this cosine the filter's footprint on the plane stops growing.
constexpr double kLeastCosine = 0.1;

struct Bounds2 {
  double x0 = std::numeric_limits<double>::infinity();
  double x1 = -x0;
  double y0 = x0;
  double y1 = -x0;
  double nearest = x0;    ///< Least z ...
  double farthest = -x0;  ///< ... and greatest.

  void add(const Eigen::Vector3d& p, const Camera& camera) {
    const double x = camera.focal_x * p.x() / p.z() + camera.center_x;
    const double y = camera.focal_y * p.y() / p.z() + camera.center_y;
    x0 = std::min(x0, x);
    x1 = std::max(x1, x);
    y0 = std::min(y0, y);
    y1 = std::max(y1, y);
    nearest = std::min(nearest, p.z());
    farthest = std::max(farthest, p.z());
  }
  bool empty() const { return !(x0 <= x1); }
};

/// Cosine and sine of the polygon's angles.
std::array<Vec2d, kCorners> make_directions() {
  std::array<Vec2d, kCorners> directions;
  for (int i = 0; i < kCorners; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCorners;
    directions[i] = {portable::cos(angle), portable::sin(angle)};
  }
  return directions;
}

/// Bounds of the part of a disc beyond z = near: its polygon is clipped in camera space.
Bounds2 bounds_of(const SurfelInCamera& surfel, const Eigen::Vector3d& bitangent, double cutoff,
                  double near, const Camera& camera) {
  static const std::array<Vec2d, kCorners> directions = make_directions();
  static const double half_angle_cosine = portable::cos(std::numbers::pi / kCorners);
  const double around = std::sqrt(2 * cutoff) / half_angle_cosine;
  std::array<Eigen::Vector3d, kCorners> corner;
  for (int i = 0; i < kCorners; ++i) {
    corner[i] = surfel.position +
                around * (directions[i].x() * std::sqrt(surfel.variance_u) * surfel.tangent +
                          directions[i].y() * std::sqrt(surfel.variance_v) * bitangent);
  }
  Bounds2 bounds;
  for (int i = 0; i < kCorners; ++i) {
    const Eigen::Vector3d& a = corner[i];
    const Eigen::Vector3d& b = corner[(i + 1) % kCorners];
    if (a.z() >= near) bounds.add(a, camera);
    if ((a.z() < near) != (b.z() < near)) {
      Eigen::Vector3d p = a + (b - a) * ((near - a.z()) / (b.z() - a.z()));
      p.z() = near;
      bounds.add(p, camera);
    }
  }
  return bounds;
}

/// First and last pixel with centres in [lo, hi] of 0..size; false if there are none.
bool pixels_of(double lo, double hi, double size, std::uint8_t& first, std::uint8_t& last) {
  const double first_pixel = std::max(0.0, std::ceil(lo - 0.5));
  const double last_pixel = std::min(size - 1, std::floor(hi - 0.5));
  if (!(first_pixel <= last_pixel)) return false;
  first = static_cast<std::uint8_t>(first_pixel);
  last = static_cast<std::uint8_t>(last_pixel);
  return true;
}

}  // namespace

std::optional<ExactKernel> make_exact_kernel(const SurfelInCamera& surfel, const Camera& camera,
                                             const ExactKernelView& view) {
  const Eigen::Vector3d& p = surfel.position;
  const Eigen::Vector3d& n = surfel.normal;
  const Eigen::Vector3d bitangent = n.cross(surfel.tangent);
  const double n_p = n.dot(p);
  const double cosine = std::abs(n_p) / p.norm();
  if (!(cosine > kEdgeOn)) return std::nullopt;
  const double two_c = 2 * view.cutoff;
  const double deviation2 = two_c * std::max(surfel.variance_u, surfel.variance_v);
  const double near = std::max(camera.near, kNearest * std::sqrt(deviation2));
  const Bounds2 bounds = bounds_of(surfel, bitangent, view.cutoff, near, camera);
  if (bounds.empty()) return std::nullopt;

  ExactKernel kernel{};
  const double filter = std::sqrt(two_c) * view.lowpass;
  const double reach = filter + view.margin;
  const double x0 = bounds.x0 - reach;
  const double x1 = bounds.x1 + reach;
  const double y0 = bounds.y0 - reach;
  const double y1 = bounds.y1 + reach;
  Splat& splat = kernel.splat;
  if (!pixels_of(x0 - view.x0, x1 - view.x0, view.x1 - view.x0, splat.box.x0, splat.box.x1) ||
      !pixels_of(y0 - view.y0, y1 - view.y0, view.y1 - view.y0, splat.box.y0, splat.box.y1)) {
    return std::nullopt;
  }
  kernel.first = (view.first_column || std::ceil(x0 - 0.5) >= view.x0) &&
                 (view.first_row || std::ceil(y0 - 0.5) >= view.y0);
  // Where it is seen: the disc's middle may be very far away.
  splat.x = static_cast<float>((std::max(x0, view.x0) + std::min(x1, view.x1)) / 2);
  splat.y = static_cast<float>((std::max(y0, view.y0) + std::min(y1, view.y1)) / 2);
  splat.k = kExactKernel;
  splat.depth = static_cast<float>(2 / (bounds.nearest + bounds.farthest));
  splat.depth_range = std::numeric_limits<float>::infinity();
  const double disc2 =
      (portable::squared(bounds.x1 - bounds.x0) + portable::squared(bounds.y1 - bounds.y0)) / 4;
  const auto step = static_cast<std::uint32_t>(
      std::min<double>(kCoarseStep, std::sqrt(disc2 / 2) / (kSpacingStep * filter)));
  splat.tag = (n_p < 0 ? kFrontTag : 0) | (disc2 < 2 * filter * filter ? kFilteredTag : 0) |
              (cosine < kGrazing ? kGrazingTag : 0) | step << kSpacingShift;

  // With the ray (X, Y, 1) of a pixel: 1 / z = n . ray / n . p, and a plane coordinate along t
  // times 1 / z is t . ray - (t . p) / z.
  const Eigen::Vector2d focal(camera.focal_x, camera.focal_y);
  const Eigen::Vector3d ray((splat.x - camera.center_x) / focal.x(),
                            (splat.y - camera.center_y) / focal.y(), 1);
  const auto store = [&](const Eigen::Vector3d& linear, float* f) {
    f[0] = static_cast<float>(linear.dot(ray));
    f[1] = static_cast<float>(linear.x() / focal.x());
    f[2] = static_cast<float>(linear.y() / focal.y());
  };
  const auto coordinate = [&](const Eigen::Vector3d& t, double variance) {
    return Eigen::Vector3d((t - n * (t.dot(p) / n_p)) / std::sqrt(variance));
  };
  ExactSplat& exact = kernel.exact;
  store(n / n_p, exact.depth);
  splat.depth_dx = exact.depth[1];
  splat.depth_dy = exact.depth[2];
  store(coordinate(surfel.tangent, surfel.variance_u), exact.u);
  store(coordinate(bitangent, surfel.variance_v), exact.v);
  exact.amplitude = static_cast<float>(
      surfel.area / (2 * std::numbers::pi * std::sqrt(surfel.variance_u * surfel.variance_v)));
  if (!(exact.amplitude > kLeastAmplitude)) return std::nullopt;
  exact.deviation2 = static_cast<float>(deviation2);
  const double pixel = filter / focal.minCoeff() / std::max(cosine, kLeastCosine);
  exact.pixel2 = static_cast<float>(pixel * pixel);
  // The filter reaches beyond the disc by the share `pixel` of the depth.
  exact.depth_lo = static_cast<float>(1 / (bounds.farthest * (1 + pixel)));
  exact.depth_hi = static_cast<float>((1 + pixel) / bounds.nearest);
  exact.depth_most = static_cast<float>(1 / camera.near);
  return kernel;
}

}  // namespace surfel
