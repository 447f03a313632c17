#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/simplify/simplify.h>

#include "support/message_of.h"

namespace surfel {
namespace {

using test::message_of;

/// n x n jittered surfels over the unit square, with a colour by place.
template <class Color>
SurfelCloud plane(int n, const Color& color) {
  SurfelCloud cloud;
  const auto h = 1 / static_cast<float>(n);
  for (int i = 0; i < n * n; ++i) {
    const auto x = (static_cast<float>(i % n) + static_cast<float>(random_uniform(5, i, 0))) * h;
    const auto y = (static_cast<float>(i / n) + static_cast<float>(random_uniform(5, i, 1))) * h;
    cloud.position.emplace_back(x, y, 0.0F);
    cloud.normal.push_back(Vec3f::UnitZ());
    cloud.variance.push_back(h * h);
    cloud.area.push_back(h * h);
    cloud.color.push_back(color(x, y));
  }
  return cloud;
}

SurfelCloud smooth_plane(int n = 64) {
  return plane(n, [](float x, float y) { return Vec3f(x, y, 0.5F); });
}

/// Black left of the middle, white right of it.
SurfelCloud step_plane(int n = 64) {
  return plane(n, [](float x, float) { return Vec3f::Constant(x < 0.5F ? 0.0F : 1.0F).eval(); });
}

SurfelCloud sphere(std::size_t n) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < n; ++i) {
    const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(n);
    const double angle = 2.399963229728653 * static_cast<double>(i);
    const double r = std::sqrt(1 - z * z);
    const Vec3d p(r * std::cos(angle), r * std::sin(angle), z);
    const auto area = static_cast<float>(12.566 / static_cast<double>(n));
    cloud.position.push_back(p.cast<float>());
    cloud.normal.push_back(p.cast<float>());
    cloud.variance.push_back(area);
    cloud.area.push_back(area);
  }
  return cloud;
}

SimplifyOptions with_error(double error) {
  SimplifyOptions options;
  options.max_error = error;
  return options;
}

SimplifyOptions with_count(std::size_t count) {
  SimplifyOptions options;
  options.count = count;
  return options;
}

double sum(const Array<float>& values) {
  double total = 0;
  for (const float v : values) total += v;
  return total;
}

TEST(SimplifyOptions, DefaultsNeedAnErrorOrACount) {
  EXPECT_EQ(SimplifyOptions{}.problems().size(), 1U);
  EXPECT_TRUE(with_error(0.1).problems().empty());
  EXPECT_TRUE(with_count(1).problems().empty());
  EXPECT_EQ(with_error(0).problems().size(), 1U);
  EXPECT_EQ(with_error(std::numeric_limits<double>::quiet_NaN()).problems().size(), 1U);
  EXPECT_EQ(with_count(0).problems().size(), 1U);
  const auto refused = [](auto change) {
    SimplifyOptions options = with_error(0.1);
    change(options);
    return options.problems().size() == 1;
  };
  EXPECT_TRUE(refused([](SimplifyOptions& o) { o.count = 5; }));
  EXPECT_TRUE(refused([](SimplifyOptions& o) { o.unit_deviation = 0; }));
  EXPECT_TRUE(refused([](SimplifyOptions& o) { o.light = -1; }));
  EXPECT_TRUE(refused([](SimplifyOptions& o) { o.sheets.normal_angle = 0; }));
  EXPECT_TRUE(refused([](SimplifyOptions& o) { o.sheets.sheet_weight = 0.5; }));
  EXPECT_TRUE(refused([](SimplifyOptions& o) { o.cutoff = 0; }));
}

TEST(Simplify, FlatAndSmoothSurfacesNeedFewSurfels) {
  const SurfelCloud cloud = smooth_plane();
  SimplifyReport report;
  const SurfelCloud out = simplify_surfels(cloud, with_error(0.02), &report);
  EXPECT_LT(out.size(), cloud.size() / 15);
  EXPECT_LE(report.error.total(), 0.02);
  EXPECT_LT(report.error.max_distance, 1e-6);
  EXPECT_EQ(report.result, out.size());
  EXPECT_TRUE(report.reached);
  // Their own, and what close gaps.
  EXPECT_GT(sum(out.area), 0.99);
  EXPECT_LT(sum(out.area), 1.2);
  EXPECT_FALSE(out.anisotropic()) << "Gaussians are of the kind that the cloud has";
  EXPECT_EQ(out.basis_cutoff, 1.0);
  for (std::size_t i = 0; i < out.size(); ++i) {
    EXPECT_NEAR(out.color[i].x(), out.position[i].x(), 1e-3);
    EXPECT_NEAR(out.coefficient[i].z(), 0.5, 1e-3);
    EXPECT_NEAR(out.normal[i].z(), 1, 1e-6);
  }
}

