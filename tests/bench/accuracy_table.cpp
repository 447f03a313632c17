// Prints the tables of docs/accuracy.md: the fast renderer against the reference. See
// tests/accuracy.sh, which calls it.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_io.h>
#include <surfel/render/renderer.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/scene/framing.h>
#include <surfel/truth/image_error.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/source_ewa.h>

#include "render/inverse_jacobian.h"
#include "render/scenes.h"

namespace {

using namespace surfel;
using namespace surfel::test;

constexpr int kSize = 128;  ///< Of the pictures, pixels.

/// Checkerboard of cells four spacings wide over the plane's own coordinates.
void color_checkered(SurfelCloud& cloud, double spacing) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto cell = [&](float x) { return static_cast<int>(std::floor(x / (4 * spacing))); };
    const bool odd = ((cell(cloud.position[i].x()) + cell(cloud.position[i].y())) & 1) != 0;
    cloud.coefficient[i] = odd ? Vec3f(0.9F, 0.8F, 0.3F) : Vec3f(0.05F, 0.1F, 0.3F);
  }
}

/// A scene as seen: `camera` sees `cloud` so that neighbours are about `spacing` pixels apart.
struct View {
  std::string scene;
  double spacing;
  std::string angle;
  SurfelCloud cloud;
  Camera camera;
};

Camera orbit_camera(double distance, double angle) {
  CameraOptions options;
  const double radians = angle * M_PI / 180;
  options.eye = Vec3d(0, -distance * std::sin(radians), distance * std::cos(radians));
  options.target = Vec3d(0, 0, 0);
  options.up = Vec3d(0.02, 1, 0.01);
  options.width = options.height = kSize;
  return make_camera(options, SceneExtent{});
}

/// Pixels that a scene unit at the target measures.
double pixels_per_unit(const Camera& camera, double distance) { return camera.focal_x / distance; }

/// On screen the plane is at most `side` pixels wide.
View plane_view(double spacing, double side, double angle, std::uint64_t seed = 1) {
  const double distance = 4;
  View view{"plane", spacing, fmt::format("{}", angle), {}, orbit_camera(distance, angle)};
  const double h = spacing / pixels_per_unit(view.camera, distance);
  const int n = std::max(6, static_cast<int>(side / spacing));
  view.cloud = jittered_plane(n, n * h / 2, 0.35, seed);
  color_checkered(view.cloud, h);
  return view;
}

/// A sphere so that neighbours in its middle are `spacing` pixels apart; checkered, too.
View sphere_view(double spacing, double diameter) {
  const double distance = 4;
  View view{"sphere", spacing, "", {}, orbit_camera(distance, 20)};
  const double radius = diameter / 2 / pixels_per_unit(view.camera, distance);
  const double h = spacing / pixels_per_unit(view.camera, distance - radius);
  view.cloud = fibonacci_sphere(
      std::max(40, static_cast<int>(4 * M_PI * radius * radius / (h * h))), radius);
  color_checkered(view.cloud, h);
  return view;
}

/// A cloud framed so that it fills the picture, moved in or away until its spacing is right.
View framed_view(const std::string& scene, SurfelCloud cloud, double spacing) {
  View view{scene, spacing, "", std::move(cloud), {}};
  RenderCloud surfels(view.cloud);
  double area = 0;
  for (std::size_t i = 0; i < surfels.size(); ++i) area += surfels.area[i];
  const double h = std::sqrt(area / static_cast<double>(surfels.size()));
  CameraOptions options;
  options.from = Vec3d(0.5, 0.3, 1);
  options.width = options.height = kSize;
  const Camera framed = make_camera(options, surfels.extent());
  const double distance = (framed.eye - view.cloud.bounds().center()).norm();
  options.zoom = spacing / (h * pixels_per_unit(framed, distance));
  view.camera = make_camera(options, surfels.extent());
  return view;
}

/// Means over several pictures.
struct Psnr {
  double inside = 0;  ///< The silhouette; NaN where no pixel is covered in both pictures.
  double whole = 0;
  int pictures = 0;

