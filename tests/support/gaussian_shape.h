#pragma once

#include <Eigen/Geometry>
#include <array>

#include <surfel/scene/gaussian_cloud.h>

namespace surfel::test {

/// The covariance of a Gaussian in space.
inline Eigen::Matrix3d covariance(const GaussianCloud& cloud, std::size_t i) {
  const std::array<float, 4>& q = cloud.rotation[i];
  const Eigen::Matrix3d axes =
      Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  return axes * cloud.scale[i].cast<double>().array().square().matrix().asDiagonal() *
         axes.transpose();
}

}  // namespace surfel::test
