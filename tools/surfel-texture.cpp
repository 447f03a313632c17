// surfel-texture: the coefficients of a texture for surfels.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/memory.h>
#include <surfel/base/progress.h>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_ranges.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/io/mesh_io.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/surface/coverage_threshold.h>
#include <surfel/texture/normal_fit.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/surface_lookup.h>
#include <surfel/texture/texture_fit.h>
#include <surfel/texture/texture_source.h>

#include "tools/support/color.h"
#include "tools/support/normal_maps.h"
#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

enum class From { kTexture, kColors };

struct Settings {
  std::string input;
  std::string output;
  std::string mesh;
  surfel::TextureSourceOptions source;
  std::string solid_name;
  surfel::SolidTextureOptions solid;  ///< But for pattern and frequency, which the name has.
  surfel::TextureFitOptions fit;
  surfel::tool::NormalMapSettings normals;
  std::optional<std::uint64_t> memory;  ///< Bytes; unset: three quarters of what is free.
  bool no_charts = false;
  From from = From::kTexture;
  std::optional<Eigen::Vector2d> bounds;
};

/// Options of the least-squares fits.
void declare_systems(CLI::App& app, Settings& s) {
  using namespace surfel;
  app.option_defaults()->group("Systems of equations (--fit gram, render)");
  tool::add_choice(app, "--solver", s.fit.solver,
                   {{"cg", FitSolver::kConjugateGradients},
                    {"ldlt", FitSolver::kLdlt},
                    {"ceres", FitSolver::kCeres}},
                   "cg = preconditioned conjugate gradients; ldlt = sparse factorisation, exact, "
                   "for small systems; ceres = least squares by Ceres, to compare with, for small "
                   "systems");
  app.add_option("--tolerance", s.fit.tolerance,
                 "Of cg: relative residual; of ceres and --robust: relative change of the "
                 "coefficients in the last step; 1e-14..0.1");
  tool::add_text(app, "--lambda", "X", "auto",
                 "Weight of the distance to ewa's coefficients by the system's mean diagonal, "
                 "0..1e6, or auto: render 0.03 (from colors 0.5), gram what keeps the condition "
                 "below 1e6 and lets cg converge",
                 [&s](const std::string& text) {
                   if (text == "auto") {
                     s.fit.lambda.reset();
                   } else {
                     s.fit.lambda = tool::parse_numbers("--lambda", text, 1).front();
                   }
                 });
  tool::add_vector(app, "--bounds", s.bounds,
                   "Of cg: keep coefficients within these two, such as 0,1");
  tool::add_choice(
      app, "--right-side", s.fit.right_side,
      {{"published", GramRightSide::kPublished}, {"normalised", GramRightSide::kNormalised}},
      "Of --fit gram, the c of R w = c: published = the integrals of SS01 (11), the "
      "optimum for the plain sum of all kernels, the default; normalised = by the "
      "kernels' sum, by which the renderer divides, the only one of --from colors");
  app.add_option("--cutoff", s.fit.cutoff,
                 "Of --fit render: the --cutoff that surfel-render is going to use, 0.1..16");
  app.add_option(
      "--points", s.fit.points,
      "Of --fit render: points of the surface a surfel that are fitted, 1..256; default: "
      "6, 12 with --refine-variance");
  tool::add_text(app, "--robust", "X", "",
                 "Of --fit render: residuals longer than this, linear R G B, are outliers and "
                 "count by their length instead of its square (Huber's loss), > 0, or auto: twice "
                 "the median residual",
                 [&s](const std::string& text) {
                   s.fit.robust = true;
                   if (text == "auto") {
                     s.fit.robust_scale.reset();
                   } else {
                     s.fit.robust_scale = tool::parse_numbers("--robust", text, 1).front();
                   }
                 });
  app.add_flag(
      "--refine-variance", s.fit.refine_variance,
      "Of --fit render: fit the surfels' variances together with the coefficients, "
      "standard deviations within 1/2..2 of what they were; takes about 0.5 ms of one core "
      "a surfel");
  app.option_defaults()->group("Options");
}