TEST(Simplify, SurfelsStayWhereColorsHaveDetail) {
  SimplifyReport report;
  const SurfelCloud out = simplify_surfels(step_plane(), with_error(0.03), &report);
  EXPECT_LE(report.error.total(), 0.03);
  EXPECT_GT(report.error.total(), 0.01) << "and no fewer would do";
  std::size_t at_edge = 0;
  for (const Vec3f& p : out.position) at_edge += std::abs(p.x() - 0.5F) < 0.1F ? 1 : 0;
  EXPECT_GT(at_edge, out.size() / 2) << "of a fifth of the area";
}

TEST(Simplify, SmallerErrorsTakeMoreSurfels) {
  const SurfelCloud cloud = sphere(6000);
  std::size_t before = 1;
  for (const double error : {0.3, 0.1, 0.05}) {
    SimplifyReport report;
    const SurfelCloud out = simplify_surfels(cloud, with_error(error), &report);
    EXPECT_LE(report.error.total(), error);
    EXPECT_GT(out.size(), before);
    EXPECT_LT(out.size(), cloud.size());
    before = out.size();
    for (std::size_t i = 0; i < out.size(); ++i) {
      EXPECT_NEAR(out.normal[i].norm(), 1, 1e-5);
      EXPECT_GT(out.normal[i].dot(out.position[i]), 0);
    }
  }
}

TEST(Simplify, LightMakesNormalsCount) {
  SimplifyOptions options = with_error(0.05);
  const std::size_t lit = simplify_surfels(sphere(6000), options).size();
  options.light = 0;
  EXPECT_LT(simplify_surfels(sphere(6000), options).size(), lit);
  options.light = 3;
  EXPECT_GT(simplify_surfels(sphere(6000), options).size(), lit);
}

TEST(Simplify, CountsAreExact) {
  const SurfelCloud cloud = step_plane();
  for (const std::size_t count : {1500U, 400U, 60U}) {
    SimplifyReport report;
    EXPECT_EQ(simplify_surfels(cloud, with_count(count), &report).size(), count);
    EXPECT_TRUE(report.reached);
    EXPECT_GT(report.error.total(), 0);
  }
  SimplifyReport report;
  EXPECT_EQ(simplify_surfels(cloud, with_count(cloud.size() + 1), &report).size(), cloud.size());
  EXPECT_FALSE(report.reached);
  // Six faces of a sphere at least have to be told apart.
  EXPECT_GT(simplify_surfels(sphere(2000), with_count(2), &report).size(), 6U);
  EXPECT_FALSE(report.reached);
}

TEST(Simplify, NothingIsChangedWhereNothingCanBeMerged) {
  const SurfelCloud cloud = plane(24, [](float x, float y) {
    return Vec3f::Constant(std::sin(9e5F * (x + 3 * y)) > 0 ? 1.0F : 0.0F).eval();
  });
  SimplifyReport report;
  const SurfelCloud out = simplify_surfels(cloud, with_error(1e-7), &report);
  ASSERT_EQ(out.size(), cloud.size());
  EXPECT_FALSE(report.reached);
  EXPECT_EQ(report.error.total(), 0);
  EXPECT_EQ(report.merged, 0U);
  EXPECT_TRUE(out.coefficient.empty());
  EXPECT_EQ(sum(out.variance), sum(cloud.variance));
}

