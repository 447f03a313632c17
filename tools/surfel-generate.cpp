// surfel-generate: surfels, meshes and images from formulas.

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/nearest_name.h>
#include <surfel/base/progress.h>
#include <surfel/base/shell_quote.h>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/hard_cases.h>
#include <surfel/sample/procedural_image.h>
#include <surfel/sample/procedural_sky.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>
#include <surfel/scene/triangle_mesh.h>

#include "tools/support/options.h"
#include "tools/support/surfels.h"
#include "tools/support/tool.h"

namespace {

using namespace surfel;

/// Surfels that are in memory at once: about 500 MB with the scratch that makes them.
constexpr std::size_t kPiece = std::size_t{2} << 20;

struct Request {
  std::string kind;
  std::string hard_case;
  std::string output;
  std::string image;
  GenerateOptions surfels;
  int width = 512;
  int height = 512;
  bool size_given = false;
  std::string mesh;
  int resolution = 256;
  std::string texture;
  double frequency = ProceduralTextureOptions{}.frequency;
};

bool is_texture(const std::string& kind) {
  const auto& names = procedural_texture_names();
  return std::find(names.begin(), names.end(), kind) != names.end();
}

/// Throws Error(kUsage) for a kind that is none.
void require_kind(const std::string& kind) {
  std::vector<std::string> kinds = procedural_scene_names();
  tool::append(kinds, procedural_texture_names());
  kinds.emplace_back(kSkyName);
  if (std::find(kinds.begin(), kinds.end(), kind) != kinds.end()) return;
  throw_usage(fmt::format("kind: '{}' is not one of {}{}", kind, fmt::join(kinds, ", "),
                          did_you_mean(kind, kinds)));
}

void declare(tool::Tool& tool, Request& r) {
  tool::CommandLine& app = tool.app();
  app.add_option("kind", r.kind,
                 fmt::format("Surface ({}), image ({}) or lat-long environment map (sky)",
                             fmt::join(procedural_scene_names(), ", "),
                             fmt::join(procedural_texture_names(), ", ")));
  std::string cases;
  for (const HardCase& info : hard_cases()) {
    cases += fmt::format("\n  {}{}: {}", info.name,
                         info.has_value() ? fmt::format("[:{:g}]", info.value) : "", info.what);
  }
  app.add_option("--case", r.hard_case,
                 "Instead of a kind, a place where methods fail, NAME or NAME:NUMBER (in brackets: "
                 "the number unless given)" +
                     cases);
  app.add_option("-o,--output", r.output,
                 "Surfels to write (PLY, PCD; - = standard output); the picture for an image kind");
  app.add_option("--count", r.surfels.count, "Surfels, exactly");
  app.add_option("--seed", r.surfels.seed, "Seed of the pattern, of relief and of noise");
  app.add_option("--jitter", r.surfels.jitter,
                 "Offset from the cell's centre, +- this part of the spacing, 0 to 0.5");
  app.add_option("--variance-scale", r.surfels.variance_scale,
                 "Standard deviation of the kernels in units of the spacing");
  app.add_flag("!--no-uv", r.surfels.uv,
               "Surfels without u, v, dpdu, dpdv: 39 bytes each instead of 71");
  app.add_option(
      "--mesh", r.mesh,
      "Write the surface as triangles with uv to this file (OBJ, PLY); with --image, its "
      "material names that picture");
  app.add_option("--resolution", r.resolution,
                 "Cells of the mesh along u and v of every part, 3 to 16384");
  app.add_option("--image", r.image,
                 "Write the surface's texture, or the picture of an image kind, to this file")
      ->expected(0, 1);
  tool::add_size(app, "--size", r.width, r.height,
                 "Size of the image in pixels; of the sky 1024x512 unless given");
  app.add_option("--texture", r.texture,
                 fmt::format("Texture for the surface instead of its own: {}",
                             fmt::join(procedural_texture_names(), ", ")));
  app.add_option(
      "--frequency", r.frequency,
      "Squares, pairs of spokes or noise cells per unit of uv, for --texture and images");
}

/// Options that do nothing for the kind asked for must not be given.
void refuse(tool::Tool& tool, const std::string& kind, const std::vector<std::string>& options) {
  tool::require_valid(tool::without_effect(tool.app(), options, "on " + kind));
}

/// Options that surfels and meshes alone have.
const std::vector<std::string> kSurfaceOptions{
    "--count", "--jitter", "--variance-scale", "--no-uv", "--mesh", "--texture", "--resolution"};

const std::string& picture_path(const Request& r, tool::Writes what) {
  const std::string& path = r.image.empty() ? r.output : r.image;
  if (path.empty()) throw_usage("nothing to write; name the picture with --image");
  if (!r.image.empty() && !r.output.empty()) {
    throw_usage("--output and --image both name the picture; give one of them");
  }
  tool::require_format(path, what);
  return path;
}

void generate_sky(tool::Tool& tool, const Request& r) {
  refuse(tool, r.kind, kSurfaceOptions);
  refuse(tool, r.kind, {"--seed", "--frequency"});
  const std::string& path = picture_path(r, tool::Writes::kSky);
  tool::write_picture(
      tool, r.size_given ? procedural_sky(r.width, r.height) : procedural_sky(1024, 512), path);
}

void generate_picture(tool::Tool& tool, const Request& r) {
  refuse(tool, r.kind, kSurfaceOptions);
  const std::string& path = picture_path(r, tool::Writes::kPicture);
  ProceduralTextureOptions options;
  options.frequency = r.frequency;
  options.seed = r.surfels.seed;
  tool::write_picture(tool, rasterize(procedural_texture(r.kind, options), r.width, r.height),
                      path);
}

/// Surfels are written in space-filling order: readers then need not sort them, and files of any
/// size can be streamed.
void write_surfels(tool::Tool& tool, const ProceduralScene& scene, const Request& r) {
  const Timer timer;
  CloudWriter writer(r.output, r.surfels.count, {.no_clobber = tool.common().no_clobber});
  std::size_t done = 0;
  ProgressStage stage("generating", r.surfels.count, "surfels");
  const auto append = [&](SurfelCloud&& piece) {
    piece.provenance.push_back(tool.provenance());
    writer.append(piece);
    done += piece.size();
    stage.add(piece.size());
  };
  if (r.surfels.count <= kPiece) {
    const SurfelCloud cloud = generate_surfels(scene, r.surfels);
    append(cloud.gathered(morton_order(cloud.position)));
  } else {
    generate_surfels_in_order(scene, r.surfels, kPiece, append);
  }
  writer.commit();
  tool.report()["generate_ms"] = timer.milliseconds();
  tool.report()["surfels"] = done;
  tool.wrote(r.output, fmt::format("{} surfels", done));
}

void generate_surface(tool::Tool& tool, const Request& r) {
  const bool no_clobber = tool.common().no_clobber;
  if (r.output.empty() && r.image.empty() && r.mesh.empty()) {
    throw_usage("nothing to write; name a file with --output, --mesh or --image");
  }
  tool::require_format(r.output, tool::Writes::kSurfels);
  const ProceduralScene scene = procedural_scene(r.kind, r.surfels.seed, r.texture, r.frequency);
  if (!r.output.empty()) {
    write_surfels(tool, scene, r);
  }
  if (!r.mesh.empty()) {
    const TriangleMesh mesh = generate_mesh(scene, r.resolution, r.image);
    write_mesh(mesh, r.mesh, {.no_clobber = no_clobber});
    tool.wrote(r.mesh, fmt::format("{} faces", mesh.face.size()));
  }
  if (!r.image.empty()) {
    tool::write_picture(tool, generate_texture(scene, r.width, r.height), r.image);
  }
}

void generate_hard_case(tool::Tool& tool, const Request& r) {
  const std::string what = "--case";
  if (!r.kind.empty()) throw_usage("--case stands instead of a kind; give one of them");
  refuse(tool, what,
         {"--count", "--jitter", "--variance-scale", "--resolution", "--texture", "--frequency",
          "--size"});
  const HardScene scene = make_hard_case(r.hard_case, r.surfels.seed);
  if (!scene.mesh) refuse(tool, what + " " + r.hard_case, {"--mesh"});
  if (!scene.image) refuse(tool, what + " " + r.hard_case, {"--image"});
  if (r.output.empty() && r.image.empty() && r.mesh.empty()) {
    throw_usage("nothing to write; name a file with --output");
  }
  tool::require_format(r.output, tool::Writes::kSurfels);
  const bool no_clobber = tool.common().no_clobber;
  if (!r.output.empty()) {
    SurfelCloud cloud = scene.cloud;
    tool::write_result(tool, cloud, r.output);
    tool.report()["surfels"] = cloud.size();
    tool.report()["view"] = view_options(scene.view);
    tool.wrote(r.output, fmt::format("{} surfels to be seen with surfel-render {} {} -o OUT",
                                     cloud.size(), shell_file(r.output), view_options(scene.view)));
  }
  if (!r.mesh.empty()) {
    TriangleMesh mesh = *scene.mesh;
    if (!r.image.empty()) {
      mesh.material.push_back({"surface", Vec3f(1, 1, 1), r.image});
      mesh.face_material.assign(mesh.face.size(), 0);
    }
    write_mesh(mesh, r.mesh, {.no_clobber = no_clobber});
    tool.wrote(r.mesh, fmt::format("{} faces", mesh.face.size()));
  }
  if (!r.image.empty()) tool::write_picture(tool, *scene.image, r.image);
}

}  // namespace

