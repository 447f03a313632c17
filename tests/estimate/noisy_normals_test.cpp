#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/range_normals.h>
#include <surfel/io/cloud_io.h>
#include <surfel/sample/generate.h>

#include "support/range_image.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

constexpr double kFlake = std::numbers::pi / 4;
const Vec3d kOrigin(0, 0, 0);

NormalEstimate normals_of(const Array<Vec3f>& points, const NormalOptions& options) {
  return estimate_normals(points, *make_neighbor_search(points), options);
}

NormalOptions seen_from(const Vec3d& sensor) {
  NormalOptions options;
  options.sensor = sensor;
  return options;
}

NormalOptions plain(int k) {
  NormalOptions options;
  options.k = k;
  options.grow_in_noise = false;
  return options;
}

TEST(NoisyNormals, RangeImagesHaveNoFlakes) {
  for (const double noise : {0.0, 1.0}) {  // Without noise there is quantisation.
    DepthCamera camera;
    camera.step = 2;
    camera.noise = noise;
    camera.lateral *= noise;
    const RangeImage image = room_range_image(camera);
    const Array<Vec3f>& points = image.points.position;
    for (const int k : noise > 0 ? std::vector{16, 48} : std::vector{16}) {
      EXPECT_GT(share_beyond(normals_of(points, plain(k)).normal, image.normal, kFlake), 0.005);
      NormalOptions options = seen_from(kOrigin);
      options.k = k;
      const NormalEstimate out = normals_of(points, options);
      EXPECT_EQ(out.remade, points.size());
      EXPECT_LT(share_beyond(out.normal, image.normal, kFlake), 0.002) << noise << ", k " << k;
      EXPECT_LT(share_beyond(out.normal, image.normal, kFlake / 2), 0.02) << noise << ", k " << k;
    }
  }
}

TEST(NoisyNormals, RangeImagesHaveNoFlakesIfNoOneKnowsWhereTheSensorStood) {
  for (const int step : {2, 4}) {
    DepthCamera camera;
    camera.step = step;
    RangeImage image = room_range_image(camera);
    const Eigen::Matrix3f turn =
        Eigen::AngleAxisf(1.1F, Vec3f(1, 2, -2).normalized()).toRotationMatrix();
    for (Vec3f& p : image.points.position) p = turn * p + Vec3f(3, -1, 2);
    for (Vec3f& n : image.normal) n = turn * n;
    const Array<Vec3f>& points = image.points.position;
    for (const NormalOptions& options : {NormalOptions(), seen_from(kOrigin)}) {
      const NormalEstimate out = normals_of(points, options);
      EXPECT_GT(out.remade, points.size() * 9 / 10);
      EXPECT_LT(share_beyond(out.normal, image.normal, kFlake), 0.005) << step;
    }
  }
}

TEST(NoisyNormals, NoiseIsFound) {
  DepthCamera camera;
  camera.step = 2;
  camera.disparity = 0;
  const RangeImage image = room_range_image(camera);
  for (const NormalOptions& options : {NormalOptions(), seen_from(kOrigin)}) {
    const NormalEstimate out = normals_of(image.points.position, options);
    ASSERT_EQ(out.noise.size(), image.normal.size());
    double ratio = 0;
    std::size_t walls = 0;
    for (std::size_t i = 0; i < image.normal.size(); ++i) {
      const Vec3d p = image.points.position[i].cast<double>();
      if (-image.normal[i].z() < 0.99F || p.z() < 3) continue;  // The wall that is looked at.
      const double true_noise = 0.0012 + 0.0019 * std::pow(p.z() - 0.4, 2);
      ratio += static_cast<double>(out.noise[i]) / true_noise;
      ++walls;
    }
    ASSERT_GT(walls, 10000U);
    EXPECT_NEAR(ratio / static_cast<double>(walls), 1, 0.25);
  }
}

TEST(NoisyNormals, CloudsWithoutNoiseStayAsTheyAre) {
  DepthCamera exact;
  exact.step = 2;
  exact.noise = exact.disparity = exact.lateral = 0;
  std::vector<Array<Vec3f>> clouds = {room_range_image(exact).points.position};
  for (const char* kind : {"sphere", "terrain"}) {
    clouds.push_back(generate_surfels(procedural_scene(kind, 1), {.count = 20000}).position);
  }
  for (const Array<Vec3f>& points : clouds) {
    const NormalEstimate out = normals_of(points, seen_from(kOrigin));
    EXPECT_EQ(out.remade, 0U);
    EXPECT_EQ(out.normal, normals_of(points, plain(16)).normal);
  }
}

