#include "gaussian/gaussian_oracle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <vector>

namespace surfel::test {
namespace {

using Mat3 = Eigen::Matrix3d;
using Mat2 = Eigen::Matrix2d;
using Vec2 = Eigen::Vector2d;

constexpr double kPi = 3.14159265358979323846;
constexpr int kTile = 16;

/// A Gaussian as all profiles see it.
struct Seen {
  Vec3d mean;  ///< Camera space.
  Mat3 axes;   ///< Columns, in camera space, as long as the standard deviations.
  double amplitude;
  std::array<double, 3> color;
  Vec2 at;  ///< Pixels.
};

/// What a pixel gets from a Gaussian.
struct Contribution {
  double alpha = 0;
  double depth = 0;
  bool counts = false;
};

std::array<double, 3> color_of(const GaussianCloud& cloud, std::size_t i, const Vec3d& direction) {
  const double x = direction.x();
  const double y = direction.y();
  const double z = direction.z();
  const double xx = x * x;
  const double yy = y * y;
  const double zz = z * z;
  // Real spherical harmonics with the Condon-Shortley phase, by their closed forms.
  const double c0 = std::sqrt(1 / (4 * kPi));
  const double c1 = std::sqrt(3 / (4 * kPi));
  const double c2 = std::sqrt(15 / (4 * kPi));
  const double c30 = std::sqrt(35 / (32 * kPi));
  const double c31 = std::sqrt(105 / (4 * kPi));
  const double c32 = std::sqrt(21 / (32 * kPi));
  const std::array<double, 25> basis{
      c0,
      -c1 * y,
      c1 * z,
      -c1 * x,
      c2 * x * y,
      -c2 * y * z,
      std::sqrt(5 / (16 * kPi)) * (2 * zz - xx - yy),
      -c2 * x * z,
      c2 / 2 * (xx - yy),
      -c30 * y * (3 * xx - yy),
      c31 * x * y * z,
      -c32 * y * (4 * zz - xx - yy),
      std::sqrt(7 / (16 * kPi)) * z * (2 * zz - 3 * xx - 3 * yy),
      -c32 * x * (4 * zz - xx - yy),
      c31 / 2 * z * (xx - yy),
      -c30 * x * (xx - 3 * yy),
      std::sqrt(315 / (16 * kPi)) * x * y * (xx - yy),
      -std::sqrt(315 / (32 * kPi)) * y * z * (3 * xx - yy),
      std::sqrt(45 / (16 * kPi)) * x * y * (7 * zz - 1),
      -std::sqrt(45 / (32 * kPi)) * y * z * (7 * zz - 3),
      std::sqrt(9 / (256 * kPi)) * (35 * zz * zz - 30 * zz + 3),
      -std::sqrt(45 / (32 * kPi)) * x * z * (7 * zz - 3),
      std::sqrt(45 / (64 * kPi)) * (xx - yy) * (7 * zz - 1),
      -std::sqrt(315 / (32 * kPi)) * x * z * (xx - 3 * yy),
      std::sqrt(315 / (256 * kPi)) * (xx * (xx - 3 * yy) - yy * (3 * xx - yy))};
  std::array<double, 3> sum{0.5, 0.5, 0.5};
  const std::size_t stride = cloud.harmonics_stride();
  for (std::size_t k = 0; k < stride / 3; ++k) {
    for (std::size_t c = 0; c < 3; ++c) {
      sum[c] += basis[k] * cloud.harmonics[i * stride + 3 * k + c];
    }
  }
  for (double& c : sum) c = std::max(c, 0.0);
  return sum;
}

std::vector<Seen> see(const GaussianCloud& cloud, const Camera& camera) {
  std::vector<Seen> out(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d world = cloud.origin + cloud.position[i].cast<double>();
    const auto& q = cloud.rotation[i];
    Seen& s = out[i];
    s.mean = camera.camera_from_world * (world - camera.eye);
    s.axes = camera.camera_from_world *
             Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix() *
             cloud.scale[i].cast<double>().asDiagonal();
    s.amplitude = cloud.amplitude[i];
    if (camera.orthographic) {
      s.color = color_of(cloud, i, camera.camera_from_world.row(2));
      s.at = {camera.focal_x * s.mean.x() + camera.center_x,
              camera.focal_y * s.mean.y() + camera.center_y};
      continue;
    }
    s.color = color_of(cloud, i, (world - camera.eye).normalized());
    s.at = {camera.focal_x * s.mean.x() / s.mean.z() + camera.center_x,
            camera.focal_y * s.mean.y() / s.mean.z() + camera.center_y};
  }
  return out;
}

Eigen::Matrix<double, 2, 3> jacobian(const Camera& camera, const Vec3d& at) {
  Eigen::Matrix<double, 2, 3> J;
  if (camera.orthographic) {
    J << camera.focal_x, 0, 0, 0, camera.focal_y, 0;
    return J;
  }
  J << camera.focal_x / at.z(), 0, -camera.focal_x * at.x() / (at.z() * at.z()), 0,
      camera.focal_y / at.z(), -camera.focal_y * at.y() / (at.z() * at.z());
  return J;
}

/// Tiles of a renderer's rectangle: pixels [x0, x1) x [y0, y1).
struct Rect {
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool holds(int x, int y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
};

/// The published rectangle around a centre: pixel centres are whole numbers there.
Rect inria_rect(const Vec2& at, double radius) {
  const auto low = [&](double v) { return std::floor((v - 0.5 - radius) / kTile) * kTile; };
  const auto high = [&](double v) {
    return std::floor((v - 0.5 + radius + kTile - 1) / kTile) * kTile;
  };
  return {low(at.x()), low(at.y()), high(at.x()), high(at.y())};
}

/// Affine kernels: 3DGS, gsplat, Mip-Splatting.
class Affine {
 public:
  Affine(const Seen& s, const Camera& camera, GaussianProfile profile, AmplitudeRule rule)
      : at_(s.at), depth_(s.mean.z()) {
    const bool gsplat = profile == GaussianProfile::kGsplat;
    const bool mip = profile == GaussianProfile::kMip;
    if (depth_ <= (camera.orthographic ? 0 : gsplat ? 0.01 : 0.2)) return;
    const double tan_x = camera.width / (2 * camera.focal_x);
    const double tan_y = camera.height / (2 * camera.focal_y);
    Vec3d p = s.mean;
    const auto clamp = [&](double v, double size, double focal, double center, double tangent) {
      return std::clamp(v / p.z(), -center / focal - 0.3 * tangent,
                        (size - center) / focal + 0.3 * tangent) *
             p.z();
    };
    p.x() = clamp(p.x(), camera.width, camera.focal_x, camera.center_x, tan_x);
    p.y() = clamp(p.y(), camera.height, camera.focal_y, camera.center_y, tan_y);
    const auto J = jacobian(camera, p);
    const Mat2 plain = J * s.axes * s.axes.transpose() * J.transpose();
    const double h2 = mip ? 0.1 : 0.3;
    const Mat2 V = plain + h2 * Mat2::Identity();
    opacity_ = s.amplitude;
    if (mip) {
      const double det0 = std::max(1e-6, plain.determinant());
      const double det1 = std::max(1e-6, V.determinant());
      opacity_ *= det0 <= 1e-6 || det1 <= 1e-6 ? 0 : std::sqrt(det0 / (det1 + 1e-6) + 1e-6);
    } else if (rule == AmplitudeRule::kCompensated) {
      const double share = plain.determinant() / V.determinant();
      opacity_ *= std::sqrt(std::max(gsplat ? 0.0 : 0.000025, share));
    }
    conic_ = V.inverse();
    cap_ = gsplat ? 0.999 : 0.99;
    if (gsplat) {
      if (opacity_ < 1.0 / 255) return;
      const double extent = std::min(3.33, std::sqrt(2 * std::log(opacity_ * 255)));
      const double rx = std::ceil(extent * std::sqrt(V(0, 0)));
      const double ry = std::ceil(extent * std::sqrt(V(1, 1)));
      rect_ = {
          std::floor((at_.x() - rx) / kTile) * kTile, std::floor((at_.y() - ry) / kTile) * kTile,
          std::ceil((at_.x() + rx) / kTile) * kTile, std::ceil((at_.y() + ry) / kTile) * kTile};
    } else {
      const double mid = V.trace() / 2;
      const double lambda = mid + std::sqrt(std::max(0.1, mid * mid - V.determinant()));
      rect_ = inria_rect(at_, std::ceil(3 * std::sqrt(lambda)));
    }
  }
  double order() const { return depth_; }
  Contribution at(int x, int y) const {
    Contribution out;
    if (!rect_.holds(x, y)) return out;
    const Vec2 d = Vec2(x + 0.5, y + 0.5) - at_;
    out.alpha = std::min(cap_, opacity_ * std::exp(-0.5 * d.dot(conic_ * d)));
    out.depth = depth_;
    out.counts = out.alpha >= 1.0 / 255;
    return out;
  }

