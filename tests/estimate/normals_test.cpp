#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/normals.h>
#include <surfel/sample/generate.h>

namespace surfel {
namespace {

using Points = Array<Vec3f>;

NormalEstimate normals_of(const Points& points, const NormalOptions& options = {}) {
  return estimate_normals(points, *make_neighbor_search(points), options);
}

double uniform(std::size_t i, std::uint64_t dimension) { return random_uniform(17, i, dimension); }

/// Normally distributed (Box, Muller).
double gaussian(std::size_t i) {
  return std::sqrt(-2 * std::log(1 - uniform(i, 90))) *
         std::cos(2 * std::numbers::pi * uniform(i, 91));
}

Points random_plane(std::size_t count, const Eigen::Matrix3d& frame, const Vec3d& at = {0, 0, 0}) {
  Points p;
  for (std::size_t i = 0; i < count; ++i) {
    p.push_back((at + frame * Vec3d(uniform(i, 0), uniform(i, 1), 0)).cast<float>());
  }
  return p;
}

Eigen::Matrix3d some_rotation() {
  return Eigen::AngleAxisd(0.7, Vec3d(1, 2, -2).normalized()).toRotationMatrix();
}

struct Angles {
  double mean = 0;
  double percentile_99 = 0;
};

/// Between lines, in degrees.
Angles angles(const Array<Vec3f>& a, const Array<Vec3f>& truth) {
  std::vector<double> all;
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Vec3d p = a[i].cast<double>();
    const Vec3d q = truth[i].cast<double>();
    all.push_back(std::atan2(p.cross(q).norm(), std::abs(p.dot(q))) * 180 / std::numbers::pi);
    sum += all.back();
  }
  std::sort(all.begin(), all.end());
  return {sum / static_cast<double>(all.size()), all[all.size() * 99 / 100]};
}

/// A generated surface with noise along its normals, in spacings.
SurfelCloud noisy_surface(const std::string& kind, double noise) {
  SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), {.count = 20000});
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double distance = noise * std::sqrt(static_cast<double>(cloud.area[i])) * gaussian(i);
    cloud.position[i] += static_cast<float>(distance) * cloud.normal[i];
  }
  return cloud;
}

/// What holds for every estimate of anything.
void expect_sound(const NormalEstimate& e, std::size_t count) {
  ASSERT_EQ(e.normal.size(), count);
  ASSERT_EQ(e.quality.size(), count);
  std::array<std::size_t, kPointFlags> flagged{};
  for (std::size_t i = 0; i < count; ++i) {
    ++flagged[static_cast<std::size_t>(e.quality[i].flag)];
    if (e.quality[i].flag == PointFlag::kGood || e.quality[i].flag == PointFlag::kThin) {
      ASSERT_NEAR(e.normal[i].norm(), 1, 1e-6) << i;
    } else {
      ASSERT_TRUE(e.normal[i].isZero(0)) << i;
    }
    ASSERT_TRUE(e.quality[i].curvature >= 0 && e.quality[i].curvature <= 0.33334F) << i;
    ASSERT_TRUE(e.quality[i].confidence >= 0 && e.quality[i].confidence <= 1) << i;
  }
  EXPECT_EQ(flagged, e.flagged);
}

TEST(NormalOptions, DefaultsAreValidAndBadValuesRefused) {
  EXPECT_TRUE(NormalOptions{}.problems().empty());
  EXPECT_TRUE(NormalOptions{.adaptive = true}.problems().empty());
  const Points points = random_plane(30, Eigen::Matrix3d::Identity());
  for (const NormalOptions& bad :
       {NormalOptions{.k = 2}, NormalOptions{.k = 65536}, NormalOptions{.k_min = 3},
        NormalOptions{.k_min = 65}, NormalOptions{.k_max = 65536}, NormalOptions{.k_max = 0},
        NormalOptions{.radius = -1}, NormalOptions{.radius = std::nan("")},
        NormalOptions{.radius = std::numeric_limits<double>::infinity()},
        NormalOptions{.adaptive = true, .radius = 1}}) {
    EXPECT_EQ(bad.problems().size(), 1U);
    EXPECT_THROW(normals_of(points, bad), Error);
  }
  const Points others = random_plane(31, Eigen::Matrix3d::Identity());
  EXPECT_THROW(estimate_normals(points, *make_neighbor_search(others)), Error);
}

