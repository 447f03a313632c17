#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

namespace surfel::test {

/// Sigma = J J^T of a unit disc at P with normal n as SS01 section 4 has it: the screen's basis
/// vectors are projected along the line of sight onto the tangent plane, which gives J_pr^-1, and
/// that is inverted. Focal length 1.
template <class T>
Eigen::Matrix<T, 2, 2> Sigma_by_inverse(const Eigen::Matrix<T, 3, 1>& P,
                                        const Eigen::Matrix<T, 3, 1>& n) {
  using Vec3 = Eigen::Matrix<T, 3, 1>;
  const Vec3 ray = P.normalized();
  const auto onto_plane = [&](const Vec3& x) {
    return Vec3(P.z() * (x - ray * (n.dot(x) / n.dot(ray))));
  };
  const Vec3 x0 = onto_plane(Vec3::UnitX());
  const Vec3 x1 = onto_plane(Vec3::UnitY());
  const Vec3 u0 = x0 / x0.norm();
  const Vec3 u1 = n.cross(u0);
  Eigen::Matrix<T, 2, 2> J_inverse;
  J_inverse << x0.norm(), x1.dot(u0), 0, x1.dot(u1);
  const Eigen::Matrix<T, 2, 2> J = J_inverse.inverse();
  return J * J.transpose();
}

/// The same by the direct Jacobian (ewa_kernel.h), in any precision.
template <class T>
Eigen::Matrix<T, 2, 2> Sigma_direct(const Eigen::Matrix<T, 3, 1>& P,
                                    const Eigen::Matrix<T, 3, 1>& n) {
  using Vec3 = Eigen::Matrix<T, 3, 1>;
  const Vec3 t = n.unitOrthogonal();
  const Vec3 b = n.cross(t);
  const auto column = [&](const Vec3& v) {
    return Eigen::Matrix<T, 2, 1>((v.template head<2>() - P.template head<2>() / P.z() * v.z()) /
                                  P.z());
  };
  Eigen::Matrix<T, 2, 2> J;
  J.col(0) = column(t);
  J.col(1) = column(b);
  return J * J.transpose();
}

/// What became of normals at one angle to the line of sight.
struct JacobianErrors {
  double largest = 0;  ///< Relative error of Sigma (Frobenius), of those that did not fail.
  std::size_t tried = 0;
  std::size_t failed = 0;  ///< Not finite, or off by more than a tenth.
};

/// Both methods at `angle` degrees between normal and line of sight, over places on the picture and
/// turns of the normal; `sigma` is one of the two above, in precision T, against the direct one in
/// long double.
template <class T, class Sigma>
JacobianErrors jacobian_errors(double angle, Sigma sigma) {
  using Exact = Eigen::Matrix<long double, 3, 1>;
  JacobianErrors errors;
  const double radians = angle * M_PI / 180;
  for (int place = 0; place < 25; ++place) {
    const Exact P(0.15L * (place % 5 - 2), 0.15L * (place / 5 - 2), 1.0L + 0.37L * place);
    const Exact at = Exact(P.x() * P.z(), P.y() * P.z(), P.z());
    const Exact ray = at.normalized();
    const Exact side = ray.unitOrthogonal();
    for (int turn = 0; turn < 36; ++turn) {
      const Exact around = Eigen::AngleAxis<long double>(turn * M_PI / 18, ray) * side;
      const Exact n = (std::cos(radians) * -ray + std::sin(radians) * around).normalized();
      const Eigen::Matrix<T, 3, 1> p_t = at.template cast<T>();
      const Eigen::Matrix<T, 3, 1> n_t = n.template cast<T>();
      // The inputs as rounded are the problem to solve.
      const Eigen::Matrix<long double, 2, 2> truth = Sigma_direct<long double>(
          p_t.template cast<long double>(), n_t.template cast<long double>());
      const Eigen::Matrix<long double, 2, 2> got = sigma(p_t, n_t).template cast<long double>();
      const double error = static_cast<double>((got - truth).norm() / truth.norm());
      ++errors.tried;
      if (!(error <= 0.1)) {
        ++errors.failed;
      } else {
        errors.largest = std::max(errors.largest, error);
      }
    }
  }
  return errors;
}

}  // namespace surfel::test
