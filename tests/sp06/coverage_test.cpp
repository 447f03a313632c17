#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/scene/clips.h>
#include <surfel/sp06/coverage.h>

namespace surfel {
namespace {

/// Surfels of a procedural scene in `groups` groups drawn at random, or each where it overlaps
/// least of those before it.
SurfelCloud grouped_scene(const std::string& kind, std::size_t count, std::size_t groups,
                          bool random = false) {
  SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), {.count = count});
  cloud.group.assign(count, 0);
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<double> overlap(groups);
    if (random) {
      for (std::size_t k = 0; k < groups; ++k) overlap[k] = random_uniform(5, i, k);
    } else {
      const float r = std::sqrt(2 * cloud.variance[i]);
      for (std::size_t j = 0; j < i; ++j) {
        const float lens = 2 * r - (cloud.position[i] - cloud.position[j]).norm();
        if (lens > 0) overlap[cloud.group[j]] += static_cast<double>(lens);
      }
    }
    cloud.group[i] = static_cast<std::uint16_t>(std::min_element(overlap.begin(), overlap.end()) -
                                                overlap.begin());
  }
  return cloud;
}

/// Square grid of pitch 1 in the plane z = 0, all in group 0.
SurfelCloud grid(int side, float radius) {
  SurfelCloud cloud;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      cloud.position.emplace_back(static_cast<float>(x), static_cast<float>(y), 0.0F);
    }
  }
  cloud.normal.assign(cloud.size(), Vec3f(0, 0, 1));
  cloud.variance.assign(cloud.size(), radius * radius / 2);
  cloud.group.assign(cloud.size(), 0);
  return cloud;
}

float radius_of(const SurfelCloud& cloud, std::size_t i) {
  return cloud.group_radius.empty() ? std::sqrt(2 * cloud.variance[i]) : cloud.group_radius[i];
}

/// Does a disc of the group cover the point, looked at along the disc's normal?
bool covered(const SurfelCloud& cloud, std::uint16_t group, const Vec3f& point,
             const Vec3f& normal) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float r = radius_of(cloud, i);
    const Vec3f offset = point - cloud.position[i];
    if (cloud.group[i] != group || offset.squaredNorm() > 2 * r * r) continue;
    const float height = offset.dot(cloud.normal[i]);
    if (cloud.normal[i].dot(normal) > 0 && offset.squaredNorm() - height * height <= r * r) {
      return true;
    }
  }
  return false;
}

/// Share of a scene's surface that a group leaves uncovered, at random points of parameters
/// (u, v); `uniform` maps two random numbers to these, by area.
template <class Uniform>
double uncovered_share(const SurfelCloud& cloud, std::uint16_t group, const std::string& kind,
                       std::size_t points, Uniform uniform) {
  const ProceduralScene scene = procedural_scene(kind, 1);
  std::size_t holes = 0;
  for (std::size_t k = 0; k < points; ++k) {
    const Vec2d uv = uniform(random_uniform(9, k, 0), random_uniform(9, k, 1));
    const auto at = scene.parts[0].shape->at(uv.x(), uv.y());
    holes += covered(cloud, group, at.position.cast<float>(), at.normal.cast<float>()) ? 0 : 1;
  }
  return static_cast<double>(holes) / static_cast<double>(points);
}

Vec2d on_plane(double s, double t) { return {s, t}; }
/// The sphere's poles are at v = 0 and 1.
Vec2d on_sphere(double s, double t) { return {s, std::acos(1 - 2 * t) / std::numbers::pi}; }

SurfelCloud covered_by(SurfelCloud cloud, CoverMethod method, CoverageReport* report = nullptr) {
  const CoverageReport found = cover_groups(cloud, {.method = method});
  if (report) *report = found;
  return cloud;
}

constexpr CoverMethod kCoverMethods[] = {CoverMethod::kNone, CoverMethod::kEnlarge,
                                         CoverMethod::kEnlargeEach, CoverMethod::kDuplicate};