TEST(NoisyNormals, OnlyRangeImagesAreTakenForSome) {
  DepthCamera camera;
  camera.step = 4;
  const Array<Vec3f> image = room_range_image(camera).points.position;
  NormalEstimate out = normals_of(image, plain(16));
  const Array<Vec3f> before = out.normal;
  EXPECT_FALSE(remake_range_normals(image, Vec3d(0.5, 0, 0), out));
  EXPECT_FALSE(remake_range_normals(image, image[0].cast<double>(), out));
  EXPECT_EQ(out.normal, before);
  EXPECT_TRUE(remake_range_normals(image, kOrigin, out));
  const Array<Vec3f> sphere =
      generate_surfels(procedural_scene("sphere", 1), {.count = 20000}).position;
  out = normals_of(sphere, plain(16));
  EXPECT_FALSE(remake_range_normals(sphere, Vec3d(0, 0, 5), out));
  // Shells around the sensor, each a tenth of the next one, are not one image of large noise.
  Array<Vec3f> shells = image;
  float scale = 1;
  for (Vec3f& p : shells) {
    p *= scale;
    scale = scale < 0.01F ? 1 : scale / 10;
  }
  EXPECT_FALSE(remake_range_normals(shells, kOrigin, out));
}

TEST(NoisyNormals, SameBytesForAnyNumberOfThreads) {
  DepthCamera camera;
  camera.step = 4;
  const Array<Vec3f> points = room_range_image(camera).points.position;
  for (const NormalOptions& options : {NormalOptions(), seen_from(kOrigin)}) {
    set_thread_count(1);
    const NormalEstimate one = normals_of(points, options);
    set_thread_count(5);
    const NormalEstimate five = normals_of(points, options);
    set_thread_count(0);
    EXPECT_GT(one.remade, 0U);
    EXPECT_EQ(one.normal, five.normal);
    EXPECT_EQ(one.quality, five.quality);
    EXPECT_EQ(one.noise, five.noise);
  }
}

/// Share of the normals, of every eighth point, that are flakes beside the direction that those of
/// the 200 nearest points have in common.
double flakes(const Array<Vec3f>& points, const Array<Vec3f>& normal) {
  const auto search = make_neighbor_search(points);
  std::vector<Neighbor> near;
  Array<Vec3f> own, common;
  for (std::size_t i = 0; i < points.size(); i += 8) {
    search->nearest(points[i], 200, near);
    Eigen::Matrix3f sum = Eigen::Matrix3f::Zero();
    for (const Neighbor& n : near) sum += normal[n.index] * normal[n.index].transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> axes(sum);
    own.push_back(normal[i]);
    common.push_back(axes.eigenvectors().col(2));
  }
  return share_beyond(own, common, kFlake);
}

TEST(NoisyNormals, DepthCamerasInTheTestDataHaveNoFlakes) {
  SURFEL_REQUIRE_TEST_DATA();
  for (const char* file : {"milk_color.pcd", "table_scene_mug_stereo.pcd"}) {
    const SurfelCloud cloud = read_cloud((data_folder() / "colour_clouds" / file).string());
    Array<Vec3f> points;
    for (const Vec3f& p : cloud.position) {
      if (p.allFinite()) points.push_back(p);
    }
    const Array<Vec3f> before = normals_of(points, plain(16)).normal;
    const NormalEstimate out = normals_of(points, seen_from(kOrigin));
    EXPECT_EQ(out.remade, points.size());
    const auto edge_on = [&](const Array<Vec3f>& normal) {  // Beyond 80 degrees to the sensor.
      double count = 0;
      for (std::size_t i = 0; i < points.size(); ++i) {
        count += std::abs(normal[i].dot(points[i].normalized())) < 0.17F ? 1 : 0;
      }
      return count / static_cast<double>(points.size());
    };
    EXPECT_LT(edge_on(out.normal), 0.0002) << file;
    EXPECT_GT(edge_on(before), 0.0002) << file;
    // What is left is at real edges, of the carton and of the mug.
    const double left = flakes(points, out.normal);
    const double were = flakes(points, before);
    EXPECT_LT(left, 0.005) << file;
    EXPECT_LT(left, 0.5 * were) << file;
  }
}

}  // namespace
}  // namespace surfel::test