/// Options of solid textures.
void declare_solid(CLI::App& app, Settings& s) {
  using namespace surfel;
  app.option_defaults()->group("Solid textures (--solid)");
  app.add_option(
      "--solid", s.solid_name,
      "Texture that fills space and needs no uv: checker, noise, marble, wood, each also "
      "as NAME:FREQUENCY, features (cubes, blots, veins, rings) along the diagonal of "
      "the surfels' bounds; default: checker 16, noise 12, marble 9, wood 32");
  app.add_option("--feature-size", s.solid.feature_size,
                 "Size of a feature in scene units, instead of a frequency, > 0");
  tool::add_vector(app, "--center", s.solid.center,
                   "Where the centre of the pattern's block lies, world coordinates; default: "
                   "centre of the surfels' bounds");
  app.add_option("--octaves", s.solid.octaves,
                 "Of noise, marble and wood: octaves of the noise, 1..16");
  app.add_option("--seed", s.solid.seed, "Of noise, marble and wood: chooses the noise");
  tool::add_color(app, "--dark", s.solid.dark,
                  "Dark colour: a name, #rrggbb, or linear R,G,B; default: the pattern's own");
  tool::add_color(app, "--light", s.solid.light,
                  "Light colour: a name, #rrggbb, or linear R,G,B; default: the pattern's own");
  app.option_defaults()->group("Options");
}

void declare_options(CLI::App& app, Settings& s) {
  using namespace surfel;
  app.add_option("surfels", s.input, "Surfels (PLY, PCD, LAS, LAZ; - = standard input)")
      ->required();
  app.add_option("-o,--output", s.output, "Surfels to write (- = standard output)")->required();
  app.add_option("--image", s.source.image,
                 "Image file, or checker, siemens, noise, each also as NAME:FREQUENCY; default: "
                 "the images of the mesh's materials");
  app.add_option("--mesh", s.mesh,
                 "The mesh that the surfels were sampled from: its materials' images, and its "
                 "charts, beyond whose borders no kernel takes colour");
  app.add_flag("--no-charts", s.no_charts, "Let kernels take colour from beyond their chart");
  tool::add_choice(
      app, "--wrap", s.source.wrap,
      {{"repeat", WrapMode::kRepeat}, {"mirror", WrapMode::kMirror}, {"clamp", WrapMode::kClamp}},
      "What lies beyond the image's borders; default: as the mesh's materials say, else repeat");
  tool::add_choice(app, "--from", s.from, {{"texture", From::kTexture}, {"colors", From::kColors}},
                   "What the coefficients are fitted to: an image, or the surfels' own colours");
  tool::add_choice(app, "--fit", s.fit.kind,
                   {{"ewa", TextureFitKind::kEwa},
                    {"gram", TextureFitKind::kGram},
                    {"render", TextureFitKind::kRender}},
                   "How coefficients are found: ewa = view-independent EWA; gram = R w = c, the "
                   "least squares of the plain sum of all kernels; render = least squares for what "
                   "surfel-render "
                   "makes of them: the sharpest under magnification");
  app.add_option("--reconstruction", s.fit.reconstruction,
                 "Standard deviation of the texture's reconstruction kernel, texels, 0.25..16");
  app.add_option("--prefilter", s.fit.prefilter,
                 "With --fit ewa: variance of the kernel that filters the texture, by the "
                 "surfel's own, 1/16..4. 1 is as published; 0.5 is sharper where surfels are less "
                 "than a pixel apart or magnified, and noisier where they are far away");
  app.add_option("--max-aspect", s.fit.max_aspect,
                 "Kernels longer than this many times their width are widened, 1..10000");
  app.add_flag("--exact", s.fit.exact,
               "Sum over the image's own texels whatever it takes, instead of a pyramid's");

  declare_solid(app, s);
  app.option_defaults()->group("Normals");
  tool::add_normal_maps(app, s.normals);
  declare_systems(app, s);
  tool::add_memory(app, s.memory,
                   "Memory for surfels; a binary PLY file may be larger with --fit ewa, and is "
                   "textured block by block");
}