 private:
  Vec2 at_;
  double depth_;
  double opacity_ = 0;
  double cap_ = 0.99;
  Mat2 conic_ = Mat2::Zero();
  Rect rect_;
};

/// Of a pixel's centre, by depth.
struct Ray {
  Vec3d start{0, 0, 0};
  Vec3d direction{0, 0, 1};

  Ray(const Camera& camera, int x, int y) {
    Vec3d& place = camera.orthographic ? start : direction;
    place.x() = (x + 0.5 - camera.center_x) / camera.focal_x;
    place.y() = (y + 0.5 - camera.center_y) / camera.focal_y;
  }
  Vec3d at(double depth) const { return start + depth * direction; }
};

/// Discs that rays meet, with the filter of 2DGS.
class Disc {
 public:
  Disc(const Seen& s, const Camera& camera) : camera_(camera), s_(s) {
    if (s.mean.z() <= least_depth()) return;
    if (camera.orthographic) {
      box_ = s.at;
      const double half = 3 * std::max(camera.focal_x * s.axes.row(0).head<2>().norm(),
                                       camera.focal_y * s.axes.row(1).head<2>().norm());
      rect_ = inria_rect(box_, std::ceil(std::max(half, 3 * 0.707106)));
      return;
    }
    // Homogeneous pixels from the disc's coordinates (u, v, 1).
    Mat3 K;
    K << camera.focal_x, 0, camera.center_x, 0, camera.focal_y, camera.center_y, 0, 0, 1;
    Mat3 H;
    H << s.axes.col(0), s.axes.col(1), s.mean;
    H = K * H;
    const Vec3d sign(9, 9, -1);
    const Vec3d t0 = H.row(0);
    const Vec3d t1 = H.row(1);
    const Vec3d t2 = H.row(2);
    const Vec3d f = sign / sign.dot(t2.cwiseProduct(t2));
    box_ = {f.dot(t0.cwiseProduct(t2)), f.dot(t1.cwiseProduct(t2))};
    const Vec2 half2 =
        box_.cwiseProduct(box_) - Vec2(f.dot(t0.cwiseProduct(t0)), f.dot(t1.cwiseProduct(t1)));
    const double half = std::sqrt(std::max(1e-4, half2.maxCoeff()));
    rect_ = inria_rect(box_, std::ceil(std::max(half, 3 * 0.707106)));
  }
  double order() const { return s_.mean.z(); }
  Contribution at(int x, int y) const {
    Contribution out;
    if (!rect_.holds(x, y)) return out;
    const Vec2 pixel(x + 0.5, y + 0.5);
    const Ray ray(camera_, x, y);
    const Vec3d u = s_.axes.col(0);
    const Vec3d v = s_.axes.col(1);
    const Vec3d n = u.cross(v);
    out.depth = n.dot(s_.mean - ray.start) / n.dot(ray.direction);
    const Vec3d hit = ray.at(out.depth) - s_.mean;
    const double rho3 =
        std::pow(hit.dot(u) / u.squaredNorm(), 2) + std::pow(hit.dot(v) / v.squaredNorm(), 2);
    const double rho = std::min(rho3, 2 * (pixel - box_).squaredNorm());
    out.alpha = std::min(0.99, s_.amplitude * std::exp(-rho / 2));
    out.counts = out.depth >= least_depth() && out.alpha >= 1.0 / 255;
    return out;
  }