TEST(Simplify, DoesNotDependOnThreadsNorOnTheOrder) {
  const SurfelCloud cloud = step_plane();
  Array<std::uint32_t> order(cloud.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  for (std::size_t i = order.size(); i-- > 1;) {
    std::swap(order[i], order[random_bits(1, i) % (i + 1)]);
  }
  set_thread_count(1);
  const SurfelCloud one = simplify_surfels(cloud, with_error(0.03));
  set_thread_count(3);
  const SurfelCloud three = simplify_surfels(cloud, with_error(0.03));
  const SurfelCloud shuffled = simplify_surfels(cloud.gathered(order), with_error(0.03));
  set_thread_count(0);
  for (const SurfelCloud* other : {&three, &shuffled}) {
    EXPECT_EQ(one.position, other->position);
    EXPECT_EQ(one.coefficient, other->coefficient);
    EXPECT_EQ(one.variance, other->variance);
    EXPECT_EQ(one.area, other->area);
  }
  SimplifyOptions options = with_error(0.03);
  options.seed = 2;
  EXPECT_NE(simplify_surfels(cloud, options).position, one.position);
}

TEST(Simplify, ColumnsAreMergedCarriedOrLeftOut) {
  SurfelCloud cloud = smooth_plane();
  cloud.alpha.assign(cloud.size(), 0.5F);
  cloud.material.assign(cloud.size(), 0);
  cloud.group.assign(cloud.size(), 3);
  cloud.source.assign(cloud.size(), 1);
  cloud.origin = Vec3d(1e7, 0, 0);
  ExtraProperty extra{"intensity", ScalarType::kUint8, {}};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const bool left = cloud.position[i].x() < 0.5F;
    cloud.material[i] = left ? 0 : 7;
    extra.data.push_back(static_cast<std::byte>(left ? 10 : 20));
    cloud.uv.emplace_back(2 * cloud.position[i].x(), 1 - cloud.position[i].y());
    cloud.dpdu.emplace_back(0.5F, 0.0F, 0.0F);
    cloud.dpdv.emplace_back(0.0F, -1.0F, 0.0F);
  }
  cloud.extra.push_back(extra);
  SimplifyReport report;
  const SurfelCloud out = simplify_surfels(cloud, with_error(0.02), &report);
  EXPECT_LT(out.size(), cloud.size() / 10);
  EXPECT_EQ(report.left_out, (std::vector<std::string>{"group", "source"}));
  EXPECT_TRUE(out.group.empty() && out.source.empty());
  EXPECT_EQ(out.origin, cloud.origin);
  ASSERT_EQ(out.extra.size(), 1U);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const bool left = out.position[i].x() < 0.5F;
    EXPECT_EQ(out.material[i], left ? 0 : 7);
    EXPECT_EQ(static_cast<int>(out.extra[0].data[i]), left ? 10 : 20);
    EXPECT_NEAR(out.alpha[i], 0.5F, 1e-4);
    EXPECT_NEAR(out.uv[i].x(), 2 * out.position[i].x(), 1e-5);
    EXPECT_NEAR(out.uv[i].y(), 1 - out.position[i].y(), 1e-5);
  }
}

TEST(Simplify, OpacityIsDetailToo) {
  SurfelCloud cloud = smooth_plane();
  const std::size_t opaque = simplify_surfels(cloud, with_error(0.03)).size();
  for (const Vec3f& p : cloud.position) cloud.alpha.push_back(p.y() < 0.5F ? 1.0F : 0.1F);
  SimplifyReport report;
  EXPECT_GT(simplify_surfels(cloud, with_error(0.03), &report).size(), 2 * opaque);
  EXPECT_LE(report.error.total(), 0.03);
}

TEST(Simplify, EllipsesStayEllipses) {
  SurfelCloud cloud = smooth_plane();
  cloud.tangent.assign(cloud.size(), Vec3f::UnitX());
  cloud.variance_u = cloud.variance;
  cloud.variance_v = cloud.variance;
  cloud.variance = {};
  const SurfelCloud out = simplify_surfels(cloud, with_error(0.02));
  EXPECT_LT(out.size(), cloud.size() / 15);
  ASSERT_TRUE(out.anisotropic());
  for (std::size_t i = 0; i < out.size(); ++i) {
    EXPECT_GE(out.variance_u[i], out.variance_v[i]);
    EXPECT_GT(out.variance_v[i], 0);
    EXPECT_NEAR(out.tangent[i].z(), 0, 1e-6);
  }
}

