// surfel-render: pictures of surfels by EWA splatting, and the truths to measure them against.

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/base/timing.h>
#include <surfel/intake/intake.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/image_io.h>
#include <surfel/io/image_queue.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/scene_file.h>
#include <surfel/measure/view_guess.h>
#include <surfel/render/environment_map.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/sp06/methods.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/texture_source.h>
#include <surfel/truth/mesh_renderer.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/source_ewa.h>

#include "tools/support/color.h"
#include "tools/support/normal_maps.h"
#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

/// Most pictures that wait to be encoded: one while the next is drawn, and one to spare.
constexpr std::size_t kPicturesInFlight = 2;

enum class Shading { kPhong, kNone };
enum class Cull { kNone, kBack };
enum class Refractions { kScene, kSingle, kMulti };
enum class Lod { kAuto, kOn, kOff };
enum class Filter { kEwa, kEwaSource, kCircular, kNone };

struct Settings {
  std::vector<std::string> inputs;
  std::string output;
  std::string keep;
  bool print_commands = false;
  std::string camera_file;
  std::string scene_file;
  Refractions refraction = Refractions::kScene;
  surfel::CameraOptions camera;
  surfel::ViewChoice view;
  surfel::RenderOptions render;
  surfel::Method method = surfel::Method::kABuffer;
  surfel::MethodOptions method_options;
  int turntable = 0;
  bool explain = false;
  std::optional<std::array<float, 4>> background;  ///< Unset: by the picture's format.
  Shading shading = Shading::kPhong;
  Cull cull = Cull::kNone;
  Filter filter = Filter::kEwa;
  Lod lod = Lod::kAuto;
  int progressive = 1;
  bool reference = false;
  surfel::ReferenceOptions rays;
  std::optional<std::uint64_t> memory;
  std::string mesh;
  surfel::TextureSourceOptions texture;
  surfel::tool::NormalMapSettings normals;
  int bounces = 0;
};

void declare_camera(CLI::App& app, Settings& s) {
  using namespace surfel::tool;
  app.option_defaults()->group("Camera");
  add_view(app, s.camera, s.view);
  app.add_option("--near", s.camera.near, "Nothing nearer than this is drawn, scene units, >= 0");
  app.add_option(
      "--camera", s.camera_file,
      "Camera file (TOML); its keys win over the options above; [[camera]] = one view each");
  app.add_option("--turntable", s.turntable,
                 "That many pictures around the target, 1..100000; 0 = one picture");
}

void declare_kernel(CLI::App& app, Settings& s) {
  using namespace surfel::tool;
  app.option_defaults()->group("Kernel and filter");
  using surfel::Kernel;
  add_choice(
      app, "--kernel", s.render.kernel,
      {{"auto", Kernel::kAuto}, {"affine", Kernel::kAffine}, {"perspective", Kernel::kPerspective}},
      "Projection of the kernel: affine about each surfel's centre, exact, or exact where "
      "affine may be off by more than --kernel-tolerance");
  app.add_option("--kernel-tolerance", s.render.kernel_tolerance,
                 "Of --kernel auto: error on the splat's rim, pixels, > 0");
  add_choice(app, "--filter", s.filter,
             {{"ewa", Filter::kEwa},
              {"ewa-source", Filter::kEwaSource},
              {"circular", Filter::kCircular},
              {"none", Filter::kNone}},
             "Filter; the others are there to compare with: ewa-source filters in the surfels' "
             "planes, slowly, circular in all directions alike (always affine), none not at all");
  app.add_option("--cutoff", s.render.cutoff, "c: kernels end where beta >= c, 0.1..16");
  app.add_option("--lowpass", s.render.lowpass,
                 "Standard deviation of the low-pass filter, pixels, 0.1..16");
}

