#include <cmath>
#include <cstring>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/join.h>

namespace surfel {
namespace {

const std::vector<std::string> kNames = {"a.ply", "b.ply", "c.ply"};

SurfelCloud points(const std::vector<Vec3f>& positions) {
  SurfelCloud cloud;
  cloud.position.assign(positions.begin(), positions.end());
  return cloud;
}

/// Two surfels with all that a renderer asks for.
SurfelCloud surfels(float variance = 0.25F) {
  SurfelCloud cloud = points({{0, 0, 0}, {1, 2, 3}});
  cloud.normal.assign(2, Vec3f(0, 0, 1));
  cloud.variance.assign(2, variance);
  return cloud;
}

SurfelCloud join(std::vector<SurfelCloud> clouds, const JoinOptions& options = {},
                 JoinReport* report = nullptr) {
  const auto names = std::span(kNames).first(clouds.size());
  SurfelCloud out = join_clouds(std::move(clouds), options, names, report);
  out.check_columns("joined");
  return out;
}

bool filled(const JoinReport& report, std::size_t cloud, const std::string& column) {
  for (const auto& f : report.filled) {
    if (f.cloud == cloud && f.column == column) return true;
  }
  return false;
}

TEST(JoinClouds, KeepsTheOrderAndFillsWhatIsMissing) {
  SurfelCloud a = surfels();
  a.alpha = {0.5F, 0.25F};
  a.color = {Vec3f(1, 0, 0), Vec3f(0, 1, 0)};
  a.level = {1, 2};
  const SurfelCloud b = surfels(0.5F);
  JoinReport report;
  const SurfelCloud joined = join({a, b}, {}, &report);
  ASSERT_EQ(joined.size(), 4U);
  EXPECT_EQ(joined.position[1], Vec3f(1, 2, 3));
  EXPECT_EQ(joined.position[3], Vec3f(1, 2, 3));
  EXPECT_EQ(joined.variance, (Array<float>{0.25F, 0.25F, 0.5F, 0.5F}));
  EXPECT_EQ(joined.alpha, (Array<float>{0.5F, 0.25F, 1, 1}));
  EXPECT_EQ(joined.level, (Array<std::uint8_t>{1, 2, 0, 0}));
  EXPECT_EQ(joined.color[0], Vec3f(1, 0, 0));
  EXPECT_EQ(joined.color[2], SurfelCloud::colorless());
  EXPECT_TRUE(joined.area.empty());
  for (const char* column : {"alpha", "color", "level"}) {
    EXPECT_TRUE(filled(report, 1, column)) << column;
    EXPECT_FALSE(filled(report, 0, column)) << column;
  }
  EXPECT_FALSE(filled(report, 1, "variance"));
}

TEST(JoinClouds, AreasAndCoefficientsAreWhatWouldBeRendered) {
  SurfelCloud a = surfels();
  a.area = {3, 4};
  a.coefficient = {Vec3f(1, 2, 3), Vec3f(4, 5, 6)};
  SurfelCloud b = surfels(0.5F);
  b.color = {Vec3f(0.1F, 0.2F, 0.3F), Vec3f(0.4F, 0.5F, 0.6F)};
  SurfelCloud c = surfels();
  c.variance.clear();
  c.tangent.assign(2, Vec3f(1, 0, 0));
  c.variance_u.assign(2, 4);
  c.variance_v.assign(2, 9);
  const SurfelCloud joined = join({a, b, c});
  EXPECT_EQ(joined.area, (Array<float>{3, 4, 0.5F, 0.5F, 6, 6}));
  EXPECT_EQ(joined.coefficient[1], a.coefficient[1]);
  EXPECT_EQ(joined.coefficient[3], b.color[1]);
  EXPECT_EQ(joined.coefficient[5], SurfelCloud::colorless());
}

TEST(JoinClouds, CirclesBecomeEllipses) {
  const SurfelCloud a = surfels();
  SurfelCloud b = surfels();
  b.variance.clear();
  b.tangent.assign(2, Vec3f(0, 1, 0));
  b.variance_u.assign(2, 4);
  b.variance_v.assign(2, 9);
  const SurfelCloud joined = join({a, b});
  EXPECT_TRUE(joined.variance.empty());
  EXPECT_EQ(joined.variance_u, (Array<float>{0.25F, 0.25F, 4, 4}));
  EXPECT_EQ(joined.variance_v, (Array<float>{0.25F, 0.25F, 9, 9}));
  EXPECT_NEAR(joined.tangent[0].norm(), 1, 1e-6);
  EXPECT_EQ(joined.tangent[0].dot(a.normal[0]), 0);
  EXPECT_EQ(joined.tangent[2], Vec3f(0, 1, 0));
}

TEST(JoinClouds, WhatHasNoDefaultStaysWhereAllHaveIt) {
  SurfelCloud a = surfels();
  a.uv.assign(2, Vec2f(0.5F, 0.25F));
  a.group = {0, 1};
  SurfelCloud b = surfels();
  b.group = {1, 1};
  JoinReport report;
  const SurfelCloud joined = join({a, b}, {}, &report);
  EXPECT_TRUE(joined.uv.empty());
  EXPECT_EQ(report.dropped, std::vector<std::string>{"uv"});
  EXPECT_EQ(joined.group, (Array<std::uint16_t>{0, 1, 1, 1}));
}

TEST(JoinClouds, SurfelsAndPointsWithoutSizeAreRefused) {
  try {
    join({surfels(), points({{1, 1, 1}})});
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInput);
    EXPECT_TRUE(std::string(error.what()).starts_with("b.ply: has no variance")) << error.what();
  }
  EXPECT_EQ(join({points({{1, 1, 1}}), points({{2, 2, 2}})}).size(), 2U);
}

TEST(JoinClouds, CopiesOfDifferentCloudsNeverShareTheirSource) {
  SurfelCloud a = points({{0, 0, 0}, {0, 0, 0}, {1, 0, 0}});
  a.source = {7, 7, 4000000000U};
  const SurfelCloud b = points({{0, 0, 0}, {0, 0, 0}});
  SurfelCloud c = points({{0, 0, 0}, {0, 0, 0}});
  c.source = {7, 7};
  const SurfelCloud joined = join({a, b, c});
  EXPECT_EQ(joined.source, (Array<std::uint32_t>{0, 0, 1, 2, 3, 4, 4}));
}

TEST(JoinClouds, MaterialsAsGivenOrApart) {
  SurfelCloud a = surfels();
  a.material = {2, 0};
  const SurfelCloud b = surfels();
  EXPECT_EQ(join({a, b}).material, (Array<std::uint16_t>{2, 0, 0, 0}));
  EXPECT_EQ(join({a, b}, {.material = {-1, 7}}).material, (Array<std::uint16_t>{2, 0, 7, 7}));
  EXPECT_EQ(join({a, b, a}, {.material = {}, .separate_materials = true}).material,
            (Array<std::uint16_t>{2, 0, 3, 3, 6, 4}));
  EXPECT_EQ(join({b}, {.material = {7}}).material, (Array<std::uint16_t>{7, 7}));

  EXPECT_TRUE(JoinOptions{}.problems(2).empty());
  EXPECT_FALSE((JoinOptions{.material = {1}}.problems(2).empty()));
  EXPECT_FALSE((JoinOptions{.material = {1, 65536}}.problems(2).empty()));
  EXPECT_FALSE((JoinOptions{.material = {1, -2}}.problems(2).empty()));
  EXPECT_FALSE((JoinOptions{.material = {1, 2}, .separate_materials = true}.problems(2).empty()));
  a.material = {65535, 0};
  EXPECT_THROW(join({a, b}, {.material = {}, .separate_materials = true}), Error);
}

TEST(JoinClouds, OtherPropertiesByNameAndInATypeThatHoldsAll) {
  const auto extra = [](const char* name, auto first, auto second) {
    using T = decltype(first);
    constexpr auto kType = std::is_same_v<T, float> ? ScalarType::kFloat32 : ScalarType::kUint16;
    ExtraProperty property{name, kType, {}};
    property.data.resize(2 * sizeof(T));
    std::memcpy(property.data.data(), &first, sizeof(T));
    std::memcpy(property.data.data() + sizeof(T), &second, sizeof(T));
    return property;
  };
  SurfelCloud a = surfels();
  a.extra = {extra("time", 0.5F, 1.5F), extra("class", std::uint16_t{3}, std::uint16_t{4})};
  SurfelCloud b = surfels();
  b.extra = {extra("class", 0.25F, 8.0F)};
  JoinReport report;
  const SurfelCloud joined = join({a, b}, {}, &report);
  ASSERT_EQ(joined.extra.size(), 2U);
  EXPECT_EQ(joined.extra[0].type, ScalarType::kFloat32);
  float time[4];
  ASSERT_EQ(joined.extra[0].data.size(), sizeof(time));
  std::memcpy(time, joined.extra[0].data.data(), sizeof(time));
  EXPECT_EQ(std::vector<float>(time, time + 4), (std::vector<float>{0.5F, 1.5F, 0, 0}));
  EXPECT_EQ(joined.extra[1].type, ScalarType::kFloat64);
  double kind[4];
  ASSERT_EQ(joined.extra[1].data.size(), sizeof(kind));
  std::memcpy(kind, joined.extra[1].data.data(), sizeof(kind));
  EXPECT_EQ(std::vector<double>(kind, kind + 4), (std::vector<double>{3, 4, 0.25, 8}));
  EXPECT_TRUE(filled(report, 1, "time"));
}

TEST(JoinClouds, FarPositionsAreMovedInDouble) {
  SurfelCloud a = surfels();
  a.origin = Vec3d(1e7, 0, 0);
  SurfelCloud b = surfels();
  b.origin = Vec3d(1e7 + 0.125, -4e6, 0);
  b.position[0] = Vec3f(0.0625F, 4e6F, 0);
  b.position[1] = Vec3f(3, 4e6F, 0);
  SurfelCloud joined = join({a, b});
  const std::vector<Vec3d> expected{
      {1e7, 0, 0}, {1e7 + 1, 2, 3}, {1e7 + 0.1875, 0, 0}, {1e7 + 3.125, 0, 0}};
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(joined.world(i), expected[i]) << i;
  EXPECT_TRUE(joined.exact.empty());
  // Offsets from no origin hold these.
  b.origin = Vec3d(-1e7 + 0.1, 0, 0);
  const SurfelCloud alone = b;
  joined = join({a, b});
  EXPECT_EQ(joined.exact.size(), 4U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(joined.world(i), a.world(i));
    EXPECT_EQ(joined.world(2 + i), alone.world(i));
  }
}

TEST(JoinClouds, HeadersAreJoined) {
  SurfelCloud a = surfels();
  a.provenance = {"made", "textured"};
  a.comments = {"one"};
  a.color.assign(2, Vec3f(0, 0, 0));
  a.coefficient.assign(2, Vec3f(0, 0, 0));
  a.basis_cutoff = 2;
  a.viewpoint = Viewpoint{};
  a.up = Vec3d(0, 0, 1);
  SurfelCloud b = surfels();
  b.provenance = {"made", "moved"};
  b.comments = {"one", "two"};
  b.color.assign(2, Vec3f(0, 0, 0));
  b.color_encoding = ColorEncoding::kUint16Srgb;
  b.double_positions = true;
  JoinReport report;
  SurfelCloud joined = join({a, b}, {}, &report);
  EXPECT_EQ(joined.provenance, (std::vector<std::string>{"made", "textured", "moved"}));
  EXPECT_EQ(joined.comments, (std::vector<std::string>{"one", "two"}));
  EXPECT_EQ(joined.color_encoding, ColorEncoding::kUint16Srgb);
  EXPECT_TRUE(joined.double_positions);
  EXPECT_EQ(joined.basis_cutoff, 2);
  EXPECT_FALSE(report.basis_differs);
  EXPECT_FALSE(joined.viewpoint.has_value());
  EXPECT_FALSE(joined.up.has_value());
  b.up = a.up;
  b.viewpoint = a.viewpoint;
  joined = join({a, b}, {}, &report);
  EXPECT_TRUE(joined.viewpoint.has_value());
  EXPECT_EQ(joined.up, a.up);
  b.coefficient = a.coefficient;
  joined = join({a, b}, {}, &report);
  EXPECT_FALSE(joined.basis_cutoff.has_value());
  EXPECT_TRUE(report.basis_differs);
}

ExtraProperty scans(const std::vector<std::uint8_t>& numbers) {
  ExtraProperty property{"scan", ScalarType::kUint8, {}};
  for (const std::uint8_t number : numbers) property.data.push_back(std::byte{number});
  return property;
}

TEST(JoinClouds, ScansAreNumberedAnewWithTheirViewpoints) {
  SurfelCloud a = surfels();
  a.extra = {scans({1, 0})};
  a.scan_viewpoints = {{.position = Vec3d(1, 0, 0)}, {.position = Vec3d(2, 0, 0)}};
  a.comments = {"scan 0: Hall", "scan 1: Door", "scanned in spring"};
  SurfelCloud b = surfels();
  b.viewpoint = Viewpoint{.position = Vec3d(3, 0, 0)};
  SurfelCloud c = a;
  c.scan_viewpoints[1].position.y() = 5;
  JoinReport report;
  const SurfelCloud joined = join({a, b, c}, {}, &report);
  EXPECT_FALSE(joined.viewpoint.has_value());
  EXPECT_FALSE(report.viewpoints_dropped);
  EXPECT_TRUE(report.filled.empty());
  ASSERT_EQ(joined.scan_viewpoints.size(), 5U);
  EXPECT_EQ(joined.sensors(),
            (Array<Vec3d>{{2, 0, 0}, {1, 0, 0}, {3, 0, 0}, {3, 0, 0}, {2, 5, 0}, {1, 0, 0}}));
  EXPECT_EQ(joined.comments,
            (std::vector<std::string>{"scan 0: Hall", "scan 1: Door", "scanned in spring",
                                      "scan 3: Hall", "scan 4: Door"}));

  // Parts of one file keep its numbers.
  const SurfelCloud parts = join({a, a}, {}, &report);
  EXPECT_EQ(parts.scan_viewpoints.size(), 2U);
  EXPECT_EQ(parts.sensors(), (Array<Vec3d>{{2, 0, 0}, {1, 0, 0}, {2, 0, 0}, {1, 0, 0}}));

  const SurfelCloud unknown = join({a, surfels()}, {}, &report);
  EXPECT_TRUE(unknown.scan_viewpoints.empty());
  EXPECT_TRUE(report.viewpoints_dropped);

  // A scan without a viewpoint would get the number of another file's scan.
  a.extra = {scans({0, 2})};
  EXPECT_THROW(join({a, b}), Error);
}

TEST(JoinClouds, PiecesAreJoinedAsWholes) {
  SurfelCloud a = surfels();
  a.source = {9, 3};
  a.material = {0, 4};
  SurfelCloud b = surfels();
  b.color.assign(2, Vec3f(0.25F, 0.5F, 1));
  b.source = {3, 3};
  b.origin = Vec3d(1e6, 0, 0);
  const JoinOptions options{.material = {}, .separate_materials = true};
  const SurfelCloud whole = join({a, b}, options);
  CloudJoiner joiner({CloudJoiner::head(a), CloudJoiner::head(b)}, options,
                     std::span(kNames).first(2));
  for (std::uint32_t i = 0; i < 4; ++i) {
    const SurfelCloud& from = i < 2 ? a : b;
    const SurfelCloud piece = joiner.joined(i / 2, from.gathered(Array<std::uint32_t>{i % 2}));
    ASSERT_EQ(piece.size(), 1U);
    EXPECT_EQ(piece.world(0), from.world(i % 2));
    EXPECT_EQ(piece.source[0], whole.source[i]) << i;
    EXPECT_EQ(piece.material[0], whole.material[i]) << i;
    EXPECT_EQ(piece.color[0], whole.color[i]) << i;
  }
}

TEST(JoinClouds, ColoursAreRecordedWhereAllAre) {
  const auto colored = [](ColorLight said) {
    SurfelCloud cloud = surfels();
    cloud.color.assign(2, Vec3f(0, 0, 0));
    cloud.color_light = said;
    return cloud;
  };
  const auto joined = [](const SurfelCloud& a, const SurfelCloud& b) {
    return join({a, b}).color_light;
  };
  const SurfelCloud unsaid = colored(ColorLight::kUnsaid);
  const SurfelCloud recorded = colored(ColorLight::kRecorded);
  const SurfelCloud own = colored(ColorLight::kReflectance);
  EXPECT_EQ(joined(unsaid, unsaid), ColorLight::kUnsaid);
  EXPECT_EQ(joined(unsaid, recorded), ColorLight::kRecorded);
  EXPECT_EQ(joined(own, own), ColorLight::kReflectance);
  EXPECT_EQ(joined(recorded, own), ColorLight::kMixed);
  EXPECT_EQ(joined(own, unsaid), ColorLight::kMixed);
  EXPECT_EQ(joined(colored(ColorLight::kMixed), own), ColorLight::kMixed);
  // The grey that colourless surfels get is no record.
  EXPECT_EQ(joined(surfels(), recorded), ColorLight::kMixed);
  EXPECT_EQ(joined(surfels(), own), ColorLight::kReflectance);
  EXPECT_EQ(joined(surfels(), surfels()), ColorLight::kUnsaid);
  EXPECT_EQ(joined(SurfelCloud{}, recorded), ColorLight::kRecorded);
}

TEST(JoinClouds, ASingleOneIsUntouched) {
  SurfelCloud a = surfels();
  a.origin = Vec3d(5, 5, 5);
  a.viewpoint = Viewpoint{};
  a.source = {9, 3};
  a.uv.assign(2, Vec2f(0, 1));
  const SurfelCloud joined = join({a});
  EXPECT_EQ(joined.origin, a.origin);
  EXPECT_EQ(joined.source, a.source);
  EXPECT_EQ(joined.uv, a.uv);
  EXPECT_TRUE(joined.viewpoint.has_value());
}

}  // namespace
}  // namespace surfel