/// Completes the options of the solid texture, if there is one, and adds what is wrong with them.
void check_solid(const CLI::App& app, Settings& s, std::vector<std::string>& problems) {
  using surfel::tool::append;
  using surfel::tool::without_effect;
  if (s.solid_name.empty()) {
    append(problems,
           without_effect(
               app, {"--feature-size", "--center", "--octaves", "--seed", "--dark", "--light"},
               "without --solid"));
    return;
  }
  const surfel::SolidTextureOptions named = surfel::solid_texture_options(s.solid_name);
  s.solid.pattern = named.pattern;
  s.solid.frequency = named.frequency;
  append(problems, s.solid.problems());
  append(problems, without_effect(app,
                                  {"--image", "--no-charts", "--wrap", "--reconstruction",
                                   "--prefilter", "--max-aspect", "--exact"},
                                  "with --solid"));
  if (s.normals.maps.empty()) append(problems, without_effect(app, {"--mesh"}, "with --solid"));
  if (named.pattern == surfel::SolidPattern::kChecker) {
    append(problems, without_effect(app, {"--octaves", "--seed"}, "with --solid checker"));
  }
  if (s.from == From::kColors) {
    problems.emplace_back("--solid and --from colors do not go together; leave one out");
  }
}

/// Refuses options of fits where there are no colours to be fitted.
void refuse_fits(const CLI::App& app) {
  surfel::tool::require_valid(surfel::tool::without_effect(
      app,
      {"--fit", "--prefilter", "--solver", "--tolerance", "--lambda", "--bounds", "--cutoff",
       "--points", "--robust", "--refine-variance", "--right-side"},
      "with normals alone"));
}

void check(const CLI::App& app, Settings& s) {
  std::vector<std::string> problems = s.fit.problems();
  check_solid(app, s, problems);
  const auto refuse = [&](const std::vector<std::string>& options, const std::string& where) {
    surfel::tool::append(problems, surfel::tool::without_effect(app, options, where));
  };
  if (s.fit.kind == surfel::TextureFitKind::kEwa) {
    refuse({"--solver", "--tolerance", "--lambda", "--bounds"}, "with --fit ewa");
  }
  if (s.fit.kind != surfel::TextureFitKind::kRender) {
    refuse({"--cutoff", "--points"}, "without --fit render");
  }
  if (s.from == From::kColors) {
    refuse({"--image", "--mesh", "--no-charts", "--wrap", "--reconstruction", "--prefilter",
            "--max-aspect", "--exact", "--points", "--refine-variance"},
           "with --from colors");
    refuse(surfel::tool::normal_map_options(), "with --from colors");
    if (s.fit.kind == surfel::TextureFitKind::kEwa) {
      problems.emplace_back(
          "--from colors is for --fit gram and render: ewa leaves them as they are");
    }
  } else if (s.source.image.empty() && s.mesh.empty() && s.solid_name.empty()) {
    if (s.normals.maps.empty()) {
      problems.emplace_back(
          "there is neither --image nor --mesh nor --solid, nor a --normal-map or --bump alone; "
          "give "
          "one");
    }
    refuse_fits(app);
  }
  surfel::tool::append(problems, s.normals.maps.problems());
  surfel::tool::require_valid(problems);
}

/// Refuses a mesh that no surfel lies on, and tells where only some do. Where they lie on it, as
/// nearly always, a few thousand surfels show it.
/// \param sample  these, at even steps through the cloud
/// \param all     measures all `surfels`
void check_mesh(const surfel::SurfelCloud& sample, std::size_t surfels,
                const surfel::TriangleMesh& mesh, surfel::FunctionRef<surfel::MeshProximity()> all,
                const Settings& s, surfel::tool::Tool& tool) {
  if (sample.empty() || !surfel::has_variance(sample)) return;
  if (surfel::mesh_proximity(sample, mesh, sample.size()).far == 0) return;
  const surfel::MeshProximity found = all();
  tool.report()["far_from_mesh"] = found.far;
  if (found.near == 0) {
    surfel::throw_input(
        s.input, fmt::format("none of its {} surfels lies on {}: the nearest is {:.3g} away; give "
                             "the mesh that the surfels were sampled from, at its own place",
                             surfels, s.mesh, found.least_distance));
  }
  const double share = static_cast<double>(found.far) / static_cast<double>(surfels);
  tool.note(fmt::format(
      "{}: {} of {} surfels ({:.3g} %) do not lie on {}, but more than 3 standard deviations away",
      s.input, found.far, surfels, 100 * share, s.mesh));
}