void declare_visibility(CLI::App& app, Settings& s) {
  using namespace surfel::tool;
  app.option_defaults()->group("Visibility and coverage");
  using surfel::Method;
  add_choice(
      app, "--method", s.method,
      {{"abuffer", Method::kABuffer},
       {"deferred", Method::kDeferred},
       {"transparent", Method::kTransparent},
       {"transparent-high", Method::kTransparentHigh},
       {"two-pass", Method::kTwoPass},
       {"depth-peel", Method::kDepthPeel}},
      "What becomes of a pixel's splats: surfaces separated in an A-buffer; for surfels with "
      "groups (surfel-group) opaque surfaces by deferred blending, and transparent ones "
      "with all layers blended alike or the nearest interpolated; opaque surfaces by a pass for "
      "depth and one for colour, to compare deferred with; or one layer after another, as a "
      "reference for the transparent ones");
  using surfel::Voronoi;
  add_choice(app, "--voronoi", s.method_options.voronoi,
             {{"off", Voronoi::kOff},
              {"quantised", Voronoi::kQuantised},
              {"windowed", Voronoi::kWindowed}},
             "Of methods with groups: how fragments of one layer are told, of which the nearest to "
             "its splat's centre stays: not at all, by steps of depth (with seams between them), "
             "or by --depth-epsilon");
  using surfel::LayersBy;
  add_choice(app, "--layers-by", s.method_options.layers_by,
             {{"surface", LayersBy::kSurface}, {"group", LayersBy::kGroup}},
             "Of methods transparent and transparent-high: what tells the layers of a pixel, the "
             "discs of all groups together, so that enlarged and added splats close holes and make "
             "no layers, or each group's splats alone, as published");
  app.add_option("--peel", s.method_options.peel, "Of --method depth-peel: most layers, 1..64");
  app.add_option("--layers", s.render.layers,
                 "Fragments per pixel of --method abuffer, deferred and two-pass, 1..64");
  app.add_option("--depth-epsilon", s.render.depth_epsilon,
                 "Surfaces within this many footprints (to beta = 1) in depth are one, > 0");
  app.add_option("--coverage-threshold", s.render.coverage_threshold,
                 "Sum of kernels that covers a pixel, > 0; default: by the cutoff");
  add_choice(app, "--cull", s.cull, {{"none", Cull::kNone}, {"back", Cull::kBack}},
             "Leave out surfels that face away: for closed, opaque surfaces");
}

void declare_levels(CLI::App& app, Settings& s) {
  using namespace surfel::tool;
  app.option_defaults()->group("Level of detail");
  add_choice(app, "--lod", s.lod, {{"auto", Lod::kAuto}, {"on", Lod::kOn}, {"off", Lod::kOff}},
             "Use the levels of detail of the file (surfel-lod), so that the time follows the "
             "pixels, not the surfels; auto: where it has them, with --method abuffer and --filter "
             "ewa; off: the finest level");
  app.add_option("--lod-error", s.render.lod_error,
                 fmt::format("Piece of surface that one surfel may stand for, pixels, 0..1000; "
                             "default: {:g} --lowpass",
                             surfel::RenderOptions::kLodError));
  app.add_option("--progressive", s.progressive,
                 "Make every picture in that many steps, 1..10, each with half the --lod-error of "
                 "the one before it, and write each over the last");
}

void declare_truth(CLI::App& app, Settings& s) {
  using namespace surfel::tool;
  app.option_defaults()->group("Truth");
  CLI::Option* reference =
      app.add_flag("--reference", s.reference,
                   "Ray-cast the surfels, slowly and exactly, instead: the truth to measure the "
                   "other pictures against (R G B A only)");
  CLI::Option* mesh = app.add_option("--mesh", s.mesh,
                                     "Ray-trace this mesh instead (OBJ, PLY, STL, OFF): the truth "
                                     "to measure surfels made from it against (R G B A only)")
                          ->excludes(reference);
  app.add_option("--image", s.texture.image,
                 "Of --mesh: image file, or checker, siemens, noise, each also as NAME:FREQUENCY; "
                 "default: the images of the mesh's materials")
      ->needs(mesh);
  add_choice(app, "--wrap", s.texture.wrap,
             {{"repeat", surfel::WrapMode::kRepeat},
              {"mirror", surfel::WrapMode::kMirror},
              {"clamp", surfel::WrapMode::kClamp}},
             "Of --mesh: what lies beyond the image's borders")
      ->needs(mesh);
  for (CLI::Option* option : add_normal_maps(app, s.normals, "Of --mesh: ")) option->needs(mesh);
  app.add_option("--samples", s.rays.samples,
                 "Of --reference and --mesh: rays along each side of a pixel, 1..64");
}

void declare_shading(CLI::App& app, Settings& s) {
  using namespace surfel::tool;
  app.option_defaults()->group("Shading");
  add_choice(app, "--shading", s.shading, {{"phong", Shading::kPhong}, {"none", Shading::kNone}},
             "none shows the filtered texture itself");
  app.add_option("--scene", s.scene_file, "Lights, materials, environment (TOML)");
  add_choice(app, "--refraction", s.refraction,
             {{"scene", Refractions::kScene},
              {"single", Refractions::kSingle},
              {"multi", Refractions::kMulti}},
             "Of --scene: rays are refracted by the nearest surface alone, or once by each; scene "
             "= as the file says");
  app.add_option("--bounces", s.bounces,
                 "Of --mesh and --scene: surfaces at which a ray is bent and mirrored one after "
                 "another, 0..32; 0 = rays go straight on, and surfaces show the environment as "
                 "surfels do");
  add_text(app, "--background", "COLOR", "auto",
           "A name such as white or navy, '#rrggbb', '#rrggbbaa', or linear R,G,B and straight "
           "alpha; auto = transparent, white where the picture's format has no alpha",
           [&s](const std::string& text) {
             s.background.reset();
             if (text != "auto") s.background = parse_color("--background", text);
           });
}

