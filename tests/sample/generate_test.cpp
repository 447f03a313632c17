#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <map>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/sample/generate.h>

namespace surfel {
namespace {

SurfelCloud generated(const std::string& kind, std::size_t count, double jitter = 0.35) {
  GenerateOptions options;
  options.count = count;
  options.seed = 3;
  options.jitter = jitter;
  return generate_surfels(procedural_scene(kind, 3), options);
}

double total_area(const SurfelCloud& cloud) {
  double sum = 0;
  for (const float a : cloud.area) sum += a;
  return sum;
}

TEST(GenerateSurfels, CountIsExactForEveryKind) {
  for (const std::string& kind : procedural_scene_names()) {
    for (const std::size_t count : {1u, 2u, 7u, 100u, 12345u}) {
      const SurfelCloud cloud = generated(kind, count);
      EXPECT_EQ(cloud.size(), count) << kind;
      EXPECT_NO_THROW(cloud.check_columns(kind));
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        ASSERT_TRUE(cloud.position[i].allFinite());
        ASSERT_NEAR(cloud.normal[i].norm(), 1, 1e-5);
        ASSERT_GE(cloud.color[i].minCoeff(), 0);
        ASSERT_LE(cloud.color[i].maxCoeff(), 1);
      }
    }
  }
}

TEST(GenerateSurfels, SquareCountOnThePlaneIsTheJitteredGrid) {
  constexpr int kSide = 96;
  const double h = 2.0 / kSide;
  const SurfelCloud cloud = generated("plane", kSide * kSide);
  double largest = 0;
  for (int row = 0; row < kSide; ++row) {
    for (int column = 0; column < kSide; ++column) {
      const Vec3f& p = cloud.position[row * kSide + column];
      const double dx = p.x() - (-1 + (column + 0.5) * h);
      const double dy = p.y() - (-1 + (row + 0.5) * h);
      largest = std::max({largest, std::abs(dx), std::abs(dy)});
      ASSERT_EQ(p.z(), 0);
    }
  }
  EXPECT_LE(largest, 0.35 * h * (1 + 1e-4));
  EXPECT_GE(largest, 0.34 * h);
  EXPECT_NEAR(cloud.variance[17], h * h, 1e-6 * h * h);
  EXPECT_EQ(cloud.normal[17], Vec3f(0, 0, 1));
  EXPECT_EQ(cloud.dpdu[17], Vec3f(2, 0, 0));
}

TEST(GenerateSurfels, InOrderAreTheSameSurfelsSorted) {
  for (const std::string& kind : procedural_scene_names()) {
    const ProceduralScene scene = procedural_scene(kind, 3);
    GenerateOptions options;
    options.count = 8000;
    options.uv = kind != "terrain";
    const SurfelCloud whole = generate_surfels(scene, options);
    EXPECT_EQ(whole.uv.empty(), !options.uv);
    const SurfelCloud sorted = whole.gathered(morton_order(whole.position));
    std::size_t done = 0;
    std::size_t pieces = 0;
    generate_surfels_in_order(scene, options, 1000, [&](SurfelCloud&& piece) {
      ++pieces;
      for (std::size_t i = 0; i < piece.size(); ++i, ++done) {
        ASSERT_EQ(piece.position[i], sorted.position[done]) << kind;
        ASSERT_EQ(piece.normal[i], sorted.normal[done]) << kind;
        ASSERT_EQ(piece.color[i], sorted.color[done]) << kind;
        if (options.uv) {
          ASSERT_EQ(piece.uv[i], sorted.uv[done]) << kind;
        }
      }
    });
    EXPECT_EQ(done, options.count) << kind;
    EXPECT_GT(pieces, 2U) << kind;
  }
}

TEST(GenerateSurfels, AreasSumToTheSurface) {
  constexpr double kPi = std::numbers::pi;
  EXPECT_NEAR(total_area(generated("plane", 5000)), 4, 1e-3);
  EXPECT_NEAR(total_area(generated("sphere", 5000)), 4 * kPi, 4e-3);
  EXPECT_NEAR(total_area(generated("torus", 5000)), 4 * kPi * kPi * 0.7 * 0.3, 4e-3);
}

TEST(GenerateSurfels, PointsLieOnSphereAndTorusWithTheirNormals) {
  for (const Vec3f& p : generated("sphere", 3000).position) ASSERT_NEAR(p.norm(), 1, 1e-6);
  const SurfelCloud torus = generated("torus", 3000);
  for (std::size_t i = 0; i < torus.size(); ++i) {
    const Vec3f& p = torus.position[i];
    const Vec3f center = 0.7f * Vec3f(p.x(), p.y(), 0).normalized();
    ASSERT_NEAR((p - center).norm(), 0.3, 1e-6);
    ASSERT_GT(torus.normal[i].dot((p - center).normalized()), 0.99999);
  }
}

/// Density by area: cells of a coarse grid of directions must hold their share of the surfels.
TEST(GenerateSurfels, DensityIsUniformByAreaOnTheSphere) {
  const SurfelCloud cloud = generated("sphere", 20000);
  std::array<int, 20> slices{};
  std::array<int, 12> sectors{};
  for (const Vec3f& p : cloud.position) {
    ++slices[std::min(19, static_cast<int>((p.y() + 1) * 10))];  // Archimedes: equal areas.
    ++sectors[std::min(11,
                       static_cast<int>((std::atan2(p.x(), p.z()) / std::numbers::pi + 1) * 6))];
  }
  for (const int n : slices) EXPECT_NEAR(n, 1000, 100);
  for (const int n : sectors) EXPECT_NEAR(n, 20000 / 12.0, 100);
}

/// Without jitter the cells' centres keep apart on every kind, so neither rows nor cells collapse.
TEST(GenerateSurfels, CellsAreAboutSquare) {
  for (const std::string kind : {"plane", "sphere", "torus", "head", "terrain"}) {
    const SurfelCloud cloud = generated(kind, 3001, 0);
    const double h = std::sqrt(cloud.area[0]);
    double closest = INFINITY;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        closest = std::min<double>(closest, (cloud.position[i] - cloud.position[j]).norm());
      }
    }
    EXPECT_GT(closest, 0.4 * h) << kind;
  }
}

