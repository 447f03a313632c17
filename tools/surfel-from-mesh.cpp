// surfel-from-mesh: surfels that cover a mesh.

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <surfel/base/shell_quote.h>
#include <surfel/base/timing.h>
#include <surfel/io/mesh_io.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/adaptive_spacing.h>
#include <surfel/texture/texture_source.h>

#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

using namespace surfel;

struct Request {
  std::string mesh;
  std::string output;
  MeshSampleOptions options;
  double crease_angle_deg = MeshSampleOptions{}.crease_angle * 180 / std::numbers::pi;
  bool adaptive = false;
  AdaptiveSpacingOptions adapt;
  TextureSourceOptions texture;
};

void declare(tool::Tool& tool, Request& r) {
  tool::CommandLine& app = tool.app();
  app.add_option("mesh", r.mesh, "Triangles (OBJ, PLY, STL, OFF, glTF)")->required();
  app.add_option("-o,--output", r.output,
                 "Surfels to write (PLY, PCD, LAS, LAZ; - = standard output)")
      ->required();
  app.add_option("--spacing", r.options.spacing,
                 "Mean spacing in scene units: the root of the area per sample");
  app.add_option("--count", r.options.count,
                 "Samples instead of a spacing: exactly this many, unless the mesh has more "
                 "components or no room for them, then as near as possible");
  app.add_option("--seed", r.options.seed, "Seed of the pattern");
  app.add_flag("--flat", r.options.flat, "Normals of the faces instead of smooth ones");
  app.add_option("--variance-scale", r.options.variance_scale,
                 "Standard deviation of the kernels in units of the spacing; 0.7 is the sharpest "
                 "without holes, 1 is that of SS01");
  app.add_option("--crease-angle", r.crease_angle_deg,
                 "Faces that meet at a larger angle share no normal, where the mesh has none of "
                 "its own; degrees");

  app.add_flag("--clip", r.options.clip,
               "Surfels end at the mesh's borders and at creases of more than --crease-angle, with "
               "mirrored surfels beyond, on top of --count; for meshes with sharp edges");

  app.group("Adaptive spacing");
  app.add_flag("--adaptive", r.adaptive,
               "Small surfels where texture or shape have detail, large ones elsewhere; with "
               "--max-error or --count");
  app.add_option("--max-error", r.adapt.max_error,
                 "Of --adaptive: the fewest surfels whose error is this: root mean square over the "
                 "surface, seen from near, of the colour's error (linear light, 1 = black against "
                 "white) together with the shape's (in units of --unit-deviation)");
  app.add_option("--unit-deviation", r.adapt.unit_deviation,
                 "Of --adaptive: distance between surfels and surface that counts as much as black "
                 "against white, scene units; default: 1/30 of the bounding box's diagonal");
  app.add_option("--image", r.texture.image,
                 "Of --adaptive: the image that the surfels are going to get, as in "
                 "surfel-texture; default: those of the mesh's materials");
  tool::add_choice(
      app, "--wrap", r.texture.wrap,
      {{"repeat", WrapMode::kRepeat}, {"mirror", WrapMode::kMirror}, {"clamp", WrapMode::kClamp}},
      "Of --adaptive: what lies beyond the image's borders; default: as the mesh's materials say, "
      "else repeat");
  app.group("Options");
}

void check(const tool::CommandLine& app, const Request& r) {
  std::vector<std::string> problems;
  if (r.adaptive) {
    problems = r.adapt.problems();
    if (r.options.spacing) {
      problems.emplace_back("--spacing has no effect with --adaptive; give --max-error or --count");
    }
  } else {
    problems = tool::without_effect(app, {"--max-error", "--unit-deviation", "--image", "--wrap"},
                                    "without --adaptive");
    tool::append(problems, r.options.problems());
  }
  tool::require_valid(problems);
}

/// The mesh's spacing, adapted to its detail.
SizingField adapt(const TriangleMesh& mesh, Request& r, tool::Json& json, const tool::Tool& tool) {
  const bool textured = !r.texture.image.empty() ||
                        (!mesh.wedge_uv.empty() &&
                         std::any_of(mesh.material.begin(), mesh.material.end(),
                                     [](const MeshMaterial& m) { return !m.texture.empty(); }));
  std::optional<TextureSet> textures;
  if (textured) textures = load_textures(r.texture, &mesh, r.mesh);
  AdaptiveSpacingReport report;
  SizingField field =
      adaptive_spacing(mesh, textures ? &*textures : nullptr, r.adapt, &report, r.mesh);
  json["adaptive"] = {{"probes", report.probes},
                      {"cells", report.cells},
                      {"unit_deviation", report.unit_deviation},
                      {"error", report.error},
                      {"color_error", report.color_error},
                      {"shape_error", report.shape_error},
                      {"least_spacing", report.least_spacing},
                      {"reached", report.reached}};
  tool::add_stages(json, report.times);
  tool.note(
      fmt::format("{}: expected error {:.3g} (colour {:.3g}, shape {:.3g} of {:.3g} units), "
                  "spacing from {:.3g} up",
                  r.mesh, report.error, report.color_error, report.shape_error,
                  report.unit_deviation, report.least_spacing));
  if (!report.reached) {
    tool.note(
        fmt::format("{}: the error stays above {:.3g} at the finest spacing that is looked at",
                    r.mesh, *r.adapt.max_error));
  }
  return field;
}

