#include <Eigen/LU>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/io/rigid_pose.h>
#include <surfel/io/transforms_json.h>

namespace surfel {
namespace {

/// A frame, whose members stand for the file's members of the same name.
class FrameMembers {
 public:
  FrameMembers(const JsonValue& root, const JsonValue& frame) : root_(root), frame_(frame) {}

  std::optional<double> number(const char* key) const {
    const std::optional<double> own = frame_.number(key);
    return own ? own : root_.number(key);
  }
  std::optional<std::string> text(const char* key) const {
    const std::optional<std::string> own = frame_.text(key);
    return own ? own : root_.text(key);
  }
  std::optional<int> side(const char* key) const {
    const std::optional<int> own = frame_.count(key, Camera::kMostSide);
    return own ? own : root_.count(key, Camera::kMostSide);
  }

 private:
  const JsonValue& root_;
  const JsonValue& frame_;
};

/// The lens of a frame; nullopt where it bends nothing.
std::optional<Lens> read_lens(const JsonValue& json, const FrameMembers& frame, bool fisheye) {
  const std::string model = frame.text("camera_model").value_or("OPENCV");
  Lens lens;
  if (model == "EQUIRECTANGULAR") {
    lens.model = Lens::Model::kEquirectangular;
    return lens;
  }
  if (model == "OPENCV_FISHEYE" || fisheye) {
    lens.model = Lens::Model::kFisheye;
  } else if (model != "PINHOLE" && model != "SIMPLE_PINHOLE" && model != "OPENCV" &&
             model != "RADIAL" && model != "SIMPLE_RADIAL" && model != "FULL_OPENCV") {
    json.fail(
        fmt::format("has the camera model {}, which is not supported; make pictures and "
                    "cameras without distortion (colmap image_undistorter) and a "
                    "transforms.json of these",
                    model));
  }
  constexpr std::array<const char*, 6> kRadial{"k1", "k2", "k3", "k4", "k5", "k6"};
  bool bends = lens.model == Lens::Model::kFisheye;
  for (std::size_t i = 0; i < kRadial.size(); ++i) {
    lens.k[i] = frame.number(kRadial[i]).value_or(0);
    bends = bends || lens.k[i] != 0;
  }
  lens.p = {frame.number("p1").value_or(0), frame.number("p2").value_or(0)};
  bends = bends || lens.p[0] != 0 || lens.p[1] != 0;
  return bends ? std::optional<Lens>(lens) : std::nullopt;
}

/// Focal length of a field of view over a picture's side.
double focal_of(const JsonValue& json, double angle, int side) {
  if (!(angle > 0 && angle < 3.14159)) {
    json.fail(fmt::format("has a field of view of {:g} radians", angle));
  }
  return side / (2 * portable::tan(angle / 2));
}

Camera read_camera(const JsonValue& json, const FrameMembers& frame, const ViewFileOptions& options,
                   bool equirectangular) {
  Camera camera;
  const auto width = frame.side("w");
  const auto height = frame.side("h");
  if ((!width || !height) && options.width == 0) {
    json.fail("has no w and h, nor has the whole file; add them, or give the pictures a size");
  }
  camera.width = width && height ? *width : options.width;
  camera.height = width && height ? *height : options.height;
  if (equirectangular) {
    // All directions are seen, so that no focal length is needed, nor said.
    camera.center_x = camera.width / 2.0;
    camera.center_y = camera.height / 2.0;
    return camera;
  }
  const auto fl_x = frame.number("fl_x");
  const auto fl_y = frame.number("fl_y");
  const auto angle_x = frame.number("camera_angle_x");
  const auto angle_y = frame.number("camera_angle_y");
  if (!fl_x && !angle_x) json.fail("has neither fl_x nor camera_angle_x, nor has the whole file");
  camera.focal_x = fl_x ? *fl_x : focal_of(json, *angle_x, camera.width);
  camera.focal_y = fl_y               ? *fl_y
                   : angle_y && !fl_x ? focal_of(json, *angle_y, camera.height)
                                      : camera.focal_x;
  camera.center_x = frame.number("cx").value_or(camera.width / 2.0);
  camera.center_y = frame.number("cy").value_or(camera.height / 2.0);
  for (const std::string& problem : camera.problems()) json.fail("is not usable: " + problem);
  return camera;
}

/// The matrix that nerfstudio moved the world by; with it applied_scale lengths.
struct AppliedTransform {
  Eigen::Matrix4d transform = Eigen::Matrix4d::Identity();
  double scale = 1;
};

AppliedTransform read_applied(const JsonValue& json) {
  AppliedTransform applied;
  const auto found = json.find("applied_transform");
  if (found) {
    applied.transform.topRows<3>() = found->matrix(found->size() == 4 ? 4 : 3, 4).topRows(3);
    if (!(std::abs(applied.transform.determinant()) > 0)) found->fail("cannot be undone");
  }
  applied.scale = json.number("applied_scale").value_or(1);
  if (!(applied.scale > 0)) json.fail("has an applied_scale that is not > 0");
  return applied;
}

}  // namespace

std::vector<View> read_transforms(const JsonValue& json, const ViewFileOptions& options) {
  for (const char* key : {"from_mitsuba", "from_na"}) {
    if (json.flag(key).value_or(false)) {
      json.fail(
          fmt::format("the key {} says that cameras have axes of their own, which are not "
                      "supported; write cameras with x right, y up and z back",
                      key));
    }
  }
  const bool fisheye = json.flag("is_fisheye").value_or(false);
  const AppliedTransform applied = read_applied(json);
  if (options.original_world && !json.find("applied_transform")) {
    json.fail("there is no applied_transform to be undone");
  }
  const JsonValue frames = *json.find("frames");
  if (!frames.is_array() || frames.size() == 0) {
    frames.fail("must be an array of views, one at least");
  }
  std::vector<View> views;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const JsonValue object = frames.at(i);
    const FrameMembers frame(json, object);
    View view;
    view.name = object.text("file_path").value_or(fmt::format("view_{}", i));
    view.lens = read_lens(object, frame, fisheye);
    const bool all_round = view.lens && view.lens->model == Lens::Model::kEquirectangular;
    view.camera = read_camera(object, frame, options, all_round);
    const auto found = object.find("transform_matrix");
    if (!found) object.fail("has no transform_matrix");
    Eigen::MatrixXd matrix = found->matrix(found->size() == 3 ? 3 : 4, 4);
    if (options.original_world) {
      matrix.topRightCorner<3, 1>() /= applied.scale;
      const Eigen::MatrixXd undone = applied.transform.inverse().topLeftCorner<3, 3>();
      matrix.topLeftCorner<3, 3>() = (undone * matrix.topLeftCorner<3, 3>()).eval();
      matrix.topRightCorner<3, 1>() =
          (undone * (matrix.topRightCorner<3, 1>() - applied.transform.topRightCorner<3, 1>()))
              .eval();
    }
    set_pose(view.camera, matrix, CameraAxes::kRightUpBack,
             [&](const std::string& message) { found->fail(message); });
    views.push_back(std::move(view));
  }
  return views;
}

}  // namespace surfel