/// Surfels that check_mesh() looks at.
constexpr std::size_t kMeshSample = 1 << 12;

void check_mesh(const surfel::SurfelCloud& cloud, const surfel::TriangleMesh& mesh,
                const Settings& s, surfel::tool::Tool& tool) {
  const std::size_t count = std::min(kMeshSample, cloud.size());
  surfel::Array<std::uint32_t> rows(count);
  for (std::size_t k = 0; k < count; ++k) {
    rows[k] = static_cast<std::uint32_t>(k * cloud.size() / count);
  }
  check_mesh(
      cloud.gathered(rows), cloud.size(), mesh,
      [&] { return surfel::mesh_proximity(cloud, mesh, cloud.size()); }, s, tool);
}

/// Tells where surfels that come without uv were found on the mesh.
void tell_located(const surfel::SurfaceLookupReport& found, std::size_t surfels, const Settings& s,
                  surfel::tool::Tool& tool) {
  nlohmann::json& json = tool.report();
  json["located"] = found.located;
  json["too_far"] = found.too_far;
  json["turned_away"] = found.turned_away;
  json["mean_distance"] = found.mean_distance;
  tool.note(fmt::format("{}: u, v found on {} for {} of {} surfels, {:.3g} away on average",
                        s.input, s.mesh, found.located, surfels, found.mean_distance));
  if (found.turned_away > surfels / 2) {
    tool.note(fmt::format("{}: most normals look the other way than {}'s faces", s.input, s.mesh));
  }
}

nlohmann::json to_json(const surfel::Vec3f& v) { return {v.x(), v.y(), v.z()}; }

void report(nlohmann::json& json, const surfel::TextureFitReport& fit) {
  json["surfels"] = fit.surfels;
  json["without_uv"] = fit.without_uv;
  json["without_kernel"] = fit.without_kernel;
  json["widened"] = fit.widened;
  json["charts"] = fit.charts;
  json["charts_too_large"] = fit.charts_too_large;
  json["outside_charts"] = fit.outside_charts;
  json["levels"] = fit.levels;
  json["alpha"] = fit.alpha;
  json["coefficient_min"] = to_json(fit.coefficient_min);
  json["coefficient_max"] = to_json(fit.coefficient_max);
  surfel::tool::add_stages(json, fit.times);
  if (!fit.system) return;
  const surfel::SystemReport& system = *fit.system;
  json["system"] = {{"functions", system.functions},
                    {"entries", system.entries},
                    {"lambda", system.lambda},
                    {"eigen_min", system.eigen_min},
                    {"eigen_max", system.eigen_max},
                    {"condition", system.condition()},
                    {"iterations", system.iterations},
                    {"residual", system.residual},
                    {"converged", system.converged},
                    {"points", system.points},
                    {"rough_iterations", system.rough_iterations},
                    {"uncovered", system.uncovered},
                    {"unresolved", system.unresolved},
                    {"error_ewa", system.error_ewa},
                    {"error", system.error},
                    {"min_reach", system.min_reach},
                    {"max_reach", system.max_reach}};
  if (system.robust) {
    const surfel::RobustReport& robust = *system.robust;
    json["system"]["robust"] = {{"scale", robust.scale},
                                {"rounds", robust.rounds},
                                {"down_weighted", robust.down_weighted},
                                {"cost", robust.cost}};
  }
  if (system.variance) {
    const surfel::VarianceFitReport& variance = *system.variance;
    json["system"]["variance"] = {{"rounds", variance.rounds},
                                  {"accepted", variance.accepted},
                                  {"iterations", variance.iterations},
                                  {"objective_start", variance.objective_start},
                                  {"objective", variance.objective},
                                  {"error_before", system.error_before},
                                  {"sigma_min", variance.sigma_min},
                                  {"sigma_max", variance.sigma_max},
                                  {"held", variance.held}};
  }
}

/// The right side of SS01 (11) takes amplitudes for areas.
bool needs_area(const Settings& s) {
  return s.from == From::kTexture && s.fit.kind == surfel::TextureFitKind::kGram &&
         s.fit.right_side != surfel::GramRightSide::kNormalised;
}