TEST(CoverageOptions, DefaultsAreValidAndBadValuesRefused) {
  EXPECT_TRUE(CoverageOptions{}.problems().empty());
  const double nan = std::nan("");
  SurfelCloud cloud = grid(3, 1);
  for (const CoverageOptions& bad :
       {CoverageOptions{.cutoff = 0}, CoverageOptions{.cutoff = nan}, CoverageOptions{.target = 0},
        CoverageOptions{.target = 1.1}, CoverageOptions{.least_gain = 0},
        CoverageOptions{.least_gain = 1}, CoverageOptions{.most_growth = 0.5},
        CoverageOptions{.most_growth = nan}, CoverageOptions{.fixed_point_iterations = -1}}) {
    EXPECT_EQ(bad.problems().size(), 1U);
    EXPECT_THROW(cover_groups(cloud, bad), Error);
  }
}

TEST(Coverage, MissingColumnsAreNamed) {
  const auto message = [](SurfelCloud cloud) -> std::string {
    try {
      cover_groups(cloud);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      return error.what();
    }
    return "";
  };
  SurfelCloud cloud = grid(3, 1);
  cloud.group = {};
  EXPECT_NE(message(cloud).find("groups"), std::string::npos);
  cloud = grid(3, 1);
  cloud.normal = {};
  EXPECT_NE(message(cloud).find("normals"), std::string::npos);
  cloud = grid(3, 1);
  cloud.variance = {};
  EXPECT_NE(message(cloud).find("variances"), std::string::npos);
}

TEST(Coverage, OfAGridInClosedForm) {
  // Radius 0.6 overlaps the four neighbours: two segments of each lens belong to the discs' cells.
  const double r = 0.6;
  const double segment = r * r * std::acos(0.5 / r) - 0.5 * std::sqrt(r * r - 0.25);
  CoverageReport report;
  const int side = 20;
  covered_by(grid(side, static_cast<float>(r)), CoverMethod::kNone, &report);
  const double lenses = 2.0 * side * (side - 1);
  const double expected = side * side * std::numbers::pi * r * r - lenses * 2 * segment;
  // Without `area` A is the union of the discs, as they are one group.
  EXPECT_FALSE(report.area_from_column);
  EXPECT_NEAR(report.area, expected, 1e-5 * expected);
  EXPECT_NEAR(report.covered_area, expected, 1e-5 * expected);
  EXPECT_NEAR(report.overlap_area, lenses * 2 * segment, 1e-4 * expected);
}

TEST(Coverage, EnlargedGridCoversItsCorners) {
  // The corner of a cell of the grid is at sqrt(1/2); the border's cells end with the discs.
  SurfelCloud cloud = covered_by(grid(20, 0.6F), CoverMethod::kEnlargeEach);
  EXPECT_NEAR(cloud.group_radius[20 * 10 + 10], std::sqrt(0.5), 1e-6);
  for (const float r : cloud.group_radius) {
    EXPECT_GE(r, 0.6F);
    EXPECT_LE(r, 0.6 * std::numbers::sqrt2 + 1e-5);
  }
}

TEST(Coverage, OfASphereAgreesWithRandomPoints) {
  for (const bool random : {false, true}) {
    CoverageReport report;
    const SurfelCloud cloud =
        covered_by(grouped_scene("sphere", 3000, 4, random), CoverMethod::kNone, &report);
    EXPECT_TRUE(report.area_from_column);
    EXPECT_NEAR(report.area, 4 * std::numbers::pi, 0.01);
    const double holes = uncovered_share(cloud, 1, "sphere", 6000, on_sphere);
    const GroupCoverage& group = report.groups[1];
    // 1 % and two standard errors of the random points.
    EXPECT_NEAR(group.covered_area / report.area, 1 - holes, 0.01 + (random ? 0.01 : 0.005));
    EXPECT_NEAR(group.cell_area / report.area, 1, 0.01);
    EXPECT_NEAR(group.covered_area + group.uncovered_area, group.cell_area, 1e-9);
    // Two standard errors of 3000 samples.
    EXPECT_NEAR(group.missed_share, holes, 0.015);
  }
}