  void add(const Image& image, const Image& truth) {
    ImageErrorOptions options;
    options.inside_only = true;
    whole += std::min(image_error(image, truth).psnr, 99.9);
    try {
      inside += std::min(image_error(image, truth, options).psnr, 99.9);
    } catch (const Error&) {
      inside = std::numeric_limits<double>::quiet_NaN();
    }
    ++pictures;
  }
  std::string text() const {
    return (std::isnan(inside) ? "-" : fmt::format("{:.1f}", inside / pictures)) +
           fmt::format(" / {:.1f}", whole / pictures);
  }
};

/// Rows of means over views that differ by their random numbers alone.
void rows(const std::vector<View>& views) {
  const Scene scene;
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    std::array<Psnr, 6> columns;
    for (const View& view : views) {
      RenderCloud surfels(view.cloud);
      RenderOptions options;
      options.lit = false;
      options.layers = 8;
      options.cutoff = cutoff;
      const Image truth = ReferenceRenderer(surfels, scene, options).render(view.camera);
      const auto fast = [&] { return Renderer(surfels, scene, options).render(view.camera); };
      std::size_t column = 0;
      for (const Kernel kernel : {Kernel::kAffine, Kernel::kPerspective, Kernel::kAuto}) {
        options.kernel = kernel;
        columns[column++].add(fast(), truth);
      }
      columns[column++].add(SourceEwaRenderer(surfels, scene, options).render(view.camera), truth);
      for (const Filter filter : {Filter::kCircular, Filter::kNone}) {
        options.filter = filter;
        columns[column++].add(fast(), truth);
      }
    }
    std::string row = fmt::format("| {} | {:g} | {} | {:g} |", views[0].scene, views[0].spacing,
                                  views[0].angle, cutoff);
    for (const Psnr& psnr : columns) row += fmt::format(" {} |", psnr.text());
    fmt::print("{}\n", row);
    std::fflush(stdout);
  }
}

void fast_against_reference(const std::vector<std::string>& mesh_clouds) {
  fmt::print(
      "## The fast renderer against the reference\n\nPSNR in dB of sRGB values, inside the "
      "silhouette / whole picture, of {0} x {0} pixels against `--reference` (16 x 16 rays a\n"
      "pixel), 8 layers, unlit, h_s = 1 pixel. Spacing: between neighbours on screen, pixels (35: "
      "splats of 100 pixels); c: cutoff.\nTextures are checkers of four spacings. Planes and "
      "transparent "
      "scenes: means over four sets of samples.\n\n"
      "| scene | spacing | angle | c | affine | perspective | auto | ewa-source | circular | none "
      "|\n|---|---|---|---|---|---|---|---|---|---|\n",
      kSize);
  struct Distance {
    double spacing, side;
  };
  for (const Distance& d : {Distance{35, 400}, Distance{1, 150}, Distance{0.1, 60}}) {
    for (const double angle : {0.0, 45.0, 75.0, 85.0}) {
      // The fewer pixels a row has, the more it depends on where its samples happen to lie.
      std::vector<View> views;
      for (const std::uint64_t seed : {1, 2, 3, 4}) {
        views.push_back(plane_view(d.spacing, d.side, angle, seed));
      }
      rows(views);
    }
  }
  for (const Distance& d : {Distance{35, 600}, Distance{1, 150}, Distance{0.1, 60}}) {
    rows({sphere_view(d.spacing, d.side)});
  }
  GenerateOptions generate;
  for (const double spacing : {35.0, 1.0, 0.1}) {
    generate.count = spacing > 1 ? 3000 : spacing == 1 ? 60000 : 200000;
    std::vector<View> views;
    for (const std::uint64_t seed : {1, 2, 3, 4}) {
      generate.seed = seed;
      views.push_back(framed_view("transparent",
                                  generate_surfels(procedural_scene("transparent", seed), generate),
                                  spacing));
    }
    rows(views);
  }
  const double spacings[] = {35, 1, 0.1};
  for (std::size_t i = 0; i < std::min<std::size_t>(3, mesh_clouds.size()); ++i) {
    rows({framed_view("textured mesh", read_cloud(mesh_clouds[i]), spacings[i])});
  }
}