void warn(const surfel::tool::Tool& tool, const std::string& input,
          const surfel::TextureFitReport& fit) {
  const auto count = [&](std::size_t surfels, const std::string& what) {
    if (surfels > 0) {
      tool.note(fmt::format("{}: {} of {} surfels {}", input, surfels, fit.surfels, what));
    }
  };
  count(fit.without_uv, "have no finite u, v: given the image's mean colour");
  count(fit.without_kernel,
        "have no usable derivatives, normal or variance: given the colour at a point");
  count(fit.outside_charts, "lie on no chart of the mesh: filtered without one");
  if (!fit.system) return;
  count(fit.surfels - fit.system->functions, "are unusable: they keep the coefficients of ewa");
  if (!fit.system->converged) {
    tool.note(
        fmt::format("{}: the solver ended after {} iterations with a relative residual of "
                    "{:.2g}; a larger --lambda helps",
                    input, fit.system->iterations, fit.system->residual));
  }
}

surfel::TextureSet load_textures(Settings& s, const surfel::TriangleMesh* mesh) {
  s.source.charts = !s.no_charts;
  s.source.whole = false;
  return surfel::load_textures(s.source, mesh, s.mesh);
}

surfel::SolidTexture make_solid(const Settings& s, const surfel::Bounds& bounds,
                                surfel::tool::Tool& tool) {
  surfel::SolidTexture texture(s.solid, bounds);
  tool.report()["feature_size"] = texture.feature_size();
  return texture;
}

surfel::TextureFitReport make_fit(surfel::SurfelCloud& cloud, const surfel::TriangleMesh* mesh,
                                  Settings& s, surfel::tool::Tool& tool) {
  surfel::ProgressStage stage("fitting", cloud.size(), "surfels");
  s.fit.progress = [&stage](double share) { stage.set_share(share); };
  if (s.from == From::kColors) return surfel::fit_colors(cloud, s.fit, s.input);
  if (!s.solid_name.empty()) {
    return surfel::fit_solid(cloud, make_solid(s, cloud.bounds(), tool), s.fit, s.input);
  }
  surfel::TextureSet textures = load_textures(s, mesh);
  return surfel::fit_texture(cloud, textures, s.fit, s.input);
}

/// None where colours come from the surfels.
std::optional<surfel::NormalMaps> load_normals(const CLI::App& app, Settings& s,
                                               const surfel::TriangleMesh* mesh) {
  if (s.from == From::kColors) return std::nullopt;
  s.normals.maps.wrap = s.source.wrap;
  s.normals.maps.charts = !s.no_charts;
  return surfel::tool::load_normal_maps(app, s.normals, mesh, s.mesh);
}

/// A mesh without materials has no colours; its surfels may be given normals alone.
bool fits_colors(const Settings& s, const surfel::TriangleMesh* mesh) {
  if (s.from == From::kColors || !s.source.image.empty() || !s.solid_name.empty()) return true;
  if (s.normals.maps.empty()) return true;
  return mesh && !mesh->material.empty();
}

double degrees(double radians) { return radians * 180 / std::numbers::pi; }

void tell_normals(const surfel::NormalFitReport& fit, std::size_t surfels, const Settings& s,
                  surfel::tool::Tool& tool) {
  nlohmann::json& json = tool.report();
  const double spread = degrees(std::sqrt(fit.mean_variance));
  json["normals"] = {{"mapped", fit.mapped},
                     {"unmapped", fit.unmapped},
                     {"without_frame", fit.without_frame},
                     {"mean_tilt", degrees(fit.mean_tilt)},
                     {"spread", spread}};
  surfel::tool::add_stages(json["normals"], fit.times);
  std::string source = s.normals.maps.normal_map + s.normals.maps.bump;
  if (source.empty()) source = "the materials of " + s.mesh;
  tool.note(fmt::format(
      "{}: normals from {} for {} of {} surfels, tilted by {:.1f} degrees on average, {:.1f} "
      "degrees of spread below the surfels' size",
      s.input, source, fit.mapped, surfels, degrees(fit.mean_tilt), spread));
  if (fit.without_frame > 0) {
    tool.note(
        fmt::format("{}: {} of {} surfels have no finite u, v, no normal or no derivatives: "
                    "they keep their normals",
                    s.input, fit.without_frame, surfels));
  }
}