TEST(Coverage, OfAPlaneAgreesWithACountOfPoints) {
  CoverageReport report;
  const SurfelCloud cloud =
      covered_by(grouped_scene("plane", 1500, 4, true), CoverMethod::kNone, &report);
  const double radius = std::sqrt(2 * static_cast<double>(cloud.variance[0]));
  // A grid over the square and what its discs reach beyond.
  constexpr int kSide = 200;
  const double half = 1 + radius;
  int inside = 0;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const Vec3d p(half * (2 * (x + 0.5) / kSide - 1), half * (2 * (y + 0.5) / kSide - 1), 0);
      inside += covered(cloud, 1, p.cast<float>(), Vec3f(0, 0, 1)) ? 1 : 0;
    }
  }
  const double expected = 4 * half * half * inside / (kSide * kSide);
  const GroupCoverage& group = report.groups[1];
  EXPECT_NEAR(group.covered_area, expected, 0.01 * expected);
  EXPECT_GT(group.cell_area, 4);
  EXPECT_LT(group.cell_area, 4 * half * half);
}

TEST(Coverage, CoveredAreaOfSeparateDiscsIsTheirs) {
  // Discs that do not meet: n pi r^2, on a sphere to the 1 % asked for.
  for (const std::string kind : {"plane", "sphere"}) {
    SurfelCloud cloud =
        generate_surfels(procedural_scene(kind, 1), {.count = 4000, .variance_scale = 0.05});
    for (std::size_t i = 0; i < cloud.size(); ++i) cloud.group.push_back(i % 3 == 0 ? 1 : 0);
    CoverageReport report;
    covered_by(cloud, CoverMethod::kNone, &report);
    const double disc = std::numbers::pi * 2 * static_cast<double>(cloud.variance[0]);
    for (const GroupCoverage& group : report.groups) {
      const double expected = static_cast<double>(group.splats) * disc;
      EXPECT_NEAR(group.covered_area, expected, 0.001 * expected) << kind;
      EXPECT_NEAR(group.overlap_area, 0, 0.001 * expected) << kind;
    }
  }
}

TEST(Coverage, EnlargeEachLeavesNoHoles) {
  for (const std::size_t groups : {4U, 9U}) {
    for (const std::string kind : {"plane", "sphere"}) {
      CoverageReport report;
      const SurfelCloud cloud =
          covered_by(grouped_scene(kind, 2500, groups), CoverMethod::kEnlargeEach, &report);
      EXPECT_LT(report.uncovered_area, 1e-6 * report.area);
      const double holes = kind == "plane" ? uncovered_share(cloud, 2, kind, 5000, on_plane)
                                           : uncovered_share(cloud, 2, kind, 5000, on_sphere);
      EXPECT_LT(holes, 0.001) << kind << ' ' << groups;
      EXPECT_LT(report.missed_share, 0.001) << kind << ' ' << groups;
    }
  }
}

TEST(Coverage, EnlargeReachesItsTargetWithOneFactor) {
  const SurfelCloud before = grouped_scene("sphere", 2500, 4);
  SurfelCloud cloud = before;
  // Flat cells hold a little less than the sphere.
  const CoverageReport report =
      cover_groups(cloud, {.method = CoverMethod::kEnlarge, .target = 0.99});
  for (const GroupCoverage& group : report.groups) {
    ASSERT_TRUE(group.enlargement);
    EXPECT_TRUE(group.enlargement->converged);
    EXPECT_NEAR(group.covered_area, 0.99 * report.area, 1e-5 * report.area);
    EXPECT_NEAR(group.unreachable_area, 0, 1e-5 * report.area);
  }
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double own = std::sqrt(2 * static_cast<double>(before.variance[i]));
    const double factor = report.groups[cloud.group[i]].enlargement->factor;
    EXPECT_NEAR(cloud.group_radius[i], factor * own, 1e-6 * own * factor);
  }
  EXPECT_LT(uncovered_share(cloud, 0, "sphere", 5000, on_sphere), 0.02);
}

TEST(Coverage, AreaBeyondTheCellsIsReportedAndInflatesNothing) {
  // Twice the area that there is: the cells hold half of it, and their last corners are left open.
  SurfelCloud cloud = grid(20, 0.6F);
  cloud.area.assign(cloud.size(), 2);
  const CoverageReport report = cover_groups(cloud, {.method = CoverMethod::kEnlarge});
  const GroupCoverage& group = report.groups[0];
  EXPECT_FALSE(group.enlargement->converged);
  EXPECT_NEAR(group.covered_area, 0.999 * group.cell_area, 1e-5 * group.cell_area);
  EXPECT_NEAR(group.unreachable_area, 2.0 * 400 - group.covered_area, 1e-6 * 800);
  EXPECT_EQ(report.unreachable_area, group.unreachable_area);
}

