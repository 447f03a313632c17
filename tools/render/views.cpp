#include "tools/render/views.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/view_file.h>
#include <surfel/scene/camera_path.h>
#include <surfel/scene/map_place.h>
#include <surfel/scene/view.h>

#include "tools/render/made_by.h"

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

/// When a path is at a view: as the view says, else a second after the one before it.
double time_of(const AskedView& view, std::size_t number) {
  const std::optional<double> time = view.known ? view.known->time : view.options.time;
  return time.value_or(static_cast<double>(number));
}

/// Number of the pictures of a path.
std::size_t path_pictures(const Settings& s, const std::vector<AskedView>& views) {
  if (s.path_pictures > 0) return static_cast<std::size_t>(s.path_pictures);
  constexpr double kMost = 1e6;
  const double seconds = time_of(views.back(), views.size() - 1) - time_of(views.front(), 0);
  const double count = std::round(seconds * s.fps) + 1;
  if (!(count >= 2 && count <= kMost)) {
    throw_usage(
        fmt::format("--path takes {:g} seconds, at --fps {:g} {:.0f} pictures, which must "
                    "be 2 to 1000000; give --path-pictures",
                    seconds, s.fps, count));
  }
  return static_cast<std::size_t>(count);
}

/// The views of a path's pictures.
std::vector<View> along_path(const Settings& s, const std::vector<AskedView>& asked,
                             const std::vector<View>& views) {
  std::vector<PathKey> keys;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].lens) {
      throw_usage(
          "--path is flown along by cameras without distortion; see colmap "
          "image_undistorter, or leave out --projection");
    }
    PathKey& key = keys.emplace_back();
    key.time = time_of(asked[i], i);
    key.camera = views[i].camera;
    if (!asked[i].known) key.target = asked[i].options.target;
    key.up = asked[i].options.up_or_y();
  }
  if (const std::vector<std::string> problems = path_problems(keys); !problems.empty()) {
    throw_input(s.camera_file.empty() ? s.views_file : s.camera_file, problems.front());
  }
  std::vector<View> all;
  for (const Camera& camera : camera_path(keys, path_pictures(s, asked), s.ease)) {
    all.push_back({views.front().name, camera});
  }
  return all;
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
    AskedView& added = asked.emplace_back(AskedView{o, view, up});
    added.options.name = view.name;
  }
  return asked;
}

/// Makes the horizon of a panorama level: its middle lies on it, towards the target, or, where
/// there is none, along -z, along y where z is up.
void level(CameraOptions& view) {
  if (!view.eye) {
    throw_usage("--projection equirectangular needs the place that all is seen from: give an eye");
  }
  if (view.ortho || view.frame_all) {
    throw_usage("ortho and frame-all do not go with --projection equirectangular; leave them out");
  }
  const Vec3d up = view.up_or_y().normalized();
  Vec3d ahead = view.target              ? Vec3d(*view.target - *view.eye)
                : std::abs(up.z()) > 0.5 ? Vec3d(0, 1, 0)
                                         : Vec3d(0, 0, -1);
  ahead -= ahead.dot(up) * up;
  if (!(ahead.norm() > 1e-9 * (1 + view.eye->norm()))) ahead = up.unitOrthogonal();
  view.target = *view.eye + ahead.normalized() * (1 + view.eye->norm());
}

/// The same view, of all directions.
View panorama(View view) {
  view.lens.emplace().model = Lens::Model::kEquirectangular;
  return view;
}

/// Names for the files of the views' pictures.
std::vector<std::string> names_of(const std::vector<AskedView>& asked) {
  std::vector<View> views;
  for (const AskedView& view : asked) views.push_back({view.options.name, {}});
  return file_names(views);
}

Camera camera_of(const AskedView& view, const SceneExtent& scene) {
  return view.known ? view.known->camera : make_camera(view.options, scene);
}

}  // namespace

bool is_pattern(const std::string& name) {
  return has_number(name) || name.find(kName) != std::string::npos;
}

std::vector<AskedView> asked_views(const Settings& s) {
  if (!s.views_file.empty()) return known_views(s);
  std::vector<CameraOptions> cameras{s.camera};
  if (s.map) {
    // Stands for the map's camera, whose pixels it has, until the scene's extent is known.
    cameras[0].from = Vec3d(0, 0, 1);
    cameras[0].up = Vec3d(0, 1, 0);
    cameras[0].ortho = *s.map * cameras[0].height;
  }
  if (!s.camera_file.empty()) cameras = read_cameras(s.camera_file, s.camera);
  std::vector<AskedView> asked;
  for (CameraOptions& camera : cameras) {
    if (s.projection == Projection::kEquirectangular) level(camera);
    asked.push_back({camera, {}});
  }
  return asked;
}