/// Tells what a fit of colours has found.
/// \param areas  The surfels have areas.
void tell_fit(const surfel::TextureFitReport& fit, bool areas, const Settings& s,
              surfel::tool::Tool& tool) {
  report(tool.report(), fit);
  warn(tool, s.input, fit);
  if (needs_area(s) && !areas && fit.surfels > 0) {
    tool.note(
        fmt::format("{}: the surfels have no area, so that their kernels do not sum to "
                    "about 1, and surfel-render, which divides by the sum, shows other "
                    "colours than the texture's; --right-side normalised needs none",
                    s.input));
  }
}

std::optional<surfel::TriangleMesh> load_mesh(const Settings& s, const surfel::tool::Tool& tool) {
  if (s.mesh.empty()) return std::nullopt;
  std::optional<surfel::TriangleMesh> mesh = surfel::read_mesh(s.mesh);
  for (const std::string& note : mesh->notes) tool.note(s.mesh + ": " + note);
  return mesh;
}

void texture_in_memory(surfel::tool::Tool& tool, Settings& s) {
  const surfel::Timer timer;
  surfel::SurfelCloud cloud = surfel::tool::read_finest(tool, s.input);
  const std::optional<surfel::TriangleMesh> mesh = load_mesh(s, tool);
  if (mesh) check_mesh(cloud, *mesh, s, tool);
  if (mesh && cloud.uv.empty()) {
    tell_located(surfel::locate_on_mesh(cloud, *mesh, s.mesh), cloud.size(), s, tool);
  }
  tool.report()["load_ms"] = timer.milliseconds();

  const surfel::TriangleMesh* const surface = mesh ? &*mesh : nullptr;
  std::optional<surfel::NormalMaps> normals = load_normals(tool.app(), s, surface);
  if (fits_colors(s, surface)) {
    tell_fit(make_fit(cloud, surface, s, tool), !cloud.area.empty(), s, tool);
    if (s.from != From::kColors) surfel::show_coefficients(cloud);
  } else {
    refuse_fits(tool.app());
  }
  if (normals) {
    tell_normals(surfel::fit_normals(cloud, *normals, s.fit, s.input), cloud.size(), s, tool);
  }
  surfel::tool::write_result(tool, cloud, s.output);
  tool.wrote(s.output, fmt::format("{} surfels", cloud.size()));
}

/// Textures surfels that stay in their file, a block after the other: what a surfel gets depends on
/// no other surfel. The blocks are read twice, first to know which part of the images they need.
class BlockTexturing {
 public:
  BlockTexturing(surfel::tool::Tool& tool, Settings& s, const surfel::CloudRanges& ranges,
                 std::size_t block)
      : tool_(tool),
        s_(s),
        ranges_(ranges),
        block_(block),
        first_(ranges.read(0, 1)),
        survey_(s.output) {}

  void run() {
    surfel::tool::require_piecewise_format(s_.output, s_.input);
    surfel::tool::tell_finest(tool_, s_.input, first_, ranges_.size());
    mesh_ = load_mesh(s_, tool_);
    const surfel::TriangleMesh* const surface = mesh_ ? &*mesh_ : nullptr;
    if (mesh_) check_mesh_of_file();
    normals_ = load_normals(tool_.app(), s_, surface);
    colors_ = fits_colors(s_, surface);
    if (!colors_) {
      refuse_fits(tool_.app());
    } else if (!s_.solid_name.empty()) {
      solid_ = make_solid(s_, ranges_.bounds(), tool_);
    } else {
      textures_ = load_textures(s_, surface);
    }
    look();
    fit();
  }

 private:
  /// Calls visit(block, number of its first surfel, where it was found on the mesh).
  template <class Visit>
  void for_blocks(const char* what, const Visit& visit) const {
    surfel::ProgressStage stage(what, ranges_.size(), "surfels");
    for (std::size_t begin = 0; begin < ranges_.size(); begin += block_) {
      surfel::SurfelCloud block = ranges_.read(begin, std::min(begin + block_, ranges_.size()));
      surfel::SurfaceLookupReport found;
      if (mesh_ && block.uv.empty()) found = surfel::locate_on_mesh(block, *mesh_, s_.mesh);
      const std::size_t count = block.size();
      visit(std::move(block), begin, found);
      stage.add(count);
    }
  }

