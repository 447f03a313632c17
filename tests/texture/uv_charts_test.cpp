#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/texture/texel_kernel.h>
#include <surfel/texture/uv_charts.h>

namespace surfel {
namespace {

/// Squares of two triangles at the given corners in space and in the image.
class MeshBuilder {
 public:
  std::uint32_t vertex(const Vec3f& position) {
    mesh.position.push_back(position);
    return static_cast<std::uint32_t>(mesh.position.size() - 1);
  }
  void square(const std::array<std::uint32_t, 4>& v, const Vec2f& low, const Vec2f& high,
              std::uint16_t material = 0) {
    const std::array<Vec2f, 4> uv{low, Vec2f(high.x(), low.y()), high, Vec2f(low.x(), high.y())};
    for (const auto& [a, b, c] : {std::array{0, 1, 2}, std::array{0, 2, 3}}) {
      mesh.face.push_back({v[a], v[b], v[c]});
      mesh.wedge_uv.push_back({uv[a], uv[b], uv[c]});
      mesh.face_material.push_back(material);
    }
  }
  TriangleMesh mesh;
};

/// Two squares side by side in space, sharing an edge: vertices 0 1 4 3 and 1 2 5 4.
MeshBuilder two_squares() {
  MeshBuilder builder;
  for (const float y : {0.0F, 1.0F}) {
    for (const float x : {0.0F, 1.0F, 2.0F}) builder.vertex({x, y, 0});
  }
  return builder;
}

constexpr std::array<std::uint32_t, 4> kLeft{0, 1, 4, 3};
constexpr std::array<std::uint32_t, 4> kRight{1, 2, 5, 4};

TEST(UvCharts, AreOneWhereTheSharedEdgeHasTheSameUvOnBothSides) {
  MeshBuilder builder = two_squares();
  builder.square(kLeft, {0, 0}, {0.5F, 1});
  builder.square(kRight, {0.5F, 0}, {1, 1});
  EXPECT_EQ(UvCharts(builder.mesh).count(), 1U);
}

TEST(UvCharts, AreTwoAcrossASeamAndAcrossMaterials) {
  MeshBuilder seam = two_squares();
  seam.square(kLeft, {0, 0}, {0.4F, 1});
  seam.square(kRight, {0.5F, 0}, {1, 1});
  EXPECT_EQ(UvCharts(seam.mesh).count(), 2U);

  MeshBuilder materials = two_squares();
  materials.square(kLeft, {0, 0}, {0.5F, 1}, 0);
  materials.square(kRight, {0.5F, 0}, {1, 1}, 1);
  EXPECT_EQ(UvCharts(materials.mesh).count(), 2U);
}

TEST(UvCharts, ThatCoverTheSameTrianglesAreOne) {
  MeshBuilder builder = two_squares();
  builder.square(kLeft, {0, 0}, {0.5F, 1});
  // The right one has the same square, its faces seen from behind.
  builder.mesh.face.push_back({4, 1, 5});
  builder.mesh.face.push_back({2, 5, 1});
  builder.mesh.wedge_uv.push_back({Vec2f(0.5F, 0), Vec2f(0, 0), Vec2f(0.5F, 1)});
  builder.mesh.wedge_uv.push_back({Vec2f(0, 1), Vec2f(0.5F, 1), Vec2f(0, 0)});
  builder.mesh.face_material.insert(builder.mesh.face_material.end(), {0, 0});
  EXPECT_EQ(UvCharts(builder.mesh).count(), 1U);
}

TEST(UvCharts, FindTellsOverlappingChartsApartByPosition) {
  MeshBuilder builder = two_squares();
  builder.square(kLeft, {0, 0}, {0.6F, 1});
  builder.square(kRight, {0.4F, 0}, {1, 1});
  const UvCharts charts(builder.mesh);
  ASSERT_EQ(charts.count(), 2U);
  const Vec2f tolerance(1e-4F, 1e-4F);
  const auto left = charts.find({0.1F, 0.5F}, {0.2, 0.5, 0}, 0, tolerance);
  const auto right = charts.find({0.9F, 0.5F}, {1.8, 0.5, 0}, 0, tolerance);
  ASSERT_TRUE(left && right);
  EXPECT_NE(*left, *right);
  // uv (0.5, 0.5) is at x = 5/6 on the left square and at x = 7/6 on the right one.
  EXPECT_EQ(charts.find({0.5F, 0.5F}, {0.83, 0.5, 0}, 0, tolerance), left);
  EXPECT_EQ(charts.find({0.5F, 0.5F}, {1.17, 0.5, 0}, 0, tolerance), right);
  EXPECT_EQ(charts.find({1.5F, 0.5F}, {1.17, 0.5, 0}, 0, tolerance), std::nullopt);
  EXPECT_EQ(charts.find({0.5F, 0.5F}, {1.17, 0.5, 0}, 3, tolerance), std::nullopt);
}

TEST(UvCharts, FindForgivesRoundingAtTheBorderButNoMore) {
  MeshBuilder builder = two_squares();
  builder.square(kLeft, {0, 0}, {0.5F, 1});
  const UvCharts charts(builder.mesh);
  EXPECT_TRUE(charts.find({0.5005F, 0.3F}, {1, 0.3, 0}, std::nullopt, {0.001F, 0.001F}));
  EXPECT_FALSE(charts.find({0.502F, 0.3F}, {1, 0.3, 0}, std::nullopt, {0.001F, 0.001F}));
}

TEST(UvCharts, FindsEveryFaceOfALargeGrid) {
  MeshBuilder builder;
  constexpr int kSide = 40;
  for (int y = 0; y <= kSide; ++y) {
    for (int x = 0; x <= kSide; ++x) {
      builder.vertex({static_cast<float>(x), static_cast<float>(y), 0});
    }
  }
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const auto v = static_cast<std::uint32_t>(y * (kSide + 1) + x);
      // A gap around each square makes each a chart.
      const Vec2f low(static_cast<float>(x), static_cast<float>(y));
      builder.square({v, v + 1, v + kSide + 2, v + kSide + 1}, low, low + Vec2f(0.9F, 0.9F));
    }
  }
  const UvCharts charts(builder.mesh);
  ASSERT_EQ(charts.count(), static_cast<std::size_t>(kSide * kSide));
  std::vector<bool> seen(charts.count(), false);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const Vec2f uv(static_cast<float>(x) + 0.3F, static_cast<float>(y) + 0.7F);
      const auto chart = charts.find(uv, {0, 0, 0}, 0, {1e-3F, 1e-3F});
      ASSERT_TRUE(chart);
      EXPECT_FALSE(seen[*chart]);
      seen[*chart] = true;
    }
  }
}