TEST(Coverage, GrowthIsLimitedAndTheRestReported) {
  // A grid with one gap: its neighbours would have to grow over it.
  SurfelCloud plane = grid(20, 0.75F);
  for (std::size_t i = 0; i < plane.size(); ++i) {
    const Vec2f from_center = plane.position[i].head<2>() - Vec2f(9.5F, 9.5F);
    plane.group[i] = from_center.norm() < 3 ? 1 : 0;
  }
  const auto cover = [](SurfelCloud cloud, double most_growth, CoverageReport& report) {
    report = cover_groups(cloud, {.method = CoverMethod::kEnlargeEach, .most_growth = most_growth});
    return cloud;
  };
  CoverageReport free;
  CoverageReport limited;
  const SurfelCloud grown = cover(plane, 100, free);
  const SurfelCloud held = cover(plane, 1.5, limited);
  EXPECT_EQ(free.limited, 0U);
  EXPECT_LT(free.uncovered_area, 1e-4 * free.area);
  EXPECT_GT(free.groups[0].growth_max, 3);
  EXPECT_GT(limited.groups[0].limited, 0U);
  EXPECT_EQ(limited.limited, limited.groups[0].limited + limited.groups[1].limited);
  EXPECT_GT(limited.groups[0].uncovered_area, 1);
  for (std::size_t i = 0; i < plane.size(); ++i) {
    if (plane.group[i] != 0) continue;
    // The median splat of the grid covers its cell as it is.
    EXPECT_LE(held.group_radius[i], 1.5F * 0.75F * 1.0001F);
    EXPECT_LE(held.group_radius[i], grown.group_radius[i]);
  }
}

TEST(Coverage, EnlargeEachOverlapsLessThanEnlarge) {
  // A closed surface: the cells at a border hold more than the surface, which one factor for all
  // leaves open.
  const SurfelCloud cloud = grouped_scene("sphere", 2500, 5);
  CoverageReport one;
  CoverageReport each;
  covered_by(cloud, CoverMethod::kEnlarge, &one);
  covered_by(cloud, CoverMethod::kEnlargeEach, &each);
  EXPECT_LT(each.overlap_area, 0.9 * one.overlap_area);
  EXPECT_LT(each.uncovered_area, one.uncovered_area);
}

TEST(Coverage, FixedPointStaysBelowTheRootAndDivergesBeyondTheArea) {
  const SurfelCloud source = grid(16, 0.3F);
  const Discs discs = make_discs(source, 1);
  SurfelCloud wide = source;
  for (float& variance : wide.variance) variance *= 9;
  const DiscSurface surface(make_discs(wide, 1), false);
  const GroupCells cells(discs, surface);
  const double reachable = 0.95 * cells.area();
  const Enlargement root = enlarge_by_bracketing(cells, discs.radius, reachable);
  const Enlargement fixed = enlarge_by_fixed_point(cells, discs.radius, reachable, 1000);
  EXPECT_TRUE(root.converged);
  EXPECT_TRUE(fixed.converged);
  EXPECT_NEAR(cells.covered_area(discs.radius, root.factor), reachable, 2e-6 * reachable);
  EXPECT_LE(fixed.factor, root.factor);
  EXPECT_NEAR(fixed.factor, root.factor, 0.01 * root.factor);

  const double too_much = 1.05 * cells.area();
  EXPECT_FALSE(enlarge_by_bracketing(cells, discs.radius, too_much).converged);
  const Enlargement some = enlarge_by_fixed_point(cells, discs.radius, too_much, 50);
  const Enlargement more = enlarge_by_fixed_point(cells, discs.radius, too_much, 200);
  EXPECT_FALSE(more.converged);
  EXPECT_GT(more.factor, 1.2 * some.factor) << "grows without limit";
}