void declare_options(CLI::App& app, Settings& s) {
  using namespace surfel::tool;
  app.add_option(
      "files", s.inputs,
      "Surfels (PLY, PCD; - = standard input), meshes, which are sampled at half a pixel "
      "and textured, and raw points, which are estimated; several files are joined. With "
      "--mesh surfels only frame the picture, and may be left out");
  app.add_option("-o,--output", s.output,
                 "Picture (EXR, PNG, TIFF, JPEG, ...; several views: a pattern with %04d)")
      ->required();
  declare_camera(app, s);
  declare_kernel(app, s);
  declare_visibility(app, s);
  declare_levels(app, s);
  declare_truth(app, s);
  declare_shading(app, s);
  app.option_defaults()->group("Options");
  app.add_option("--keep", s.keep, "Surfels to write, as they were made of the files");
  app.add_flag("--print-commands", s.print_commands,
               "Write the commands that do the same, one by one, to standard output");
  app.add_flag("--explain", s.explain,
               "Say what was chosen for the (first) picture where there was a choice, and why");
  add_text(app, "--memory", "BYTES", "auto",
           "Memory for surfels and what a picture makes of them, such as 512M or 2G; a binary PLY "
           "file that needs more, in space-filling order or nearly, is read piece by piece, for "
           "each picture anew; of levels of detail only what is shown is read, and kept; auto = "
           "three quarters of what is free",
           [&s](const std::string& text) {
             s.memory.reset();
             if (text != "auto") s.memory = parse_bytes("--memory", text);
           });
}

/// The levels of detail are wanted, if the file has them.
bool wants_levels(const Settings& s) {
  const bool fast = !s.reference && s.mesh.empty() && s.filter != Filter::kEwaSource;
  if (s.lod != Lod::kAuto) return s.lod == Lod::kOn;
  return fast && s.method == surfel::Method::kABuffer && s.filter == Filter::kEwa;
}

bool blends_layers(const Settings& s) {
  return s.method == surfel::Method::kTransparent || s.method == surfel::Method::kTransparentHigh;
}

/// Levels of detail are of the fast renderer and of surfels without groups.
void check_levels(const CLI::App& app, const Settings& s) {
  const auto refuse = [&](bool wrong, const std::string& what) {
    if (wrong && s.lod == Lod::kOn) {
      surfel::throw_usage(fmt::format("--lod on has no effect with {}; leave it out", what));
    }
  };
  refuse(s.reference, "--reference");
  refuse(!s.mesh.empty(), "--mesh");
  refuse(s.filter == Filter::kEwaSource, "--filter ewa-source");
  refuse(s.render.compositing().columns().groups, "methods that need groups");
  for (const char* option : {"--lod-error", "--progressive"}) {
    if (app.get_option(option)->count() > 0 && !wants_levels(s)) {
      surfel::throw_usage(fmt::format(
          "{} needs levels of detail, which are not used here; leave it out, or see --lod",
          option));
    }
  }
}

/// Fills in fields of the library's options that the command line has in other types.
void finish(Settings& s) {
  s.render.method = surfel::compositing_method(s.method, s.method_options);
  s.render.lit = s.shading == Shading::kPhong;
  s.texture.charts = false;
  s.normals.maps.charts = false;
  s.normals.maps.wrap = s.texture.wrap;
  s.render.cull_back = s.cull == Cull::kBack;
  s.render.aovs = surfel::tool::lower_extension(s.output) == ".exr" && !blends_layers(s);
  constexpr std::array<float, 4> kWhite{1, 1, 1, 1};
  if (s.background) {
    s.render.background = *s.background;
  } else if (!surfel::image_format_has_alpha(s.output)) {
    s.render.background = kWhite;
  }
  if (s.filter == Filter::kCircular) s.render.filter = surfel::Filter::kCircular;
  if (s.filter == Filter::kNone) s.render.filter = surfel::Filter::kNone;
}