TEST(UvCharts, SkipFacesWithoutArea) {
  MeshBuilder builder = two_squares();
  builder.square(kLeft, {0.2F, 0.3F}, {0.2F, 0.8F});
  EXPECT_EQ(UvCharts(builder.mesh).count(), 0U);
  EXPECT_FALSE(UvCharts(builder.mesh).find({0.2F, 0.3F}, {0, 0, 0}, 0, {1, 1}));
}

TEST(UvCharts, NeedTextureCoordinates) { EXPECT_THROW(UvCharts(TriangleMesh{}), Error); }

CoverageRaster covered(const std::vector<UvCharts::Triangle>& triangles, int size) {
  CoverageRaster raster = coverage_box(triangles, size, size, 1e9).value();
  rasterize_coverage(triangles, size, size, raster);
  return raster;
}

TEST(Coverage, MarksExactlyTheCentresInsideAndTheTexelsTouched) {
  const UvCharts::Triangle triangle{Vec2f(0.11F, 0.22F), Vec2f(0.83F, 0.37F), Vec2f(0.36F, 0.91F)};
  constexpr int kSize = 40;
  const CoverageRaster raster = covered({triangle}, kSize);
  const auto inside = [&](double x, double y) {
    std::array<Vec2d, 3> t;
    for (int i = 0; i < 3; ++i) t[i] = texel_position(triangle[i], kSize, kSize);
    int left = 0;
    for (int i = 0; i < 3; ++i) {
      const Vec2d e = t[(i + 1) % 3] - t[i];
      const Vec2d d = Vec2d(x, y) - t[i];
      left += e.x() * d.y() - e.y() * d.x() >= 0 ? 1 : 0;
    }
    return left == 0 || left == 3;
  };
  for (int j = 0; j < raster.height; ++j) {
    for (int i = 0; i < raster.width; ++i) {
      const int x = raster.first_x + i;
      const int y = raster.first_y + j;
      bool touched = false;
      for (int s = 0; s <= 400 && !touched; ++s) {
        touched = inside(x + (s % 21) / 20.0, y + (s / 21) / 20.0);
      }
      const float weight = raster.weight[static_cast<std::size_t>(j) * raster.width + i];
      if (inside(x + 0.5, y + 0.5)) {
        EXPECT_EQ(weight, 1) << x << ' ' << y;
      } else if (touched) {
        EXPECT_EQ(weight, kPartialCoverage) << x << ' ' << y;
      } else {
        EXPECT_LT(weight, 1) << x << ' ' << y;  // Touched between the samples, or not at all.
      }
    }
  }
}

TEST(Coverage, SliversThatHoldNoCentreAreStillThere) {
  const CoverageRaster raster =
      covered({{Vec2f(0.101F, 0.1F), Vec2f(0.101F, 0.9F), Vec2f(0.1015F, 0.5F)}}, 10);
  ASSERT_EQ(raster.width, 1);
  for (const float weight : raster.weight) EXPECT_EQ(weight, kPartialCoverage);
}

TEST(Coverage, BoxesLieWhereTheChartsDoAndAreRefusedWhereTooLarge) {
  const std::vector<UvCharts::Triangle> triangles{
      {Vec2f(-1.5F, 2), Vec2f(-1, 2), Vec2f(-1, 2.25F)}};
  const auto box = coverage_box(triangles, 8, 4, 100);
  ASSERT_TRUE(box);
  EXPECT_EQ(box->first_x, -12);
  EXPECT_EQ(box->first_y, -5);
  EXPECT_FALSE(coverage_box(triangles, 800, 400, 100));
  EXPECT_FALSE(coverage_box({{Vec2f(1e30F, 0), Vec2f(1e30F, 1), Vec2f(0, 0)}}, 8, 4, 1e99));
}

}  // namespace
}  // namespace surfel
