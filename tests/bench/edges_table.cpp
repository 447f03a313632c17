// Prints the tables of edges in docs/estimation.md: where lines of surfel-estimate --clip lie, and
// how many surfels of smooth shapes lines cut; tests/estimation.sh calls it.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/estimate/estimate.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/scene/clips.h>

#include "support/side_scenes.h"

namespace {

using namespace surfel;
using namespace surfel::test;

std::string test_data(const std::string& name) {
  const char* data = std::getenv("SURFEL_TEST_DATA");
  return fmt::format("{}/{}", data ? data : SURFEL_TEST_DATA_DEFAULT, name);
}

enum class Pattern : std::uint8_t { kBlueNoise, kRandom, kGrid };

SidedPoints of_cloud(const SurfelCloud& cloud) {
  SidedPoints out;
  out.position = cloud.position;
  out.truth = cloud.normal;
  double area = 0;
  for (const float a : cloud.area) area += static_cast<double>(a);
  out.spacing = std::sqrt(area / static_cast<double>(cloud.size()));
  return out;
}

SidedPoints of_mesh(const TriangleMesh& mesh, std::size_t count) {
  MeshSampleOptions options;
  options.count = count;
  return of_cloud(sample_mesh(mesh, options));
}

TriangleMesh polygon(const std::vector<Vec2d>& corner) {
  TriangleMesh mesh;
  for (const Vec2d& p : corner) mesh.position.push_back(Vec3d(p.x(), p.y(), 0).cast<float>());
  for (std::uint32_t i = 2; i < corner.size(); ++i) mesh.face.push_back({0, i - 1, i});
  return mesh;
}

TriangleMesh cube_mesh() {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.position.push_back(Vec3d(2 * (i % 2) - 1, i / 2 % 2 * 2 - 1, i / 4 * 2 - 1).cast<float>());
  }
  const std::uint32_t quad[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                    {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& q : quad) {
    mesh.face.push_back({q[0], q[1], q[2]});
    mesh.face.push_back({q[0], q[2], q[3]});
  }
  return mesh;
}

/// Points of the square [-1, 1]^2 that `holds`, turned by 0.3 radians.
SidedPoints plate(Pattern pattern, std::size_t count,
                  const std::function<bool(double, double)>& holds, const TriangleMesh& mesh,
                  double area) {
  if (pattern == Pattern::kBlueNoise) return of_mesh(mesh, count);
  SidedPoints out;
  out.spacing = std::sqrt(area / static_cast<double>(count));
  if (pattern == Pattern::kRandom) {
    const auto all = static_cast<std::uint64_t>(4 / (out.spacing * out.spacing));
    for (std::uint64_t i = 0; i < all; ++i) {
      const double x = 2 * random_uniform(5, i, 0) - 1;
      const double y = 2 * random_uniform(5, i, 1) - 1;
      if (holds(x, y)) out.add(Vec3d(x, y, 0), Vec3d(0, 0, 1));
    }
    return out;
  }
  const int n = static_cast<int>(1.5 / out.spacing);
  const double c = std::cos(0.3);
  const double s = std::sin(0.3);
  for (int j = -n; j <= n; ++j) {
    for (int i = -n; i <= n; ++i) {
      const double x = (c * i - s * j) * out.spacing;
      const double y = (s * i + c * j) * out.spacing;
      if (std::max(std::abs(x), std::abs(y)) < 1 && holds(x, y)) {
        out.add(Vec3d(x, y, 0), Vec3d(0, 0, 1));
      }
    }
  }
  return out;
}

SurfelCloud estimated(const SidedPoints& points, EstimateReport* report = nullptr) {
  SurfelCloud cloud;
  cloud.position = points.position;
  EstimateOptions options;
  options.edges.emplace();
  return estimate_surfels(cloud, options, report);
}

/// Prints how far lines end beyond the true edges, in spacings.
/// \param beyond  distance of a point from the edge next to it, outward, unless it is near a
/// corner.
void line_row(const std::string& name, const SidedPoints& points,
              const std::function<double(const Vec3d&)>& beyond,
              const std::function<bool(const Vec3d&, double)>& counts) {
  EstimateReport report;
  const SurfelCloud cloud = estimated(points, &report);
  std::vector<double> error;
  std::size_t near = 0;
  std::size_t cut = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = cloud.position[i].cast<double>();
    if (!counts(p, 4 * points.spacing)) continue;
    const bool close = beyond(p) > -0.7 * points.spacing;
    near += close ? 1 : 0;
    if (!is_clipped(cloud, i)) continue;
    cut += close ? 1 : 0;
    const Vec3d foot =
        p + static_cast<double>(cloud.clip1_distance[i]) * cloud.clip1[i].cast<double>();
    error.push_back(beyond(foot) / points.spacing);
  }
  double mean = 0;
  double square = 0;
  for (const double e : error) mean += e / static_cast<double>(error.size());
  for (const double e : error)
    square += (e - mean) * (e - mean) / static_cast<double>(error.size());
  fmt::print("| {} | {} | {:.1f} % | {:.3f} / {:.3f} | {} / {} | {} / {} |\n", name, cloud.size(),
             100.0 * static_cast<double>(cut) / static_cast<double>(std::max<std::size_t>(near, 1)),
             mean, std::sqrt(square), report.creases.points, report.creases.unsure,
             report.borders.points, report.borders.unsure);
  std::fflush(stdout);
}