/// Refuses options that the chosen renderer or method does not heed.
void require_effect(const CLI::App& app, const Settings& s) {
  const auto refuse = [&](const std::string& renderer, const std::vector<std::string>& options) {
    surfel::tool::require_valid(surfel::tool::without_effect(app, options, "with " + renderer));
  };
  const auto refuse_fast = [&](const std::string& renderer, std::vector<std::string> options) {
    for (const char* option : {"--kernel", "--kernel-tolerance", "--layers", "--method",
                               "--voronoi", "--layers-by", "--peel", "--explain"}) {
      options.emplace_back(option);
    }
    refuse(renderer, options);
  };
  if (s.reference) refuse_fast("--reference", {"--filter"});
  if (s.filter == Filter::kEwaSource) refuse_fast("--filter ewa-source", {});
  static const std::map<surfel::Method, std::pair<const char*, std::vector<std::string>>> kMethods{
      {surfel::Method::kABuffer, {"abuffer", {"--voronoi", "--layers-by", "--peel"}}},
      {surfel::Method::kDeferred, {"deferred", {"--layers-by", "--peel"}}},
      {surfel::Method::kTransparent, {"transparent", {"--peel", "--layers"}}},
      {surfel::Method::kTransparentHigh, {"transparent-high", {"--peel", "--layers"}}},
      {surfel::Method::kTwoPass, {"two-pass", {"--voronoi", "--layers-by", "--peel"}}},
      {surfel::Method::kDepthPeel, {"depth-peel", {"--voronoi", "--layers-by", "--layers"}}}};
  const auto& [method, unheeded] = kMethods.at(s.method);
  refuse(std::string("--method ") + method, unheeded);
  if (s.method == surfel::Method::kTransparent &&
      s.method_options.layers_by == surfel::LayersBy::kGroup) {
    // Layers that each group tells by itself are discs, without kernels.
    refuse("--method transparent", {"--lowpass", "--coverage-threshold"});
  }
  if (!s.mesh.empty()) {
    refuse_fast("--mesh", {"--filter", "--cutoff", "--depth-epsilon", "--coverage-threshold"});
  } else if (s.inputs.empty()) {
    surfel::throw_usage("there are neither surfels nor --mesh; give one");
  }
  if (s.inputs.empty()) {
    refuse("--mesh without surfels", {"--memory", "--keep", "--print-commands"});
  }
  if (s.scene_file.empty()) refuse("the default scene", {"--refraction", "--bounces"});
  if (!s.render.lit) {
    refuse("--shading none", {"--refraction", "--bounces"});
    refuse("--shading none", surfel::tool::normal_map_options());
  }
  if (s.mesh.empty()) refuse("surfels", {"--bounces"});
  if (s.bounces > 0) refuse("--bounces", {"--refraction"});
  if (!s.reference && s.mesh.empty()) refuse("the fast renderer", {"--samples"});
}

void check(const Settings& s) {
  if (s.print_commands && s.output == "-") {
    surfel::throw_usage("--print-commands and --output - both write to standard output");
  }
  if (s.inputs.size() > 1 && std::count(s.inputs.begin(), s.inputs.end(), "-") > 0) {
    surfel::throw_usage("standard input (-) does not go together with other files");
  }
  std::vector<std::string> problems = s.camera.problems();
  surfel::tool::append(problems, s.render.problems());
  surfel::tool::append(problems, s.rays.problems());
  surfel::tool::append(problems, s.normals.maps.problems());
  if (s.progressive < 1 || s.progressive > 10) {
    problems.push_back(fmt::format("--progressive is {}; it must be in 1..10", s.progressive));
  }
  if (s.progressive > 1 && s.output == "-") {
    problems.emplace_back("--progressive writes its steps over one another; give --output a file");
  }
  if (s.turntable < 0 || s.turntable > 100000) {
    problems.push_back(fmt::format("--turntable is {}; it must be in 0..100000", s.turntable));
  }
  surfel::tool::require_valid(problems);
}

/// The scene with its environment, which pictures without shading do without.
surfel::Scene load_scene(surfel::tool::Tool& tool, const Settings& s) {
  if (s.scene_file.empty()) return {};
  surfel::Scene scene = surfel::read_scene(s.scene_file);
  if (s.refraction == Refractions::kSingle) scene.refraction = surfel::Refraction::kSingle;
  if (s.refraction == Refractions::kMulti) scene.refraction = surfel::Refraction::kMulti;
  if (scene.environment) {
    tool.files().read_also("the environment map", scene.environment->image);
  }
  if (s.render.lit) surfel::load_environment(scene);
  return scene;
}

/// Makes a picture. `progress` is called with the share of it that is done, where it takes long.
using Paint =
    std::function<surfel::Image(const surfel::Camera& camera, surfel::FrameStatistics& statistics,
                                const std::function<void(double)>& progress)>;