TEST(Simplify, WithoutColorsShapeAloneCounts) {
  SurfelCloud cloud = smooth_plane();
  cloud.color = {};
  SimplifyReport report;
  const SurfelCloud out = simplify_surfels(cloud, with_error(0.01), &report);
  EXPECT_LT(out.size(), 60U);
  EXPECT_TRUE(out.color.empty() && out.coefficient.empty());
  EXPECT_FALSE(out.basis_cutoff.has_value());
  EXPECT_LT(report.error.color, 1e-12);
}

TEST(Simplify, SurfelsWithoutAreasGetThoseOfTheirVariances) {
  const SurfelCloud with = smooth_plane(16);
  SurfelCloud without = with;
  without.area.clear();
  EXPECT_EQ(simplify_surfels(without, with_count(100)).area,
            simplify_surfels(with, with_count(100)).area);
}

TEST(Simplify, UnusableSurfelsAreLeftOutAndUnknownNormalsKept) {
  SurfelCloud cloud = smooth_plane();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.position[10].y() = nan;
  cloud.variance[20] = -1;
  cloud.color[30].x() = nan;
  cloud.normal[40].setZero();
  cloud.normal[50] = Vec3f::Constant(nan);
  cloud.normal[60] *= 5;
  SimplifyReport report;
  const SurfelCloud out = simplify_surfels(cloud, with_error(0.02), &report);
  EXPECT_EQ(report.dropped.total(), 3U);
  EXPECT_EQ(report.surfels, cloud.size() - 3);
  EXPECT_EQ(report.no_normal, 2U);
  EXPECT_LT(out.size(), cloud.size() / 10);
  std::size_t unknown = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    EXPECT_TRUE(out.position[i].allFinite() && out.coefficient[i].allFinite());
    EXPECT_GT(out.variance[i], 0);
    if (!out.normal[i].isZero()) continue;
    ++unknown;
    EXPECT_TRUE(out.position[i] == cloud.position[40] || out.position[i] == cloud.position[50]);
  }
  EXPECT_EQ(unknown, 2U);
}

TEST(Simplify, FewAndCoincidentSurfels) {
  SurfelCloud cloud = smooth_plane(2);
  for (const std::size_t n : {1U, 2U, 4U}) {
    Array<std::uint32_t> order(n);
    for (std::uint32_t i = 0; i < n; ++i) order[i] = i;
    const SurfelCloud few = cloud.gathered(order);
    const SurfelCloud out = simplify_surfels(few, with_error(10));
    EXPECT_GE(out.size(), 1U);
    EXPECT_LE(out.size(), n);
    EXPECT_EQ(simplify_surfels(few, with_count(1)).size(), 1U);
  }
  for (Vec3f& p : cloud.position) p = Vec3f(0.1F, 0.2F, 0.3F);
  const SurfelCloud one = simplify_surfels(cloud, with_count(1));
  ASSERT_EQ(one.size(), 1U);
  EXPECT_NEAR((one.position[0] - cloud.position[0]).norm(), 0, 1e-6);
  EXPECT_GT(one.variance[0], 0);
}

TEST(Simplify, RefusesWhatHasNoSurface) {
  const auto message = [](const SurfelCloud& cloud) {
    return message_of([&] { simplify_surfels(cloud, with_error(0.1), nullptr, "a.ply"); });
  };
  EXPECT_EQ(message({}), "a.ply: holds no surfel");
  SurfelCloud cloud = smooth_plane(4);
  cloud.normal = {};
  EXPECT_NE(message(cloud).find("a.ply: the surfels have no normals"), std::string::npos);
  EXPECT_NE(message(cloud).find("surfel-estimate"), std::string::npos);
  cloud = smooth_plane(4);
  cloud.variance = {};
  EXPECT_NE(message(cloud).find("no variance"), std::string::npos);
  cloud = smooth_plane(4);
  std::fill(cloud.area.begin(), cloud.area.end(), 0.0F);
  EXPECT_NE(message(cloud).find("no area"), std::string::npos);
  cloud = smooth_plane(4);
  for (Vec3f& p : cloud.position) p.x() = std::numeric_limits<float>::infinity();
  EXPECT_NE(message(cloud).find("no surfel that can be drawn"), std::string::npos);
  cloud = smooth_plane(4);
  EXPECT_EQ(message_of([&] { simplify_surfels(cloud, {}); }),
            "either `max_error` or `count` must be given, and not both");
}

}  // namespace
}  // namespace surfel