TEST(Coverage, DuplicatesCoverWhatTheGroupLacks) {
  for (const std::string kind : {"plane", "sphere"}) {
    const SurfelCloud before = grouped_scene(kind, 2500, 4);
    CoverageReport none;
    CoverageReport report;
    covered_by(before, CoverMethod::kNone, &none);
    const SurfelCloud cloud = covered_by(before, CoverMethod::kDuplicate, &report);
    EXPECT_GT(report.points_added, 0U);
    ASSERT_EQ(cloud.size(), before.size() + report.points_added);
    EXPECT_TRUE(cloud.group_radius.empty());
    EXPECT_LT(report.uncovered_area, 0.25 * none.uncovered_area);
    ASSERT_EQ(cloud.source.size(), cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const std::uint32_t original = cloud.source[i];
      if (i < before.size()) {
        EXPECT_EQ(original, i);
        EXPECT_EQ(cloud.group[i], before.group[i]);
      } else {
        EXPECT_NE(cloud.group[i], before.group[original]);
      }
      EXPECT_EQ(cloud.position[i], before.position[original]);
    }
    const double holes = kind == "plane" ? uncovered_share(cloud, 0, kind, 3000, on_plane)
                                         : uncovered_share(cloud, 0, kind, 3000, on_sphere);
    EXPECT_LT(holes, 0.01) << kind;
  }
}

TEST(Coverage, SmallerLeastGainCoversMoreWithMorePoints) {
  SurfelCloud coarse = grouped_scene("sphere", 1500, 4);
  SurfelCloud fine = coarse;
  const CoverageReport few =
      cover_groups(coarse, {.method = CoverMethod::kDuplicate, .least_gain = 0.3});
  const CoverageReport many =
      cover_groups(fine, {.method = CoverMethod::kDuplicate, .least_gain = 0.03});
  EXPECT_LT(few.points_added, many.points_added);
  EXPECT_GT(few.uncovered_area, many.uncovered_area);
}

TEST(Coverage, OpenPatchDoesNotGrowBeyondItsBorder) {
  const SurfelCloud before = grouped_scene("plane", 2000, 6);
  CoverageReport report;
  const SurfelCloud cloud = covered_by(before, CoverMethod::kEnlargeEach, &report);
  EXPECT_GT(report.capped, 0U);
  EXPECT_LT(report.capped, cloud.size() / 2);
  EXPECT_LT(report.growth_max, 4) << "six groups: cells are 2.4 times as wide";
  EXPECT_LT(report.groups[0].cell_area, 4.6) << "a strip as wide as a radius";
}

TEST(Coverage, OtherSheetsDoNotCut) {
  // Two grids back to back, closer than their pitch and shifted by half of it.
  SurfelCloud front = grid(12, 0.8F);
  SurfelCloud both = front;
  for (std::size_t i = 0; i < front.size(); ++i) {
    both.position.push_back(front.position[i] + Vec3f(0.5F, 0.5F, -0.01F));
    both.normal.emplace_back(0.0F, 0.0F, -1.0F);
  }
  both.variance.assign(both.size(), front.variance[0]);
  both.group.assign(both.size(), 0);
  CoverageReport one;
  CoverageReport two;
  const SurfelCloud alone = covered_by(front, CoverMethod::kEnlargeEach, &one);
  const SurfelCloud backed = covered_by(both, CoverMethod::kEnlargeEach, &two);
  EXPECT_NEAR(two.area, 2 * one.area, 1e-5 * two.area);
  for (std::size_t i = 0; i < front.size(); ++i) {
    EXPECT_NEAR(backed.group_radius[i], alone.group_radius[i], 1e-5);
  }
}

TEST(Coverage, CreasesMakeNoSpikes) {
  // Two jittered squares, folded along the y axis by more and more: no disc grows by what its plane
  // meets beyond the fold.
  for (const double fold : {30.0, 60.0, 85.0, 95.0, 150.0}) {
    const double angle = fold * std::numbers::pi / 180;
    SurfelCloud cloud = grouped_scene("plane", 1600, 3, true);
    double unfolded = 0;
    for (const float r : covered_by(cloud, CoverMethod::kEnlargeEach).group_radius) {
      unfolded = std::max(unfolded, static_cast<double>(r));
    }
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3f p = cloud.position[i];
      if (p.x() < 0) continue;
      const auto sine = static_cast<float>(std::sin(angle));
      const auto cosine = static_cast<float>(std::cos(angle));
      cloud.position[i] = Vec3f(p.x() * cosine, p.y(), -p.x() * sine);
      cloud.normal[i] = Vec3f(sine, 0, cosine);
    }
    cloud = covered_by(std::move(cloud), CoverMethod::kEnlargeEach);
    for (const float r : cloud.group_radius) EXPECT_LT(r, 1.3 * unfolded) << fold;
  }
}

