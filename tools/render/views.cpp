#include "tools/render/views.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/view_file.h>
#include <surfel/scene/view.h>

namespace surfel::render_tool {

namespace {

constexpr std::string_view kName = "{name}";

/// Does a pattern hold a %d or %04d, to be replaced by a number?
bool has_number(const std::string& name) {
  const std::size_t percent = name.find('%');
  if (percent == std::string::npos) return false;
  const std::size_t end = name.find_first_not_of("0123456789", percent + 1);
  return end != std::string::npos && end - percent <= 3 && name[end] == 'd';
}

std::string with_number(const std::string& pattern, std::size_t number) {
  const std::size_t percent = pattern.find('%');
  const std::size_t d = pattern.find('d', percent);
  const std::string width = pattern.substr(percent + 1, d - percent - 1);
  const int digits = width.empty() ? 0 : std::stoi(width);
  return pattern.substr(0, percent) +
         (width.starts_with('0') ? fmt::format("{:0{}}", number, digits)
                                 : fmt::format("{:{}}", number, digits)) +
         pattern.substr(d + 1);
}

/// Name of a picture by a pattern. The view's name may hold a % itself.
std::string picture_name(const std::string& pattern, std::size_t number, const std::string& name) {
  std::string file = has_number(pattern) ? with_number(pattern, number) : pattern;
  if (const std::size_t at = file.find(kName); at != std::string::npos) {
    file.replace(at, kName.size(), name);
  }
  return file;
}

std::vector<AskedView> known_views(const Settings& s) {
  const CameraOptions& o = s.camera;
  std::vector<View> views = read_views(s.views_file, {.width = s.resize ? o.width : 0,
                                                      .height = s.resize ? o.height : 0,
                                                      .original_world = s.original_world});
  if (s.resize) resize_views(views, o.width, o.height);
  const Vec3d up = mean_up(views);
  std::vector<AskedView> asked;
  for (View& view : views) {
    if (o.near > 0) view.camera.near = o.near;
    AskedView& added = asked.emplace_back(AskedView{o, view.camera, up});
    added.options.name = view.name;
  }
  return asked;
}

/// Names for the files of the views' pictures.
std::vector<std::string> names_of(const std::vector<AskedView>& asked) {
  std::vector<View> views;
  for (const AskedView& view : asked) views.push_back({view.options.name, {}});
  return file_names(views);
}

Camera camera_of(const AskedView& view, const SceneExtent& scene) {
  return view.known ? *view.known : make_camera(view.options, scene);
}

}  // namespace

std::vector<AskedView> asked_views(const Settings& s) {
  if (!s.views_file.empty()) return known_views(s);
  if (s.camera_file.empty()) return {{s.camera, {}}};
  std::vector<AskedView> asked;
  for (const CameraOptions& camera : read_cameras(s.camera_file, s.camera)) {
    asked.push_back({camera, {}});
  }
  return asked;
}

bool needs_guess(const Settings& s, const std::vector<AskedView>& views) {
  return std::any_of(views.begin(), views.end(), [&](const AskedView& view) {
    return !view.known && s.view.needs_guess(view.options);
  });
}

std::vector<Shot> asked_shots(const tool::Tool& tool, const Settings& s,
                              const std::vector<AskedView>& views) {
  const std::size_t turns = s.turntable > 0 ? static_cast<std::size_t>(s.turntable) : 1;
  const std::size_t count = views.size() * turns;
  const std::size_t first = s.frames ? (*s.frames)[0] : 0;
  const std::size_t last = s.frames ? (*s.frames)[1] : count - 1;
  if (last >= count) {
    throw_usage(
        fmt::format("--frames is {}-{} but the last picture is {}", first, last, count - 1));
  }
  const bool named = s.output.find(kName) != std::string::npos;
  if (named && turns > 1 && !has_number(s.output)) {
    throw_usage(
        fmt::format("--output is \"{}\" but --turntable makes {} pictures of each view; give "
                    "a pattern such as {{name}}_%04d.png",
                    s.output, turns));
  }
  if (first != last && !named && !has_number(s.output)) {
    throw_usage(
        fmt::format("--output is \"{}\" but there are {} views; give a pattern such "
                    "as view_%04d.png",
                    s.output, last - first + 1));
  }
  const std::vector<std::string> names = names_of(views);
  std::vector<Shot> shots;
  for (std::size_t i = first; i <= last; ++i) {
    const std::string file = picture_name(s.output, i, names[i / turns]);
    std::error_code none;
    if (s.skip_existing && std::filesystem::exists(file, none)) continue;
    shots.push_back({i, file});
  }
  if (const std::size_t skipped = last - first + 1 - shots.size(); skipped > 0) {
    tool.note(fmt::format("{} of {} pictures are there already", skipped, last - first + 1));
  }
  return shots;
}

void aim(tool::Tool& tool, const Settings& s, const SurfaceSample& sample, ViewHints hints,
         std::vector<AskedView>& views) {
  bool said = false;
  const std::optional<Vec3d> up_of_file = hints.up;
  for (AskedView& asked : views) {
    if (asked.known && up_of_file) asked.likely_up = *up_of_file;
    CameraOptions& view = asked.options;
    if (asked.known || !s.view.needs_guess(view)) continue;
    hints.up = view.up ? view.up : up_of_file;
    hints.up_reason = view.up ? "as given" : "as the file says";
    const std::string done = aim_camera(view, s.view, guess_view(sample, hints));
    if (!said) tool.note(done);
    if (!said) tool.report()["view"] = done;
    said = true;
  }
}

std::vector<Camera> cameras(const tool::Tool& tool, const Settings& s,
                            const std::vector<AskedView>& views, const SceneExtent& scene) {
  std::vector<Camera> all;
  bool strays_left_out = false;
  for (const AskedView& view : views) {
    const bool framed = !view.known && (!view.options.eye || !view.options.target);
    strays_left_out = strays_left_out || (framed && scene.stray > 0 && !view.options.frame_all);
    if (s.turntable > 0) {
      for (const Camera& c : turntable(view.options, scene, s.turntable)) all.push_back(c);
    } else {
      all.push_back(camera_of(view, scene));
    }
  }
  if (strays_left_out) {
    tool.note(
        fmt::format("{} stray points lie outside of the frame, far from all others; "
                    "--frame-all takes them in",
                    scene.stray));
  }
  return all;
}

double half_a_pixel(const std::vector<AskedView>& views, const Bounds& box) {
  // From within a scene its middle may be as near as can be.
  constexpr double kLeastShare = 0.05;
  if (box.empty()) return 1;
  const double size = (box.max - box.min).norm();
  double least = std::numeric_limits<double>::infinity();
  for (const AskedView& view : views) {
    const Camera camera = camera_of(view, {.box = box});
    const double z = (camera.camera_from_world * (box.center() - camera.eye)).z();
    const double distance = camera.orthographic ? 1 : std::max(z, kLeastShare * size);
    least = std::min(least, distance / std::max(camera.focal_x, camera.focal_y) / 2);
  }
  return least > 0 ? least : 1;
}

}  // namespace surfel::render_tool
