#include <Eigen/Eigenvalues>

#include <gtest/gtest.h>
#include <surfel/render/ewa_kernel.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

SurfelInCamera slanted(double degrees) {
  SurfelInCamera s;
  s.position = {0.3, -0.2, 2};
  const double a = degrees * M_PI / 180;
  s.normal = Eigen::Vector3d(std::sin(a), 0, -std::cos(a));
  s.tangent = Eigen::Vector3d(std::cos(a), 0, std::sin(a));
  s.variance_u = 0.01;
  s.variance_v = 0.0025;
  s.area = 0.005;
  return s;
}

Eigen::Vector2d project(const Eigen::Vector3d& p, const Camera& camera) {
  const double w = camera.orthographic ? 1 : p.z();
  return {camera.focal_x * p.x() / w + camera.center_x,
          camera.focal_y * p.y() / w + camera.center_y};
}

TEST(EwaKernel, JacobianIsTheDerivativeOfTheProjection) {
  for (const bool orthographic : {false, true}) {
    Camera camera = camera_at(1, 256);
    camera.orthographic = orthographic;
    camera.focal_y *= 1.25;
    for (const double degrees : {0.0, 30.0, 60.0, 85.0, 90.0}) {
      const SurfelInCamera s = slanted(degrees);
      const Eigen::Matrix2d J = screen_from_tangent_jacobian(s, camera);
      constexpr double kStep = 1e-5;
      const Eigen::Vector3d frame[] = {s.tangent, s.normal.cross(s.tangent)};
      for (int i = 0; i < 2; ++i) {
        const Eigen::Vector2d difference = (project(s.position + kStep * frame[i], camera) -
                                            project(s.position - kStep * frame[i], camera)) /
                                           (2 * kStep);
        EXPECT_LT((J.col(i) - difference).norm(), 1e-4) << degrees << " degrees, column " << i;
      }
    }
  }
}

TEST(EwaKernel, IntegratesToTheSurfelsAreaOnScreen) {
  const Camera camera = camera_at(1, 256);
  for (const double degrees : {0.0, 45.0, 80.0}) {
    const SurfelInCamera s = slanted(degrees);
    const auto kernel = make_ewa_kernel(s, camera, 1);
    ASSERT_TRUE(kernel);
    double sum = 0;
    for (int y = -200; y < 400; ++y) {
      for (int x = -200; x < 500; ++x) sum += kernel->rho({x + 0.5, y + 0.5});
    }
    const double area = s.area * std::abs(screen_from_tangent_jacobian(s, camera).determinant());
    EXPECT_NEAR(sum, area, 1e-3 * area);
  }
}

TEST(EwaKernel, DeterminantDoesNotCancelForSlivers) {
  const Camera camera = camera_at(1, 512);
  SurfelInCamera s = slanted(90);
  s.position.x() = 0;  // The line of sight lies in the tangent plane.
  s.variance_u = 1e4;
  const auto kernel = make_ewa_kernel(s, camera, 1);
  ASSERT_TRUE(kernel);
  EXPECT_GT(kernel->determinant, 0);
  EXPECT_NEAR(kernel->amplitude, 0, 1e-9);  // Edge-on: no area on screen.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(kernel->Sigma);
  EXPECT_GE(eigen.eigenvalues()[1], 1);
}

TEST(EwaKernel, NothingBehindTheEye) {
  const Camera camera = camera_at(1, 64);
  SurfelInCamera s = slanted(10);
  s.position.z() = -1;
  EXPECT_FALSE(make_ewa_kernel(s, camera, 1));
  s.position.z() = 0;
  EXPECT_FALSE(make_ewa_kernel(s, camera, 1));
}

TEST(EwaKernel, DepthPlaneIsExactOnTheTangentPlane) {
  for (const bool orthographic : {false, true}) {
    Camera camera = camera_at(1, 256);
    camera.orthographic = orthographic;
    const SurfelInCamera s = slanted(50);
    const DepthPlane plane = depth_plane(s, camera);
    const Eigen::Vector3d q = s.position + 0.13 * s.tangent - 0.21 * s.normal.cross(s.tangent);
    const double expected = orthographic ? -q.z() : 1 / q.z();
    const double found =
        plane.value + plane.gradient.dot(project(q, camera) - project(s.position, camera));
    EXPECT_NEAR(found, expected, 1e-12);
  }
}

}  // namespace
}  // namespace surfel::test
