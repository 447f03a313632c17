#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <string>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/estimate.h>
#include <surfel/io/cloud_io.h>
#include <surfel/surface/neighbor_search.h>

#include "support/test_data.h"

namespace surfel::test {
namespace {

Array<std::uint32_t> all_of(const SurfelCloud& cloud) {
  Array<std::uint32_t> points(cloud.size());
  std::iota(points.begin(), points.end(), 0U);
  return points;
}

SurfelCloud averaged(const SurfelCloud& cloud, double size) {
  double edge = 0;
  return average_voxels(cloud, all_of(cloud), {.edge = size}, "cloud", edge);
}

using Cell = std::array<int, 3>;

Cell cell_of(const Vec3f& p, double edge) {
  Cell cell;
  for (int c = 0; c < 3; ++c) cell[c] = static_cast<int>(static_cast<double>(p[c]) / edge);
  return cell;
}

SurfelCloud random_cloud(std::size_t count) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const auto random = [&](int d) { return static_cast<float>(random_uniform(9, i, d)); };
    cloud.position.emplace_back(random(0), random(1), random(2));
    cloud.color.emplace_back(random(3), random(4), random(5));
    cloud.normal.push_back(Vec3f(random(6), random(7), 1).normalized());
    cloud.alpha.push_back(random(8));
    cloud.material.push_back(static_cast<std::uint16_t>(i));
  }
  cloud.position[0] = Vec3f(0, 0, 0);  // The grid begins here.
  return cloud;
}

TEST(VoxelGrid, MeansOfEveryCell) {
  const SurfelCloud cloud = random_cloud(5000);
  const double edge = 0.09;
  const SurfelCloud out = averaged(cloud, edge);
  out.check_columns("");
  struct Sum {
    Vec3d position{0, 0, 0};
    Vec3d color{0, 0, 0};
    double alpha = 0;
    int count = 0;
  };
  std::map<Cell, Sum> sums;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    Sum& sum = sums[cell_of(cloud.position[i], edge)];
    sum.position += cloud.position[i].cast<double>();
    sum.color += cloud.color[i].cast<double>();
    sum.alpha += cloud.alpha[i];
    ++sum.count;
  }
  ASSERT_EQ(out.size(), sums.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    // The point that the other columns come from lies in the cell.
    const Sum& sum = sums.at(cell_of(cloud.position[out.material[i]], edge));
    const double n = sum.count;
    EXPECT_LT((out.position[i].cast<double>() - sum.position / n).norm(), 1e-6);
    EXPECT_LT((out.color[i].cast<double>() - sum.color / n).norm(), 1e-6);
    EXPECT_NEAR(out.alpha[i], sum.alpha / n, 1e-6);
    EXPECT_NEAR(out.normal[i].norm(), 1, 1e-6);
    if (i > 0) {
      EXPECT_LT(out.material[i - 1], out.material[i]) << "order of the file";
    }
  }
}

TEST(VoxelGrid, OppositeNormalsLeaveNone) {
  SurfelCloud cloud;
  cloud.position = {Vec3f(0, 0, 0), Vec3f(0.1F, 0, 0), Vec3f(5, 0, 0)};
  cloud.normal = {Vec3f(0, 0, 1), Vec3f(0, 0, -1), Vec3f(0, 1, 0)};
  const SurfelCloud out = averaged(cloud, 1);
  ASSERT_EQ(out.size(), 2U);
  EXPECT_EQ(out.normal[0], Vec3f(0, 0, 0));
  EXPECT_EQ(out.normal[1], Vec3f(0, 1, 0));
}