TEST(Coverage, OneSplatAndEmptyClouds) {
  for (const CoverMethod method : kCoverMethods) {
    CoverageReport report;
    const SurfelCloud one = covered_by(grid(1, 2), method, &report);
    EXPECT_EQ(one.size(), 1U);
    // The directions in which the border is measured make a polygon of 16 sides about the disc.
    const double polygon = 16 * std::tan(std::numbers::pi / 16) * 4;
    EXPECT_NEAR(report.groups[0].cell_area, polygon, 1e-4);
    EXPECT_GE(report.covered_area, 4 * std::numbers::pi - 1e-4);
    EXPECT_LE(radius_of(one, 0), 2 / std::cos(std::numbers::pi / 16) + 1e-5);
    SurfelCloud empty;
    EXPECT_EQ(cover_groups(empty, {.method = method}).groups.size(), 0U);
  }
}

TEST(Coverage, GroupOfOneSplatCoversWhatItSees) {
  SurfelCloud plane = grouped_scene("plane", 400, 2);
  for (std::size_t i = 0; i < plane.size(); ++i) plane.group[i] = i == 210 ? 1 : 0;
  CoverageReport report;
  SurfelCloud grown = covered_by(plane, CoverMethod::kEnlargeEach, &report);
  EXPECT_LT(uncovered_share(grown, 1, "plane", 2000, on_plane), 0.001);
  EXPECT_LT(grown.group_radius[210], 3.2F) << "the square's diagonal is 2.8";

  SurfelCloud sphere = grouped_scene("sphere", 400, 2);
  for (std::size_t i = 0; i < sphere.size(); ++i) sphere.group[i] = i == 210 ? 1 : 0;
  grown = covered_by(sphere, CoverMethod::kEnlargeEach, &report);
  EXPECT_LT(grown.group_radius[210], 3.0F);
  EXPECT_GT(report.groups[1].unreachable_area, 1) << "no disc covers the sphere's back";
}

TEST(Coverage, CoincidentSplatsCoverOnce) {
  for (const CoverMethod method : kCoverMethods) {
    SurfelCloud cloud = grid(1, 1);
    const std::size_t count = 5000;
    cloud.position.assign(count, Vec3f(1, 2, 3));
    cloud.normal.assign(count, Vec3f(0, 0, 1));
    cloud.variance.assign(count, 0.5F);
    cloud.group.assign(count, 0);
    for (std::size_t i = 0; i < count; ++i) cloud.group[i] = static_cast<std::uint16_t>(i % 3);
    CoverageReport report;
    covered_by(cloud, method, &report);
    EXPECT_EQ(report.points_added, 0U);
    EXPECT_EQ(report.hidden, count - 3);
    EXPECT_NEAR(report.area, std::numbers::pi, 1e-5);
    EXPECT_NEAR(report.covered_area, std::numbers::pi, 0.014 * std::numbers::pi);
    EXPECT_LT(report.growth_max, 1.03);
  }
}

TEST(Coverage, RadiiOfNineMagnitudesInOneCloud) {
  const SurfelCloud source = grouped_scene("plane", 600, 3);
  for (const CoverMethod method : kCoverMethods) {
    SurfelCloud cloud = source;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const double radius = std::pow(10, -6 + 9 * random_uniform(3, i));
      cloud.variance[i] = static_cast<float>(radius * radius / 2);
    }
    CoverageReport report;
    cloud = covered_by(std::move(cloud), method, &report);
    for (const GroupCoverage& group : report.groups) {
      EXPECT_TRUE(std::isfinite(group.covered_area) && group.covered_area > 0);
      EXPECT_TRUE(std::isfinite(group.overlap_area));
      EXPECT_LE(group.covered_area, group.cell_area * (1 + 1e-9));
    }
    for (const float r : cloud.group_radius) EXPECT_TRUE(r > 0 && std::isfinite(r));
  }
}

