#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/splat_size.h>

namespace surfel {
namespace {

struct OrientedPoints {
  Array<Vec3f> position;
  Array<Vec3f> normal;
  void add(double x, double y, double z = 0, const Vec3f& n = {0, 0, 1}) {
    position.push_back(Vec3d(x, y, z).cast<float>());
    normal.push_back(n);
  }
};

/// n x n points over the unit square, rows `aspect` times as far apart as columns.
OrientedPoints grid(int n, double jitter, double aspect = 1) {
  OrientedPoints out;
  const double h = 1.0 / n;
  const int rows = static_cast<int>(n / aspect);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::uint64_t>(j) * n + i;
      const double du = (2 * random_uniform(1, k, 0) - 1) * jitter;
      const double dv = (2 * random_uniform(1, k, 1) - 1) * jitter;
      out.add((i + 0.5 + du) * h, (j + 0.5 + dv) * h * aspect);
    }
  }
  return out;
}

SplatSizes sizes_of(const OrientedPoints& points, const SplatSizeOptions& options = {}) {
  const auto search = make_neighbor_search(points.position);
  return estimate_splat_sizes(points.position, points.normal, true, *search, options);
}

/// Mean number of discs or ellipses (beta < cutoff) over random places of the square's interior;
/// -1 if one is not covered.
double overlap(const OrientedPoints& points, const SplatSizes& sizes, double cutoff,
               double border) {
  const auto search = make_neighbor_search(points.position);
  double reach = 0;
  for (std::size_t i = 0; i < points.position.size(); ++i) {
    const float longest = sizes.of[i].variance_u;
    reach = std::max(reach, std::sqrt(2 * cutoff * longest));
  }
  std::vector<Neighbor> near;
  double sum = 0;
  constexpr int kPlaces = 20000;
  for (int s = 0; s < kPlaces; ++s) {
    const auto at = [&](int d) {
      return static_cast<float>(border + (1 - 2 * border) * random_uniform(7, s, d));
    };
    const Vec3f place(at(0), at(1), 0);
    search->within(place, static_cast<float>(reach), points.position.size(), near);
    int discs = 0;
    for (const Neighbor& neighbor : near) {
      const std::size_t i = neighbor.index;
      const Vec3f offset = place - points.position[i];
      double beta = offset.squaredNorm() / (2 * sizes.of[i].variance);
      if (sizes.ellipses) {
        const float u = offset.dot(sizes.of[i].tangent);
        const float v2 = offset.squaredNorm() - u * u;
        beta = u * u / (2 * sizes.of[i].variance_u) + v2 / (2 * sizes.of[i].variance_v);
      }
      discs += beta < cutoff ? 1 : 0;
    }
    if (discs == 0) return -1;
    sum += discs;
  }
  return sum / kPlaces;
}

TEST(SplatSize, RefusesBadOptions) {
  EXPECT_TRUE(SplatSizeOptions{}.problems().empty());
  for (const double cutoff : {0.0, 17.0, std::nan("")}) {
    EXPECT_EQ(SplatSizeOptions{.cutoff = cutoff}.problems().size(), 1U);
    EXPECT_THROW(sizes_of(grid(4, 0), {.cutoff = cutoff}), Error);
  }
  EXPECT_TRUE(SplatSizeOptions{.max_radius = 0}.problems().empty());
  for (const double radius : {-1.0, 0.5, std::nan("")}) {
    EXPECT_EQ(SplatSizeOptions{.max_radius = radius}.problems().size(), 1U);
  }
}

TEST(SplatSize, CoverHasNoHolesAndLittleOverlap) {
  for (const double jitter : {0.0, 0.35, 1.0}) {
    const OrientedPoints points = grid(60, jitter);
    SplatSizeOptions options;
    const double cover = overlap(points, sizes_of(points, options), 1, 0.1);
    options.rule = VarianceRule::kMaxDistance;
    const double largest = overlap(points, sizes_of(points, options), 1, 0.1);
    EXPECT_GT(cover, 1) << jitter;
    EXPECT_LT(cover, 0.35 * largest) << jitter;
  }
  // On a grid the disc's radius is half of the diagonal: pi / 2 discs over a point, with the
  // margin.
  const double expected = std::numbers::pi / 2 * 1.05 * 1.05;
  EXPECT_NEAR(overlap(grid(60, 0), sizes_of(grid(60, 0)), 1, 0.1), expected, 0.02);
}

TEST(SplatSize, VarianceFollowsTheCutoff) {
  const OrientedPoints points = grid(40, 0.35);
  for (const double cutoff : {0.5, 2.0, 4.0}) {
    SplatSizeOptions options;
    options.cutoff = cutoff;
    EXPECT_GT(overlap(points, sizes_of(points, options), cutoff, 0.1), 1);
  }
}

