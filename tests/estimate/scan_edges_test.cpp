// Lines at which surfels of scans end.

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/estimate.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/scene/clips.h>

#include "support/side_scenes.h"

namespace surfel::test {
namespace {

constexpr double kSpacing = 0.05;

SurfelCloud estimated(const SidedPoints& points, EstimateReport* report = nullptr,
                      bool edges = true) {
  SurfelCloud cloud;
  cloud.position = points.position;
  EstimateOptions options;
  if (edges) options.edges.emplace();
  options.size.anisotropy = Anisotropy::kOff;  // shows() is about discs.
  return estimate_surfels(cloud, options, report);
}

/// Points of a jittered grid over [-1, 1]^2, where `holds` says so, turned by 0.3 radians.
template <class Holds>
SidedPoints plate(const Holds& holds) {
  SidedPoints out;
  out.spacing = kSpacing;
  const int n = static_cast<int>(1.5 / kSpacing);
  for (int j = -n; j <= n; ++j) {
    for (int i = -n; i <= n; ++i) {
      const auto k = static_cast<std::uint64_t>((j + n) * 1000 + i + n);
      const double a = i + 0.6 * random_uniform(3, k, 0);
      const double b = j + 0.6 * random_uniform(3, k, 1);
      const Vec2d p(std::cos(0.3) * a - std::sin(0.3) * b, std::sin(0.3) * a + std::cos(0.3) * b);
      const Vec2d at = kSpacing * p;
      if (at.cwiseAbs().maxCoeff() < 1 && holds(at)) {
        out.add(Vec3d(at.x(), at.y(), 0), Vec3d(0, 0, 1));
      }
    }
  }
  return out;
}

SidedPoints cube() { return box_points({{{-1, -1, -1}, {1, 1, 1}}}, kSpacing); }

SidedPoints sphere() {
  GenerateOptions options;
  options.count = 20000;
  const SurfelCloud cloud = generate_surfels(procedural_scene("sphere", 1), options);
  SidedPoints out;
  out.position = cloud.position;
  out.truth = cloud.normal;
  out.spacing = std::sqrt(4 * std::numbers::pi / 20000);
  return out;
}

std::size_t clipped(const SurfelCloud& cloud) {
  std::size_t out = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) out += is_clipped(cloud, i) ? 1 : 0;
  return out;
}

/// Is a place within the disc of surfel i and its half-planes?
bool shows(const SurfelCloud& cloud, std::size_t i, const Vec3f& place) {
  const Vec3f offset = place - cloud.position[i];
  const float height = offset.dot(cloud.normal[i]);
  if (std::abs(height) > 0.01F || offset.squaredNorm() > 2 * cloud.variance[i]) return false;
  const auto within = [&](const Array<Vec3f>& clip, const Array<float>& distance) {
    return clip.empty() || clip[i].isZero(0) || offset.dot(clip[i]) <= distance[i];
  };
  return within(cloud.clip1, cloud.clip1_distance) && within(cloud.clip2, cloud.clip2_distance);
}

bool shown(const SurfelCloud& cloud, const Vec3f& place) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (shows(cloud, i, place)) return true;
  }
  return false;
}

TEST(ScanEdges, OptionsAreChecked) {
  EXPECT_TRUE(CreaseOptions{}.problems().empty());
  EXPECT_FALSE(CreaseOptions{.crease_angle = 5}.problems().empty());
  EXPECT_FALSE(CreaseOptions{.crease_angle = 91}.problems().empty());
  EstimateOptions options;
  options.edges = CreaseOptions{.crease_angle = 0};
  EXPECT_THROW(estimate_surfels(estimated(sphere()), options), Error);
}

TEST(ScanEdges, BordersEndWhereTheSurfaceDoes) {
  EstimateReport report;
  const SurfelCloud cloud = estimated(plate([](const Vec2d&) { return true; }), &report);
  double sum = 0;
  double squares = 0;
  std::size_t lines = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = cloud.position[i].cast<double>().cwiseAbs();
    const double inside = 1 - p.maxCoeff();
    if (inside < 0.5 * kSpacing) {
      EXPECT_TRUE(is_clipped(cloud, i)) << p.transpose();
    }
    if (inside > 4 * kSpacing) {
      EXPECT_FALSE(is_clipped(cloud, i)) << p.transpose();
    }
    if (!is_clipped(cloud, i) || std::min(p.x(), p.y()) > 1 - 4 * kSpacing) continue;
    const Vec3d foot = cloud.position[i].cast<double>() +
                       cloud.clip1[i].cast<double>() * static_cast<double>(cloud.clip1_distance[i]);
    const double beyond = (foot.cwiseAbs().maxCoeff() - 1) / kSpacing;
    sum += beyond;
    squares += beyond * beyond;
    ++lines;
  }
  ASSERT_GT(lines, 100U);
  EXPECT_EQ(report.borders.points, clipped(cloud));
  EXPECT_EQ(report.creases.points, 0U);
  const double mean = sum / static_cast<double>(lines);
  EXPECT_LT(std::abs(mean), 0.15);
  EXPECT_LT(std::sqrt(squares / static_cast<double>(lines) - mean * mean), 0.2);
}

