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
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/normal_fit.h>
#include <surfel/texture/normal_maps.h>
#include <surfel/texture/surface_lookup.h>
#include <surfel/texture/texture_fit.h>
#include <surfel/texture/texture_source.h>

#include "tools/support/normal_maps.h"
#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"
#include "tools/texture/settings.h"

namespace {

using surfel::texture_tool::From;
using surfel::texture_tool::Settings;

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
    surfel::texture_tool::refuse_fits(tool.app());
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
      surfel::texture_tool::refuse_fits(tool_.app());
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
  surfel::texture_tool::declare_options(tool.app(), settings);
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
    surfel::texture_tool::settle(tool.app(), settings);
    const std::uint64_t memory = surfel::memory_to_use(settings.memory);
    if (texture_larger(tool, settings, memory)) return;
    surfel::tool::require_room(settings.input, {}, memory,
                               [&](std::size_t surfels, const surfel::SurfelCloud& first) {
                                 return texture_bytes(surfels, first, settings);
                               });
    texture_in_memory(tool, settings);
  });
}