 private:
  double least_depth() const { return camera_.orthographic ? 0 : 0.2; }

  const Camera& camera_;
  const Seen& s_;
  Vec2 box_{0, 0};
  Rect rect_;
};

/// Kernels along rays.
class Integrated {
 public:
  Integrated(const Seen& s, const Camera& camera, AmplitudeRule rule, double lowpass)
      : camera_(camera), s_(s), density_(rule == AmplitudeRule::kDensity) {
    if (s.mean.z() <= 0) return;
    const Mat3 S = s.axes * s.axes.transpose();
    // A pixel at the centre's depth, scene units.
    const double depth = camera.orthographic ? 1 : s.mean.z();
    const Vec3d pixel(depth / camera.focal_x, depth / camera.focal_y, 0);
    const Mat3 filtered = S + lowpass * lowpass * Mat3(pixel.cwiseProduct(pixel).asDiagonal());
    inverse_ = filtered.inverse();
    amplitude_ = s.amplitude;
    if (density_) {
      amplitude_ *= std::sqrt(S.determinant() / filtered.determinant());
    } else {
      const auto J = jacobian(camera, s.mean);
      const Mat2 V = J * S * J.transpose();
      amplitude_ *=
          std::sqrt(V.determinant() / (V + lowpass * lowpass * Mat2::Identity()).determinant());
    }
  }
  double order() const { return 0; }
  Contribution at(int x, int y) const {
    Contribution out;
    if (amplitude_ <= 0) return out;
    const Ray ray(camera_, x, y);
    const Vec3d& w = ray.direction;
    out.depth = w.dot(inverse_ * (s_.mean - ray.start)) / w.dot(inverse_ * w);
    if (out.depth <= 0) return out;
    const Vec3d off = s_.mean - ray.at(out.depth);
    const double kernel = amplitude_ * std::exp(-0.5 * off.dot(inverse_ * off));
    if (density_) {
      const Vec3d unit = w.normalized();
      out.alpha = -std::expm1(-kernel * std::sqrt(2 * kPi / unit.dot(inverse_ * unit)));
    } else {
      out.alpha = kernel;
    }
    out.counts = out.alpha > 0;
    return out;
  }