TEST(Normals, PlaneIsExactAtAnyScaleAndPlace) {
  const Eigen::Matrix3d frame = some_rotation();
  const NormalOptions fixed;
  const NormalOptions adaptive{.adaptive = true};
  for (const double scale : {1e-6, 1.0, 1e6}) {
    const Points points = random_plane(2000, scale * frame);
    const NormalOptions radius{.radius = 0.1 * scale};
    for (const NormalOptions& options : {fixed, adaptive, radius}) {
      const NormalEstimate e = normals_of(points, options);
      expect_sound(e, points.size());
      EXPECT_EQ(e.count(PointFlag::kGood), points.size());
      Array<Vec3f> truth;
      truth.assign(points.size(), frame.col(2).cast<float>());
      EXPECT_LT(angles(e.normal, truth).percentile_99, 1e-3);
      for (const NormalQuality& quality : e.quality) {
        EXPECT_LT(quality.curvature, 1e-10F);
        EXPECT_GT(quality.confidence, 0.9999F);
      }
    }
  }
  // The offsets are a 4000th of the coordinates: what is left are the roundings of these.
  const Points far = random_plane(2000, frame, Vec3d(4000, -4000, 4000));
  Array<Vec3f> truth;
  truth.assign(far.size(), frame.col(2).cast<float>());
  EXPECT_LT(angles(normals_of(far).normal, truth).percentile_99, 0.3);
}

TEST(Normals, SidesAreFixed) {
  const NormalEstimate e = normals_of(noisy_surface("sphere", 0).position);
  for (const Vec3f& n : e.normal) {
    Eigen::Index largest = 0;
    n.cwiseAbs().maxCoeff(&largest);
    ASSERT_GT(n[largest], 0);
  }
}

TEST(Normals, CurvedSurfacesAreWithinBounds) {
  const SurfelCloud sphere = noisy_surface("sphere", 0);
  const NormalEstimate e = normals_of(sphere.position);
  expect_sound(e, sphere.size());
  EXPECT_LT(angles(e.normal, sphere.normal).mean, 0.3);
  EXPECT_LT(angles(e.normal, sphere.normal).percentile_99, 0.8);
  const SurfelCloud torus = noisy_surface("torus", 0);
  const Angles error = angles(normals_of(torus.position).normal, torus.normal);
  EXPECT_LT(error.mean, 0.8);
  EXPECT_LT(error.percentile_99, 2.5);
}

TEST(Normals, CurvatureIsThatOfASphericalCap) {
  // On a disc of radius r of a surface of curvature K, z = K s^2 / 2 has the variance K^2 r^4 / 48,
  // each of the other two axes r^2 / 4.
  const SurfelCloud sphere = noisy_surface("sphere", 0);
  const int k = 400;
  const NormalEstimate e = normals_of(sphere.position, {.k = k});
  const double r2 = k * static_cast<double>(sphere.area[0]) / std::numbers::pi;
  double sum = 0;
  for (const NormalQuality& q : e.quality) sum += static_cast<double>(q.curvature);
  const double expected = r2 / 48 / (0.5 + r2 / 48);
  EXPECT_NEAR(sum / static_cast<double>(e.quality.size()), expected, 0.03 * expected);
}

