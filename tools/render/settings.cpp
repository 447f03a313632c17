#include "tools/render/settings.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/gaussian/gaussian_cut.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/coordinate_system.h>
#include <surfel/store/attribute_values.h>

#include "tools/render/views.h"
#include "tools/support/color.h"
#include "tools/support/movie.h"
#include "tools/support/options.h"
#include "tools/support/tool.h"

namespace surfel::render_tool {

namespace {

void declare_camera(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Camera");
  add_view(app, s.camera, s.view);
  app.add_option("--near", s.camera.near, "Nothing nearer than this is drawn, scene units, >= 0");
  app.add_option(
      "--camera", s.camera_file,
      "Camera file (TOML); its keys win over the options above; [[camera]] = one view each");
  app.add_option("--views", s.views_file,
                 "Views to make pictures of: a folder that COLMAP wrote, a transforms.json (NeRF, "
                 "nerfstudio, instant-ngp), JSON of intrinsics and poses, or a camera file; --size "
                 "scales their pictures, --up says where a sky is");
  app.add_flag("--original-world", s.original_world,
               "Of --views: undo the applied_transform of a transforms.json");
  add_choice(app, "--projection", s.projection,
             {{"pinhole", Projection::kPinhole}, {"equirectangular", Projection::kEquirectangular}},
             "What the picture shows: what a pinhole sees, or, 360 by 180 degrees, all around the "
             "--eye, twice as wide as high (--ortho: neither)");
  app.add_option("--turntable", s.turntable,
                 "That many pictures around the target, 1..100000; 0 = one picture");
  add_text(app, "--path", "FILE", "",
           "Key frames to fly along, in any file that --views takes; in a camera file and in JSON "
           "they may have a time, in seconds, else they are a second apart",
           [&s](const std::string& text) {
             s.views_file = text;
             s.path = true;
           })
      ->excludes(app.get_option("--views"));
  app.add_option("--path-pictures", s.path_pictures,
                 "Of --path: that many pictures, 2..1000000; 0 = by time and --fps");
  add_choice(app, "--ease", s.ease,
             {{"none", PathEase::kNone},
              {"in", PathEase::kIn},
              {"out", PathEase::kOut},
              {"both", PathEase::kBoth}},
             "Of --path: begin at rest, come to rest, or both");
  app.add_option("--fps", s.fps, "Pictures a second of films, and of --path, 0.1..1000");
  app.add_option("--map", s.map,
                 "Map of all that there is from above, z up: pixels of that many scene units, > 0, "
                 "at multiples of it; a world file is written beside the picture, and TIFF gets "
                 "the tags of GeoTIFF");
  app.add_option("--epsg", s.epsg,
                 "Of --map: code of the coordinate system that GeoTIFF gets, 1024..32766; default: "
                 "as the files say, LAS and what was made of it");
  add_text(app, "--frames", "A-B", "",
           "Of several pictures those from number A to number B, the first of which is 0",
           [&s](const std::string& text) { s.frames = parse_range("--frames", text); });
  app.add_flag("--skip-existing", s.skip_existing,
               "Leave pictures alone that the same command made of files of the same content; "
               "other pictures "
               "of their names are refused, parts of pictures made again");
  add_text(app, "--tiles", "I/N", "",
           "The I-th of N parts of each picture, 1 the uppermost, as EXR: surfel-join makes one "
           "picture of all parts, which has the bytes that it has when it is made in one",
           [&s](const std::string& text) { s.tiles = parse_part("--tiles", text); });
}

void declare_kernel(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Kernel and filter");
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

void declare_visibility(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Visibility and coverage");
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
  add_choice(app, "--voronoi", s.method_options.voronoi,
             {{"off", Voronoi::kOff},
              {"quantised", Voronoi::kQuantised},
              {"windowed", Voronoi::kWindowed}},
             "Of methods with groups: how fragments of one layer are told, of which the nearest to "
             "its splat's centre stays: not at all, by steps of depth (with seams between them), "
             "or by --depth-epsilon");
  add_choice(app, "--layers-by", s.method_options.layers_by,
             {{"surface", LayersBy::kSurface}, {"group", LayersBy::kGroup}},
             "Of methods transparent and transparent-high: what tells the layers of a pixel, the "
             "discs of all groups together, so that enlarged and added splats close holes and make "
             "no layers, or each group's splats alone, as published");
  app.add_option("--peel", s.method_options.peel, "Of --method depth-peel: most layers, 1..64");
  app.add_option("--layers", s.render.layers,
                 "Fragments per pixel of --method abuffer, deferred and two-pass, 1..64");
  app.add_option(
      "--depth-epsilon", s.render.depth_epsilon,
      "Surfaces within this many footprints (to beta = 1) in depth are one, 1e-6..1e6; flat and "
      "transparent ones: within half as many");
  app.add_option("--coverage-threshold", s.render.coverage_threshold,
                 "Sum of kernels that covers a pixel, 1e-12..1000; default: by the cutoff");
  add_choice(app, "--cull", s.cull, {{"none", Cull::kNone}, {"back", Cull::kBack}},
             "Leave out surfels that face away: for closed, opaque surfaces");
}

void declare_levels(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Level of detail");
  add_choice(app, "--lod", s.lod, {{"auto", Lod::kAuto}, {"on", Lod::kOn}, {"off", Lod::kOff}},
             "Use the levels of detail of the file (surfel-lod), so that the time follows the "
             "pixels, not the surfels; auto: where it has them, with --method abuffer and --filter "
             "ewa; off: the finest level");
  app.add_option(
      "--lod-error", s.render.lod_error,
      fmt::format("Piece of surface that one surfel may stand for, pixels, 0..1000; "
                  "default: {:g} --lowpass; of Gaussians twice the standard deviation of "
                  "merged ones, default: {:g}",
                  RenderOptions::kLodError, kGaussianLodError));
  app.add_option("--progressive", s.progressive,
                 "Make every picture in that many steps, 1..10, each with half the --lod-error of "
                 "the one before it, and write each over the last");
}

void declare_texture(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Texture of meshes, of --mesh where it is given");
  app.add_option("--image", s.texture.image,
                 "Image file, or checker, siemens, noise, each also as NAME:FREQUENCY; "
                 "default: the images of the mesh's materials");
  add_choice(
      app, "--wrap", s.texture.wrap,
      {{"repeat", WrapMode::kRepeat}, {"mirror", WrapMode::kMirror}, {"clamp", WrapMode::kClamp}},
      "What lies beyond the image's borders; default: as the mesh's materials say, else repeat");
  add_normal_maps(app, s.normals);
}

void declare_gaussians(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Gaussians");
  std::string names;
  for (const auto& [name, profile] : gaussian_profiles()) names += ", " + name;
  add_text(app, "--profile", "NAME", "auto",
           "Whose picture to make of trained splats: that of 3D Gaussian splatting as published, "
           "of gsplat, of Mip-Splatting or of 2D Gaussian splatting; or exact, which integrates "
           "kernels along rays in perspective and orders them by pixel; or surfel, which draws "
           "kernels as samples of opaque surfaces, divided by their sum; auto: as the file says "
           "what it was trained with, else inria (auto" +
               names + ")",
           [&s](const std::string& text) {
             s.profile.reset();
             if (text == "auto") return;
             std::vector<std::string> known{"auto"};
             for (const auto& [name, profile] : gaussian_profiles()) {
               if (name == text) s.profile = profile;
               known.push_back(name);
             }
             if (s.profile) return;
             throw tool::OptionError(
                 "--profile", fmt::format("'{}' is not one of {}{}", text, fmt::join(known, ", "),
                                          did_you_mean(text, known)));
           });
}

void declare_truth(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Truth");
  tool::Option* reference =
      app.add_flag("--reference", s.reference,
                   "Ray-cast the surfels, slowly and exactly, instead: the truth to measure the "
                   "other pictures against (R G B A only)");
  app.add_option("--mesh", s.mesh,
                 "Ray-trace this mesh instead (OBJ, PLY, STL, OFF, glTF): the truth "
                 "to measure surfels made from it against (R G B A only)")
      ->excludes(reference);
  app.add_option("--samples", s.rays.samples,
                 "Of --reference and --mesh: rays along each side of a pixel, 1..64; of --profile "
                 "exact: samples along each side, 1..4, by default 2 for volumes and 1 for splats");
}

void declare_colors(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Colour by attribute");
  app.add_option("--color-by", s.color_by,
                 "Colour surfels by elevation, x, y, z, normal, radius, spacing, density, or a "
                 "column of the file such as intensity, classification, confidence, group "
                 "(surfel-info lists them); none: their own colours; auto: none where they have "
                 "colours, else elevation for terrain, and intensity where they have it")
      ->type_name("NAME");
  add_choice(app, "--color-map", s.color_map,
             {{"auto", MapChoice::kAuto},
              {"viridis", MapChoice::kViridis},
              {"turbo", MapChoice::kTurbo},
              {"terrain", MapChoice::kTerrain},
              {"grey", MapChoice::kGrey},
              {"classes", MapChoice::kClasses}},
             "Of --color-by: the colours; classes gives each whole number a colour of its own; "
             "auto: terrain for elevation, grey for intensity, classes for classifications, "
             "groups, materials and labels, else viridis");
  add_vector(app, "--color-range", s.color_range,
             "Of --color-by: values of the map's ends, the smaller one first; default: what 98 in "
             "100 surfels lie between");
  add_choice(
      app, "--legend", s.legend,
      {{"auto", LegendChoice::kAuto}, {"on", LegendChoice::kOn}, {"off", LegendChoice::kOff}},
      "What colours stand for, in the lower right corner; auto: with --color-by in pictures of 256 "
      "pixels and more each way, but for EXR");
}

void declare_shading(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.group("Shading");
  add_choice(app, "--shading", s.shading,
             {{"auto", Shading::kAuto}, {"phong", Shading::kPhong}, {"none", Shading::kNone}},
             "phong lights the surfels, none shows the filtered texture itself; auto: none for "
             "colours that were recorded, such as a scan's, phong for all others and with "
             "--scene");
  add_choice(app, "--relief", s.relief,
             {{"auto", ReliefChoice::kAuto},
              {"none", ReliefChoice::kNone},
              {"eye-dome", ReliefChoice::kEyeDome},
              {"occlusion", ReliefChoice::kOcclusion}},
             "Shade by the picture's depths, which needs no normals: eye-dome by what is nearer "
             "around a pixel, occlusion by how much light what is around it hides; auto: "
             "occlusion for opaque surfels, or --mesh, without colours that are lit by no --scene");
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

/// Levels of detail are of the fast renderer and of surfels without groups.
void check_levels(const tool::CommandLine& app, const Settings& s) {
  const auto refuse = [&](bool wrong, const std::string& what) {
    if (wrong && s.lod == Lod::kOn) {
      throw_usage(fmt::format("--lod on has no effect with {}; leave it out", what));
    }
  };
  refuse(s.reference, "--reference");
  refuse(!s.mesh.empty(), "--mesh");
  refuse(s.filter == Filter::kEwaSource, "--filter ewa-source");
  refuse(s.render.compositing().columns().groups, "methods that need groups");
  refuse(AttributeValues::of_size(s.color_by),
         "--color-by " + s.color_by + ", which coarser levels do not have alike");
  for (const char* option : {"--lod-error", "--progressive"}) {
    if (app.get_option(option)->count() > 0 && !wants_levels(s)) {
      throw_usage(fmt::format(
          "{} needs levels of detail, which are not used here; leave it out, or see --lod",
          option));
    }
  }
}

/// Fills in fields of the library's options that the command line has in other types.
void finish(Settings& s) {
  s.render.method = compositing_method(s.method, s.method_options);
  s.render.lit = s.shading != Shading::kNone;
  if (s.relief == ReliefChoice::kEyeDome) s.render.relief = Relief::kEyeDome;
  if (s.relief == ReliefChoice::kOcclusion) s.render.relief = Relief::kOcclusion;
  s.texture.charts = false;
  s.normals.maps.charts = false;
  s.normals.maps.wrap = s.texture.wrap;
  s.render.cull_back = s.cull == Cull::kBack;
  s.render.aovs =
      (s.contact_sheet || tool::lower_extension(s.output) == ".exr") && !blends_layers(s);
  constexpr std::array<float, 4> kWhite{1, 1, 1, 1};
  if (s.background) {
    s.render.background = *s.background;
  } else if (wants_film(s) || !image_format_has_alpha(s.output)) {
    s.render.background = kWhite;
  }
  if (s.contact_sheet) {
    s.sheet_background = s.background.value_or(kWhite);
    s.render.background = {0, 0, 0, 0};  // Holes are found where nothing is behind them.
  }
  if (s.filter == Filter::kCircular) s.render.filter = surfel::Filter::kCircular;
  if (s.filter == Filter::kNone) s.render.filter = surfel::Filter::kNone;
}

/// Panoramas show all directions from a place, by degrees.
void check_projection(const tool::CommandLine& app, Settings& s) {
  if (s.projection != Projection::kEquirectangular) return;
  tool::require_valid(tool::without_effect(
      app, {"--fov", "--ortho", "--zoom", "--frame-all", "--turntable", "--from", "--view"},
      "with --projection equirectangular"));
  if (s.camera_file.empty() && s.views_file.empty() && !s.camera.eye) {
    throw_usage("--projection equirectangular needs the place that all is seen from: give --eye");
  }
  if (app.get_option("--size")->count() == 0) {
    s.camera.width = 1024;
    s.camera.height = 512;
  }
  if (s.views_file.empty() && s.camera.width != 2 * s.camera.height) {
    throw_usage(
        fmt::format("--size is {}x{}; with --projection equirectangular pictures are "
                    "twice as wide as high",
                    s.camera.width, s.camera.height));
  }
}

/// Known views leave nothing of a camera open but its near plane.
void check_views(const tool::CommandLine& app, Settings& s) {
  if (!s.path) {
    tool::require_valid(tool::without_effect(app, {"--path-pictures", "--ease"}, "without --path"));
  }
  if (!s.path && !wants_film(s)) {
    tool::require_valid(tool::without_effect(app, {"--fps"}, "without --path and films"));
  }
  if (s.path) tool::require_valid(tool::without_effect(app, {"--turntable"}, "with --path"));
  if (s.views_file.empty()) {
    tool::require_valid(tool::without_effect(app, {"--original-world"}, "without --views"));
    return;
  }
  const std::string option = s.path ? "--path" : "--views";
  if (!s.camera_file.empty()) throw_usage("--camera and " + option + " exclude each other");
  s.resize = app.get_option("--size")->count() > 0;
  if (tool::lower_extension(s.views_file) == ".toml") {
    s.camera_file = std::exchange(s.views_file, {});
    tool::require_valid(
        tool::without_effect(app, {"--original-world"}, "on the cameras of a TOML file"));
    return;
  }
  tool::require_valid(tool::without_effect(app,
                                           {"--eye", "--from", "--view", "--target", "--fov",
                                            "--ortho", "--zoom", "--frame-all", "--turntable"},
                                           "on the views of " + option));
  if (s.view.guess_up) {
    throw_usage("--up auto has no effect on the views of " + option + "; leave it out");
  }
}

/// Maps have their own camera.
void check_map(const tool::CommandLine& app, const Settings& s) {
  if (!s.map) {
    tool::require_valid(tool::without_effect(app, {"--epsg"}, "without --map"));
    return;
  }
  if (s.epsg) tool::require_valid(coordinate_system_of_code(*s.epsg).problems());
  if (!(*s.map > 0 && std::isfinite(*s.map))) {
    throw_usage(fmt::format("--map is {:g}; it must be > 0", *s.map));
  }
  if (s.output == "-") throw_usage("--map writes a world file beside the picture; name a file");
  tool::require_valid(tool::without_effect(
      app,
      {"--eye", "--from", "--view", "--target", "--up", "--fov", "--ortho", "--size", "--zoom",
       "--near", "--camera", "--views", "--path", "--turntable", "--projection"},
      "with --map"));
}

/// Refuses options that the chosen renderer or method does not heed.
void require_effect(const tool::CommandLine& app, const Settings& s) {
  const auto refuse = [&](const std::string& renderer, const std::vector<std::string>& options) {
    tool::require_valid(tool::without_effect(app, options, "with " + renderer));
  };
  const auto refuse_fast = [&](const std::string& renderer, std::vector<std::string> options) {
    for (const char* option :
         {"--kernel", "--kernel-tolerance", "--layers", "--method", "--voronoi", "--layers-by",
          "--peel", "--explain", "--explain-pixel"}) {
      options.emplace_back(option);
    }
    refuse(renderer, options);
  };
  if (s.contact_sheet) refuse("--contact-sheet", {"--legend", "--explain-pixel"});
  if (s.reference) refuse_fast("--reference", {"--filter", "--contact-sheet", "--relief"});
  if (s.filter == Filter::kEwaSource)
    refuse_fast("--filter ewa-source", {"--contact-sheet", "--relief"});
  if (blends_layers(s)) refuse("methods that blend layers", {"--contact-sheet"});
  if (s.projection == Projection::kEquirectangular) {
    refuse("--projection equirectangular", {"--contact-sheet", "--explain-pixel"});
  }
  static const std::map<Method, std::pair<const char*, std::vector<std::string>>> kMethods{
      {Method::kABuffer, {"abuffer", {"--voronoi", "--layers-by", "--peel"}}},
      {Method::kDeferred, {"deferred", {"--layers-by", "--peel"}}},
      {Method::kTransparent, {"transparent", {"--peel", "--layers"}}},
      {Method::kTransparentHigh, {"transparent-high", {"--peel", "--layers"}}},
      {Method::kTwoPass, {"two-pass", {"--voronoi", "--layers-by", "--peel"}}},
      {Method::kDepthPeel, {"depth-peel", {"--voronoi", "--layers-by", "--layers"}}}};
  const auto& [method, unheeded] = kMethods.at(s.method);
  refuse(std::string("--method ") + method, unheeded);
  if (s.method == Method::kTransparent && s.method_options.layers_by == LayersBy::kGroup) {
    // Layers that each group tells by itself are discs, without kernels.
    refuse("--method transparent", {"--lowpass", "--coverage-threshold"});
  }
  if (!s.mesh.empty()) {
    refuse("--mesh", {"--color-by", "--color-map", "--color-range", "--legend"});
    refuse_fast("--mesh", {"--contact-sheet", "--filter", "--cutoff", "--depth-epsilon",
                           "--coverage-threshold"});
  } else if (s.inputs.empty()) {
    throw_usage("there are neither surfels nor --mesh; give one");
  }
  if (s.inputs.empty()) {
    refuse("--mesh without surfels", {"--memory", "--keep", "--print-commands"});
  }
  if (s.scene_file.empty()) refuse("the default scene", {"--refraction", "--bounces"});
  if (!s.render.lit) {
    refuse("--shading none", {"--refraction", "--bounces"});
    refuse("--shading none", tool::normal_map_options());
  }
  if (s.color_by == "none") {
    refuse("--color-by none", {"--color-map", "--color-range", "--legend"});
  }
  if (s.color_by == "normal") {
    refuse("--color-by normal", {"--color-map", "--color-range", "--legend"});
  }
  if (s.color_map == MapChoice::kClasses) refuse("--color-map classes", {"--color-range"});
  if (s.mesh.empty()) refuse("surfels", {"--bounces"});
  if (s.bounces > 0) refuse("--bounces", {"--refraction"});
}

/// Throws Error(kUsage) where no parts can be made of the pictures.
void check_tiles(const tool::CommandLine& app, const Settings& s) {
  if (!s.tiles) return;
  tool::require_valid(tool::without_effect(
      app, {"--map", "--contact-sheet", "--progressive", "--explain"}, "--tiles"));
  if (s.projection == Projection::kEquirectangular) {
    throw_usage("--tiles has no effect with --projection equirectangular; leave it out");
  }
  if (tool::lower_extension(s.output) != ".exr") {
    throw_usage(
        fmt::format("--output is \"{}\", but --tiles writes parts of pictures as EXR; give a "
                    "name that ends in .exr, of which surfel-join makes other formats",
                    s.output));
  }
}

void check(const Settings& s) {
  if (s.print_commands && s.output == "-") {
    throw_usage("--print-commands and --output - both write to standard output");
  }
  if (!s.explained_pixels.empty() && s.output == "-") {
    throw_usage("--explain-pixel and --output - both write to standard output");
  }
  if (s.inputs.size() > 1 && std::count(s.inputs.begin(), s.inputs.end(), "-") > 0) {
    throw_usage("standard input (-) does not go together with other files");
  }
  std::vector<std::string> problems = s.camera.problems();
  tool::append(problems, s.render.problems());
  tool::append(problems, s.rays.problems());
  tool::append(problems, s.normals.maps.problems());
  if (s.progressive < 1 || s.progressive > 10) {
    problems.push_back(fmt::format("--progressive is {}; it must be in 1..10", s.progressive));
  }
  if (s.color_range && !((*s.color_range)[0] < (*s.color_range)[1])) {
    problems.push_back(fmt::format("--color-range is {:g},{:g}; the first must be the smaller one",
                                   (*s.color_range)[0], (*s.color_range)[1]));
  }
  if (tool::is_film_name(s.output) && is_pattern(s.output)) {
    problems.push_back(fmt::format(
        "--output is \"{}\", but one film is made of all views; leave out %d and {{name}}",
        s.output));
  }
  if (s.progressive > 1 && wants_film(s)) {
    problems.emplace_back("--progressive has no effect on films; leave it out");
  }
  if (s.path_pictures != 0 && (s.path_pictures < 2 || s.path_pictures > 1000000)) {
    problems.push_back(
        fmt::format("--path-pictures is {}; it must be 0 or 2..1000000", s.path_pictures));
  }
  if (!(s.fps >= 0.1 && s.fps <= 1000)) {
    problems.push_back(fmt::format("--fps is {:g}; it must be in 0.1..1000", s.fps));
  }
  if (s.progressive > 1 && s.output == "-") {
    problems.emplace_back("--progressive writes its steps over one another; give --output a file");
  }
  tool::append(problems, s.part.options().problems());
  if (s.turntable < 0 || s.turntable > 100000) {
    problems.push_back(fmt::format("--turntable is {}; it must be in 0..100000", s.turntable));
  }
  tool::require_valid(problems);
}

}  // namespace

const std::vector<std::pair<std::string, GaussianProfile>>& gaussian_profiles() {
  static const std::vector<std::pair<std::string, GaussianProfile>> profiles{
      {"inria", GaussianProfile::kInria}, {"gsplat", GaussianProfile::kGsplat},
      {"mip", GaussianProfile::kMip},     {"2dgs", GaussianProfile::k2dgs},
      {"exact", GaussianProfile::kExact}, {"surfel", GaussianProfile::kSurfel}};
  return profiles;
}

void declare_options(tool::CommandLine& app, Settings& s) {
  using namespace tool;
  app.add_option(
      "files", s.inputs,
      "Surfels (PLY, PCD, LAS, LAZ; - = standard input), meshes, which are sampled at half a pixel "
      "and textured, and raw points (E57, PTX and text, too), which are estimated; several files "
      "are joined; or trained splats (PLY, .splat, .spz, .ksplat). With --mesh surfels only frame "
      "the "
      "picture, and may be left out");
  app.add_option("-o,--output", s.output,
                 "Picture (EXR, PNG, TIFF, JPEG, ...; several views: a pattern with %04d, their "
                 "number, or {name}, their name), or film of several views (MP4, WebM, GIF, WebP; "
                 "ffmpeg makes it)")
      ->required();
  add_part(app, s.part);
  declare_camera(app, s);
  declare_kernel(app, s);
  declare_visibility(app, s);
  declare_levels(app, s);
  declare_texture(app, s);
  declare_gaussians(app, s);
  declare_truth(app, s);
  declare_shading(app, s);
  declare_colors(app, s);
  app.group("Options");
  app.add_flag("--contact-sheet", s.contact_sheet,
               "Six pictures in one: colour, normals, depth, surfels a pixel, holes and weight");
  app.add_option("--keep", s.keep, "Surfels to write, as they were made of the files");
  app.add_flag("--print-commands", s.print_commands,
               "Write the commands that do the same, one by one, to standard output");
  app.add_flag("--explain", s.explain,
               "Say what was chosen for the (first) picture where there was a choice, and why");
  add_texts(
      app, "--explain-pixel", "X,Y",
      "Write to standard output what made the pixel in column X and row Y of each picture, 0,0 "
      "at the top left: splats, weights, depths, layers; --stats has all of it; several may be "
      "given",
      [&s](const std::vector<std::string>& texts) {
        s.explained_pixels.clear();
        for (const std::string& text : texts) {
          s.explained_pixels.push_back(parse_pixel("--explain-pixel", text));
        }
      });
  add_memory(app, s.memory,
             "Memory for surfels or Gaussians and what a picture makes of them; a binary PLY file "
             "that needs more, in space-filling order or nearly, is read piece by piece, for each "
             "picture anew; of levels of detail only what is shown is read");
}

bool wants_film(const Settings& s) {
  // What is one picture as WebP is a film where there are several to be joined.
  const bool several = (s.turntable > 0 || s.path) && !is_pattern(s.output);
  return tool::is_film_name(s.output) || (several && tool::lower_extension(s.output) == ".webp");
}

bool wants_legend(const Settings& s) {
  if (s.legend != LegendChoice::kAuto) return s.legend == LegendChoice::kOn;
  return tool::lower_extension(s.output) != ".exr";
}

bool blends_layers(const Settings& s) {
  return s.method == Method::kTransparent || s.method == Method::kTransparentHigh;
}

bool wants_levels(const Settings& s) {
  const bool fast = !s.reference && s.mesh.empty() && s.filter != Filter::kEwaSource &&
                    !AttributeValues::of_size(s.color_by);
  if (s.lod != Lod::kAuto) return s.lod == Lod::kOn;
  return fast && s.method == Method::kABuffer && s.filter == Filter::kEwa;
}

void settle(const tool::CommandLine& app, Settings& s) {
  finish(s);
  check_views(app, s);
  check_projection(app, s);
  check_map(app, s);
  check_tiles(app, s);
  require_effect(app, s);
  check_levels(app, s);
  check(s);
}

}  // namespace surfel::render_tool