 private:
  const Camera& camera_;
  const Seen& s_;
  bool density_;
  double amplitude_ = 0;
  Mat3 inverse_ = Mat3::Zero();
};

template <class Kernel>
Image draw(const std::vector<Seen>& seen, const std::vector<Kernel>& kernels, const Camera& camera,
           bool by_pixel, bool ends_inclusive) {
  std::vector<std::size_t> order(kernels.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return kernels[a].order() < kernels[b].order();
  });
  Image image{camera.width, camera.height, {"R", "G", "B", "A", "Z", "Z.mean"}, {}};
  image.data.resize(6 * static_cast<std::size_t>(camera.width) *
                    static_cast<std::size_t>(camera.height));
  std::vector<std::pair<Contribution, std::size_t>> met;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      met.clear();
      for (const std::size_t i : order) {
        const Contribution c = kernels[i].at(x, y);
        if (c.counts) met.emplace_back(c, i);
      }
      if (by_pixel) {
        std::stable_sort(met.begin(), met.end(), [](const auto& a, const auto& b) {
          return a.first.depth < b.first.depth;
        });
      }
      std::array<double, 4> sum{};
      double transmittance = 1;
      double median = std::numeric_limits<double>::infinity();
      for (const auto& [c, i] : met) {
        const double next = transmittance * (1 - c.alpha);
        if (!by_pixel && (ends_inclusive ? next <= 1e-4 : next < 1e-4)) break;
        for (std::size_t k = 0; k < 3; ++k) sum[k] += c.alpha * transmittance * seen[i].color[k];
        sum[3] += c.alpha * transmittance * c.depth;
        if (transmittance > 0.5) median = c.depth;
        transmittance = next;
      }
      float* pixel = image.pixel(x, y);
      for (std::size_t k = 0; k < 3; ++k) pixel[k] = static_cast<float>(sum[k]);
      pixel[3] = static_cast<float>(1 - transmittance);
      pixel[4] = static_cast<float>(transmittance <= 0.5 ? median
                                                         : std::numeric_limits<double>::infinity());
      pixel[5] = static_cast<float>(transmittance < 1 ? sum[3] / (1 - transmittance)
                                                      : std::numeric_limits<double>::infinity());
    }
  }
  return image;
}

}  // namespace

Image gaussian_oracle(const GaussianCloud& cloud, const Camera& camera,
                      const GaussianOptions& options) {
  const std::vector<Seen> seen = see(cloud, camera);
  if (options.profile == GaussianProfile::kExact) {
    std::vector<Integrated> kernels;
    for (const Seen& s : seen) kernels.emplace_back(s, camera, cloud.rule, options.lowpass);
    return draw(seen, kernels, camera, true, false);
  }
  if (options.profile == GaussianProfile::k2dgs) {
    std::vector<Disc> kernels;
    for (const Seen& s : seen) kernels.emplace_back(s, camera);
    return draw(seen, kernels, camera, false, false);
  }
  std::vector<Affine> kernels;
  for (const Seen& s : seen) kernels.emplace_back(s, camera, options.profile, cloud.rule);
  return draw(seen, kernels, camera, false, options.profile == GaussianProfile::kGsplat);
}

}  // namespace surfel::test
