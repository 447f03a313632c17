#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>

#include <fmt/format.h>
#include <surfel/io/rigid_pose.h>

namespace surfel {

void set_pose(Camera& camera, const Eigen::MatrixXd& world_from_camera, CameraAxes axes,
              FunctionRef<void(const std::string&)> fail) {
  if (!world_from_camera.allFinite()) fail("holds a number that is not finite");
  if (world_from_camera.rows() == 4 &&
      !world_from_camera.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1), 1e-6)) {
    fail("has a last row other than 0 0 0 1; the matrix may be transposed");
  }
  Eigen::Matrix3d rotation = world_from_camera.topLeftCorner<3, 3>();
  const double size = std::sqrt(rotation.squaredNorm() / 3);
  const double off = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).norm();
  constexpr double kMostOff = 1e-3;
  if (!(off < kMostOff)) {
    fail(std::abs(size - 1) > kMostOff
             ? fmt::format("scales lengths by {:g}, and must be a rotation and a translation", size)
             : "is no rotation and translation");
  }
  if (rotation.determinant() < 0) fail("mirrors, and must be a rotation and a translation");
  // What is a rotation to all digits stays as it is.
  constexpr double kRounding = 1e-14;
  if (off > kRounding) {
    const Eigen::JacobiSVD<Eigen::Matrix3d> nearest(rotation,
                                                    Eigen::ComputeFullU | Eigen::ComputeFullV);
    rotation = nearest.matrixU() * nearest.matrixV().transpose();
  }
  if (axes == CameraAxes::kRightUpBack) rotation.rightCols<2>() *= -1;
  camera.camera_from_world = rotation.transpose();
  camera.eye = world_from_camera.topRightCorner<3, 1>();
}

}  // namespace surfel
