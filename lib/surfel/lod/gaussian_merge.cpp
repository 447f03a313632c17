#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <surfel/base/bounds.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/gaussian_merge.h>
#include <surfel/scene/gaussian_mass.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {
namespace {

constexpr std::size_t kMergeGrain = 512;
/// Opacities that trained renderers blend at least.
constexpr float kLeastOpacity = 1.0F / 255;
/// Neighbours, itself included, that may lie over a Gaussian.
constexpr std::size_t kNeighbors = 32;
/// Opacities that they cap at.
constexpr double kMostOpacity = 0.99;

bool is_density(AmplitudeRule rule) { return rule == AmplitudeRule::kDensity; }

/// Integral of a Gaussian of peak 1 over space.
double volume_of(const Vec3d& scale) {
  const double root = std::sqrt(2 * std::numbers::pi);
  return root * root * root * scale.prod();
}

/// R diag(s^2) R'.
std::array<float, 6> covariance_of(const GaussianCloud& cloud, std::size_t i) {
  const std::array<float, 4>& q = cloud.rotation[i];
  const Eigen::Matrix3d rotation =
      Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  const Eigen::Matrix3d axes = rotation * cloud.scale[i].cast<double>().asDiagonal();
  const Eigen::Matrix3d c = axes * axes.transpose();
  const auto at = [&](int row, int column) { return static_cast<float>(c(row, column)); };
  return {at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)};
}

double mass_of(const GaussianCloud& cloud, std::size_t i) {
  const Vec3d scale = cloud.scale[i].cast<double>();
  return double{cloud.amplitude[i]} *
         (is_density(cloud.rule) ? volume_of(scale) : mean_projection(scale));
}

/// Are all moments of any of these Gaussians together finite in float? Covariances are means of
/// covariances and of squares of distances, and optical depths less than twice the masses.
bool moments_are_finite(const GaussianCloud& cloud, const Array<std::uint32_t>& order) {
  double mass = 0;
  double largest = 0;
  Bounds box;
  for (const std::uint32_t i : order) {
    mass += mass_of(cloud, i);
    largest = std::max(largest, static_cast<double>(cloud.scale[i].cwiseAbs().maxCoeff()));
    box.add(cloud.position[i].cast<double>());
  }
  constexpr double kMost = std::numeric_limits<float>::max() / 4;
  return mass < kMost && portable::squared(largest) + portable::squared(box.diagonal()) < kMost;
}

}  // namespace

void MergeGaussians::resize(std::size_t size) {
  position.resize(size);
  covariance.resize(size);
  mass.resize(size);
  depth.resize(size);
  source.resize(size);
  harmonics.resize(size * stride);
}

void MergeGaussians::assign(std::size_t to, const MergeGaussians& others, std::size_t i) {
  position[to] = others.position[i];
  covariance[to] = others.covariance[i];
  mass[to] = others.mass[i];
  depth[to] = others.depth[i];
  source[to] = others.source[i];
  std::copy_n(others.harmonics_of(i), stride, harmonics_of(to));
}

void MergeGaussians::merge(std::size_t i, std::size_t j) {
  const double sum = double{mass[i]} + double{mass[j]};
  const double share = mass[j] / sum;
  const Vec3d apart = (position[j] - position[i]).cast<double>();
  position[i] = (position[i].cast<double>() + share * apart).cast<float>();
  const double between = share * (1 - share);
  std::size_t k = 0;
  for (int row = 0; row < 3; ++row) {
    for (int column = row; column < 3; ++column, ++k) {
      const double within = (1 - share) * covariance[i][k] + share * covariance[j][k];
      covariance[i][k] = static_cast<float>(within + between * apart[row] * apart[column]);
    }
  }
  float* const to = harmonics_of(i);
  const float* const from = harmonics_of(j);
  for (std::size_t h = 0; h < stride; ++h) {
    to[h] = static_cast<float>((1 - share) * to[h] + share * from[h]);
  }
  mass[i] = static_cast<float>(sum);
  depth[i] += depth[j];
  source[i] = kMerged;
}

bool has_mass(const GaussianCloud& cloud, std::size_t i) {
  if (!is_density(cloud.rule) && cloud.amplitude[i] < kLeastOpacity) return false;
  if (!(cloud.position[i].cwiseAbs().maxCoeff() <= static_cast<float>(kLargestExtent)))
    return false;
  // Sums are divided by masses, which must be normal numbers in float.
  const auto mass = static_cast<float>(mass_of(cloud, i));
  return mass >= std::numeric_limits<float>::min() && std::isfinite(mass);
}