TEST(Coverage, ScaleDoesNotMatter) {
  const SurfelCloud source = grouped_scene("sphere", 600, 3);
  CoverageReport unit;
  const SurfelCloud reference = covered_by(source, CoverMethod::kEnlargeEach, &unit);
  for (const float scale : {0x1p-20F, 0x1p+20F}) {
    SurfelCloud cloud = source;
    for (Vec3f& p : cloud.position) p *= scale;
    for (float& v : cloud.variance) v *= scale * scale;
    for (float& a : cloud.area) a *= scale * scale;
    CoverageReport report;
    cloud = covered_by(std::move(cloud), CoverMethod::kEnlargeEach, &report);
    EXPECT_NEAR(report.growth_mean, unit.growth_mean, 1e-6);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      EXPECT_NEAR(cloud.group_radius[i] / scale, reference.group_radius[i],
                  1e-5 * reference.group_radius[i]);
    }
  }
}

TEST(Coverage, SplatsWithoutDiscAreCountedAndLeftAlone) {
  SurfelCloud cloud = grid(6, 0.8F);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.position[3].x() = nan;
  cloud.normal[8] = Vec3f::Zero();
  cloud.variance[10] = 0;
  cloud.variance[11] = nan;
  cloud.variance[12] = -1;
  for (const CoverMethod method : kCoverMethods) {
    CoverageReport report;
    const SurfelCloud out = covered_by(cloud, method, &report);
    EXPECT_EQ(report.without_disc, 5U);
    if (out.group_radius.empty()) continue;
    for (const std::size_t i : {3, 8, 10, 11, 12}) EXPECT_EQ(out.group_radius[i], 0);
  }
}

TEST(Coverage, SameBytesForAnyNumberOfThreads) {
  const SurfelCloud source = grouped_scene("head", 2000, 5);
  for (const CoverMethod method : kCoverMethods) {
    SurfelCloud first;
    CoverageReport first_report;
    for (const int threads : {1, 2, 5}) {
      set_thread_count(threads);
      CoverageReport report;
      const SurfelCloud cloud = covered_by(source, method, &report);
      if (threads == 1) {
        first = cloud;
        first_report = report;
        continue;
      }
      EXPECT_EQ(cloud.group, first.group);
      EXPECT_EQ(cloud.source, first.source);
      ASSERT_EQ(cloud.group_radius.size(), first.group_radius.size());
      EXPECT_EQ(cloud.group_radius, first.group_radius);
      EXPECT_EQ(report.covered_area, first_report.covered_area);
      EXPECT_EQ(report.overlap_area, first_report.overlap_area);
      EXPECT_EQ(report.area, first_report.area);
    }
    set_thread_count(0);
  }
}

/// Mirror images beyond a border are no surface: they are neither covered nor counted.
TEST(Coverage, SurfelsThatContinueOthersBeyondALineCountForNothing) {
  TriangleMesh square;
  square.position = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  square.face = {{0, 1, 2}, {0, 2, 3}};
  MeshSampleOptions options;
  options.spacing = 0.05;
  options.clip = true;
  MeshSampleReport sampled;
  SurfelCloud cloud = sample_mesh(square, options, &sampled);
  ASSERT_GT(sampled.mirrored, 0U);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.group.push_back(static_cast<std::uint16_t>(i % 2));
  }
  for (const CoverMethod method : kCoverMethods) {
    CoverageReport report;
    const SurfelCloud out = covered_by(cloud, method, &report);
    EXPECT_NEAR(report.area, 1, 1e-4);
    EXPECT_EQ(report.groups[0].splats + report.groups[1].splats,
              cloud.size() - sampled.mirrored + report.points_added);
    if (method == CoverMethod::kEnlargeEach) {
      EXPECT_LT(report.missed_share, 0.01);
    }
    for (std::size_t i = 0; i < out.size(); ++i) {
      if (!is_cut_off(out, i)) continue;
      EXPECT_FLOAT_EQ(radius_of(out, i), std::sqrt(2 * out.variance[i]));
      EXPECT_LT(i, cloud.size()) << "no copies of them";
    }
    ASSERT_EQ(out.clip1.size(), out.size());
    for (std::size_t i = cloud.size(); i < out.size(); ++i) {
      EXPECT_EQ(out.clip1[i], cloud.clip1[out.source[i]]) << "copies keep their lines";
      EXPECT_EQ(out.clip1_distance[i], cloud.clip1_distance[out.source[i]]);
    }
  }
}

}  // namespace
}  // namespace surfel