  void check_mesh_of_file() {
    const std::size_t count = std::min(kMeshSample, ranges_.size());
    surfel::SurfelCloud sample = surfel::cloud_of_rows(first_, count);
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t i = k * ranges_.size() / count;
      surfel::copy_rows(ranges_.read(i, i + 1), 0, 1, sample, k);
    }
    const auto all = [&] {
      surfel::MeshProximity sum;
      sum.least_distance = std::numeric_limits<double>::infinity();
      for (std::size_t begin = 0; begin < ranges_.size(); begin += block_) {
        const surfel::SurfelCloud block =
            ranges_.read(begin, std::min(begin + block_, ranges_.size()));
        const surfel::MeshProximity part = surfel::mesh_proximity(block, *mesh_, block.size());
        sum.near += part.near;
        sum.far += part.far;
        if (part.near + part.far > 0) {
          sum.least_distance = std::min(sum.least_distance, part.least_distance);
        }
      }
      return sum;
    };
    check_mesh(sample, ranges_.size(), *mesh_, all, s_, tool_);
  }

  /// What has to be known of all surfels before the first is written.
  void look() {
    surfel::SurfaceLookupReport located;
    double distance = 0;
    for_blocks("looking for texels", [&](surfel::SurfelCloud block, std::size_t begin,
                                         const surfel::SurfaceLookupReport& found) {
      survey_.add(block);
      located.located += found.located;
      located.too_far += found.too_far;
      located.turned_away += found.turned_away;
      distance += found.mean_distance * static_cast<double>(found.located);
      if (textures_) surfel::request_kernels(block, *textures_, s_.fit, s_.input, begin);
      if (normals_ && !relief_) {
        relief_ = surfel::fit_normals(block, *normals_, s_.fit, s_.input).mapped > 0;
      }
    });
    if (textures_) surfel::load_requested(*textures_);
    if (mesh_ && first_.uv.empty()) {
      if (located.located > 0) {
        located.mean_distance = distance / static_cast<double>(located.located);
      }
      tell_located(located, ranges_.size(), s_, tool_);
    }
  }

  void fit() {
    surfel::tool::PieceWriter writer(tool_, s_.output, survey_);
    surfel::TextureFitReport fitted;
    surfel::NormalFitReport normals;
    for_blocks("fitting",
               [&](surfel::SurfelCloud block, std::size_t, const surfel::SurfaceLookupReport&) {
                 if (colors_) {
                   fitted.add(solid_ ? surfel::fit_solid(block, *solid_, s_.fit, s_.input)
                                     : surfel::fit_texture(block, *textures_, s_.fit, s_.input));
                   surfel::show_coefficients(block);
                 }
                 if (normals_)
                   add(surfel::fit_normals(block, *normals_, s_.fit, s_.input), normals);
                 // The surfels of other blocks have some.
                 if (relief_) block.shading_normal.resize(block.size(), surfel::Vec3f(0, 0, 0));
                 writer.append(std::move(block));
               });
    if (colors_) tell_fit(fitted, !first_.area.empty(), s_, tool_);
    if (normals_) {
      if (normals.mapped > 0) {
        normals.mean_tilt /= static_cast<double>(normals.mapped);
        normals.mean_variance /= static_cast<double>(normals.mapped);
      }
      tell_normals(normals, ranges_.size(), s_, tool_);
    }
    writer.commit();
    tool_.wrote(s_.output, fmt::format("{} surfels", ranges_.size()));
  }

  /// Adds figures of a block: means become sums.
  static void add(const surfel::NormalFitReport& block, surfel::NormalFitReport& sum) {
    sum.mapped += block.mapped;
    sum.unmapped += block.unmapped;
    sum.without_frame += block.without_frame;
    sum.mean_tilt += block.mean_tilt * static_cast<double>(block.mapped);
    sum.mean_variance += block.mean_variance * static_cast<double>(block.mapped);
    for (const auto& [stage, milliseconds] : block.times.stages()) {
      sum.times.add(stage, milliseconds);
    }
  }

  surfel::tool::Tool& tool_;
  Settings& s_;
  const surfel::CloudRanges& ranges_;
  std::size_t block_;
  surfel::SurfelCloud first_;
  surfel::CloudSurvey survey_;
  std::optional<surfel::TriangleMesh> mesh_;
  std::optional<surfel::NormalMaps> normals_;
  std::optional<surfel::SolidTexture> solid_;
  std::optional<surfel::TextureSet> textures_;
  bool colors_ = false;  ///< Colours are fitted, and not normals alone.
  bool relief_ = false;  ///< Some surfel gets a normal.
};

