#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh.h>
#include <surfel/sample/mesh_sampler.h>
#include <tools/support/tool.h>

namespace {

using namespace surfel;

struct Request {
  std::string mesh;
  std::string output;
  MeshSampleOptions options;
  double crease_angle_deg = MeshSampleOptions{}.crease_angle * 180 / std::numbers::pi;
};

void declare(tool::Tool& tool, Request& r) {
  CLI::App& app = tool.app();
  app.add_option("mesh", r.mesh, "Triangles (OBJ, PLY, STL, OFF)")->required();
  app.add_option("-o,--output", r.output, "Surfels to write (PLY, PCD; - = standard output)")
      ->required();
  app.add_option("--spacing", r.options.spacing,
                 "Mean spacing in scene units: the root of the area per sample");
  app.add_option("--count", r.options.count,
                 "Samples instead of a spacing: exactly this many, unless the mesh has more "
                 "components or no room for them, then as near as possible");
  app.add_option("--seed", r.options.seed, "Seed of the pattern");
  app.add_flag("--flat", r.options.flat, "Normals of the faces instead of smooth ones");
  app.add_option("--variance-scale", r.options.variance_scale,
                 "Standard deviation of the kernels in units of the spacing");
  app.add_option("--crease-angle", r.crease_angle_deg,
                 "Faces that meet at a larger angle share no normal, where the mesh has none of "
                 "its own; degrees");
}

void fill_report(nlohmann::json& json, const SurfelCloud& cloud, const MeshSampleReport& report) {
  json["surfels"] = cloud.size();
  json["faces"] = report.faces;
  json["degenerate_faces"] = report.degenerate_faces;
  json["flat_uv_faces"] = report.flat_uv_faces;
  json["components"] = report.components;
  json["area"] = report.area;
  json["spacing"] = report.spacing;
  // A single sample has no distance to others; JSON has no infinity.
  if (std::isfinite(report.least_distance)) json["least_distance"] = report.least_distance;
  json["mean_distance"] = report.mean_distance;
  for (const auto& [name, milliseconds] : report.times.stages()) {
    json["stages"][name] = milliseconds;
  }
}

void tell(const tool::Tool& tool, const Request& r, const SurfelCloud& cloud,
          const MeshSampleReport& report) {
  if (report.degenerate_faces > 0) {
    tool.note(fmt::format("{}: {} faces without area skipped", r.mesh, report.degenerate_faces));
  }
  if (report.flat_uv_faces > 0) {
    tool.note(fmt::format("{}: {} faces have uv without area; dpdu and dpdv are zero there", r.mesh,
                          report.flat_uv_faces));
  }
  if (r.options.count && cloud.size() != *r.options.count) {
    tool.note(fmt::format(
        "{}: {} samples instead of {}: its {} components {}", r.mesh, cloud.size(),
        *r.options.count, report.components,
        cloud.size() > *r.options.count ? "need one each at least" : "have no room for more"));
  }
  tool.note(fmt::format("{}: {} surfels, spacing {:.4g}", r.output, cloud.size(), report.spacing));
}

}  // namespace

int main(int argc, char** argv) {
  tool::Tool tool("surfel-from-mesh",
                  "Covers a mesh with evenly spread surfels: blue noise, sheet by sheet.");
  Request request;
  declare(tool, request);
  return tool.run(argc, argv, [&] {
    request.options.crease_angle = request.crease_angle_deg * std::numbers::pi / 180;
    tool::require_valid(request.options.problems());
    Timer timer;
    const TriangleMesh mesh = read_mesh(request.mesh);
    tool.report()["load_ms"] = timer.milliseconds();
    MeshSampleReport report;
    SurfelCloud cloud = sample_mesh(mesh, request.options, &report, request.mesh);
    cloud.provenance.push_back(tool.provenance());
    fill_report(tool.report(), cloud, report);
    timer.restart();
    write_cloud(cloud, request.output, {.no_clobber = tool.common().no_clobber});
    tool.report()["write_ms"] = timer.milliseconds();
    tell(tool, request, cloud, report);
  });
}