void fill_report(tool::Json& json, const SurfelCloud& cloud, const MeshSampleReport& report) {
  json["surfels"] = cloud.size();
  json["faces"] = report.faces;
  json["degenerate_faces"] = report.degenerate_faces;
  json["repeated_faces"] = report.repeated_faces;
  json["flat_uv_faces"] = report.flat_uv_faces;
  json["components"] = report.components;
  json["eliminated"] = report.eliminated;
  json["border_edges"] = report.edges.border;
  json["non_manifold_edges"] = report.edges.non_manifold;
  json["inconsistent_edges"] = report.edges.inconsistent;
  json["clipped"] = report.clipped;
  json["mirrored"] = report.mirrored;
  json["area"] = report.area;
  json["spacing"] = report.spacing;
  // A single sample has no distance to others; JSON has no infinity.
  if (std::isfinite(report.least_distance)) json["least_distance"] = report.least_distance;
  json["mean_distance"] = report.mean_distance;
  tool::add_stages(json, report.times);
}

/// One line about the edges that a closed surface would not have; nothing where there are none.
std::string unsound_edges(const std::string& mesh, const EdgeCounts& edges) {
  std::string found;
  const auto add = [&](std::size_t count, const char* kind) {
    if (count > 0) found += fmt::format("{}{} {}", found.empty() ? "" : ", ", count, kind);
  };
  add(edges.border, "of one face (surfels end there)");
  add(edges.non_manifold, "of three faces or more (sheets touch there)");
  add(edges.inconsistent, "of two faces that face opposite ways (so do their surfels)");
  if (found.empty()) return found;
  return fmt::format("{}: has edges {}; `surfel-info {}` tells more; a mesh editor can mend them",
                     mesh, found, shell_file(mesh));
}

void tell(const tool::Tool& tool, const Request& r, const TriangleMesh& mesh,
          const SurfelCloud& cloud, const MeshSampleReport& report) {
  for (const std::string& note : mesh.notes) tool.note(r.mesh + ": " + note);
  if (report.degenerate_faces > 0) {
    tool.note(fmt::format("{}: {} faces without area skipped", r.mesh, report.degenerate_faces));
  }
  if (report.repeated_faces > 0) {
    tool.note(
        fmt::format("{}: {} faces that repeat another skipped", r.mesh, report.repeated_faces));
  }
  const std::string unsound = unsound_edges(r.mesh, report.edges);
  if (!unsound.empty()) tool.note(unsound);
  if (report.flat_uv_faces > 0) {
    tool.note(fmt::format("{}: {} faces have uv without area; dpdu and dpdv are zero there", r.mesh,
                          report.flat_uv_faces));
  }
  const std::size_t samples = cloud.size() - report.mirrored;
  if (r.options.count && samples != *r.options.count) {
    tool.note(fmt::format(
        "{}: {} samples instead of {}: its {} components {}", r.mesh, samples, *r.options.count,
        report.components,
        samples > *r.options.count ? "need one each at least" : "have no room for more"));
  }
  const std::string clipped = report.clipped > 0
                                  ? fmt::format(", {} end at edges, {} of them mirrored beyond",
                                                report.clipped, report.mirrored)
                                  : "";
  tool.wrote(r.output,
             fmt::format("{} surfels, spacing {:.4g}{}", cloud.size(), report.spacing, clipped));
}

}  // namespace

int main(int argc, char** argv) {
  tool::Tool tool("surfel-from-mesh",
                  "Covers a mesh with evenly spread surfels: blue noise, sheet by sheet.");
  Request request;
  declare(tool, request);
  tool.everyday(
      {"--output", "--count", "--spacing", "--adaptive", "--max-error", "--image", "--flat",
       "--seed"},
      {"surfel-from-mesh lion.obj --count 100k -o lion.ply",
       "surfel-from-mesh lion.obj --spacing 0.01 --flat -o lion.ply",
       "surfel-from-mesh lion.obj --adaptive --max-error 0.05 --image lion.png -o lion.ply"});
  tool.reads_images();
  tool.reads_named_files();
  tool.files().reads({"mesh", "--image"});
  tool.files().writes("--output", tool::Writes::kSurfels);
  return tool.run(argc, argv, [&] {
    request.options.crease_angle = request.crease_angle_deg * std::numbers::pi / 180;
    request.adapt.count = request.options.count;
    request.adapt.seed = request.options.seed;
    request.adapt.variance_scale = request.options.variance_scale;
    check(tool.app(), request);
    Timer timer;
    const TriangleMesh mesh = read_mesh(request.mesh);
    tool.report()["load_ms"] = timer.milliseconds();
    std::optional<SizingField> field;
    if (request.adaptive) {
      field = adapt(mesh, request, tool.report(), tool);
      request.options.field = &*field;
      if (!request.options.count) request.options.spacing = 1;
      tool::require_valid(request.options.problems());
    }
    MeshSampleReport report;
    SurfelCloud cloud = sample_mesh(mesh, request.options, &report, request.mesh);
    fill_report(tool.report(), cloud, report);
    timer.restart();
    tool::write_result(tool, cloud, request.output);
    tool.report()["write_ms"] = timer.milliseconds();
    tell(tool, request, mesh, cloud, report);
  });
}