TEST(Normals, AdaptiveSizeTakesNoiseAwayAndIsNoWorseWithout) {
  for (const std::string kind : {"sphere", "torus"}) {
    for (const double noise : {0.0, 0.1, 0.3}) {
      const SurfelCloud cloud = noisy_surface(kind, noise);
      const Angles fixed = angles(normals_of(cloud.position).normal, cloud.normal);
      const NormalEstimate e = normals_of(cloud.position, {.adaptive = true});
      expect_sound(e, cloud.size());
      const Angles adaptive = angles(e.normal, cloud.normal);
      const double share = noise == 0 ? 1 : noise < 0.2 ? 0.6 : 0.4;
      EXPECT_LT(adaptive.mean, share * fixed.mean) << kind << noise;
      EXPECT_LT(adaptive.percentile_99, std::sqrt(share) * fixed.percentile_99) << kind << noise;
    }
  }
}

TEST(Normals, ConfidenceIsTheErrorThatThereIs) {
  for (const double noise : {0.1, 0.3}) {
    const SurfelCloud cloud = noisy_surface("plane", noise);
    const NormalEstimate e = normals_of(cloud.position);
    double predicted2 = 0;
    double found2 = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      predicted2 += std::pow(1 - e.quality[i].confidence, 2);
      found2 += e.normal[i].cross(cloud.normal[i]).squaredNorm();
    }
    EXPECT_NEAR(std::sqrt(predicted2 / found2), 1, 0.15) << noise;
  }
}

TEST(Normals, AdaptiveSizeStopsAtAnEdge) {
  // Half planes at a right angle; points within 4 spacings of the edge, whose 64 neighbours cross.
  Points points;
  Array<Vec3f> truth;
  const std::size_t count = 10000;
  for (std::size_t i = 0; i < count; ++i) {
    const auto u = static_cast<float>(uniform(i, 0));
    const auto v = static_cast<float>(uniform(i, 1));
    const bool wall = i % 2 == 0;
    points.push_back(wall ? Vec3f(u, 0, v) : Vec3f(u, v, 0));
    truth.push_back(wall ? Vec3f(0, 1, 0) : Vec3f(0, 0, 1));
  }
  const double fixed = angles(normals_of(points, {.k = 64}).normal, truth).mean;
  EXPECT_LT(angles(normals_of(points, {.adaptive = true}).normal, truth).mean, 0.6 * fixed);
}

TEST(Normals, FewPointsAreFlagged) {
  const Vec3f a(1, 2, 3);
  for (const bool adaptive : {false, true}) {
    const NormalOptions options{.adaptive = adaptive};
    expect_sound(normals_of({}, options), 0);
    for (const Points& points : {Points{a}, Points{a, a}, Points{a, {2, 2, 3}}}) {
      const NormalEstimate e = normals_of(points, options);
      expect_sound(e, points.size());
      EXPECT_EQ(e.count(PointFlag::kTooFew), points.size());
      EXPECT_EQ(e.extended, 0U);
    }
    const NormalEstimate triangle = normals_of({a, {2, 2, 3}, {1, 3, 3}}, options);
    expect_sound(triangle, 3);
    EXPECT_EQ(triangle.count(PointFlag::kGood), 3U);
    EXPECT_NEAR(triangle.normal[0].z(), 1, 1e-6);
    EXPECT_EQ(triangle.quality[0].confidence, 0);  // Three points fit a plane wherever they are.
  }
}

TEST(Normals, CoincidentAndCollinearPointsAreFlagged) {
  for (const bool adaptive : {false, true}) {
    Points coincident;
    coincident.assign(5000, Vec3f(0.1F, 0.2F, 0.3F));
    const NormalEstimate e = normals_of(coincident, {.adaptive = adaptive});
    expect_sound(e, coincident.size());
    EXPECT_EQ(e.count(PointFlag::kCoincident), coincident.size());

    Points line;
    for (int i = 0; i < 1000; ++i) {
      line.push_back(Vec3f(5, 6, 7) + 0.01F * static_cast<float>(i) * Vec3f(0.3F, 0.5F, -0.7F));
    }
    const NormalEstimate of_line = normals_of(line, {.adaptive = adaptive});
    expect_sound(of_line, line.size());
    EXPECT_EQ(of_line.count(PointFlag::kCollinear), line.size());

    // Two places: a line, however many points are there.
    Points pair = coincident;
    for (std::size_t i = 0; i < pair.size(); i += 2) pair[i].x() += 1;
    const NormalEstimate of_pair = normals_of(pair, {.adaptive = adaptive});
    expect_sound(of_pair, pair.size());
    EXPECT_EQ(of_pair.count(PointFlag::kGood), 0U);
  }
}

