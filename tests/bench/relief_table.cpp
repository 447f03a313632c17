// Plain light, eye-dome lighting and occlusion in screen space beside rays, for docs/rendering.md:
// a row of its table for each surface and size. Usage: relief_table MESH... ("terrain" is
// made); with RELIEF_PICTURES set to a folder, the pictures go there.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/parallel.h>
#include <surfel/base/plugin.h>
#include <surfel/base/random.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/measure/view_guess.h>
#include <surfel/render/renderer.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/sample/smooth_normals.h>
#include <surfel/scene/framing.h>
#include <surfel/store/render_cloud.h>
#include <surfel/truth/mesh_renderer.h>
#include <surfel/truth/mesh_tracer_plugin.h>

namespace surfel {
namespace {

constexpr int kRays = 256;  // Of a vertex: a deviation of 0.03 at most.
constexpr int kTimed = 7;

TriangleMesh terrain() {
  constexpr std::uint32_t kSide = 500;
  const ProceduralScene scene = procedural_scene("terrain", 1);
  TriangleMesh mesh;
  for (std::uint32_t y = 0; y <= kSide; ++y) {
    for (std::uint32_t x = 0; x <= kSide; ++x) {
      const Vec2d uv(static_cast<double>(x) / kSide, static_cast<double>(y) / kSide);
      mesh.position.push_back(scene.parts.front().shape->at(uv.x(), uv.y()).position.cast<float>());
      if (x == kSide || y == kSide) continue;
      const std::uint32_t a = y * (kSide + 1) + x;
      const std::uint32_t b = a + kSide + 1;
      mesh.face.push_back({a, a + 1, b});
      mesh.face.push_back({a + 1, b + 1, b});
    }
  }
  return mesh;
}

/// Share of an even sky that each vertex sees, by rays.
void bake_occlusion(TriangleMesh& mesh) {
  auto* const make =
      reinterpret_cast<MakeMeshTracer*>(plugin_symbol("trace", kMakeMeshTracerSymbol));
  const std::unique_ptr<MeshTracer> tracer(make({mesh.position.front().data(), mesh.position.size(),
                                                 mesh.face.front().data(), mesh.face.size()}));
  Array<Vec3f> normal(mesh.position.size(), Vec3f(0, 0, 0));
  Bounds box;
  for (const auto& face : mesh.face) {
    const Vec3f& p = mesh.position[face[0]];
    const Vec3f across = (mesh.position[face[1]] - p).cross(Vec3f(mesh.position[face[2]] - p));
    for (const std::uint32_t v : face) {
      normal[v] += across;
      box.add(mesh.position[v].cast<double>());
    }
  }
  const auto lift = static_cast<float>(1e-4 * box.diagonal());
  mesh.color.assign(mesh.position.size(), SurfelCloud::colorless());
  parallel_for(mesh.position.size(), 256, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t v = begin; v < end; ++v) {
      if (normal[v].squaredNorm() == 0) continue;  // Of no face.
      const Vec3f n = normal[v].normalized();
      const Vec3f u = n.unitOrthogonal();
      const Vec3f w = n.cross(u);
      const Vec3f from = mesh.position[v] + lift * n;
      int open = 0;
      for (int i = 0; i < kRays; ++i) {
        const double r2 = (i + random_uniform(1, v, 2 * i)) / kRays;
        const double phi = 2 * std::numbers::pi * random_uniform(1, v, 2 * i + 1);
        const auto r = static_cast<float>(std::sqrt(r2));
        const auto up = static_cast<float>(std::sqrt(1 - r2));
        const Vec3f d = r * static_cast<float>(std::cos(phi)) * u +
                        r * static_cast<float>(std::sin(phi)) * w + up * n;
        const MeshRay ray{{from.x(), from.y(), from.z()}, {d.x(), d.y(), d.z()}};
        open += tracer->nearest(ray) ? 0 : 1;
      }
      mesh.color[v] *= static_cast<float>(open) / kRays;
    }
  });
}

