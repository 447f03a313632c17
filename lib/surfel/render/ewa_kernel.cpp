#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/render/ewa_kernel.h>

namespace surfel {

Eigen::Matrix2d screen_from_tangent_jacobian(const SurfelInCamera& surfel, const Camera& camera) {
  const Eigen::Vector3d bitangent = surfel.normal.cross(surfel.tangent);
  const double scale = camera.orthographic ? 1 : 1 / surfel.position.z();
  const Eigen::Vector2d slope =
      camera.orthographic ? Eigen::Vector2d(0, 0)
                          : Eigen::Vector2d(surfel.position.head<2>() / surfel.position.z());
  Eigen::Matrix2d J;
  J.col(0) = scale * (surfel.tangent.head<2>() - slope * surfel.tangent.z());
  J.col(1) = scale * (bitangent.head<2>() - slope * bitangent.z());
  J.row(0) *= camera.focal_x;
  J.row(1) *= camera.focal_y;
  return J;
}

double EwaKernel::beta(const Eigen::Vector2d& x) const {
  const Eigen::Vector2d d = x - center;
  return 0.5 *
         (Sigma(1, 1) * d.x() * d.x() - 2 * Sigma(0, 1) * d.x() * d.y() +
          Sigma(0, 0) * d.y() * d.y()) /
         determinant;
}

double EwaKernel::rho(const Eigen::Vector2d& x) const {
  return amplitude * portable::exp(-beta(x));
}

std::optional<EwaKernel> make_ewa_kernel(const SurfelInCamera& surfel, const Camera& camera,
                                         double lowpass) {
  const double z = surfel.position.z();
  if (!(z > camera.near) || (!camera.orthographic && !(z > 0))) return std::nullopt;
  const Eigen::Matrix2d J = screen_from_tangent_jacobian(surfel, camera);
  const Eigen::Vector2d V(surfel.variance_u, surfel.variance_v);
  const Eigen::Matrix2d JVJt = J * V.asDiagonal() * J.transpose();
  const double h2 = lowpass * lowpass;

  EwaKernel kernel;
  const double w = camera.orthographic ? 1 : z;
  kernel.center = {camera.focal_x * surfel.position.x() / w + camera.center_x,
                   camera.focal_y * surfel.position.y() / w + camera.center_y};
  kernel.Sigma = JVJt + h2 * Eigen::Matrix2d::Identity();  // SS01 (6)
  // |Sigma| = |J V J^T| + h^2 tr(J V J^T) + h^4 does not cancel when the ellipse is a sliver.
  const double det_J = std::abs(J.determinant());
  kernel.determinant = det_J * det_J * V.x() * V.y() + h2 * JVJt.trace() + h2 * h2;
  kernel.amplitude = surfel.area * det_J / (2 * std::numbers::pi * std::sqrt(kernel.determinant));
  return kernel;
}

DepthPlane depth_plane(const SurfelInCamera& surfel, const Camera& camera) {
  const Eigen::Vector3d& n = surfel.normal;
  const Eigen::Vector3d& p = surfel.position;
  const Eigen::Vector2d focal(camera.focal_x, camera.focal_y);
  if (camera.orthographic) {
    // On the plane n.xy dx + n.z dz = 0.
    return {-p.z(), (n.head<2>() / n.z()).cwiseQuotient(focal)};
  }
  // The pixel's ray z (X, Y, 1) meets the plane n . q = n . p where 1/z = (n.x X + n.y Y + n.z) /
  // n.p.
  return {1 / p.z(), (n.head<2>() / n.dot(p)).cwiseQuotient(focal)};
}

}  // namespace surfel