TEST(ScanEdges, CutSurfelsLeaveNoHole) {
  const SurfelCloud flat = estimated(plate([](const Vec2d&) { return true; }));
  const SurfelCloud solid = estimated(cube());
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const auto at = [&](int d) { return static_cast<float>(2 * random_uniform(9, i, d) - 1); };
    const Vec3f place(0.98F * at(0), 0.98F * at(1), 0);
    EXPECT_TRUE(shown(flat, place)) << place.transpose();
    // The faces of the cube show all of it, up to its edges.
    EXPECT_TRUE(shown(solid, Vec3f(at(0), at(1), 1))) << at(0) << ' ' << at(1);
  }
}

TEST(ScanEdges, FacesOfACubeEndAtItsEdges) {
  EstimateReport report;
  const SurfelCloud cloud = estimated(cube(), &report);
  EXPECT_LT(report.creases.unsure, cloud.size() / 100);
  std::size_t missed = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3f p = cloud.position[i].cwiseAbs();
    int face = 0;
    p.maxCoeff(&face);
    const Vec3f normal = cloud.normal[i].cwiseAbs();
    Vec3f others = p;
    others[face] = 0;
    if (others.maxCoeff() < 1 - 0.7 * kSpacing) continue;
    if (!is_clipped(cloud, i) || normal[face] < 0.9999F) {
      ++missed;
      continue;
    }
    const Vec3f foot = cloud.position[i] + cloud.clip1[i] * cloud.clip1_distance[i];
    Vec3f edge = foot.cwiseAbs();
    edge[face] = 0;
    EXPECT_NEAR(edge.maxCoeff(), 1, 0.1 * kSpacing);
  }
  EXPECT_LT(missed, cloud.size() / 200);
  EXPECT_TRUE(estimated(cube(), nullptr, false).clip1.empty());
}

TEST(ScanEdges, SmoothSurfacesAreNotCut) {
  for (const double noise : {0.0, 0.1, 0.3, 0.5}) {
    EXPECT_EQ(clipped(estimated(damaged(sphere(), {.noise = noise}))), 0U) << noise;
  }
}

TEST(ScanEdges, UnevenDensityIsNoBorder) {
  // A quarter of the points in every second stripe.
  const SidedPoints points = plate([](const Vec2d& p) {
    const bool dense = static_cast<int>(std::floor(5 * p.x())) % 2 == 0;
    const auto key = static_cast<std::uint64_t>(1e6 * (p.x() + 2) + 1e9 * (p.y() + 2));
    return dense || random_uniform(8, key) < 0.25;
  });
  const SurfelCloud cloud = estimated(points);
  std::size_t cut = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.position[i].cwiseAbs().maxCoeff() > 0.75F) continue;
    cut += is_clipped(cloud, i) ? 1 : 0;
  }
  EXPECT_LT(cut, cloud.size() / 100);
}

TEST(ScanEdges, ReflexCornersKeepTheirSurface) {
  const SidedPoints points = plate([](const Vec2d& p) { return p.x() < 0 || p.y() < 0; });
  const SurfelCloud cloud = estimated(points);
  for (int i = -20; i <= 20; ++i) {
    const auto x = static_cast<float>(0.7 * i / 20);
    EXPECT_TRUE(shown(cloud, {x, -0.03F, 0}));
    EXPECT_TRUE(shown(cloud, {-0.03F, x, 0}));
  }
}

TEST(ScanEdges, DoNotDependOnThreads) {
  const SidedPoints points = damaged(cube(), {.noise = 0.1});
  const SurfelCloud all = estimated(points);
  set_thread_count(1);
  const SurfelCloud one = estimated(points);
  set_thread_count(0);
  EXPECT_EQ(all.clip1, one.clip1);
  EXPECT_EQ(all.clip1_distance, one.clip1_distance);
  EXPECT_EQ(all.clip2, one.clip2);
  EXPECT_EQ(all.normal, one.normal);
}

TEST(ScanEdges, OfFewOrCoincidentPointsThereAreNone) {
  SidedPoints points;
  for (int i = 0; i < 60; ++i) points.add(Vec3d(1, 2, 3), Vec3d(0, 0, 1));
  EXPECT_EQ(clipped(estimated(points)), 0U);
  points = {};
  for (int i = 0; i < 3; ++i) points.add(Vec3d(i, i * i, 0), Vec3d(0, 0, 1));
  EXPECT_EQ(clipped(estimated(points)), 0U);
}

}  // namespace
}  // namespace surfel::test