std::size_t without_massless(const GaussianCloud& cloud, Array<std::uint32_t>& order,
                             const std::string& name) {
  const auto without = std::erase_if(order, [&](std::uint32_t i) { return !has_mass(cloud, i); });
  if (order.empty()) {
    throw_input(name, "holds no Gaussian that can be seen: all are points, or clearer than 1/255");
  }
  if (!moments_are_finite(cloud, order)) {
    throw_input(name,
                "its extent is too large for single precision, in which Gaussians are merged; "
                "scale it down");
  }
  return without;
}

MergeGaussians merge_gaussians(const GaussianCloud& cloud, std::span<const std::uint32_t> which) {
  MergeGaussians out;
  out.rule = cloud.rule;
  out.stride = cloud.harmonics_stride();
  out.resize(which.size());
  parallel_each(which.size(), kMergeGrain, [&](std::size_t to) {
    const std::uint32_t i = which[to];
    out.position[to] = cloud.position[i];
    out.covariance[to] = covariance_of(cloud, i);
    const double mass = mass_of(cloud, i);
    out.mass[to] = static_cast<float>(mass);
    const double opacity = std::min(double{cloud.amplitude[i]}, kMostOpacity);
    out.depth[to] = is_density(cloud.rule)
                        ? out.mass[to]
                        : static_cast<float>(mass / cloud.amplitude[i] * dilogarithm(opacity));
    out.source[to] = i;
    const auto at = cloud.harmonics.begin() + static_cast<std::ptrdiff_t>(i * out.stride);
    std::copy_n(at, out.stride, out.harmonics_of(to));
    if (cloud.degree > 0) return;
    // Colours are clamped at 0 when they are drawn, so that what is darker must not count.
    constexpr auto kBlack = static_cast<float>(-0.5 / GaussianCloud::kHarmonic0);
    for (std::size_t k = 0; k < out.stride; ++k) {
      out.harmonics_of(to)[k] = std::max(kBlack, out.harmonics_of(to)[k]);
    }
  });
  return out;
}

namespace {

using Matrix2 = Eigen::Matrix2d;
using Matrix3 = Eigen::Matrix3d;

/// A Gaussian that is to be drawn.
struct Shape {
  Matrix3 axes = Matrix3::Identity();  ///< Columns, the longest first.
  Vec3d scale{0, 0, 0};
  double amplitude = 0;
  double growth = 1;  ///< Mass by the mass that the amplitude and the scales have, >= 1.
};

Matrix3 matrix_of(const std::array<float, 6>& c) {
  Matrix3 m;
  m << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
  return m;
}

/// The shape of a Gaussian that has its covariance.
Shape shape_of(const MergeGaussians& gaussians, std::size_t i) {
  Shape out;
  const Matrix3 matrix = matrix_of(gaussians.covariance[i]);
  // The trace is 1, so that no determinant overflows.
  const double trace = std::max(matrix.trace(), double{std::numeric_limits<float>::min()});
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(matrix / trace);
  out.axes = solver.eigenvectors().rowwise().reverse();
  if (out.axes.determinant() < 0) out.axes.col(2) = -out.axes.col(2);
  out.scale = (solver.eigenvalues().reverse().cwiseMax(0) * trace).cwiseSqrt();
  const double mass = gaussians.mass[i];
  if (is_density(gaussians.rule)) {
    // Coplanar members have no volume; with a thickness of a hundredth their mass is shown.
    constexpr double kThin = 0.01;
    out.scale = out.scale.cwiseMax(kThin * out.scale[0]);
    out.amplitude =
        std::min(mass / volume_of(out.scale), double{std::numeric_limits<float>::max()});
    return out;
  }
  const double projection = mean_projection(out.scale);
  out.amplitude = std::min(opacity_of_dilogarithm(gaussians.depth[i] / projection, kMostOpacity),
                           mass / projection);
  out.growth = std::max(1.0, mass / (out.amplitude * projection));
  return out;
}

/// Enlarges shapes, as drawn_gaussians() says.
class Growth {
 public:
  Growth(const MergeGaussians& gaussians, const Array<Shape>& shapes)
      : gaussians_(gaussians), shapes_(shapes) {}

