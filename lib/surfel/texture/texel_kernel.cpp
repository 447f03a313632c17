// Zwicker, Pfister, van Baar, Gross 2001, "Surface Splatting", section 5.
// Heckbert 1989, "Fundamentals of Texture Mapping and Image Warping" (limit of the eccentricity).

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/texture/texel_kernel.h>

namespace surfel {
namespace {

/// Sine of the angle between the derivatives by x and y, scaled by their ratio, below which the
/// map from texture to surface has no area: some ten times the rounding of float derivatives.
constexpr double kSingular = 1e-6;

/// V in the frame (t, n x t); t is meaningless where V is isotropic.
Vec2d surfel_variance(const SurfelCloud& cloud, std::size_t k) {
  if (cloud.anisotropic()) return {cloud.variance_u[k], cloud.variance_v[k]};
  return Vec2d::Constant(cloud.variance[k]);
}

/// Derivatives of the surface by an image's texels, and their cross product.
struct TexelFrame {
  Vec3d dpdx, dpdy, cross;
};

/// nullopt where the derivatives span no area.
std::optional<TexelFrame> texel_frame(const Vec3d& dpdu, const Vec3d& dpdv, int width, int height) {
  // Image rows run downwards, v upwards.
  const Vec3d dpdx = dpdu / width;
  const Vec3d dpdy = -dpdv / height;
  const Vec3d cross = dpdx.cross(dpdy);
  const double longest2 = std::max(dpdx.squaredNorm(), dpdy.squaredNorm());
  if (!(cross.norm() > kSingular * longest2)) return std::nullopt;
  return TexelFrame{dpdx, dpdy, cross};
}

std::optional<TexelFrame> texel_frame(const SurfelCloud& cloud, std::size_t surfel, int width,
                                      int height) {
  return texel_frame(cloud.dpdu[surfel].cast<double>(), cloud.dpdv[surfel].cast<double>(), width,
                     height);
}

}  // namespace

bool TexelKernel::interpolates() const {
  constexpr double kWidest = 0.25;  // Beside the triangle.
  return bilinear && principal_variances(variance).minor < kWidest + kBilinearVariance;
}

PrincipalVariances principal_variances(const Mat2d& variance) {
  const double mean = variance.trace() / 2;
  const double difference = (variance(0, 0) - variance(1, 1)) / 2;
  const double major = mean + portable::hypot(difference, variance(0, 1));
  if (!(major > 0)) return {};
  return {major, std::max(0.0, variance.determinant() / major)};
}

// T^-1 V T^-T of SS01 section 5.
std::optional<Mat2d> texture_space_variance(const SurfelCloud& cloud, std::size_t surfel, int width,
                                            int height) {
  const auto frame = texel_frame(cloud, surfel, width, height);
  if (!frame) return std::nullopt;
  const auto& [dpdx, dpdy, cross] = *frame;
  const Vec2d V = surfel_variance(cloud, surfel);
  if (!(V.minCoeff() >= 0)) return std::nullopt;

  const Vec3d normal = cross / cross.norm();
  Vec3d t = dpdx;
  if (cloud.anisotropic()) {
    const Vec3d tangent = cloud.tangent[surfel].cast<double>();
    const Vec3d projected = tangent - normal * normal.dot(tangent);
    if (projected.squaredNorm() > 0) t = projected;
  }
  t.normalize();
  const Vec3d b = normal.cross(t);
  Mat2d T;
  T << t.dot(dpdx), t.dot(dpdy), b.dot(dpdx), b.dot(dpdy);
  const Mat2d T_inverse = T.inverse();
  const Mat2d variance = T_inverse * V.asDiagonal() * T_inverse.transpose();
  if (!variance.allFinite()) return std::nullopt;
  return variance;
}

std::optional<Eigen::Matrix<double, 2, 3>> texels_per_unit(const SurfelCloud& cloud,
                                                           std::size_t surfel, int width,
                                                           int height) {
  return texels_per_unit(cloud.dpdu[surfel].cast<double>(), cloud.dpdv[surfel].cast<double>(),
                         width, height);
}

std::optional<Eigen::Matrix<double, 2, 3>> texels_per_unit(const Vec3d& dpdu, const Vec3d& dpdv,
                                                           int width, int height) {
  const auto frame = texel_frame(dpdu, dpdv, width, height);
  if (!frame) return std::nullopt;
  const auto& [dpdx, dpdy, cross] = *frame;
  const double area2 = cross.squaredNorm();
  // The dual basis: rows that are 1 along one derivative and 0 along the other.
  Eigen::Matrix<double, 2, 3> L;
  L.row(0) = dpdy.cross(cross).transpose() / area2;
  L.row(1) = cross.cross(dpdx).transpose() / area2;
  if (!L.allFinite()) return std::nullopt;
  return L;
}

bool limit_kernel(Mat2d& variance, double max_aspect) {
  constexpr double kMostSigma = 0x1p24;  // Texels: a kernel as wide sees the mean of any image.
  PrincipalVariances axes = principal_variances(variance);
  const double max_variance = kMostSigma * kMostSigma;
  if (axes.major > max_variance) {
    const double shrink = max_variance / axes.major;
    variance *= shrink;
    axes.major *= shrink;
    axes.minor *= shrink;
  }
  const double least = axes.major / (max_aspect * max_aspect);
  if (axes.minor >= least) return false;
  // Adds to the minor axis alone: major I - M projects on it.
  const Mat2d projector = (axes.major * Mat2d::Identity() - variance) / (axes.major - axes.minor);
  variance += (least - axes.minor) * projector;
  return true;
}

// sum_i G_M(s - s_i) = sum_m exp(-2 pi^2 m^T M m) cos(2 pi m^T s), texels s_i at integers.
double lattice_sum(const TexelKernel& kernel) {
  if (kernel.interpolates()) return 1;
  constexpr double kMostExponent = 20;  // exp(-20) = 2e-9.
  constexpr double kTwoPi2 = 2 * std::numbers::pi * std::numbers::pi;
  const double minor = principal_variances(kernel.variance).minor;
  const int reach = static_cast<int>(std::sqrt(kMostExponent / (kTwoPi2 * minor)));
  // Where texels have their centres.
  const Vec2d s = kernel.center - Vec2d(0.5, 0.5);
  double sum = 0;
  for (int y = -reach; y <= reach; ++y) {
    for (int x = -reach; x <= reach; ++x) {
      const Vec2d m(x, y);
      sum += portable::exp(-kTwoPi2 * m.dot(kernel.variance * m)) *
             portable::cos(2 * std::numbers::pi * m.dot(s));
    }
  }
  return sum;
}

}  // namespace surfel