TEST(ParametricSurface, DerivativesAndNormalsMatchFiniteDifferences) {
  constexpr double kStep = 1e-6;
  for (const std::string& kind : procedural_scene_names()) {
    for (const SurfacePart& part : procedural_scene(kind, 1).parts) {
      for (double u = 0.05; u < 1; u += 0.093) {
        for (double v = 0.05; v < 1; v += 0.087) {
          const auto p = part.shape->at(u, v);
          const Vec3d by_u =
              (part.shape->at(u + kStep, v).position - part.shape->at(u - kStep, v).position) /
              (2 * kStep);
          const Vec3d by_v =
              (part.shape->at(u, v + kStep).position - part.shape->at(u, v - kStep).position) /
              (2 * kStep);
          EXPECT_LT((p.dpdu - by_u).norm(), 1e-3) << kind;
          EXPECT_LT((p.dpdv - by_v).norm(), 1e-3) << kind;
          EXPECT_GT(p.normal.dot(p.dpdu.cross(p.dpdv).normalized()), 1 - 1e-9) << kind;
        }
      }
    }
  }
}

TEST(GenerateSurfels, ThreadsDoNotChangeTheResult) {
  set_thread_count(1);
  const SurfelCloud one = generated("head", 20000);
  set_thread_count(5);
  const SurfelCloud five = generated("head", 20000);
  set_thread_count(0);
  EXPECT_EQ(0, std::memcmp(one.position.data(), five.position.data(), 20000 * sizeof(Vec3f)));
  EXPECT_EQ(0, std::memcmp(one.color.data(), five.color.data(), 20000 * sizeof(Vec3f)));
}