  /// The factor on the variances of Gaussian i: the largest that it needs across its own planes, of
  /// which the flat side is one.
  double at(std::size_t i, std::span<const std::uint32_t> around) const {
    const Shape& own = shapes_[i];
    double growth = 1;
    for (int axis = 0; axis < 3 && own.growth > growth; ++axis) {
      Plane plane;
      plane << own.axes.col(axis), own.axes.col((axis + 1) % 3);
      growth = std::max(growth, needed(i, around, plane));
    }
    return std::min({growth, own.growth, kMostGrowth});
  }

 private:
  using Plane = Eigen::Matrix<double, 3, 2>;

  Matrix2 projected(std::size_t i, const Plane& plane) const {
    return plane.transpose() * matrix_of(gaussians_.covariance[i]) * plane;
  }

  /// The factor after which the optical depth over Gaussian i, seen across a plane, is as wanted.
  double needed(std::size_t i, std::span<const std::uint32_t> around, const Plane& plane) const {
    const Matrix2 variance = projected(i, plane);
    double depth = 0;
    double shown = 0;
    for (const std::uint32_t j : around) {
      const Matrix2 other = projected(j, plane);
      const Matrix2 sum = variance + other;
      const double determinant = sum.determinant();
      if (!(determinant > 0)) continue;
      const Eigen::Vector2d apart =
          plane.transpose() * (gaussians_.position[j] - gaussians_.position[i]).cast<double>();
      const double distance2 = (sum(1, 1) * apart[0] * apart[0] + sum(0, 0) * apart[1] * apart[1] -
                                2 * sum(0, 1) * apart[0] * apart[1]) /
                               determinant;
      const double here = shapes_[j].amplitude *
                          std::sqrt(std::max(0.0, other.determinant()) / determinant) *
                          portable::exp(-distance2 / 2);
      shown += here;
      depth += here * shapes_[j].growth;
    }
    if (!(shown > 0)) return 1;
    const double peak = kFilteredPeak * shapes_[i].amplitude;
    const double wanted = std::min(depth, std::max(1.0, depth * peak / dilogarithm(peak)));
    return std::min(wanted, kMostDepth) / shown;
  }

  /// What the pixel filter (variance 0.3) leaves of a kernel's peak, where a merged Gaussian has a
  /// standard deviation of 0.7 pixels: 0.5 / 0.8.
  static constexpr double kFilteredPeak = 0.625;
  /// More layers of opaque Gaussians make nothing more opaque, but silhouettes wider. Full clouds
  /// have them wider, too, by the tails of the pixel filter.
  static constexpr double kMostDepth = 10;
  /// What is larger blurs more than it closes.
  static constexpr double kMostGrowth = 4;

  const MergeGaussians& gaussians_;
  const Array<Shape>& shapes_;
};

}  // namespace

GaussianCloud drawn_gaussians(const MergeGaussians& gaussians, const GaussianCloud& cloud) {
  GaussianCloud out = cloud.without_gaussians();
  const std::size_t size = gaussians.size();
  out.resize(size);
  Array<Shape> shapes(size);
  parallel_each(size, kMergeGrain, [&](std::size_t i) {
    const std::uint32_t source = gaussians.source[i];
    shapes[i] = {};
    if (source == MergeGaussians::kMerged) {
      shapes[i] = shape_of(gaussians, i);
    } else {
      shapes[i].amplitude = cloud.amplitude[source];
    }
  });
  const Growth growth(gaussians, shapes);
  const std::unique_ptr<NeighborSearch> search = make_neighbor_search(gaussians.position);
  const NeighborRows rows = search->rows(std::min(kNeighbors, size));
  parallel_each(size, kMergeGrain, [&](std::size_t i) {
    const std::uint32_t source = gaussians.source[i];
    if (source != MergeGaussians::kMerged) {
      out.assign(i, cloud, source);
      return;
    }
    const Shape& shape = shapes[i];
    Eigen::Quaterniond q(shape.axes);
    q.normalize();
    out.position[i] = gaussians.position[i];
    out.scale[i] = (shape.scale * std::sqrt(growth.at(i, rows.of(i)))).cast<float>();
    out.rotation[i] = {static_cast<float>(q.w()), static_cast<float>(q.x()),
                       static_cast<float>(q.y()), static_cast<float>(q.z())};
    out.amplitude[i] = static_cast<float>(shape.amplitude);
    const auto at = out.harmonics.begin() + static_cast<std::ptrdiff_t>(i * gaussians.stride);
    std::copy_n(gaussians.harmonics_of(i), gaussians.stride, at);
  });
  return out;
}

}  // namespace surfel