void convergence(const std::vector<std::string>& mesh_clouds) {
  fmt::print(
      "\n## Convergence of the reference\n\nPSNR in dB between n x n and 2n x 2n rays a pixel, "
      "spacing 1 pixel, c = 1.\n\n| scene | 4, 8 | 8, 16 | 16, 32 |\n|---|---|---|---|\n");
  std::vector<View> views;
  views.push_back(plane_view(1, 150, 45));
  views.push_back(sphere_view(1, 150));
  if (mesh_clouds.size() > 1) {
    views.push_back(framed_view("textured mesh", read_cloud(mesh_clouds[1]), 1));
  }
  for (const View& view : views) {
    RenderCloud surfels(view.cloud);
    const Scene scene;
    RenderOptions options;
    options.lit = false;
    Image last;
    std::string row = fmt::format("| {} |", view.scene);
    for (const int n : {4, 8, 16, 32}) {
      Image image = ReferenceRenderer(surfels, scene, options, {.samples = n}).render(view.camera);
      if (n > 4) row += fmt::format(" {:.1f} |", image_error(last, image).psnr);
      last = std::move(image);
    }
    fmt::print("{}\n", row);
  }
}

void jacobian() {
  fmt::print(
      "\n## Jacobian\n\nSigma = J J^T by the inverse of J^-1 (SS01 section 4) and directly, "
      "against "
      "long double: largest relative error / failures (not\nfinite, or off by a tenth) of 900 "
      "normals at each angle to the line of sight.\n\n| angle | inverse, float | direct, float | "
      "inverse, double | direct, double |\n|---|---|---|---|---|\n");
  const auto cell = [](const JacobianErrors& e) {
    return fmt::format(" {:.0e} / {} |", e.largest, e.failed);
  };
  const auto inverse = [](const auto& P, const auto& n) { return Sigma_by_inverse(P, n); };
  const auto direct = [](const auto& P, const auto& n) { return Sigma_direct(P, n); };
  for (const double angle : {0.0, 60.0, 85.0, 89.0, 89.9, 89.99, 89.999, 89.9999, 89.99999, 90.0}) {
    fmt::print("| {:g} |{}{}{}{}\n", angle, cell(jacobian_errors<float>(angle, inverse)),
               cell(jacobian_errors<float>(angle, direct)),
               cell(jacobian_errors<double>(angle, inverse)),
               cell(jacobian_errors<double>(angle, direct)));
  }
}

void cost() {
  fmt::print(
      "\n## Cost of --kernel auto\n\n1 million surfels, 512 x 512 pixels, unlit, c = 1, {} "
      "threads; "
      "best of 12 frames, in turns.\n\n| scene | affine | auto | perspective "
      "|\n|---|---|---|---|\n",
      thread_count());
  for (const char* kind : {"head", "terrain"}) {
    GenerateOptions generate;
    generate.count = 1000000;
    RenderCloud surfels(generate_surfels(procedural_scene(kind, 1), generate));
    const Scene scene;
    CameraOptions camera_options;
    const Camera camera = make_camera(camera_options, surfels.extent());
    double best[3];
    std::fill_n(best, 3, std::numeric_limits<double>::infinity());
    RenderOptions options;
    options.lit = false;
    std::vector<std::unique_ptr<Renderer>> renderers;
    for (const Kernel kernel : {Kernel::kAffine, Kernel::kAuto, Kernel::kPerspective}) {
      options.kernel = kernel;
      renderers.push_back(std::make_unique<Renderer>(surfels, scene, options));
    }
    for (int repeat = 0; repeat < 12; ++repeat) {
      for (int i = 0; i < 3; ++i) {
        FrameStatistics statistics;
        renderers[static_cast<std::size_t>(i)]->render(camera, &statistics);
        best[i] = std::min(best[i], statistics.milliseconds);
      }
    }
    fmt::print("| {} | {:.1f} ms | {:.1f} ms | {:.1f} ms |\n", kind, best[0], best[1], best[2]);
  }
}

}  // namespace

/// Arguments: clouds of a textured mesh for the three distances.
int main(int argc, char** argv) {
  const std::vector<std::string> mesh_clouds(argv + 1, argv + argc);
  cost();
  convergence(mesh_clouds);
  jacobian();
  fmt::print("\n");
  fast_against_reference(mesh_clouds);
}
