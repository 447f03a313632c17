// Where pictures of sampled meshes end.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>
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
      EXPECT_LT(std::abs(e.bias), 0.03) << cutoff << ' ' << spacing;
      EXPECT_LT(e.spread, cutoff < 2 ? 0.15 : 0.1) << cutoff << ' ' << spacing;
    }
  }
}

/// A line may stand in either pair of columns.
TEST(Edges, MayBeOfTheSecondLineAlone) {
  SurfelCloud first = fibonacci_sphere(500, 1);
  for (const Vec3f& n : first.normal) {
    first.clip1.push_back(n.cross(Vec3f(0.3F, 1, 0.2F)).normalized());
    first.clip1_distance.push_back(0.01F);
  }
  SurfelCloud second = first;
  std::swap(second.clip1, second.clip2);
  std::swap(second.clip1_distance, second.clip2_distance);
  const Camera camera = camera_at(3, 64);
  EXPECT_TRUE(render_unlit(first, camera).data == render_unlit(second, camera).data);
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

/// The convex polygon around points, counter-clockwise (Andrew's monotone chain).
std::vector<Vec2d> convex_hull(std::vector<Vec2d> points) {
  std::sort(points.begin(), points.end(), [](const Vec2d& a, const Vec2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  const auto chain = [](auto begin, auto end) {
    std::vector<Vec2d> out;
    for (auto p = begin; p != end; ++p) {
      const auto turns_right = [&] {
        const Vec2d a = out.back() - out[out.size() - 2];
        const Vec2d b = *p - out.back();
        return a.x() * b.y() - a.y() * b.x() <= 0;
      };
      while (out.size() >= 2 && turns_right()) out.pop_back();
      out.push_back(*p);
    }
    out.pop_back();
    return out;
  };
  std::vector<Vec2d> hull = chain(points.begin(), points.end());
  const std::vector<Vec2d> upper = chain(points.rbegin(), points.rend());
  hull.insert(hull.end(), upper.begin(), upper.end());
  return hull;
}

/// A cube's six faces, turned.
TriangleMesh turned_cube(double half, const Eigen::Matrix3d& turn) {
  TriangleMesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d p((corner & 1) != 0 ? half : -half, (corner & 2) != 0 ? half : -half,
                  (corner & 4) != 0 ? half : -half);
    mesh.position.push_back((turn * p).cast<float>());
  }
  constexpr std::uint32_t kSides[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                          {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& [a, b, c, d] : kSides) {
    mesh.face.push_back({a, b, c});
    mesh.face.push_back({a, c, d});
  }
  return mesh;
}

/// Errors of both ends of the rows of a picture of a convex body with this silhouette, away from
/// its corners, where an edge is not flat.
void add_row_errors(const Image& image, const std::vector<Vec2d>& hull,
                    std::vector<double>& errors) {
  constexpr double kFromCorner = 4;
  constexpr double kFlattest = 2;  // Pixels to the side for each row.
  const auto pixels = [](const Vec2d& p) -> Vec2d {
    return {(p.x() + 1) * kSize / 2, (1 - p.y()) * kSize / 2};
  };
  for (int row = 2; row < kSize - 2; ++row) {
    const double y = row + 0.5;
    double x[2];
    double slope[2];
    int found = 0;
    bool near_corner = false;
    for (std::size_t i = 0; i < hull.size(); ++i) {
      const Vec2d a = pixels(hull[i]);
      const Vec2d b = pixels(hull[(i + 1) % hull.size()]);
      near_corner = near_corner || std::abs(a.y() - y) < kFromCorner;
      if ((a.y() < y) == (b.y() < y)) continue;
      const int side = b.y() < a.y() ? 1 : 0;  // Counter-clockwise edges go up on the right.
      slope[side] = (b.x() - a.x()) / (b.y() - a.y());
      x[side] = a.x() + (y - a.y()) * slope[side];
      ++found;
    }
    if (found != 2 || near_corner) continue;
    const double middle = std::floor((x[0] + x[1]) / 2);
    double sum[2] = {0, 0};
    for (int i = 0; i < kSize; ++i) sum[i < middle ? 0 : 1] += image.pixel(i, row)[3];
    const double width[2] = {middle - x[0], x[1] - middle};
    for (int side = 0; side < 2; ++side) {
      if (std::abs(slope[side]) > kFlattest || width[side] < kFromCorner) continue;
      errors.push_back((sum[side] - width[side]) / std::sqrt(1 + slope[side] * slope[side]));
    }
  }
}

TEST(Edges, OfATurningCubeAreWhereTheMeshEnds) {
  constexpr double kHalf = 0.45;
  for (const double cutoff : {1.0, 2.0}) {
    for (const double spacing : {0.5, 2.0, 8.0}) {
      std::vector<double> errors;
      for (int turn = 0; turn < 6; ++turn) {
        const Eigen::Matrix3d rotation =
            (Eigen::AngleAxisd(0.3 + 0.55 * turn, Vec3d(0.2, 1, 0.1).normalized()) *
             Eigen::AngleAxisd(0.5 + 0.2 * turn, Vec3d::UnitX()))
                .toRotationMatrix();
        const TriangleMesh cube = turned_cube(kHalf, rotation);
        std::vector<Vec2d> corners;
        for (const Vec3f& p : cube.position) corners.push_back(p.head<2>().cast<double>());
        add_row_errors(alpha_of(cube, spacing, cutoff, 1), convex_hull(corners), errors);
      }
      ASSERT_GT(errors.size(), 300U);
      const EdgeError e = summed_up(errors);
      note("cube_c" + std::to_string(static_cast<int>(cutoff)), spacing, e);
      EXPECT_LT(std::abs(e.bias), 0.03) << cutoff << ' ' << spacing;
      EXPECT_LT(e.spread, 0.1) << cutoff << ' ' << spacing;
    }
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

/// The root of the mean square error of a picture of a black half-plane before a white plane,
/// beside the half-plane's share of the whole pixel filter: Phi of the distance from its border.
double error_before_a_plane(double spacing_px, double cutoff, double behind) {
  constexpr double kSlope = 0.2;
  const auto x_at = [](double y) { return 0.13 + kSlope * y; };
  MeshSampleOptions sampling;
  sampling.spacing = spacing_px * 2 / kSize;
  sampling.clip = true;
  TriangleMesh mesh = polygon({{-4, -3}, {x_at(-3), -3}, {x_at(3), 3}, {-4, 3}});
  for (const Vec2f& p : {Vec2f(-4, -3), Vec2f(4, -3), Vec2f(4, 3), Vec2f(-4, 3)}) {
    mesh.position.push_back({p.x(), p.y(), -static_cast<float>(behind)});
  }
  mesh.face.insert(mesh.face.end(), {{4, 5, 6}, {4, 6, 7}});
  SurfelCloud cloud = sample_mesh(mesh, sampling);
  cloud.coefficient.clear();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.coefficient.push_back(cloud.world(i).z() < -behind / 2 ? Vec3f::Ones() : Vec3f::Zero());
  }
  RenderOptions options;
  options.cutoff = cutoff;
  const Image image = render_unlit(cloud, square_camera(kSize), options);
  double squares = 0;
  for (int row = 0; row < kSize; ++row) {
    for (int x = 0; x < kSize; ++x) {
      const double edge = (x_at(1 - (row + 0.5) * 2 / kSize) + 1) / 2 * kSize;
      const double distance = (x + 0.5 - edge) / std::sqrt(1 + kSlope * kSlope);
      const double truth = 0.5 * std::erfc(-distance / std::numbers::sqrt2);
      const double error = image.pixel(x, row)[0] - truth;
      squares += error * error;
    }
  }
  return std::sqrt(squares / (kSize * kSize));
}

/// Edges are what lines tell of surfels that are larger than the pixel filter, and what the pixels
/// around tell of others.
TEST(Edges, BeforeAPlaneHaveTheirShareOfThePixelFilter) {
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    // What a surface covers beyond its last kernel, at cutoff 1, is not drawn.
    const double most = cutoff < 2 ? 0.009 : 0.0045;
    for (const double spacing : {0.5, 1.0, 8.0}) {
      EXPECT_LT(error_before_a_plane(spacing, cutoff, 1), most) << spacing << ' ' << cutoff;
    }
    // A plane 2.4 pixels behind.
    EXPECT_LT(error_before_a_plane(0.5, cutoff, 0.05), 2 * most) << cutoff;
  }
}

/// By how many pixels the picture of a black sphere is too large before a white plane, by the sum
/// of what it takes of the plane's light.
double surplus_before_a_plane(double cutoff, int layers, float alpha, std::uint64_t seed) {
  constexpr double kRadius = 0.7;
  constexpr double kDistance = 3;
  const Camera camera = camera_at(kDistance, 160);
  const double pixel = kDistance / camera.focal_x;
  SurfelCloud cloud = jittered_plane(static_cast<int>(4 / pixel), 2, 0.25, seed, -1);
  const SurfelCloud sphere = fibonacci_sphere(
      static_cast<int>(4 * std::numbers::pi * kRadius * kRadius / (pixel * pixel / 4)), kRadius);
  for (std::size_t i = 0; i < cloud.size(); ++i) cloud.coefficient[i] = Vec3f::Ones();
  for (std::size_t i = 0; i < sphere.size(); ++i) {
    add_surfel(cloud, sphere.position[i], sphere.normal[i], sphere.variance[i], sphere.area[i],
               Vec3f::Zero());
  }
  cloud.alpha.assign(cloud.size(), 1.0F);
  cloud.alpha.front() = alpha;
  RenderOptions options;
  options.cutoff = cutoff;
  options.layers = layers;
  const Image image = render_unlit(cloud, camera, options);
  double black = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) black += 1 - image.pixel(x, y)[0];
  }
  // The outline is a circle. The pixel filter leaves its area as it is.
  const double radius =
      camera.focal_x * kRadius / std::sqrt(kDistance * kDistance - kRadius * kRadius);
  return (black - std::numbers::pi * radius * radius) / (2 * std::numbers::pi * radius);
}

TEST(Edges, BeforeAnotherSurfaceAreWhereTheyAreBeforeNothing) {
  for (const double cutoff : {1.0, 2.0, 4.0}) {
    for (const int layers : {4, 16}) {
      for (const float alpha : {1.0F, 254.0F / 255}) {
        const double surplus = surplus_before_a_plane(cutoff, layers, alpha, 3);
        RecordProperty(fmt::format("sphere_{}_{}_{:.3f}", cutoff, layers, alpha),
                       fmt::format("{:.3f}", surplus));
        // Sums that fall with the surface's share of the pixel make it 0.5 (cutoff 1) and 0.25
        // (cutoff 2). Kernels of cutoff 4 reach 2.8 pixels beyond the outline, on both sides of the
        // body.
        const double most = cutoff < 4 ? 0.15 : 0.25;
        EXPECT_LT(std::abs(surplus), most) << cutoff << " " << layers << " " << alpha;
      }
    }
  }
}

}  // namespace
}  // namespace surfel::test
