#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh.h>
#include <surfel/texture/texture_fit.h>
#include <surfel/texture/texture_source.h>

#include "tools/support/options.h"
#include "tools/support/tool.h"

namespace {

struct Settings {
  std::string input;
  std::string output;
  std::string mesh;
  surfel::TextureSourceOptions source;
  surfel::TextureFitOptions fit;
  bool no_charts = false;
};

void declare_options(CLI::App& app, Settings& s) {
  using namespace surfel;
  app.add_option("surfels", s.input, "Surfels with uv (PLY, PCD; - = standard input)")->required();
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
      "What lies beyond the image's borders; OBJ files mean repeat");
  tool::add_choice(app, "--fit", s.fit.kind, {{"ewa", TextureFitKind::kEwa}},
                   "How coefficients are found: ewa = view-independent EWA");
  app.add_option("--reconstruction", s.fit.reconstruction,
                 "Standard deviation of the texture's reconstruction kernel, texels, 0.25..16")
      ->capture_default_str();
  app.add_option("--max-aspect", s.fit.max_aspect,
                 "Kernels longer than this many times their width are widened, 1..10000")
      ->capture_default_str();
  app.add_flag("--exact", s.fit.exact,
               "Sum over the image's own texels whatever it takes, instead of a pyramid's");
}

void check(const Settings& s) {
  std::vector<std::string> problems = s.fit.problems();
  if (s.source.image.empty() && s.mesh.empty()) {
    problems.emplace_back("there is neither --image nor --mesh; give one");
  }
  surfel::tool::require_valid(problems);
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
  for (const auto& [stage, ms] : fit.times.stages()) json["stages"][stage] = ms;
}

void warn(const surfel::tool::Tool& tool, const std::string& input,
          const surfel::TextureFitReport& fit) {
  const auto count = [&](std::size_t surfels, const std::string& what) {
    if (surfels > 0) {
      tool.note(fmt::format("{}: {} of {} surfels {}", input, surfels, fit.surfels, what));
    }
  };
  count(fit.without_uv, "have no finite u, v: given the image's mean colour");
  count(fit.without_kernel, "have no usable derivatives or variance: given the colour at a point");
  count(fit.outside_charts, "lie on no chart of the mesh: filtered without one");
}

}  // namespace

int main(int argc, char** argv) {
  surfel::tool::Tool tool("surfel-texture",
                          "Gives surfels the coefficients w_k of a texture, filtered for each.");
  Settings settings;
  declare_options(tool.app(), settings);
  return tool.run(argc, argv, [&] {
    check(settings);
    surfel::Timer timer;
    surfel::SurfelCloud cloud = surfel::read_cloud(settings.input);
    std::optional<surfel::TriangleMesh> mesh;
    if (!settings.mesh.empty()) mesh = surfel::read_mesh(settings.mesh);
    settings.source.charts = !settings.no_charts;
    settings.source.whole = false;
    surfel::TextureSet textures =
        surfel::load_textures(settings.source, mesh ? &*mesh : nullptr, settings.mesh);
    tool.report()["load_ms"] = timer.milliseconds();

    const surfel::TextureFitReport fit =
        surfel::fit_texture(cloud, textures, settings.fit, settings.input);
    report(tool.report(), fit);
    warn(tool, settings.input, fit);

    cloud.provenance.push_back(tool.provenance());
    surfel::write_cloud(cloud, settings.output, {.no_clobber = tool.common().no_clobber});
    tool.note(fmt::format("{}: {} surfels", settings.output, cloud.size()));
  });
}