/// The lit mesh, its sky hidden where the mesh hides it.
/// \param occluded  the mesh with bake_occlusion().
Image truth_of(const TriangleMesh& mesh, const TriangleMesh& occluded, const Scene& scene,
               const Camera& camera) {
  const MeshRenderOptions options{.samples = 4};
  Scene sky = scene;
  sky.lights.clear();
  Scene lamps = scene;
  lamps.sky.reset();
  lamps.ambient = {0, 0, 0};
  Image image = MeshRenderer(mesh, nullptr, lamps, options).render(camera);
  const Image hidden = MeshRenderer(occluded, nullptr, sky, options).render(camera);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int c = 0; c < 3; ++c) image.pixel(x, y)[c] += hidden.pixel(x, y)[c];
    }
  }
  return image;
}

/// Root mean square of the difference of what the light makes of white, where both pictures are
/// covered.
double error(const Image& image, const Image& truth) {
  double sum = 0;
  double count = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (image.pixel(x, y)[3] < 0.999F || truth.pixel(x, y)[3] < 0.999F) continue;
      const double d = image.pixel(x, y)[1] - truth.pixel(x, y)[1];
      sum += d * d;
      ++count;
    }
  }
  return std::sqrt(sum / count) / SurfelCloud::colorless().x();
}

struct Measured {
  double rms, frame_ms, relief_ms;
};

Measured measure(RenderCloud& surfels, const Scene& scene, const Camera& camera, const Image& truth,
                 Relief relief, const std::string& keep) {
  RenderOptions options;
  options.relief = relief;
  Renderer renderer(surfels, scene, options);
  Measured out{};
  std::vector<double> frame, stage;
  for (int i = 0; i < kTimed; ++i) {
    FrameStatistics statistics;
    Image image = renderer.render(camera, &statistics);
    frame.push_back(statistics.milliseconds);
    stage.push_back(0);
    for (const auto& [name, ms] : statistics.stages.stages()) {
      if (name == "relief") stage.back() = ms;
    }
    if (i > 0) continue;
    out.rms = error(image, truth);
    if (!keep.empty()) write_image(image, keep);
  }
  const auto median = [](std::vector<double>& v) {
    std::nth_element(v.begin(), v.begin() + kTimed / 2, v.end());
    return v[kTimed / 2];
  };
  out.frame_ms = median(frame);
  out.relief_ms = median(stage);
  return out;
}

void rows(const std::string& file) {
  const TriangleMesh mesh = file == "terrain" ? terrain() : read_mesh(file);
  const std::string name = std::filesystem::path(file).stem();
  const SurfelCloud cloud = sample_mesh(mesh, {.spacing = {}, .count = 1000000});
  RenderCloud surfels(cloud);
  TriangleMesh occluded = mesh;
  bake_occlusion(occluded);
  for (const int size : {512, 1024}) {
    CameraOptions view;
    view.width = view.height = size;
    aim_camera(view, {}, guess_view(sample_surface(mesh)));
    const Camera camera = make_camera(view, surfels.extent());
    Scene scene = default_scene();
    scene.sky->up = view.up_or_y();
    const Image truth = truth_of(mesh, occluded, scene, camera);
    const char* keep = std::getenv("RELIEF_PICTURES");
    const auto picture = [&](const char* kind) {
      return keep ? fmt::format("{}/{}-{}-{}.png", keep, name, size, kind) : std::string();
    };
    if (keep) write_image(truth, picture("truth"));
    const auto of = [&](Relief relief, const char* kind) {
      return measure(surfels, scene, camera, truth, relief, picture(kind));
    };
    const Measured plain = of(Relief::kNone, "plain");
    const Measured dome = of(Relief::kEyeDome, "eye-dome");
    const Measured occlusion = of(Relief::kOcclusion, "occlusion");
    fmt::print("| {} | {} | {:.3f} | {:.3f} | {:.3f} | {:.0f} | {:.1f} | {:.1f} |\n", name, size,
               plain.rms, dome.rms, occlusion.rms, plain.frame_ms, dome.relief_ms,
               occlusion.relief_ms);
    std::fflush(stdout);
  }
}

}  // namespace
}  // namespace surfel

int main(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) surfel::rows(argv[i]);
}