int main(int argc, char** argv) {
  tool::Tool tool("surfel-generate",
                  "Makes surfels, meshes and images whose truth is known, from formulas.");
  Request request;
  declare(tool, request);
  tool.everyday({"--output", "--count", "--mesh", "--image", "--size", "--texture", "--frequency",
                 "--seed", "--case"},
                {"surfel-generate sphere --count 100k -o sphere.ply",
                 "surfel-generate checker --size 1024 --frequency 16 -o checker.png",
                 "surfel-generate head --mesh head.obj --image head.png"});
  tool.files().writes("--output", tool::Writes::kAny);
  tool.files().writes("--mesh", tool::Writes::kMesh);
  tool.files().writes("--image", tool::Writes::kPicture);
  return tool.run(argc, argv, [&] {
    tool::require_valid(request.surfels.problems());
    request.size_given = tool.app().get_option("--size")->count() > 0;
    if (!request.hard_case.empty()) return generate_hard_case(tool, request);
    if (request.kind.empty()) throw_usage("nothing to make; name a surface, an image, or a --case");
    require_kind(request.kind);
    if (request.kind == kSkyName) {
      generate_sky(tool, request);
    } else if (is_texture(request.kind)) {
      generate_picture(tool, request);
    } else {
      generate_surface(tool, request);
    }
  });
}