/// Prints which share of a smooth surface's surfels lines cut, by the noise in spacings.
void smooth_row(const std::string& name, const SidedPoints& whole) {
  fmt::print("| {} |", name);
  for (const double noise : {0.0, 0.1, 0.3, 0.5, 1.0}) {
    EstimateReport report;
    const SurfelCloud cloud = estimated(damaged(whole, {.noise = noise}), &report);
    const auto share = [&](std::size_t n) {
      return 100 * static_cast<double>(n) / static_cast<double>(cloud.size());
    };
    fmt::print(" {:.2f} / {:.2f} % |", share(report.creases.points), share(report.borders.points));
    std::fflush(stdout);
  }
  fmt::print("\n");
}

}  // namespace

int main() {
  fmt::print(
      "| points | number | cut | off, mean / deviation | at creases / unsure | at borders / unsure "
      "|\n|---|---|---|---|---|---|\n");
  const TriangleMesh square = polygon({{-1, -1}, {1, -1}, {1, 1}, {-1, 1}});
  std::vector<Vec2d> corner;
  for (int i = 0; i < 360; ++i) {
    const double a = 2 * std::numbers::pi * i / 360;
    corner.emplace_back(std::cos(a), std::sin(a));
  }
  const TriangleMesh disc = polygon(corner);
  const auto off_corners = [](const Vec3d& p, double reach) {
    return std::min(std::abs(p.x()), std::abs(p.y())) < 1 - reach;
  };
  const auto all = [](const Vec3d&, double) { return true; };
  const auto beyond_square = [](const Vec3d& p) { return p.cwiseAbs().maxCoeff() - 1; };
  const auto beyond_disc = [](const Vec3d& p) { return p.norm() - 1; };
  const char* names[] = {"blue noise", "random", "grid"};
  for (const Pattern pattern : {Pattern::kBlueNoise, Pattern::kRandom, Pattern::kGrid}) {
    const char* kind = names[static_cast<int>(pattern)];
    line_row(fmt::format("square, {}", kind),
             plate(
                 pattern, 10000, [](double, double) { return true; }, square, 4),
             beyond_square, off_corners);
    line_row(fmt::format("disc, {}", kind),
             plate(
                 pattern, 10000, [](double x, double y) { return x * x + y * y < 1; }, disc,
                 std::numbers::pi),
             beyond_disc, all);
  }
  const auto beyond_cube = [](const Vec3d& p) {
    Vec3d a = p.cwiseAbs();
    std::sort(a.begin(), a.end());
    return a[1] - 1;
  };
  const auto off_cube_corners = [](const Vec3d& p, double reach) {
    return p.cwiseAbs().minCoeff() < 1 - reach;
  };
  const SidedPoints cube = of_mesh(cube_mesh(), 10000);
  for (const double noise : {0.0, 0.1, 0.2, 0.3, 0.5}) {
    line_row(fmt::format("cube, noise {}", noise), damaged(cube, {.noise = noise}), beyond_cube,
             off_cube_corners);
  }
  const double side = std::sqrt(24.0 / 10000);
  line_row("cube, random", box_points({{{-1, -1, -1}, {1, 1, 1}}}, side), beyond_cube,
           off_cube_corners);

  fmt::print(
      "\n`surfel-from-mesh` puts blue noise onto the borders themselves, so that lines end a "
      "quarter "
      "of a spacing outside there.\n\nPoints of smooth surfaces beside creases / at borders, by "
      "noise; the bunny has holes, and both it and the armadillo have folds and rims narrower than "
      "a spacing:\n");
  fmt::print(
      "\n| smooth surface | no noise | 0.1 | 0.3 | 0.5 | 1 spacing |\n|---|---|---|---|---|---|\n");
  GenerateOptions generate;
  generate.count = 40000;
  smooth_row("sphere", of_cloud(generate_surfels(procedural_scene("sphere", 1), generate)));
  generate.count = 5000;
  smooth_row("torus", of_cloud(generate_surfels(procedural_scene("torus", 1), generate)));
  for (const char* name : {"stanford_bunny.obj", "armadillo.ply"}) {
    smooth_row(name, of_mesh(read_mesh(test_data(fmt::format("meshes/{}", name))), 60000));
  }
  SidedPoints kitten = of_cloud(read_cloud(test_data("raw_scans/kitten.xyz")));
  kitten.spacing = 0.019;  // Its points have no areas.
  smooth_row("kitten", kitten);
}