TEST(GenerateSurfels, TransparentPartsShareTheCountByArea) {
  const SurfelCloud cloud = generated("transparent", 50000);
  ASSERT_EQ(cloud.alpha.size(), cloud.size());
  std::map<float, std::pair<std::size_t, float>> parts;  // alpha -> count, area
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    ++parts[cloud.alpha[i]].first;
    parts[cloud.alpha[i]].second = cloud.area[i];
  }
  EXPECT_EQ(parts.size(), 6u);
  EXPECT_GE(parts.begin()->first, 0.2f);
  EXPECT_LE(parts.rbegin()->first, 0.6f);
  for (const auto& [alpha, part] : parts) {
    EXPECT_NEAR(part.second, parts.begin()->second.second, 0.01f * part.second) << alpha;
  }
}

TEST(GenerateSurfels, RefusesBadOptions) {
  EXPECT_TRUE(GenerateOptions{}.problems().empty());
  GenerateOptions options;
  options.count = 0;
  options.jitter = 0.6;
  options.variance_scale = -1;
  EXPECT_EQ(options.problems().size(), 3u);
  EXPECT_THROW(generate_surfels(procedural_scene("plane", 1), options), Error);
  EXPECT_THROW(
      generate_surfels_in_order(procedural_scene("plane", 1), options, 10, [](SurfelCloud&&) {}),
      Error);
  EXPECT_THROW(procedural_scene("cube", 1), Error);
}

/// Signed volume by the divergence theorem, and every edge met once in each direction.
TEST(GenerateMesh, ClosedKindsAreClosedAndFaceOutward) {
  for (const std::string kind : {"sphere", "torus", "head"}) {
    const TriangleMesh mesh = generate_mesh(procedural_scene(kind, 1), 48);
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    double volume = 0;
    for (std::size_t f = 0; f < mesh.face.size(); ++f) {
      const auto& face = mesh.face[f];
      volume +=
          mesh.position[face[0]].cast<double>().dot(
              mesh.position[face[1]].cast<double>().cross(mesh.position[face[2]].cast<double>())) /
          6;
      for (int k = 0; k < 3; ++k) ++edges[{face[k], face[(k + 1) % 3]}];
    }
    for (const auto& [edge, uses] : edges) {
      ASSERT_EQ(uses, 1) << kind;
      ASSERT_TRUE(edges.contains({edge.second, edge.first})) << kind;
    }
    EXPECT_GT(volume, 0.5) << kind;
    if (kind == "sphere") {
      EXPECT_NEAR(volume, 4 * std::numbers::pi / 3, 0.03);
    }
    EXPECT_EQ(mesh.wedge_uv.size(), mesh.face.size());
    EXPECT_EQ(mesh.wedge_normal.size(), mesh.face.size());
  }
}

TEST(GenerateMesh, NamesItsTextureAndRefusesBadResolutions) {
  const ProceduralScene scene = procedural_scene("terrain", 1);
  const TriangleMesh mesh = generate_mesh(scene, 10, "terrain.png");
  EXPECT_EQ(mesh.position.size(), 121u);
  EXPECT_EQ(mesh.face.size(), 200u);
  ASSERT_EQ(mesh.material.size(), 1u);
  EXPECT_EQ(mesh.material[0].texture, "terrain.png");
  EXPECT_THROW(generate_mesh(scene, 2), Error);
}

TEST(GenerateTexture, MatchesTheSurfelsColors) {
  const ProceduralScene scene = procedural_scene("plane", 1);
  const Image image = generate_texture(scene, 64, 64);
  const SurfelCloud cloud = generated("plane", 1000);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const int x = std::min(63, static_cast<int>(cloud.uv[i].x() * 64));
    const int y = std::min(63, static_cast<int>((1 - cloud.uv[i].y()) * 64));
    ASSERT_NEAR(image.pixel(x, y)[0], cloud.color[i].x(), 1e-5);
  }
}

}  // namespace
}  // namespace surfel
