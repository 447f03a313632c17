#include <cmath>
#include <fstream>
#include <numbers>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/texture/normal_maps.h>

#include "relief_support.h"
#include "support/message_of.h"
#include "support/test_data.h"
#include "texture_support.h"

namespace surfel::test {
namespace {

const ReliefBase kFlat{{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};

/// Value of a map's texel.
Vec3f texel_value(const TextureMap& map, int x, int y) {
  const PyramidLevel& image = map.pyramid().image();
  return Vec3f(image.row(y) + static_cast<std::ptrdiff_t>(4 * x));
}

TEST(NormalMapOptions, NamesWhatIsWrong) {
  EXPECT_TRUE(NormalMapOptions{}.problems().empty());
  EXPECT_TRUE((NormalMapOptions{.bump = "b.png", .bump_scale = -0.1}).problems().empty());
  for (const NormalMapOptions& bad :
       {NormalMapOptions{.normal_map = "n.png", .bump = "b.png"},
        NormalMapOptions{.normal_map = "n.png", .bump_scale = 1},
        NormalMapOptions{.bump = "b.png", .bump_scale = std::nan("")},
        NormalMapOptions{.bump = "b.png", .y_down = true},
        NormalMapOptions{.bump = "b.png", .wrap = WrapMode::kNothing}}) {
    EXPECT_EQ(bad.problems().size(), 1U);
  }
}

TEST(LoadNormalMaps, TakesCodesAsTheyAreAndMakesNormalsUnit) {
  const TemporaryFolder folder;
  const std::string path = folder / "n.ppm";
  // Half as long as unit, but for a texel without direction.
  const Vec3d n = Vec3d(0.6, 0, 0.8);
  write_relief(path, 2, 1, false,
               [&](int x, int) { return normal_code(x == 0 ? Vec3d(n / 2) : Vec3d(0, 0, 0)); });
  NormalMaps maps = load_normal_maps({.normal_map = path}, nullptr, "");
  ASSERT_EQ(maps.kind, std::vector{ReliefKind::kNormals});
  EXPECT_FALSE(maps.empty());
  EXPECT_TRUE(texel_value(maps.first.maps[0], 0, 0).isApprox(n.cast<float>(), 1e-4F));
  EXPECT_NEAR(texel_value(maps.first.maps[0], 1, 0).norm(), 1, 1e-6F);
}

TEST(LoadNormalMaps, GreenPointsUpUnlessToldOtherwise) {
  const TemporaryFolder folder;
  const std::string path = folder / "n.ppm";
  write_relief(path, 1, 1, false, [&](int, int) { return normal_code({0, 0.6, 0.8}); });
  const auto y_of = [&](bool down) {
    NormalMaps maps = load_normal_maps({.normal_map = path, .y_down = down}, nullptr, "");
    return texel_value(maps.first.maps[0], 0, 0).y();
  };
  EXPECT_NEAR(y_of(false), 0.6, 1e-4);
  EXPECT_NEAR(y_of(true), -0.6, 1e-4);
}

TEST(LoadNormalMaps, DifferencesOfHeightsWrapAsTheImageDoes) {
  const TemporaryFolder folder;
  const std::string path = folder / "h.pgm";
  write_relief(path, 4, 2, true, [](int x, int y) { return Vec3d(0.2 * x + 0.1 * y, 0, 0); });
  const auto value = [&](WrapMode wrap, int x, int y) {
    const NormalMaps maps =
        load_normal_maps({.bump = path, .bump_scale = 10, .wrap = wrap}, nullptr, "");
    EXPECT_EQ(maps.kind, std::vector{ReliefKind::kHeights});
    const Vec3f first = texel_value(maps.first.maps[0], x, y);
    const Vec3f second = texel_value(maps.second.maps[0], x, y);
    EXPECT_FLOAT_EQ(first.z(), first.x() * first.x());
    EXPECT_FLOAT_EQ(second.x(), first.y() * first.y());
    EXPECT_FLOAT_EQ(second.y(), first.x() * first.y());
    return Vec2f(first.head<2>());
  };
  EXPECT_TRUE(value(WrapMode::kRepeat, 1, 0).isApprox(Vec2f(2, 0), 1e-3F));
  EXPECT_TRUE(value(WrapMode::kRepeat, 0, 0).isApprox(Vec2f(-2, 0), 1e-3F));
  EXPECT_TRUE(value(WrapMode::kClamp, 0, 0).isApprox(Vec2f(1, 0.5), 1e-3F));
  EXPECT_TRUE(value(WrapMode::kMirror, 3, 1).isApprox(Vec2f(1, 0.5), 1e-3F));
}

TEST(LoadNormalMaps, RefusesImagesThatAreNoReliefAndMissingOnes) {
  const TemporaryFolder folder;
  const std::string grey = folder / "grey.pgm";
  write_relief(grey, 2, 2, true, [](int, int) { return Vec3d(0.5, 0, 0); });
  const auto message = [](const NormalMapOptions& options) {
    return message_of([&] { (void)load_normal_maps(options, nullptr, ""); });
  };
  EXPECT_TRUE(message({.normal_map = grey}).starts_with(grey + ": a normal map needs"));
  const std::string missing = folder / "missing.png";
  EXPECT_NE(message({.normal_map = missing}).find(missing), std::string::npos);
  EXPECT_NE(message({.bump = missing}).find(missing), std::string::npos);
  EXPECT_NE(message({}), "");
  TriangleMesh mesh;
  EXPECT_TRUE(message_of([&] {
                (void)load_normal_maps({.bump = grey}, &mesh, "m.obj");
              }).starts_with("m.obj: the mesh has no texture coordinates"));
}

TEST(LoadNormalMaps, TakesTheMaterialsMaps) {
  const TemporaryFolder folder;
  const std::string normals = folder / "n.ppm";
  const std::string heights = folder / "h.pgm";
  write_relief(normals, 2, 2, false, [](int, int) { return normal_code({0, 0, 1}); });
  write_relief(heights, 4, 1, true, [](int x, int) { return Vec3d(0.2 * x, 0, 0); });
  TriangleMesh mesh;
  mesh.position = {Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)};
  mesh.face = {{0, 1, 2}};
  mesh.wedge_uv = {{Vec2f(0, 0), Vec2f(1, 0), Vec2f(0, 1)}};
  mesh.material.resize(5);
  mesh.material[1].normal_map = normals;
  mesh.material[1].bump_map = heights;
  mesh.material[2].bump_map = heights;
  mesh.material[2].bump_scale = 5;
  mesh.material[3].bump_map = heights;
  mesh.material[4] = mesh.material[1];
  const NormalMaps maps = load_normal_maps({}, &mesh, "m.obj");
  EXPECT_EQ(maps.first.map_of_material, (std::vector<std::size_t>{0, 1, 2, 3, 1}));
  EXPECT_EQ(maps.second.map_of_material, maps.first.map_of_material);
  EXPECT_EQ(maps.kind, (std::vector{ReliefKind::kNone, ReliefKind::kNormals, ReliefKind::kHeights,
                                    ReliefKind::kHeights}));
  EXPECT_NEAR(texel_value(maps.first.maps[2], 1, 0).x(), 1, 1e-3);
  EXPECT_NEAR(texel_value(maps.first.maps[3], 1, 0).x(), 0.2, 1e-3);
  EXPECT_TRUE(maps.first.charts.has_value());

  const NormalMaps scaled = load_normal_maps({.bump_scale = -2}, &mesh, "m.obj");
  EXPECT_EQ(scaled.kind.size(), 3U);  // One height, one map.
  EXPECT_NEAR(texel_value(scaled.first.maps[2], 1, 0).x(), -0.4, 1e-3);
  mesh.material.resize(1);
  EXPECT_TRUE(load_normal_maps({}, &mesh, "m.obj").empty());
}

TEST(NormalInScene, TurnsMirrorsAndKeepsLengths) {
  const Vec3d n(0.3, -0.2, 0.7);
  EXPECT_TRUE(normal_in_scene(kFlat, n)->isApprox(n));
  // Derivatives of other lengths, turned about the normal, and skewed.
  const ReliefBase turned{{0, 0, 1}, {0, 3, 0}, {-0.5, 7, 0}};
  EXPECT_TRUE(normal_in_scene(turned, n)->isApprox(Vec3d(0.2, 0.3, 0.7)));
  const ReliefBase mirrored{{0, 0, 1}, {-1, 0, 0}, {0, 1, 0}};
  EXPECT_TRUE(normal_in_scene(mirrored, n)->isApprox(Vec3d(-0.3, -0.2, 0.7)));
  // A smooth normal that leans away from its face.
  const Vec3d leaning = Vec3d(0.2, 0.1, 1).normalized();
  const Vec3d bent = *normal_in_scene({leaning, kFlat.dpdu, kFlat.dpdv}, n);
  EXPECT_NEAR(bent.norm(), n.norm(), 1e-12);
  EXPECT_NEAR(bent.dot(leaning), n.z(), 1e-12);
  EXPECT_FALSE(normal_in_scene({{0, 0, 1}, {1, 0, 0}, {2, 0, 0}}, n));
  EXPECT_FALSE(normal_in_scene({{0, 0, 1}, {0, 0, 0}, {0, 1, 0}}, n));
}

TEST(RaisedNormal, IsTheNormalOfTheRaisedSurface) {
  // z = 0.3 x - 0.5 y in the scene, seen by an image of 20 x 10 texels on a square of 4 x 2.
  const ReliefBase base{{0, 0, 1}, {4, 0, 0}, {0, 2, 0}};
  const HeightSlopes slopes{.mean = {0.3 * 4 / 20, 0.5 * 2 / 10}};  // Rows run against v.
  const Vec3d truth = Vec3d(-0.3, 0.5, 1).normalized();
  EXPECT_TRUE(raised_normal(base, slopes, 20, 10)->isApprox(truth));
  // The same surface with another parametrisation: mirrored and skewed.
  const ReliefBase skewed{{0, 0, 1}, {-4, 1, 0}, {3, 2, 0}};
  const Vec3d gradient(0.3, -0.5, 0);
  const HeightSlopes seen{
      .mean = {gradient.dot(skewed.dpdu) / 20, -gradient.dot(skewed.dpdv) / 10}};
  EXPECT_TRUE(raised_normal(skewed, seen, 20, 10)->isApprox(truth));
  EXPECT_FALSE(raised_normal({{0, 0, 1}, {1, 0, 0}, {2, 0, 0}}, slopes, 20, 10));
}

TEST(RaisedNormal, IsTheMeanOverGaussianSlopes) {
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  Mat2d root;
  root << 0.4, 0, -0.2, 0.3;
  const Vec2d mean(0.5, -0.1);
  Vec3d truth(0, 0, 0);
  constexpr int kCount = 400000;
  for (int i = 0; i < kCount; ++i) {
    const Vec2d s = mean + root * Vec2d(normal(generator), normal(generator));
    truth += Vec3d(-s.x(), s.y(), 1).normalized() / kCount;
  }
  const Vec3d found =
      *raised_normal(kFlat, {.mean = mean, .covariance = root * root.transpose()}, 1, 1);
  EXPECT_LT((found - truth).norm(), 2e-3) << found << truth;
  // A covariance whose determinant rounding has made negative.
  Mat2d sliver;
  sliver << 0.04, 0.02, 0.02, 0.0099;
  EXPECT_TRUE(raised_normal(kFlat, {.mean = mean, .covariance = sliver}, 1, 1)->allFinite());
}

}  // namespace
}  // namespace surfel::test
