#include "tools/render/views.h"

#include <algorithm>
#include <limits>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>

namespace surfel::render_tool {

std::string picture_name(const std::string& pattern, std::size_t i) {
  const std::size_t percent = pattern.find('%');
  const std::size_t d = pattern.find('d', percent);
  const std::string width = pattern.substr(percent + 1, d - percent - 1);
  const int digits = width.empty() ? 0 : std::stoi(width);
  return pattern.substr(0, percent) +
         (width.starts_with('0') ? fmt::format("{:0{}}", i, digits)
                                 : fmt::format("{:{}}", i, digits)) +
         pattern.substr(d + 1);
}

bool is_pattern(const std::string& name) {
  const std::size_t percent = name.find('%');
  if (percent == std::string::npos) return false;
  const std::size_t end = name.find_first_not_of("0123456789", percent + 1);
  return end != std::string::npos && end - percent <= 3 && name[end] == 'd';
}

std::vector<CameraOptions> asked_views(const Settings& s) {
  if (s.camera_file.empty()) return {s.camera};
  return read_cameras(s.camera_file, s.camera);
}

bool needs_guess(const Settings& s, const std::vector<CameraOptions>& views) {
  return std::any_of(views.begin(), views.end(),
                     [&](const auto& view) { return s.view.needs_guess(view); });
}

void aim(tool::Tool& tool, const Settings& s, const SurfaceSample& sample, ViewHints hints,
         std::vector<CameraOptions>& views) {
  bool said = false;
  const std::optional<Vec3d> up_of_file = hints.up;
  for (CameraOptions& view : views) {
    if (!s.view.needs_guess(view)) continue;
    hints.up = view.up ? view.up : up_of_file;
    hints.up_reason = view.up ? "as given" : "as the file says";
    const std::string done = aim_camera(view, s.view, guess_view(sample, hints));
    if (!said) tool.note(done);
    if (!said) tool.report()["view"] = done;
    said = true;
  }
}

std::vector<Camera> cameras(const tool::Tool& tool, const Settings& s,
                            const std::vector<CameraOptions>& views, const SceneExtent& scene) {
  std::vector<Camera> all;
  bool strays_left_out = false;
  for (const CameraOptions& view : views) {
    const bool framed = !view.eye || !view.target;
    strays_left_out = strays_left_out || (framed && scene.stray > 0 && !view.frame_all);
    if (s.turntable > 0) {
      for (const Camera& c : turntable(view, scene, s.turntable)) all.push_back(c);
    } else {
      all.push_back(make_camera(view, scene));
    }
  }
  if (all.size() > 1 && !is_pattern(s.output)) {
    throw_usage(
        fmt::format("--output is \"{}\" but there are {} views; give a pattern such "
                    "as view_%04d.png",
                    s.output, all.size()));
  }
  if (strays_left_out) {
    tool.note(
        fmt::format("{} stray points lie outside of the frame, far from all others; "
                    "--frame-all takes them in",
                    scene.stray));
  }
  return all;
}

double half_a_pixel(const std::vector<CameraOptions>& views, const Bounds& box) {
  // From within a scene its middle may be as near as can be.
  constexpr double kLeastShare = 0.05;
  if (box.empty()) return 1;
  const double size = (box.max - box.min).norm();
  double least = std::numeric_limits<double>::infinity();
  for (const CameraOptions& view : views) {
    const Camera camera = make_camera(view, {.box = box});
    const double z = (camera.camera_from_world * (box.center() - camera.eye)).z();
    const double distance = camera.orthographic ? 1 : std::max(z, kLeastShare * size);
    least = std::min(least, distance / std::max(camera.focal_x, camera.focal_y) / 2);
  }
  return least > 0 ? least : 1;
}

}  // namespace surfel::render_tool
