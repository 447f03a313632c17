#pragma once

#include <cmath>
#include <cstddef>
#include <limits>

#include <surfel/base/types.h>
#include <surfel/estimate/plane_fit.h>

namespace surfel {

/// Sums over a neighbourhood from which its covariance follows.
struct Moments {
  double n = 0;  ///< Points, or their weights.
  double x = 0, y = 0, z = 0;
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  /// \param d  offset of a point.
  void add(const Vec3d& d) {
    n += 1;
    x += d.x(), y += d.y(), z += d.z();
    xx += d.x() * d.x(), xy += d.x() * d.y(), xz += d.x() * d.z();
    yy += d.y() * d.y(), yz += d.y() * d.z(), zz += d.z() * d.z();
  }

  /// As a point that counts `weight` times.
  void add(const Vec3d& d, double weight) {
    const Vec3d w = weight * d;
    n += weight;
    x += w.x(), y += w.y(), z += w.z();
    xx += w.x() * d.x(), xy += w.x() * d.y(), xz += w.x() * d.z();
    yy += w.y() * d.y(), yz += w.y() * d.z(), zz += w.z() * d.z();
  }

  Vec3d mean() const { return Vec3d(x, y, z) / n; }

  /// Variance along a unit vector.
  double variance_along(const Vec3d& d) const {
    const double mean = d.dot(Vec3d(x, y, z)) / n;
    const Vec3d image(xx * d.x() + xy * d.y() + xz * d.z(), xy * d.x() + yy * d.y() + yz * d.z(),
                      xz * d.x() + yz * d.y() + zz * d.z());
    return d.dot(image) / n - mean * mean;
  }

  /// Trace of the covariance.
  double variance() const { return (xx + yy + zz - (x * x + y * y + z * z) / n) / n; }

  /// The covariance.
  void store(std::size_t i, PlaneBatch& batch) const {
    batch.xx[i] = (xx - x * x / n) / n;
    batch.xy[i] = (xy - x * y / n) / n;
    batch.xz[i] = (xz - x * z / n) / n;
    batch.yy[i] = (yy - y * y / n) / n;
    batch.yz[i] = (yz - y * z / n) / n;
    batch.zz[i] = (zz - z * z / n) / n;
  }
};

/// The plane that fits a neighbourhood best.
struct Plane {
  /// lambda_1 / lambda_2 below which a neighbourhood is thin: a fifth as wide as long.
  static constexpr double kThinShare = 0.04;
  /// lambda_1 / lambda_2 below which a neighbourhood is a line: a thousandth as wide as long.
  static constexpr double kLineShare = 1e-6;

  Vec3d normal;  ///< Unit length.
  Vec3d lambda;  ///< Variances of the points along the principal axes, ascending, >= 0.
  double n;      ///< Points.

  bool thin() const { return lambda[1] < kThinShare * lambda[2]; }
  double variation() const { return lambda[0] / lambda.sum(); }
  /// Variance of the points' distances from the plane; a plane has three parameters.
  double noise() const {
    return n > 3 ? lambda[0] * n / (n - 3) : std::numeric_limits<double>::infinity();
  }
  /// Standard error of the normal, in radians, where the distances have the variance `noise`;
  /// infinite where any normal is as good.
  double error(double noise) const {
    const double gap_1 = lambda[1] - lambda[0];
    const double gap_2 = lambda[2] - lambda[0];
    if (!(gap_1 > 0)) return std::numeric_limits<double>::infinity();
    return std::sqrt(noise / n * (lambda[1] / (gap_1 * gap_1) + lambda[2] / (gap_2 * gap_2)));
  }
};

/// The plane of the neighbourhood `i` of a batch that was fitted, of n points.
inline Plane plane_of(const PlaneBatch& batch, std::size_t i, double n) {
  return {{batch.normal[0][i], batch.normal[1][i], batch.normal[2][i]},
          {batch.lambda[0][i], batch.lambda[1][i], batch.lambda[2][i]},
          n};
}

/// The plane of one neighbourhood, whose points are not all at one place.
inline Plane plane_of(const Moments& moments) {
  PlaneBatch batch;
  moments.store(0, batch);
  fit_planes(1, batch);
  return plane_of(batch, 0, moments.n);
}

/// Turns a normal of arbitrary side to a side that is the same on every machine: the component of
/// largest magnitude is positive.
inline Vec3f with_fixed_side(const Vec3d& normal) {
  Eigen::Index largest = 0;
  normal.cwiseAbs().maxCoeff(&largest);
  return (normal[largest] < 0 ? Vec3d(-normal) : normal).cast<float>();
}

}  // namespace surfel