TEST(VoxelGrid, RefusesWhatItCannotDo) {
  const SurfelCloud cloud = random_cloud(100);
  double edge = 0;
  for (const double bad : {-1.0, 1e-10, 1e10, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_EQ(VoxelOptions{.edge = bad}.problems().size(), 1U) << bad;
    EXPECT_THROW(averaged(cloud, bad), Error);
  }
  EXPECT_THROW(averaged(SurfelCloud{}, 1), Error);
  try {
    averaged(cloud, 1e-7);
    FAIL() << "10^21 cells";
  } catch (const Error& e) {
    EXPECT_EQ(e.kind(), ErrorKind::kInput);
    const std::string message = e.what();
    const std::string least = "take an `edge` of ";
    ASSERT_NE(message.find(least), std::string::npos) << message;
    // The message's edge is one that works.
    const double good = std::stod(message.substr(message.find(least) + least.size()));
    EXPECT_EQ(averaged(cloud, good).size(), cloud.size());
  }
  SurfelCloud same;
  same.position.assign(20, Vec3f(1, 1, 1));
  EXPECT_THROW(average_voxels(same, all_of(same), {}, "cloud", edge), Error);
  EXPECT_EQ(averaged(same, 0.1).size(), 1U);
}

TEST(VoxelGrid, GridsOfMoreThan31BitsAreCounted) {
  SurfelCloud cloud = random_cloud(3000);
  const double edge = 2e-6;  // Half a million cells along each side.
  EXPECT_EQ(averaged(cloud, edge).size(), cloud.size());
  Bounds box;
  for (const Vec3f& p : cloud.position) box.add(p.cast<double>());
  EXPECT_TRUE(voxels_are_countable(box, edge));
  EXPECT_FALSE(voxels_are_countable(box, 2e-7));
  // Points at the same place are one, and stay where they are to the last bit.
  const std::size_t count = cloud.size();
  cloud.position.insert(cloud.position.end(), cloud.position.begin(), cloud.position.end());
  cloud.color = {};
  cloud.normal = {};
  cloud.alpha = {};
  cloud.material = {};
  const SurfelCloud out = averaged(cloud, edge);
  ASSERT_EQ(out.size(), count);
  EXPECT_TRUE(std::equal(out.position.begin(), out.position.end(), cloud.position.begin()));
}

TEST(VoxelGrid, FarAndLargeCoordinatesKeepTheirPrecision) {
  SurfelCloud cloud = random_cloud(2000);
  const SurfelCloud near = averaged(cloud, 0.1);
  // As far from zero as floats tell points of this grid apart.
  for (Vec3f& p : cloud.position) p = (p * 1024).array().round() / 1024 + 4096;
  for (Vec3f& p : cloud.position) ASSERT_TRUE(p.allFinite());
  const SurfelCloud far = averaged(cloud, 0.1);
  EXPECT_NEAR(static_cast<double>(far.size()), static_cast<double>(near.size()), 10);
}

TEST(VoxelGrid, MeansOfExactCoordinatesAreExact) {
  SurfelCloud cloud;
  cloud.origin = Vec3d(1e9, 0, 0);
  cloud.position.resize(3);
  cloud.exact.resize(3);
  cloud.place(0, Vec3d(1e9, 0.1, 0));
  cloud.place(1, Vec3d(1e9, 0.3, 0));
  cloud.place(2, Vec3d(-6.144, 0, 0));
  const SurfelCloud out = averaged(cloud, 1000);
  ASSERT_EQ(out.size(), 2U);
  EXPECT_EQ(out.world(0), Vec3d(1e9, (0.1 + 0.3) / 2, 0));
  EXPECT_EQ(out.world(1), Vec3d(-6.144, 0, 0));
}

TEST(VoxelGrid, ScanIsThinnedEvenly) {
  SURFEL_REQUIRE_TEST_DATA();
  const SurfelCloud cloud = read_cloud(data_folder() / "colour_clouds/lion_takanawa_third.ply");
  EstimateOptions options;
  options.voxels.emplace();
  options.orientation.method = Orientation::kAlign;
  EstimateReport report;
  const int before = thread_count();
  set_thread_count(1);
  const SurfelCloud out = estimate_surfels(cloud, options, &report);
  set_thread_count(3);
  const SurfelCloud again = estimate_surfels(cloud, options);
  set_thread_count(before);
  EXPECT_EQ(out.position, again.position);
  EXPECT_EQ(out.color, again.color);
  EXPECT_EQ(out.size() + report.averaged, cloud.size());
  const double share = static_cast<double>(out.size()) / static_cast<double>(cloud.size());
  EXPECT_GT(share, 0.15);
  EXPECT_LT(share, 0.4);
  const auto search = make_neighbor_search(out.position);
  std::vector<Neighbor> nearest;
  for (const Vec3f& p : cloud.position) {
    search->nearest(p, 1, nearest);
    // Within the diagonal of its cell.
    EXPECT_LE(std::sqrt(nearest.front().distance2), 1.7321 * report.voxel_edge);
  }
}

}  // namespace
}  // namespace surfel::test