/// Makes pictures by a slow renderer, which tells its progress.
template <class Renderer>
Paint paint_slowly(std::shared_ptr<Renderer> renderer) {
  return [renderer](const surfel::Camera& camera, surfel::FrameStatistics& statistics,
                    const std::function<void(double)>& progress) {
    const surfel::Timer timer;
    surfel::Image image = renderer->render(camera, progress);
    statistics.milliseconds = timer.milliseconds();
    return image;
  };
}

/// The renderer of surfels that the settings choose, with these options.
Paint surfel_painter(const Settings& s, const surfel::RenderOptions& options,
                     const surfel::LoadedCloud& loaded, const surfel::Scene& scene) {
  const surfel::RenderCloud& surfels = loaded.surfels();
  if (s.reference) {
    return paint_slowly(
        std::make_shared<surfel::ReferenceRenderer>(surfels, scene, options, s.rays));
  }
  if (s.filter == Filter::kEwaSource) {
    return paint_slowly(std::make_shared<surfel::SourceEwaRenderer>(surfels, scene, options));
  }
  const auto renderer = std::make_shared<surfel::Renderer>(loaded.store(), scene, options);
  return [renderer](const surfel::Camera& camera, surfel::FrameStatistics& statistics,
                    const std::function<void(double)>&) {
    return renderer->render(camera, &statistics);
  };
}

/// The renderers of a picture's steps, coarsest first.
std::vector<Paint> surfel_steps(const Settings& s, const surfel::LoadedCloud& surfels,
                                const surfel::Scene& scene) {
  std::vector<Paint> steps;
  for (int step = s.progressive - 1; step > 0; --step) {
    surfel::RenderOptions coarse = s.render;
    coarse.lod_error = std::min(1000.0, s.render.lod_pixels() * std::exp2(step));
    steps.push_back(surfel_painter(s, coarse, surfels, scene));
  }
  steps.push_back(surfel_painter(s, s.render, surfels, scene));
  return steps;
}

/// A mesh with its textures, and its renderer.
struct MeshPainter {
  surfel::TriangleMesh mesh;
  std::optional<surfel::TextureSet> textures;
  std::optional<surfel::NormalMaps> normals;
  std::shared_ptr<surfel::MeshRenderer> renderer;  ///< Refers to all three.

  MeshPainter(const MeshPainter&) = delete;
  MeshPainter& operator=(const MeshPainter&) = delete;
  MeshPainter(const CLI::App& app, const Settings& s, const surfel::Scene& scene)
      : mesh(surfel::read_mesh(s.mesh)) {
    const bool named = std::any_of(mesh.material.begin(), mesh.material.end(),
                                   [](const auto& m) { return !m.texture.empty(); });
    if (!s.texture.image.empty() || named) {
      textures = surfel::load_textures(s.texture, &mesh, s.mesh);
    }
    if (s.render.lit) {
      normals = surfel::tool::load_normal_maps(app, s.normals, &mesh, s.mesh);
    }
    renderer = std::make_shared<surfel::MeshRenderer>(
        mesh, textures ? &*textures : nullptr, scene,
        surfel::MeshRenderOptions{.samples = s.rays.samples,
                                  .lowpass = s.render.lowpass,
                                  .cull_back = s.render.cull_back,
                                  .lit = s.render.lit,
                                  .bounces = s.bounces,
                                  .background = s.render.background,
                                  .normal_maps = normals ? &*normals : nullptr});
  }
};

/// Name of the i-th picture: the pattern's %d or %04d replaced.
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

/// The cameras as they are asked for.
std::vector<surfel::CameraOptions> asked_views(const Settings& s) {
  if (s.camera_file.empty()) return {s.camera};
  return surfel::read_cameras(s.camera_file, s.camera);
}

/// Is a guess needed for one of them?
bool needs_guess(const Settings& s, const std::vector<surfel::CameraOptions>& views) {
  return std::any_of(views.begin(), views.end(),
                     [&](const auto& view) { return s.view.needs_guess(view); });
}

/// Completes the views by guesses, and says the first.
void aim(surfel::tool::Tool& tool, const Settings& s, const surfel::SurfaceSample& sample,
         surfel::ViewHints hints, std::vector<surfel::CameraOptions>& views) {
  bool said = false;
  const std::optional<surfel::Vec3d> up_of_file = hints.up;
  for (surfel::CameraOptions& view : views) {
    if (!s.view.needs_guess(view)) continue;
    hints.up = view.up ? view.up : up_of_file;
    hints.up_reason = view.up ? "as given" : "as the file says";
    const std::string done = surfel::aim_camera(view, s.view, surfel::guess_view(sample, hints));
    if (!said) tool.note(done);
    if (!said) tool.report()["view"] = done;
    said = true;
  }
}

