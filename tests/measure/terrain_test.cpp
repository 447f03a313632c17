// What is taken for terrain, and what is not.

#include <cmath>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/measure/terrain.h>
#include <surfel/measure/view_guess.h>
#include <surfel/sample/generate.h>

#include "support/test_data.h"

namespace surfel {
namespace {

bool terrain(const SurfelCloud& cloud) {
  const SurfaceSample sample = sample_surface(cloud);
  return is_terrain(sample, guess_view(sample, {.up = cloud.up, .viewpoint = cloud.viewpoint}));
}

bool terrain(const TriangleMesh& mesh) {
  const SurfaceSample sample = sample_surface(mesh);
  return is_terrain(sample, guess_view(sample));
}

/// Hills of some height over a square of 200 by 200, without normals.
SurfelCloud hills(double height, const Vec3d& origin) {
  SurfelCloud cloud;
  cloud.origin = origin;
  for (int i = 0; i < 100; ++i) {
    for (int j = 0; j < 100; ++j) {
      const double x = 2 * i + 0.3 * std::sin(7.0 * j);
      const double y = 2 * j + 0.3 * std::sin(5.0 * i);
      cloud.position.emplace_back(
          Vec3d(x, y, height * std::sin(0.05 * x) * std::cos(0.03 * y)).cast<float>());
    }
  }
  return cloud;
}

TEST(Terrain, HillsAreTerrainWhereverTheyLie) {
  EXPECT_TRUE(terrain(hills(10, {512000, 5400000, 200}))) << "coordinates of a map";
  SurfelCloud near = hills(10, {-100, -100, 0});
  near.up = Vec3d(0, 0, 1);
  EXPECT_TRUE(terrain(near));
}

TEST(Terrain, GeneratedTerrainIsTerrain) {
  EXPECT_TRUE(terrain(generate_surfels(procedural_scene("terrain", 1), {.count = 20000})));
}

TEST(Terrain, PlanesAndSteepThingsAreNot) {
  SurfelCloud flat = hills(0.001, {-100, -100, 0});
  flat.up = Vec3d(0, 0, 1);
  EXPECT_FALSE(terrain(flat));
  SurfelCloud steep = hills(80, {-100, -100, 0});
  steep.up = Vec3d(0, 0, 1);
  EXPECT_FALSE(terrain(steep)) << "higher than a height field that lies";
  SurfelCloud seen = hills(10, {-100, -100, 0});
  seen.viewpoint = Viewpoint{{0, 0, 300}, {0, 1, 0, 0}};
  EXPECT_FALSE(terrain(seen)) << "a scan from a known place";
}

TEST(Terrain, ClosedSurfacesAreNot) {
  for (const char* kind : {"sphere", "torus"}) {
    EXPECT_FALSE(terrain(generate_surfels(procedural_scene(kind, 1), {.count = 20000}))) << kind;
  }
}

TEST(Terrain, RealThingsAndScansAreNotButLidarIs) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path data = test::data_folder();
  for (const char* mesh :
       {"meshes/fandisk.obj", "meshes/stanford_bunny.obj", "meshes/dragon_vrip_res2.ply"}) {
    EXPECT_FALSE(terrain(read_mesh(data / mesh))) << mesh;
  }
  for (const char* scan :
       {"raw_scans/bun0.pcd", "raw_scans/bun000_range_grid.ply", "raw_scans/kitten.xyz",
        "raw_scans/oni.xyz", "colour_clouds/milk_color.pcd",
        "colour_clouds/table_scene_mug_stereo.pcd", "colour_clouds/fragment_normals_rgb.pcd"}) {
    EXPECT_FALSE(terrain(read_cloud(data / scan))) << scan;
  }
  EXPECT_TRUE(terrain(read_cloud(data / "lidar/samp11-utm.pcd")));
}

}  // namespace
}  // namespace surfel
