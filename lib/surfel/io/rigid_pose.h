#pragma once

#include <Eigen/Core>
#include <string>

#include <surfel/base/function_ref.h>
#include <surfel/scene/camera.h>

namespace surfel {

/// Which way the axes of a camera's own coordinates point.
enum class CameraAxes {
  kRightDownForward,  ///< OpenCV, COLMAP, and Camera.
  kRightUpBack        ///< OpenGL, Blender, NeRF.
};

/// Gives a camera its pose. Calls fail(message), which must not return, where the matrix is no
/// rotation and translation; files hold as few as five digits, so that it may be off by 1e-3, and
/// is then made a rotation. Internal to the io module.
/// \param world_from_camera  3x4 or 4x4, takes columns from the camera to the world.
void set_pose(Camera& camera, const Eigen::MatrixXd& world_from_camera, CameraAxes axes,
              FunctionRef<void(const std::string&)> fail);

}  // namespace surfel
