#include "tools/texture/messages.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel::texture_tool {
namespace {

double degrees(double radians) { return radians * 180 / std::numbers::pi; }

tool::Json to_json(const Vec3f& v) { return {v.x(), v.y(), v.z()}; }

void report(tool::Json& json, const TextureFitReport& fit) {
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
  tool::add_stages(json, fit.times);
  if (!fit.system) return;
  const SystemReport& system = *fit.system;
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
    const RobustReport& robust = *system.robust;
    json["system"]["robust"] = {{"scale", robust.scale},
                                {"rounds", robust.rounds},
                                {"down_weighted", robust.down_weighted},
                                {"cost", robust.cost}};
  }
  if (system.variance) {
    const VarianceFitReport& variance = *system.variance;
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
  return s.from == From::kTexture && s.fit.kind == TextureFitKind::kGram &&
         s.fit.right_side != GramRightSide::kNormalised;
}

void warn(const tool::Tool& tool, const std::string& input, const TextureFitReport& fit) {
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

}  // namespace

void check_mesh(const SurfelCloud& sample, std::size_t surfels, const TriangleMesh& mesh,
                FunctionRef<MeshProximity()> all, const Settings& s, tool::Tool& tool) {
  if (sample.empty() || !has_variance(sample)) return;
  if (mesh_proximity(sample, mesh, sample.size()).far == 0) return;
  const MeshProximity found = all();
  tool.report()["far_from_mesh"] = found.far;
  if (found.near == 0) {
    throw_input(s.input,
                fmt::format("none of its {} surfels lies on {}: the nearest is {:.3g} away; give "
                            "the mesh that the surfels were sampled from, at its own place",
                            surfels, s.mesh, found.least_distance));
  }
  const double share = static_cast<double>(found.far) / static_cast<double>(surfels);
  tool.note(fmt::format(
      "{}: {} of {} surfels ({:.3g} %) do not lie on {}, but more than 3 standard deviations away",
      s.input, found.far, surfels, 100 * share, s.mesh));
}

void check_mesh(const SurfelCloud& cloud, const TriangleMesh& mesh, const Settings& s,
                tool::Tool& tool) {
  const std::size_t count = std::min(kMeshSample, cloud.size());
  Array<std::uint32_t> rows(count);
  for (std::size_t k = 0; k < count; ++k) {
    rows[k] = static_cast<std::uint32_t>(k * cloud.size() / count);
  }
  check_mesh(
      cloud.gathered(rows), cloud.size(), mesh,
      [&] { return mesh_proximity(cloud, mesh, cloud.size()); }, s, tool);
}

void tell_located(const SurfaceLookupReport& found, std::size_t surfels, const Settings& s,
                  tool::Tool& tool) {
  tool::Json& json = tool.report();
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

void tell_fit(const TextureFitReport& fit, bool areas, const Settings& s, tool::Tool& tool) {
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

void tell_normals(const NormalFitReport& fit, std::size_t surfels, const Settings& s,
                  tool::Tool& tool) {
  tool::Json& json = tool.report();
  const double spread = degrees(std::sqrt(fit.mean_variance));
  json["normals"] = {{"mapped", fit.mapped},
                     {"unmapped", fit.unmapped},
                     {"without_frame", fit.without_frame},
                     {"mean_tilt", degrees(fit.mean_tilt)},
                     {"spread", spread}};
  tool::add_stages(json["normals"], fit.times);
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

}  // namespace surfel::texture_tool
