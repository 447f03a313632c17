#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/estimate.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/surface/point_spacing.h>

#include "support/test_data.h"

namespace surfel::test {
namespace {

/// Points of a surface with Gaussian noise along the normal, in mean spacings.
SurfelCloud noisy_points(const std::string& kind, std::size_t count, double noise) {
  GenerateOptions options;
  options.count = count;
  SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), options);
  double area = 0;
  for (const float a : cloud.area) area += a;
  const double spacing = std::sqrt(area / static_cast<double>(count));
  for (std::size_t i = 0; i < count; ++i) {
    const double u = std::max(random_uniform(5, i, 0), 1e-12);
    const double gauss =
        std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * random_uniform(5, i, 1));
    cloud.position[i] += static_cast<float>(noise * spacing * gauss) * cloud.normal[i];
  }
  return cloud;
}

double rms(const Array<Vec3f>& points, const std::function<double(const Vec3d&)>& distance) {
  double sum = 0;
  for (const Vec3f& p : points) sum += std::pow(distance(p.cast<double>()), 2);
  return std::sqrt(sum / static_cast<double>(points.size()));
}

double from_sphere(const Vec3d& p) { return p.norm() - 1; }
double from_torus(const Vec3d& p) {
  return std::hypot(std::hypot(p.x(), p.y()) - 0.7, p.z()) - 0.3;
}

SmoothedPoints smoothed(const Array<Vec3f>& points, const SmoothingOptions& options = {}) {
  return smooth_points(points, *make_neighbor_search(points), options);
}

TEST(Smoothing, TakesNoiseAwayAndLeavesShape) {
  struct Surface {
    const char* kind;
    double (*distance)(const Vec3d&);
  };
  for (const Surface& s : {Surface{"sphere", from_sphere}, Surface{"torus", from_torus}}) {
    for (const double noise : {0.1, 0.3}) {
      const SurfelCloud cloud = noisy_points(s.kind, 20000, noise);
      const SmoothedPoints out = smoothed(cloud.position);
      EXPECT_LT(rms(out.position, s.distance), 0.45 * rms(cloud.position, s.distance))
          << s.kind << " " << noise;
      EXPECT_EQ(out.stayed, 0U);
      EXPECT_GT(out.largest_shift, out.mean_shift);
    }
    // Without noise the error is that of a polynomial: a thousandth of a spacing of 0.025.
    const SurfelCloud exact = noisy_points(s.kind, 20000, 0);
    EXPECT_LT(rms(smoothed(exact.position).position, s.distance), 2.5e-4) << s.kind;
  }
}

TEST(Smoothing, PolynomialsOfSecondOrderAreReproduced) {
  Array<Vec3f> points;
  for (int i = 0; i < 900; ++i) {
    const double x = random_uniform(1, i, 0) - 0.5;
    const double y = random_uniform(1, i, 1) - 0.5;
    points.push_back(Vec3d(x, y, 0.01 * x * x - 0.02 * x * y + 0.015 * y * y).cast<float>());
  }
  const SmoothedPoints out = smoothed(points);
  // Planes of neighbourhoods lean against z by some 0.02, in which the shape is not quite of second
  // order.
  EXPECT_LT(out.largest_shift, 2e-5);
  EXPECT_GT(smoothed(points, {.order = 1}).largest_shift, 5e-5);
}

TEST(Smoothing, DoesNotDependOnThreads) {
  const SurfelCloud cloud = noisy_points("torus", 10000, 0.2);
  const int before = thread_count();
  set_thread_count(1);
  const SmoothedPoints one = smoothed(cloud.position);
  set_thread_count(3);
  const SmoothedPoints three = smoothed(cloud.position);
  set_thread_count(before);
  EXPECT_EQ(one.position, three.position);
  EXPECT_EQ(one.normal, three.normal);
  EXPECT_EQ(one.mean_shift, three.mean_shift);
}

