// Where pictures of sampled meshes end.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/sample/mesh_sampler.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

struct EdgeError {
  double bias;    ///< Mean distance of the edges found from the true ones, outwards, pixels.
  double spread;  ///< Its standard deviation.
};

EdgeError summed_up(const std::vector<double>& errors) {
  EdgeError e{0, 0};
  for (const double d : errors) e.bias += d / static_cast<double>(errors.size());
  for (const double d : errors) e.spread += (d - e.bias) * (d - e.bias);
  e.spread = std::sqrt(e.spread / static_cast<double>(errors.size()));
  return e;
}

/// Keeps figures for docs/rendering.md: --gtest_output=xml shows them.
void note(const std::string& name, double spacing, const EdgeError& e) {
  testing::Test::RecordProperty(
      name + "_" + std::to_string(static_cast<int>(2 * spacing)) + "_half",
      std::to_string(e.bias) + " " + std::to_string(e.spread));
}

/// A polygon in z = 0 as a fan of triangles; convex.
TriangleMesh polygon(const std::vector<Vec2d>& corner) {
  TriangleMesh mesh;
  for (const Vec2d& p : corner) mesh.position.push_back(Vec3d(p.x(), p.y(), 0).cast<float>());
  for (std::uint32_t i = 2; i < corner.size(); ++i) mesh.face.push_back({0, i - 1, i});
  return mesh;
}

constexpr int kSize = 96;

Image alpha_of(const TriangleMesh& mesh, double spacing_px, double cutoff, std::uint64_t seed) {
  MeshSampleOptions sampling;
  sampling.spacing = spacing_px * 2 / kSize;
  sampling.seed = seed;
  sampling.clip = true;
  RenderOptions options;
  options.cutoff = cutoff;
  return render_unlit(sample_mesh(mesh, sampling), square_camera(kSize), options);
}

/// The half plane left of a line that is turned by 0.2 radians. A row's sum of alpha is where the
/// edge is: a symmetric filter leaves it as it is.
EdgeError half_plane(double spacing_px, double cutoff) {
  constexpr double kSlope = 0.2;
  const auto x_at = [](double y) { return 0.13 + kSlope * y; };
  const TriangleMesh mesh = polygon({{-4, -3}, {x_at(-3), -3}, {x_at(3), 3}, {-4, 3}});
  std::vector<double> errors;
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const Image image = alpha_of(mesh, spacing_px, cutoff, seed);
    for (int row = 2; row < kSize - 2; ++row) {
      double sum = 0;
      for (int x = 0; x < kSize; ++x) sum += image.pixel(x, row)[3];
      const double y = 1 - (row + 0.5) * 2 / kSize;
      const double edge = (x_at(y) + 1) / 2 * kSize;
      // Across the edge, not along the row.
      errors.push_back((sum - edge) / std::sqrt(1 + kSlope * kSlope));
    }
  }
  return summed_up(errors);
}

TEST(Edges, OfAHalfPlaneAreWhereTheMeshEnds) {
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    for (const double spacing : {0.5, 2.0, 12.0}) {
      const EdgeError e = half_plane(spacing, cutoff);
      note("c" + std::to_string(static_cast<int>(cutoff)), spacing, e);
      EXPECT_LT(std::abs(e.bias), 0.05) << cutoff << ' ' << spacing;
      EXPECT_LT(e.spread, cutoff < 2 ? 0.15 : 0.1) << cutoff << ' ' << spacing;
    }
  }
}