TEST(Normals, DuplicatesDoNotHideTheSurface) {
  Points points = random_plane(500, some_rotation());
  const Points once = points;
  for (int copies = 0; copies < 15; ++copies) {
    points.insert(points.end(), once.begin(), once.end());
  }
  const NormalEstimate e = normals_of(points);  // All 16 nearest are at one place.
  expect_sound(e, points.size());
  EXPECT_EQ(e.extended, points.size());
  EXPECT_GT(e.count(PointFlag::kGood), points.size() * 95 / 100);
  EXPECT_EQ(e.count(PointFlag::kCoincident), 0U);
}

TEST(Normals, ScanLinesAreExtendedAcross) {
  // Ten times as dense along the lines as across; noise is only along the normal, so that the
  // points of one line look like a plane through the normal.
  for (const double noise : {0.0, 0.3}) {
    Points points;
    for (int y = 0; y < 40; ++y) {
      for (int x = 0; x < 400; ++x) {
        points.emplace_back(static_cast<float>(x), 10 * static_cast<float>(y),
                            static_cast<float>(noise * gaussian(points.size())));
      }
    }
    Array<Vec3f> truth;
    truth.assign(points.size(), Vec3f(0, 0, 1));
    for (const bool adaptive : {false, true}) {
      const NormalEstimate e = normals_of(points, {.adaptive = adaptive});
      expect_sound(e, points.size());
      EXPECT_EQ(e.count(PointFlag::kGood), points.size());
      if (!adaptive) {
        EXPECT_GT(e.extended, points.size() * 9 / 10);
      }
      const Angles error = angles(e.normal, truth);
      EXPECT_LT(error.mean, noise == 0 ? 1e-4 : 2.0);
      EXPECT_LT(error.percentile_99, noise == 0 ? 1e-4 : 6.0);
    }
  }
}

TEST(Normals, IsolatedPointsHaveNoNeighborsWithinTheRadius) {
  Points points = random_plane(2000, Eigen::Matrix3d::Identity());
  points.emplace_back(50.0F, 0.0F, 0.0F);
  const NormalEstimate e = normals_of(points, {.radius = 0.1});
  expect_sound(e, points.size());
  EXPECT_EQ(e.quality.back().flag, PointFlag::kTooFew);
  EXPECT_EQ(e.quality.back().neighbors, 1);
  EXPECT_EQ(e.count(PointFlag::kGood), points.size() - 1);
}

TEST(Normals, SameBytesForAnyNumberOfThreads) {
  SurfelCloud cloud = noisy_surface("torus", 0.2);
  for (int x = 0; x < 300; ++x) cloud.position.emplace_back(static_cast<float>(x), 5.0F, 5.0F);
  const auto same = [](const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  for (const bool adaptive : {false, true}) {
    const NormalOptions options{.adaptive = adaptive};
    set_thread_count(1);
    const NormalEstimate one = normals_of(cloud.position, options);
    for (const int threads : {2, 5}) {
      set_thread_count(threads);
      const NormalEstimate many = normals_of(cloud.position, options);
      EXPECT_TRUE(same(one.normal, many.normal));
      EXPECT_TRUE(one.quality == many.quality);
      EXPECT_EQ(one.flagged, many.flagged);
      EXPECT_EQ(one.extended, many.extended);
    }
  }
  set_thread_count(0);
}

}  // namespace
}  // namespace surfel
