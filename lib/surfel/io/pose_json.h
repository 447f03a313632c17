#pragma once

#include <vector>

#include <surfel/io/json_reader.h>
#include <surfel/scene/view.h>

namespace surfel {

/// Reads views given by intrinsics and pose: an array of objects, an object with such an array
/// `views`, or one object. Each has
///   name             of its picture; default: view_0, view_1, ...
///   width, height    of the picture, pixels
///   fx, fy, cx, cy   focal lengths and principal point, pixels, (0, 0) the picture's corner;
///                    default of fy: fx, of cx and cy: the middle. Or `intrinsics`, the 3x3 matrix
///   world_to_camera or camera_to_world   4x4, as rows; takes columns of x y z 1
///   axes             of the camera: "opencv" (x right, y down, z forward, the default) or "opengl"
///                    (x right, y up, z back)
///   near             nothing nearer is drawn; default: 0
///   time             seconds, for paths
/// Also the cameras.json of 3D Gaussian Splatting: img_name, width, height, position, rotation
/// (camera to world), fx, fy. Throws Error(kInput) for what is missing, and for other keys.
/// Internal to the io module.
std::vector<View> read_poses(const JsonValue& json);

}  // namespace surfel