/// The cameras to render from.
std::vector<surfel::Camera> cameras(const surfel::tool::Tool& tool, const Settings& s,
                                    const std::vector<surfel::CameraOptions>& views,
                                    const surfel::SceneExtent& scene) {
  std::vector<surfel::Camera> all;
  bool strays_left_out = false;
  for (const surfel::CameraOptions& view : views) {
    const bool framed = !view.eye || !view.target;
    strays_left_out = strays_left_out || (framed && scene.stray > 0 && !view.frame_all);
    if (s.turntable > 0) {
      for (const surfel::Camera& c : surfel::turntable(view, scene, s.turntable)) all.push_back(c);
    } else {
      all.push_back(surfel::make_camera(view, scene));
    }
  }
  if (all.size() > 1 && !is_pattern(s.output)) {
    surfel::throw_usage(
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

nlohmann::json to_json(const surfel::FrameStatistics& frame) {
  nlohmann::json json = {{"ms", frame.milliseconds},
                         {"stages", nlohmann::json::object()},
                         {"clusters", frame.clusters},
                         {"splats", frame.splats},
                         {"exact_splats", frame.exact_splats},
                         {"geometry_passes", frame.geometry_passes},
                         {"fragments", frame.fragments},
                         {"merged_fragments", frame.merged},
                         {"late_weight_share", frame.late_weight_share},
                         {"groups", frame.groups},
                         {"culled_fragments", frame.culled},
                         {"peeled_layers", frame.peeled_layers},
                         {"unpeeled_pixels", frame.unpeeled_pixels}};
  surfel::tool::add_stages(json, frame.stages);
  return json;
}

/// Half a pixel of the pictures that are asked for, scene units in the middle of what is seen: the
/// least of them.
double half_a_pixel(const std::vector<surfel::CameraOptions>& views, const surfel::Bounds& box) {
  // From within a scene its middle may be as near as can be.
  constexpr double kLeastShare = 0.05;
  if (box.empty()) return 1;
  const double size = (box.max - box.min).norm();
  double least = std::numeric_limits<double>::infinity();
  for (const surfel::CameraOptions& view : views) {
    const surfel::Camera camera = surfel::make_camera(view, {.box = box});
    const double z = (camera.camera_from_world * (box.center() - camera.eye)).z();
    const double distance = camera.orthographic ? 1 : std::max(z, kLeastShare * size);
    least = std::min(least, distance / std::max(camera.focal_x, camera.focal_y) / 2);
  }
  return least > 0 ? least : 1;
}

/// The surfels of the files, made where they are no surfels yet.
std::unique_ptr<surfel::LoadedCloud> load_files(surfel::tool::Tool& tool, const Settings& s,
                                                const std::vector<surfel::CameraOptions>& views,
                                                const surfel::CloudLoadOptions& options) {
  const std::string& first = s.inputs.front();
  std::vector<std::string> commands;
  std::string file = first;
  std::unique_ptr<surfel::LoadedCloud> loaded;
  if (s.inputs.size() == 1 && s.keep.empty() && (first == "-" || surfel::holds_surfels(first))) {
    loaded = std::make_unique<surfel::LoadedCloud>(first, options);
  } else {
    surfel::Intake intake(s.inputs);
    surfel::Intake::Made made = intake.surfels(half_a_pixel(views, intake.bounds()));
    for (const std::string& line : made.done) tool.note(line);
    commands = std::move(made.commands);
    file = made.file;
    loaded =
        std::make_unique<surfel::LoadedCloud>(made.cloud, surfel::tool::shown_name(file), options);
    if (!s.keep.empty()) surfel::tool::write_result(tool, made.cloud, s.keep);
  }
  if (s.print_commands) {
    commands.push_back("surfel-render " + surfel::shell_file(file) +
                       tool.options_given({"keep", "print-commands"}));
    surfel::tool::print(fmt::format("{}\n", fmt::join(commands, "\n")));
  }
  return loaded;
}

/// Reads and prepares surfels, and tells how many of them cannot be used.
std::unique_ptr<surfel::LoadedCloud> load_surfels(surfel::tool::Tool& tool, const Settings& s,
                                                  const std::vector<surfel::CameraOptions>& views) {
  const std::string name = surfel::tool::shown_name(s.inputs.front());
  surfel::CloudLoadOptions options{.columns = s.render.compositing().columns(),
                                   .memory = s.memory,
                                   .may_stream = s.method == surfel::Method::kABuffer &&
                                                 !s.reference && s.filter != Filter::kEwaSource,
                                   .batch = s.render.batch,
                                   .sample = needs_guess(s, views)};
  options.columns.levels = wants_levels(s);
  auto loaded = load_files(tool, s, views, options);
  if (!loaded->has_levels() && (s.lod == Lod::kOn || s.render.lod_error || s.progressive > 1)) {
    surfel::throw_input(name, "has no levels of detail; run surfel-lod on it");
  }
  if (loaded->basis_cutoff() && *loaded->basis_cutoff() != s.render.cutoff) {
    tool.note(fmt::format("{}: the coefficients were fitted for --cutoff {:g}, not {:g}", name,
                          *loaded->basis_cutoff(), s.render.cutoff));
  }
  surfel::tool::tell_left_out(tool, name, loaded->surfels().dropped());
  if (!loaded->store().resident() && loaded->surfels().tree().empty()) {
    tool.note(fmt::format("{}: more than fits into --memory; read piece by piece for each picture",
                          name));
  }
  return loaded;
}

/// Tells where a picture is incomplete.
void warn(const surfel::tool::Tool& tool, const Settings& s, std::size_t picture,
          const surfel::FrameStatistics& frame) {
  if (frame.unpeeled_pixels == 0) return;
  tool.note(
      fmt::format("picture {}: {} pixels have more than --peel {} layers; what is behind is "
                  "left out",
                  picture, frame.unpeeled_pixels, s.method_options.peel));
}

/// Tells the choices that were made for a picture, and why.
void explain(const surfel::tool::Tool& tool, const Settings& s, const surfel::LoadedCloud& loaded,
             const surfel::Camera& camera, const surfel::FrameStatistics& frame) {
  const surfel::RenderCloud& cloud = loaded.surfels();
  const surfel::RenderOptions& o = s.render;
  const auto say = [&](const std::string& what, const std::string& choice) {
    tool.note(fmt::format("{}: {}", what, choice));
  };
  say("memory", loaded.store().resident() ? "all surfels are kept"
                : cloud.tree().empty() ? "read piece by piece: the surfels are more than --memory"
                                       : "what each picture wants is read from the file");
  if (cloud.tree().empty()) {
    say("level of detail",
        !loaded.has_levels()
            ? fmt::format("none in the file; {} surfels drawn on {}x{} pixels (surfel-lod pays "
                          "where they are many times the pixels)",
                          frame.splats, camera.width, camera.height)
            : "off: the finest level alone");
  } else {
    say("level of detail",
        fmt::format("{} surfels drawn of {}: one may stand for {:g} pixels (--lod-error)",
                    frame.splats, cloud.size() - cloud.first_finest(), o.lod_pixels()));
  }
  if (o.kernel == surfel::Kernel::kAuto && o.filter != surfel::Filter::kCircular) {
    say("kernel", fmt::format("exact for {} of {} surfels, whose affine kernels may be off by more "
                              "than {:g} pixels (--kernel-tolerance); affine for the others",
                              frame.exact_splats, frame.splats, o.kernel_tolerance));
  }
  say("shape", cloud.anisotropic() ? "ellipses: some surfels have two variances"
                                   : "discs: no surfel has two variances");
  say("opacity",
      cloud.transparent() ? "some surfels have alpha below 1" : "no surfel has alpha below 1");
  say("normals", o.lit    ? "kept, to shade with"
                 : o.aovs ? "kept, for the picture's channels"
                          : "left out: nothing is shaded");
  if (cloud.groups() > 0 && o.compositing().columns().groups) {
    say("groups", fmt::format("{} in the file", cloud.groups()));
  }
  if (s.method != surfel::Method::kABuffer) return;
  say("layers",
      fmt::format("{} (--layers): {} times two surfaces were merged for want of one, after which "
                  "{:.1e} of the kernels came too late for theirs",
                  o.layers, frame.merged, frame.late_weight_share));
}

/// The command line with "-o" before a picture that follows a file, where no output is named:
/// "surfel-render a.ply a.png".
std::vector<char*> with_output(int argc, char** argv) {
  static std::string option = "-o";
  std::vector<char*> words(argv, argv + argc);
  const auto starts = [](const char* word, const char* with) {
    return std::string_view(word).starts_with(with);
  };
  const bool named = std::any_of(words.begin(), words.end(), [&](const char* word) {
    return starts(word, "-o") || starts(word, "--output") || starts(word, "--config");
  });
  for (std::size_t i = 2; i < words.size() && !named; ++i) {
    // After an option the picture may be that option's value.
    if (!surfel::is_image_name(words[i]) || starts(words[i - 1], "-")) continue;
    words.insert(words.begin() + static_cast<std::ptrdiff_t>(i), option.data());
    break;
  }
  return words;
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-render",
                          "Renders surfels by screen space EWA splatting (Zwicker et al. 2001).");
  Settings s;
  declare_options(tool.app(), s);
  tool.everyday(
      {"--output", "--size", "--from", "--eye", "--target", "--fov", "--zoom", "--turntable",
       "--background", "--scene", "--shading", "--explain"},
      {"surfel-render lion.obj -o lion.png",
       "surfel-render lion.ply -o lion.jpg --from 1,0.5,2 --size 800x600 --background navy",
       "surfel-render lion.ply -o lion_%04d.png --turntable 36 --size 512"});
  tool.files().reads(
      {"files", "--camera", "--scene", "--mesh", "--image", "--normal-map", "--bump"});
  tool.files().writes("--output", surfel::tool::Writes::kPicture);
  tool.files().writes("--keep", surfel::tool::Writes::kSurfels);
  tool.name_fields({{"y_down", "--normal-y"}});
  std::vector<char*> words = with_output(argc, argv);
  return tool.run(static_cast<int>(words.size()), words.data(), [&] {
    finish(s);
    require_effect(tool.app(), s);
    check_levels(tool.app(), s);
    check(s);
    const surfel::Scene scene = load_scene(tool, s);

    nlohmann::json& report = tool.report();
    const surfel::Timer load;
    std::unique_ptr<surfel::LoadedCloud> loaded;
    std::vector<surfel::CameraOptions> asked = asked_views(s);
    if (!s.inputs.empty()) loaded = load_surfels(tool, s, asked);
    const surfel::RenderCloud* surfels = loaded ? &loaded->surfels() : nullptr;
    std::optional<MeshPainter> mesh;
    if (!s.mesh.empty()) {
      mesh.emplace(tool.app(), s, scene);
      for (const surfel::MeshMaterial& material : mesh->mesh.material) {
        for (const std::string& map : {material.texture, material.normal_map, material.bump_map}) {
          tool.files().read_also("the mesh's image", map);
        }
      }
    }
    const surfel::SceneExtent extent = surfels ? surfels->extent() : mesh->renderer->extent();
    const std::vector<Paint> steps =
        mesh ? std::vector{paint_slowly(mesh->renderer)} : surfel_steps(s, *loaded, scene);
    report["load_ms"] = load.milliseconds();
    report["surfels"] = surfels ? surfels->size() : 0;
    report["levels"] = surfels && !surfels->tree().empty() ? surfels->tree().front().level + 1 : 1;
    report["dropped"] = surfels ? surfels->dropped().total() : 0;
    report["copies_left_out"] = surfels ? surfels->copies() : 0;
    report["streamed"] = loaded && !loaded->store().resident();
    report["stray_points"] = extent.stray;
    report["faces"] = mesh ? mesh->mesh.face.size() : 0;
    if (loaded) {
      aim(tool, s, loaded->sample(), {.up = loaded->up(), .viewpoint = loaded->viewpoint()}, asked);
    } else if (needs_guess(s, asked)) {
      aim(tool, s, surfel::sample_surface(mesh->mesh), {}, asked);
    }
    const std::vector<surfel::Camera> views = cameras(tool, s, asked, extent);
    if (is_pattern(s.output)) {
      for (std::size_t i = 0; i < views.size(); ++i) {
        tool.files().write_also("--output", picture_name(s.output, i));
      }
    }
    const std::size_t pictures = views.size() * steps.size();
    // Kept apart from the report until all are written: the writer adds to them.
    std::vector<nlohmann::json> frames(pictures);
    surfel::ImageQueue queue(pictures > 1 ? kPicturesInFlight : 0);
    for (std::size_t i = 0; i < pictures; ++i) {
      const std::size_t view = i / steps.size();
      const std::size_t step = i % steps.size();
      surfel::FrameStatistics frame;
      const auto progress = [&](double share) {
        tool.progress("rendering",
                      (static_cast<double>(i) + share) / static_cast<double>(pictures));
      };
      surfel::Image image = steps[step](views[view], frame, progress);
      warn(tool, s, view, frame);
      if (s.explain && view == 0 && step + 1 == steps.size()) {
        explain(tool, s, *loaded, views[view], frame);
      }
      frames[i] = to_json(frame);
      // Only the first step must find no file: the others find its.
      queue.write(std::move(image), is_pattern(s.output) ? picture_name(s.output, view) : s.output,
                  {.no_clobber = tool.common().no_clobber && step == 0,
                   .metadata = {{"Software", "surfel-render"}},
                   .world_to_camera = surfel::world_to_camera_matrix(views[view])});
      progress(1);
    }
    queue.finish();
    for (std::size_t i = 0; i < pictures; ++i) {
      frames[i]["encode_ms"] = queue.milliseconds()[i];
    }
    report["frames"] = std::move(frames);
  });
}