TEST(SplatSize, AreasSumToTheSurface) {
  const OrientedPoints points = grid(80, 0.35);
  double sum = 0;
  for (const SplatSize& size : sizes_of(points).of) sum += size.area;
  // The border ends a quarter of a spacing outside of the square, and counts for half of its discs.
  EXPECT_NEAR(sum, 1, 0.06);
}

TEST(SplatSize, ScanLinesGetEllipses) {
  for (const double aspect : {3.0, 8.0, 10.0}) {
    const OrientedPoints points = grid(200, 0.1, aspect);
    const SplatSizes ellipses = sizes_of(points);
    ASSERT_TRUE(ellipses.ellipses) << aspect;
    SplatSizeOptions options;
    options.anisotropy = Anisotropy::kOff;
    const SplatSizes discs = sizes_of(points, options);
    EXPECT_FALSE(discs.ellipses);
    const double with = overlap(points, ellipses, 1, 0.15);
    const double without = overlap(points, discs, 1, 0.15);
    EXPECT_GT(with, 1);
    EXPECT_GT(without, 1);
    EXPECT_LT(with, 0.8 * without) << aspect;
  }
  EXPECT_FALSE(sizes_of(grid(60, 0.35)).ellipses);  // Not worth it on even samples.
}

/// Points that fill a ball, with any normals, as leaves have.
OrientedPoints leaves() {
  OrientedPoints out;
  for (std::uint64_t k = 0; k < 20000; ++k) {
    const auto vector = [&](std::uint64_t first) {
      const auto at = [&](std::uint64_t d) { return 2 * random_uniform(4, k, first + d) - 1; };
      return Vec3d(at(0), at(1), at(2));
    };
    const Vec3d p = vector(0);
    if (p.squaredNorm() < 1) out.add(p.x(), p.y(), p.z(), vector(3).normalized().cast<float>());
  }
  return out;
}

TEST(SplatSize, LeavesGetNoPetals) {
  const OrientedPoints points = leaves();
  const auto longest = [&](double max_radius) {
    SplatSizeOptions options;
    options.max_radius = max_radius;
    const SplatSizes sizes = sizes_of(points, options);
    double most = 0;
    for (const SplatSize& size : sizes.of) {
      const double reach = std::sqrt(2 * options.cutoff * std::max(size.variance, size.variance_u));
      most = std::max(most, reach / size.spacing);
    }
    return most;
  };
  EXPECT_GT(longest(0), 4);
  EXPECT_LT(longest(3), 3.001);  // Though a few points look as if they were on a scan line.
}

TEST(SplatSize, NoiseIsReachedAcrossByHalfASpacingAtMost) {
  const OrientedPoints points = grid(60, 0);
  const auto search = make_neighbor_search(points.position);
  const auto reach2 = [&](float noise) {
    const std::vector<float> all(points.position.size(), noise);
    const SplatSizes sizes =
        estimate_splat_sizes(points.position, points.normal, true, *search, {}, all);
    return 2 * static_cast<double>(sizes.of[30 * 60 + 30].variance);
  };
  const double h = 1 / 60.0;
  const double clean = 2 * static_cast<double>(sizes_of(points).of[30 * 60 + 30].variance);
  EXPECT_NEAR(reach2(0) / clean, 1, 1e-6);
  EXPECT_NEAR((reach2(static_cast<float>(0.3 * h)) - clean) / (h * h), 0.09, 1e-3);
  EXPECT_NEAR((reach2(static_cast<float>(2 * h)) - clean) / (h * h), 0.25, 1e-3);
}

TEST(SplatSize, BordersDoNotFray) {
  const OrientedPoints points = grid(60, 0.3);
  const SplatSizes sizes = sizes_of(points);
  EXPECT_GT(sizes.border, 200U);
  EXPECT_LT(sizes.border, 300U);
  const double h = 1.0 / 60;
  std::size_t far = 0;
  for (std::size_t i = 0; i < points.position.size(); ++i) {
    const float outside =
        std::max(std::abs(points.position[i].x() - 0.5F), std::abs(points.position[i].y() - 0.5F)) -
        0.5F;
    const float reach = outside + std::sqrt(2 * sizes.of[i].variance);
    EXPECT_LT(reach, 2.1 * h);
    far += reach > 1.5 * h ? 1 : 0;
  }
  EXPECT_LT(far, sizes.border / 10);
}

TEST(SplatSize, APointAloneDoesNotSmear) {
  OrientedPoints points = grid(60, 0.3);
  points.add(0.5, 0.5, 0.7);
  points.add(3, 0.5, 0, Vec3f(0, 0, 0));  // Nor does one without a normal.
  const SplatSizes sizes = sizes_of(points);
  EXPECT_EQ(sizes.capped, 2U);
  for (const std::size_t alone : {points.position.size() - 2, points.position.size() - 1}) {
    EXPECT_LT(std::sqrt(2 * sizes.of[alone].variance), 5.0 / 60);
    EXPECT_GT(sizes.of[alone].variance, 0);
  }
}

