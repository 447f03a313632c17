#include <Eigen/LU>

#include <fmt/format.h>
#include <surfel/io/pose_json.h>
#include <surfel/io/rigid_pose.h>

namespace surfel {
namespace {

double required(const JsonValue& json, const char* key) {
  const std::optional<double> value = json.number(key);
  if (!value) json.fail(fmt::format("has no {}", key));
  return *value;
}

void read_intrinsics(const JsonValue& json, Camera& camera) {
  if (const auto found = json.find("intrinsics")) {
    const Eigen::MatrixXd k = found->matrix(3, 3);
    if (k(0, 1) != 0 || k(1, 0) != 0 || k(2, 0) != 0 || k(2, 1) != 0 || k(2, 2) != 1) {
      found->fail("must have the rows fx 0 cx, 0 fy cy, 0 0 1");
    }
    camera.focal_x = k(0, 0);
    camera.focal_y = k(1, 1);
    camera.center_x = k(0, 2);
    camera.center_y = k(1, 2);
    return;
  }
  camera.focal_x = required(json, "fx");
  camera.focal_y = json.number("fy").value_or(camera.focal_x);
  camera.center_x = json.number("cx").value_or(camera.width / 2.0);
  camera.center_y = json.number("cy").value_or(camera.height / 2.0);
}

CameraAxes read_axes(const JsonValue& json) {
  const std::string axes = json.text("axes").value_or("opencv");
  if (axes == "opencv") return CameraAxes::kRightDownForward;
  if (axes != "opengl") json.fail("has axes other than opencv and opengl");
  return CameraAxes::kRightUpBack;
}

void read_pose(const JsonValue& json, Camera& camera) {
  const CameraAxes axes = read_axes(json);
  const auto forth = json.find("world_to_camera");
  const auto back = json.find("camera_to_world");
  const auto position = json.find("position");
  const auto rotation = json.find("rotation");
  if ((forth ? 1 : 0) + (back ? 1 : 0) + (position || rotation ? 1 : 0) != 1) {
    json.fail("must have either world_to_camera or camera_to_world, or position and rotation");
  }
  if (forth) {
    const Eigen::MatrixXd matrix = forth->matrix(4, 4);
    const auto fail = [&](const std::string& message) { forth->fail(message); };
    // The inverse of a rigid motion, which is checked as it is written.
    Eigen::MatrixXd inverse = matrix;
    inverse.topLeftCorner<3, 3>() = matrix.topLeftCorner<3, 3>().transpose();
    inverse.topRightCorner<3, 1>() =
        -(matrix.topLeftCorner<3, 3>().transpose() * matrix.topRightCorner<3, 1>());
    set_pose(camera, inverse, axes, fail);
    return;
  }
  if (back) {
    set_pose(camera, back->matrix(4, 4), axes,
             [&](const std::string& message) { back->fail(message); });
    return;
  }
  if (!position || !rotation) json.fail("must have both position and rotation");
  Eigen::MatrixXd matrix(3, 4);
  matrix.leftCols<3>() = rotation->matrix(3, 3);
  const std::vector<double> eye = position->numbers(3);
  matrix.col(3) = Vec3d(eye[0], eye[1], eye[2]);
  set_pose(camera, matrix, axes, [&](const std::string& message) { rotation->fail(message); });
}

View read_view(const JsonValue& json, std::size_t number) {
  View view;
  const auto img_name = json.text("img_name");
  json.find("id");  // 3D Gaussian Splatting numbers its cameras.
  view.name = json.text("name").value_or(img_name.value_or(fmt::format("view_{}", number)));
  const auto width = json.count("width", Camera::kMostSide);
  const auto height = json.count("height", Camera::kMostSide);
  if (!width || !height) json.fail("must have width and height");
  view.camera.width = *width;
  view.camera.height = *height;
  read_intrinsics(json, view.camera);
  read_pose(json, view.camera);
  view.time = json.number("time");
  view.camera.near = json.number("near").value_or(0);
  for (const std::string& problem : view.camera.problems()) json.fail("is not usable: " + problem);
  json.reject_unread();
  return view;
}

}  // namespace

std::vector<View> read_poses(const JsonValue& json) {
  if (json.is_object() && !json.find("views")) return {read_view(json, 0)};
  const JsonValue list = json.is_object() ? *json.find("views") : json;
  if (json.is_object()) json.reject_unread();
  if (!list.is_array() || list.size() == 0) list.fail("must be an array of views, one at least");
  std::vector<View> views;
  for (std::size_t i = 0; i < list.size(); ++i) views.push_back(read_view(list.at(i), i));
  return views;
}

}  // namespace surfel