bool needs_guess(const Settings& s, const std::vector<AskedView>& views) {
  return std::any_of(views.begin(), views.end(), [&](const AskedView& view) {
    return !view.known && s.view.needs_guess(view.options);
  });
}

std::vector<Shot> asked_shots(const tool::Tool& tool, const Settings& s, const std::string& output,
                              const std::vector<AskedView>& views) {
  const std::size_t turns = s.turntable > 0 ? static_cast<std::size_t>(s.turntable) : 1;
  const std::size_t count = s.path ? path_pictures(s, views) : views.size() * turns;
  const std::size_t first = s.frames ? (*s.frames)[0] : 0;
  const std::size_t last = s.frames ? (*s.frames)[1] : count - 1;
  if (last >= count) {
    throw_usage(
        fmt::format("--frames is {}-{} but the last picture is {}", first, last, count - 1));
  }
  const bool named = output.find(kName) != std::string::npos;
  if (named && (turns > 1 || s.path) && !has_number(output)) {
    throw_usage(
        fmt::format("--output is \"{}\" but several pictures have the same name; give a "
                    "pattern such as {{name}}_%04d.png",
                    output));
  }
  if (first != last && !is_pattern(output)) {
    throw_usage(
        fmt::format("--output is \"{}\" but there are {} views; give a pattern such "
                    "as view_%04d.png",
                    output, last - first + 1));
  }
  const std::vector<std::string> names = names_of(views);
  std::vector<Shot> shots;
  for (std::size_t i = first; i <= last; ++i) {
    // Films are joined from pictures that are numbered from 0 on.
    const std::size_t number = wants_film(s) ? i - first : i;
    const std::string file = picture_name(output, number, names[s.path ? 0 : i / turns]);
    const bool there = s.skip_existing && (s.tiles ? part_is_there(file, *s.tiles, s.made_by)
                                                   : is_marked(file, made_by_mark(s, i)));
    if (there) continue;
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
  const char* const reason_of_file = hints.up_reason;
  for (AskedView& asked : views) {
    if (asked.known && up_of_file) asked.likely_up = *up_of_file;
    CameraOptions& view = asked.options;
    if (asked.known || !s.view.needs_guess(view)) continue;
    hints.up = view.up ? view.up : up_of_file;
    hints.up_reason = view.up ? "as given" : reason_of_file;
    const std::string done = aim_camera(view, s.view, guess_view(sample, hints));
    if (s.projection == Projection::kEquirectangular) level(view);
    if (!said) tool.note(done);
    if (!said) tool.report()["view"] = done;
    said = true;
  }
}

std::vector<View> complete_views(const tool::Tool& tool, const Settings& s,
                                 const std::vector<AskedView>& views, const SceneExtent& scene) {
  std::vector<View> all;
  all.reserve(views.size() * static_cast<std::size_t>(std::max(s.turntable, 1)));
  bool strays_left_out = false;
  for (const AskedView& view : views) {
    const bool framed = !view.known && (!view.options.eye || !view.options.target);
    strays_left_out = strays_left_out || (framed && scene.stray > 0 && !view.options.frame_all);
    if (s.map) {
      all.push_back({"map", map_camera(framed_extent(view.options, scene).box, *s.map)});
    } else if (s.turntable > 0) {
      for (const Camera& camera : turntable(view.options, scene, s.turntable)) {
        all.push_back({view.options.name, camera});
      }
    } else {
      all.push_back(view.known ? *view.known
                               : View{view.options.name, make_camera(view.options, scene)});
    }
    if (s.projection == Projection::kEquirectangular) all.back() = panorama(all.back());
  }
  if (strays_left_out) {
    tool.note(
        fmt::format("{} stray points lie outside of the frame, far from all others; "
                    "--frame-all takes them in",
                    scene.stray));
  }
  return s.path ? along_path(s, views, all) : std::move(all);
}

/// From within a scene its middle, or its surface, may be as near as can be.
constexpr double kLeastShare = 0.05;

double nearest_share(const std::vector<AskedView>& views, const Bounds& box) {
  double least = 1;
  for (const AskedView& view : views) {
    const Camera camera = camera_of(view, {.box = box});
    if (box.empty() || camera.orthographic) continue;
    const Vec3d along = camera.camera_from_world.row(2).transpose();
    const double middle = along.dot(box.center() - camera.eye);
    const double half = along.cwiseAbs().dot(box.max - box.min) / 2;
    least = std::min(least, std::max(kLeastShare, 1 - half / std::max(middle, half)));
  }
  return least;
}

double half_a_pixel(const std::vector<AskedView>& views, const Bounds& box) {
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