TEST(SplatSize, SheetsDoNotDisturbEachOther) {
  OrientedPoints points = grid(50, 0.3);
  const SplatSizes alone = sizes_of(points);
  const std::size_t front = points.position.size();
  for (std::size_t i = 0; i < front; ++i) {  // The plate's other side, a tenth of a spacing away.
    const Vec3f& p = points.position[i];
    points.add(1 - p.x(), p.y(), -0.002, Vec3f(0, 0, -1));
  }
  const SplatSizes both = sizes_of(points);
  std::size_t same = 0;
  for (std::size_t i = 0; i < front; ++i) {
    same += std::abs(both.of[i].variance / alone.of[i].variance - 1) < 0.01F ? 1 : 0;
  }
  EXPECT_GT(static_cast<double>(same), 0.85 * static_cast<double>(front));  // But near the border.
}

TEST(SplatSize, DegenerateCloudsGiveFiniteNumbers) {
  std::vector<OrientedPoints> clouds(5);
  clouds[0].add(1, 2, 3);
  for (int i = 0; i < 2; ++i) clouds[1].add(i, 0);
  for (int i = 0; i < 100; ++i) clouds[2].add(1, 1, 1);
  for (int i = 0; i < 100; ++i) clouds[3].add(i * 0.1, 0);
  for (int i = 0; i < 100; ++i) clouds[4].add(i % 10, i / 50, 0, Vec3f(0, 0, 0));
  clouds.emplace_back();
  for (const OrientedPoints& points : clouds) {
    SplatSizeOptions options;
    for (const Anisotropy anisotropy : {Anisotropy::kOn, Anisotropy::kOff}) {
      options.anisotropy = anisotropy;
      const SplatSizes sizes = sizes_of(points, options);
      ASSERT_EQ(sizes.of.size(), points.position.size());
      for (std::size_t i = 0; i < sizes.of.size(); ++i) {
        EXPECT_TRUE(std::isfinite(sizes.of[i].variance) && sizes.of[i].variance >= 0);
        EXPECT_TRUE(std::isfinite(sizes.of[i].area) && sizes.of[i].area >= 0);
        if (!sizes.ellipses) continue;
        EXPECT_NEAR(sizes.of[i].tangent.norm(), 1, 1e-5);
        EXPECT_TRUE(std::isfinite(sizes.of[i].variance_u) && std::isfinite(sizes.of[i].variance_v));
      }
    }
  }
}

TEST(SplatSize, CoincidentPointsShareTheirArea) {
  OrientedPoints points = grid(40, 0.2);
  const std::size_t count = points.position.size();
  for (std::size_t i = 0; i < count; ++i) {
    points.add(points.position[i].x(), points.position[i].y());
  }
  double sum = 0;
  for (const SplatSize& size : sizes_of(points).of) sum += size.area;
  EXPECT_NEAR(sum, 1, 0.08);  // The border of 40 points a side reaches half a spacing too far.
}

TEST(SplatSize, SameForAnyNumberOfThreads) {
  const OrientedPoints points = grid(100, 0.4, 4);
  set_thread_count(1);
  const SplatSizes one = sizes_of(points);
  for (const int threads : {2, 5}) {
    set_thread_count(threads);
    const SplatSizes many = sizes_of(points);
    EXPECT_TRUE(one.of == many.of);
  }
  set_thread_count(0);
}

/// Notes the largest neighbourhood that is searched for.
class NotingSearch final : public NeighborSearch {
 public:
  explicit NotingSearch(const Array<Vec3f>& points) : search_(make_neighbor_search(points)) {}
  std::size_t size() const override { return search_->size(); }
  void search(const Vec3f& query, std::size_t most, float limit2,
              std::vector<Neighbor>& out) const override {
    most_searched = std::max(most_searched.load(), most);
    search_->search(query, most, limit2, out);
  }
  void for_each(std::size_t most, float limit2, Body body) const override {
    search_->for_each(most, limit2, body);
  }

  mutable std::atomic<std::size_t> most_searched = 0;

 private:
  std::unique_ptr<NeighborSearch> search_;
};

TEST(SplatSize, PointsOnALineLookNoFurtherThanTheirSpacing) {
  OrientedPoints points;
  for (int i = 0; i < 500; ++i) points.add(0.01 * i, 0, 0, Vec3f::Zero());
  const NotingSearch search(points.position);
  const SplatSizes sizes = estimate_splat_sizes(points.position, points.normal, false, search, {});
  EXPECT_LE(search.most_searched, kSplatNeighbors);
  EXPECT_EQ(sizes.border, 500U);
  // The mean distance to the two nearest points on either side.
  EXPECT_NEAR(sizes.of[250].spacing, 0.015, 1e-6);
  EXPECT_GT(sizes.of[250].variance, 0);
}

}  // namespace
}  // namespace surfel