TEST(Smoothing, PointsWithoutASurfaceStay) {
  Array<Vec3f> same(50, Vec3f(1, 2, 3));
  Array<Vec3f> line;
  for (int i = 0; i < 50; ++i) line.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
  for (const Array<Vec3f>& points : {same, line, Array<Vec3f>{}, Array<Vec3f>{Vec3f(1, 1, 1)}}) {
    const SmoothedPoints out = smoothed(points);
    ASSERT_EQ(out.position.size(), points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_LT((out.position[i] - points[i]).norm(), 1e-5F);
    }
  }
}

TEST(Smoothing, RefusesBadOptions) {
  const Array<Vec3f> points(50, Vec3f(1, 2, 3));
  for (const SmoothingOptions& bad :
       {SmoothingOptions{.spacings = 0}, SmoothingOptions{.spacings = 21},
        SmoothingOptions{.order = 0}, SmoothingOptions{.order = 6},
        SmoothingOptions{.spacings = 1, .order = 2},
        SmoothingOptions{.spacings = std::numeric_limits<double>::quiet_NaN()}}) {
    EXPECT_EQ(bad.problems().size(), 1U);
    EXPECT_THROW(smoothed(points, bad), Error);
  }
}

TEST(Smoothing, EstimatesOfSmoothedPointsKeepTheirColumns) {
  SurfelCloud cloud = noisy_points("sphere", 20000, 0.3);
  const Array<Vec3f> truth = cloud.normal;
  cloud.position[7].x() = std::numeric_limits<float>::quiet_NaN();
  EstimateOptions options;
  options.orientation.method = Orientation::kOutward;
  const auto error = [&](const SurfelCloud& surfels) {
    double sum = 0;
    for (std::size_t i = 0; i < surfels.size(); ++i) {
      const std::size_t from = i < 7 ? i : i + 1;
      EXPECT_EQ(surfels.color[i], cloud.color[from]);
      sum += std::acos(std::min(1.0F, surfels.normal[i].dot(truth[from])));
    }
    return sum / static_cast<double>(surfels.size());
  };
  const double raw = error(estimate_surfels(cloud, options));
  options.smoothing.emplace();
  EstimateReport report;
  const SurfelCloud surfels = estimate_surfels(cloud, options, &report);
  ASSERT_EQ(surfels.size(), 19999U);
  EXPECT_TRUE(report.smoothed);
  const double fitted = error(surfels);
  EXPECT_LT(fitted, 0.55 * raw);
  // Better than normals told from the moved points.
  options.smoothing->normals = false;
  EXPECT_LT(fitted, error(estimate_surfels(cloud, options)));
  EXPECT_LT(rms(surfels.position, from_sphere), 0.005);
}

TEST(Smoothing, RangeScanComesNearerToTheMeanOfAllScans) {
  SURFEL_REQUIRE_TEST_DATA();
  // The mesh is the mean of ten scans, this one among them, in its frame.
  const Array<Vec3f> mean = read_mesh(data_folder() / "meshes/stanford_bunny.obj").position;
  const auto search = make_neighbor_search(mean);
  const Array<Vec3f> normal = estimate_normals(mean, *search).normal;
  const auto median_distance = [&](const Array<Vec3f>& points) {
    std::vector<float> distance;
    std::vector<Neighbor> nearest;
    for (const Vec3f& p : points) {
      search->nearest(p, 1, nearest);
      const std::uint32_t i = nearest.front().index;
      distance.push_back(std::abs(normal[i].dot(p - mean[i])));
    }
    const auto middle = distance.begin() + static_cast<std::ptrdiff_t>(distance.size() / 2);
    std::nth_element(distance.begin(), middle, distance.end());
    return *middle;
  };
  const SurfelCloud scan = read_cloud(data_folder() / "raw_scans/bun000_range_grid.ply");
  const SmoothedPoints out = smoothed(scan.position);
  EXPECT_LT(median_distance(out.position), 0.95F * median_distance(scan.position));
  const double spacing = point_spacing(scan.position, *make_neighbor_search(scan.position));
  EXPECT_LT(out.mean_shift, 0.2 * spacing);
}

}  // namespace
}  // namespace surfel::test