/// Corners of 90 and of 50 degrees: the sum of alpha is the area.
TEST(Edges, OfAWedgeEncloseItsArea) {
  for (const double degrees : {90.0, 50.0}) {
    const double a = degrees * M_PI / 180;
    for (const double spacing : {0.5, 1.0, 4.0, 12.0}) {
      const Vec2d tip(-0.7, -0.6);
      const Vec2d first = tip + 1.3 * Vec2d(std::cos(0.1), std::sin(0.1));
      const Vec2d second = tip + 1.3 * Vec2d(std::cos(0.1 + a), std::sin(0.1 + a));
      const TriangleMesh mesh = polygon({tip, first, second});
      const double area = 0.5 * 1.3 * 1.3 * std::sin(a) * kSize * kSize / 4;
      const double length = (2.6 + (first - second).norm()) * kSize / 2;
      std::vector<double> errors;
      for (std::uint64_t seed = 1; seed <= 4; ++seed) {
        const Image image = alpha_of(mesh, spacing, 2, seed);
        double sum = 0;
        for (int y = 0; y < kSize; ++y) {
          for (int x = 0; x < kSize; ++x) sum += image.pixel(x, y)[3];
        }
        errors.push_back((sum - area) / length);  // Of the border, pixels.
      }
      const EdgeError e = summed_up(errors);
      EXPECT_LT(std::abs(e.bias), 0.05) << degrees << " degrees, spacing " << spacing;
    }
  }
}

/// A disc of 0.7: along rays from its middle alpha sums up to the radius.
TEST(Edges, OfADiscAreRound) {
  std::vector<Vec2d> corner;
  for (int i = 0; i < 96; ++i) {
    const double angle = 2 * M_PI * i / 96;
    corner.emplace_back(0.7 * std::cos(angle), 0.7 * std::sin(angle));
  }
  const TriangleMesh mesh = polygon(corner);
  // Of the circle that has the polygon's area.
  const double radius = 0.7 * kSize / 2 * std::sqrt(std::sin(2 * M_PI / 96) / (2 * M_PI / 96));
  for (const double spacing : {0.5, 1.0, 2.0, 4.0}) {
    const Image image = alpha_of(mesh, spacing, 2, 1);
    std::vector<double> errors;
    for (int k = 0; k < 180; ++k) {
      const double angle = 2 * M_PI * k / 180;
      double sum = 0;
      constexpr double kStep = 0.05;
      for (double r = kStep / 2; r < 45; r += kStep) {
        // Bilinear between pixel centres.
        const double x = kSize / 2.0 + r * std::cos(angle) - 0.5;
        const double y = kSize / 2.0 - r * std::sin(angle) - 0.5;
        const int i = static_cast<int>(std::floor(x));
        const int j = static_cast<int>(std::floor(y));
        const auto at = [&](int p, int q) { return static_cast<double>(image.pixel(p, q)[3]); };
        const double u = x - i;
        const double v = y - j;
        sum += kStep * ((1 - v) * ((1 - u) * at(i, j) + u * at(i + 1, j)) +
                        v * ((1 - u) * at(i, j + 1) + u * at(i + 1, j + 1)));
      }
      errors.push_back(sum - radius);
    }
    const EdgeError e = summed_up(errors);
    note("disc", spacing, e);
    EXPECT_LT(std::abs(e.bias), 0.05) << spacing;
    EXPECT_LT(e.spread, 0.1) << spacing;
  }
}

/// Two faces that meet at a crease in the middle of the picture, both of which are seen: nothing
/// shines through between them.
TEST(Edges, CreasesAreClosed) {
  TriangleMesh mesh;
  for (const float x : {-3.0F, 3.0F}) {
    mesh.position.insert(mesh.position.end(), {{x, -3, -2.9F}, {x, 0.05F, 0}, {x, 3, -2.9F}});
  }
  mesh.face = {{0, 3, 4}, {0, 4, 1}, {1, 4, 5}, {1, 5, 2}};
  for (const double spacing : {0.5, 1.0, 4.0, 12.0}) {
    const Image image = alpha_of(mesh, spacing, 2, 1);
    double least = 1;
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) least = std::min<double>(least, image.pixel(x, y)[3]);
    }
    EXPECT_GT(least, 0.99) << spacing;
  }
}

}  // namespace
}  // namespace surfel::test