/// Bytes that surfels take while they are textured.
std::uint64_t texture_bytes(std::size_t surfels, const surfel::SurfelCloud& first,
                            const Settings& s) {
  // What they get, and what is noted of each. Systems of equations take 2.5 kB a surfel and more.
  constexpr std::size_t kFilter = 120;
  constexpr std::size_t kSystem = 2500;
  const bool system = s.fit.kind != surfel::TextureFitKind::kEwa;
  return std::uint64_t{surfels} * (surfel::row_bytes(first) + (system ? kSystem : kFilter));
}

/// Textures a file that is larger than the memory, if that can be done; false if it has to fit.
bool texture_larger(surfel::tool::Tool& tool, Settings& s, std::uint64_t memory) {
  if (!surfel::tool::may_not_fit(s.input, memory)) return false;
  const auto ranges = surfel::CloudRanges::open(s.input);
  if (!ranges || ranges->size() == 0) return false;
  const surfel::SurfelCloud first = ranges->read(0, 1);
  const std::uint64_t bytes = texture_bytes(ranges->size(), first, s);
  if (bytes <= memory) return false;
  if (s.fit.kind != surfel::TextureFitKind::kEwa) {
    surfel::throw_input(
        surfel::tool::shown_name(s.input),
        fmt::format("a system of equations for its {} surfels takes {} MB in memory or more, of "
                    "which {} MB are allowed (--memory); --fit ewa needs no system, and fits any "
                    "number of surfels",
                    ranges->size(), (bytes >> 20) + 1, memory >> 20));
  }
  constexpr std::uint64_t kLeast = 1 << 12;
  constexpr std::uint64_t kMost = 1 << 20;
  const std::uint64_t block =
      std::clamp(memory / 2 / (2 * texture_bytes(1, first, s)), kLeast, kMost);
  BlockTexturing(tool, s, *ranges, static_cast<std::size_t>(block)).run();
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-texture",
                          "Gives surfels the coefficients w_k of a texture, filtered for each.");
  Settings settings;
  declare_options(tool.app(), settings);
  tool.everyday(
      {"--output", "--image", "--mesh", "--fit", "--from", "--cutoff", "--solid", "--normal-map",
       "--bump", "--bump-scale", "--memory"},
      {"surfel-texture lion.ply --image lion.png -o textured.ply",
       "surfel-texture lion.ply --mesh lion.obj --fit render -o textured.ply",
       "surfel-texture lion.ply --solid marble:9 --light white --dark gray -o marble.ply"});
  tool.reads_images();
  tool.files().reads({"surfels", "--image", "--mesh", "--normal-map", "--bump"});
  tool.files().writes("--output", surfel::tool::Writes::kSurfels);
  tool.name_fields({{"robust_scale", "--robust"}, {"y_down", "--normal-y"}});
  return tool.run(argc, argv, [&] {
    if (settings.bounds) settings.fit.bounds = {settings.bounds->x(), settings.bounds->y()};
    check(tool.app(), settings);
    settings.fit.coverage = surfel::coverage_threshold(settings.fit.cutoff);
    const std::uint64_t memory = surfel::memory_to_use(settings.memory);
    if (texture_larger(tool, settings, memory)) return;
    surfel::tool::require_room(settings.input, {}, memory,
                               [&](std::size_t surfels, const surfel::SurfelCloud& first) {
                                 return texture_bytes(surfels, first, settings);
                               });
    texture_in_memory(tool, settings);
  });
}
