// PCL's normals as a second opinion on ours.

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <pcl/features/normal_3d.h>
#include <pcl/search/kdtree.h>
#include <surfel/estimate/normals.h>
#include <surfel/io/cloud_io.h>
#include <surfel/pcl/conversion.h>

#include "support/test_data.h"

namespace surfel::test {
namespace {

TEST(PclNormals, AgreeWithOursOnRealScans) {
  SURFEL_REQUIRE_TEST_DATA();
  for (const char* file : {"raw_scans/bun000_range_grid.ply", "raw_scans/kitten.xyz"}) {
    const SurfelCloud cloud = read_cloud(data_folder() / file);
    NormalOptions options;
    const NormalEstimate ours =
        estimate_normals(cloud.position, *make_neighbor_search(cloud.position), options);
    pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
    estimation.setInputCloud(pcl::PointCloud<pcl::PointXYZ>::Ptr(
        new pcl::PointCloud<pcl::PointXYZ>(toPCL<pcl::PointXYZ>(cloud, true))));
    estimation.setSearchMethod(
        pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>));
    estimation.setKSearch(options.k);
    pcl::PointCloud<pcl::Normal> theirs;
    estimation.compute(theirs);
    ASSERT_EQ(theirs.size(), cloud.size());
    std::vector<double> degrees;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      // Thin neighbourhoods are enlarged here, not there.
      if (ours.quality[i].neighbors != options.k) continue;
      const Vec3d a = ours.normal[i].cast<double>();
      const Vec3d b = theirs[i].getNormalVector3fMap().cast<double>();
      degrees.push_back(std::atan2(a.cross(b).norm(), std::abs(a.dot(b))) * 180 / std::numbers::pi);
    }
    ASSERT_GT(degrees.size(), cloud.size() * 9 / 10) << file;
    std::sort(degrees.begin(), degrees.end());
    EXPECT_LT(degrees[degrees.size() / 2], 0.01) << file;
    // Where several points are as far away as the last neighbour, either may take another.
    EXPECT_LT(degrees[degrees.size() * 9 / 10], 1) << file;
  }
}

}  // namespace
}  // namespace surfel::test
