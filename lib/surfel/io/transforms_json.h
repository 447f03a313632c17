#pragma once

#include <vector>

#include <surfel/io/json_reader.h>
#include <surfel/io/view_file.h>
#include <surfel/scene/view.h>

namespace surfel {

/// Reads the views of a transforms.json as NeRF, instant-ngp and nerfstudio write it. `frames` has
/// an object for each view: `transform_matrix`, 3x4 or 4x4 from the camera (x right, y up, z back)
/// to the world, and `file_path`, the name of its picture. Each of `fl_x`, `fl_y`, `cx`, `cy`, `w`,
/// `h`, `camera_angle_x`, `camera_angle_y` (fields of view, radians) holds for all views, or stands
/// in a frame, as do `camera_model` (OPENCV, OPENCV_FISHEYE, EQUIRECTANGULAR, PINHOLE, ...) and its
/// coefficients k1 ..., p1, p2. Without fl_y it is fl_x; the principal point is the middle unless
/// it is said.
///
/// `applied_transform` and `applied_scale` of nerfstudio moved the poses, and its point cloud with
/// them; they are undone with ViewFileOptions::original_world. `scale`, `offset` and `aabb_scale`
/// of instant-ngp only say how it trains, and move nothing. Other keys have no effect. Throws
/// Error(kInput) for other camera models and for poses of other axes (`from_mitsuba`, `from_na`).
/// Internal to the io module.
std::vector<View> read_transforms(const JsonValue& json, const ViewFileOptions& options);

}  // namespace surfel
