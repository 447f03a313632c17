#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/random.h>
#include <surfel/estimate/estimate.h>
#include <surfel/io/cloud_io.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>
#include <surfel/scene/framing.h>

#include "render/scenes.h"
#include "support/range_image.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

SurfelCloud points_of(const std::string& kind, std::size_t count) {
  GenerateOptions options;
  options.count = count;
  SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), options);
  cloud.normal = {};
  cloud.variance = {};
  cloud.area = {};
  return cloud;
}

const ExtraProperty* extra(const SurfelCloud& cloud, const std::string& name) {
  for (const ExtraProperty& p : cloud.extra) {
    if (p.name == name) return &p;
  }
  return nullptr;
}

TEST(Estimate, AStrayPointChangesNoOther) {
  // A survey's coordinates, and what scanners write for no return.
  const TemporaryFolder folder;
  std::ofstream clean(folder / "clean.xyz");
  std::ofstream stray(folder / "stray.xyz");
  constexpr std::size_t kStray = 700;
  const SurfelCloud points = points_of("torus", 2000);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3d p = Vec3d(500000, 5400000, 100) + 10 * points.world(i);
    const std::string line = fmt::format("{:.4f} {:.4f} {:.4f}\n", p.x(), p.y(), p.z());
    if (i == kStray) stray << "0 0 0\n";
    clean << line;
    stray << line;
  }
  clean.close();
  stray.close();
  const SurfelCloud alone = estimate_surfels(read_cloud(folder / "clean.xyz"), {});
  SurfelCloud both = estimate_surfels(read_cloud(folder / "stray.xyz"), {});
  Array<std::uint32_t> others;
  for (std::uint32_t i = 0; i < both.size(); ++i) {
    if (i != kStray) others.push_back(i);
  }
  both = both.gathered(others);
  EXPECT_EQ(both.origin, alone.origin);
  EXPECT_EQ(both.position, alone.position);
  EXPECT_EQ(both.normal, alone.normal);
  EXPECT_EQ(both.variance_u, alone.variance_u);
  EXPECT_EQ(both.area, alone.area);
}

TEST(Estimate, KeepsOrderAndAttributesOfThePoints) {
  SurfelCloud cloud = points_of("sphere", 3000);
  cloud.position[5].y() = std::numeric_limits<float>::quiet_NaN();
  cloud.position[9].x() = std::numeric_limits<float>::infinity();
  EstimateReport report;
  const SurfelCloud out = estimate_surfels(cloud, {}, &report);
  EXPECT_EQ(report.points, 3000U);
  EXPECT_EQ(report.nonfinite, 2U);
  ASSERT_EQ(out.size(), 2998U);
  out.check_columns("");
  for (std::size_t i = 0, j = 0; i < cloud.size(); ++i) {
    if (i == 5 || i == 9) continue;
    EXPECT_EQ(out.position[j], cloud.position[i]);
    EXPECT_EQ(out.color[j], cloud.color[i]);
    EXPECT_GT(out.normal[j].dot(cloud.position[i]), 0.99F);
    ++j;
  }
  ASSERT_TRUE(extra(out, "confidence") && extra(out, "curvature") && extra(out, "flag"));
  // A second estimate replaces them.
  EXPECT_EQ(estimate_surfels(out, {}).extra.size(), out.extra.size());
}

TEST(Estimate, DepthCamerasAreLookedForAtTheOrigin) {
  DepthCamera camera;
  camera.step = 2;
  camera.noise = camera.lateral = 0;  // There are the steps of the disparities alone.
  SurfelCloud cloud = room_range_image(camera).points;
  EstimateReport report;
  for (const Vec3d& origin : {Vec3d(0, 0, 0), Vec3d(5e5, 2, 0)}) {
    cloud.origin = origin;
    estimate_surfels(cloud, {}, &report);
    EXPECT_EQ(report.remade, origin.isZero(0) ? cloud.size() : 0U);
  }
  EstimateOptions options;
  options.normals.sensor = cloud.origin;
  estimate_surfels(cloud, options, &report);
  EXPECT_EQ(report.remade, cloud.size());
}

TEST(Estimate, VarianceMatchesTheTrueSpacing) {
  for (const char* kind : {"plane", "sphere", "torus"}) {
    SurfelCloud cloud = points_of(kind, 20000);
    const SurfelCloud out = estimate_surfels(cloud, {});
    GenerateOptions truth;
    truth.count = 20000;
    const SurfelCloud known = generate_surfels(procedural_scene(kind, 1), truth);
    double sum = 0;
    double expected = 0;
    for (std::size_t i = 0; i < out.size(); ++i) {
      sum += out.area[i];
      expected += known.area[i];
    }
    // Cells at the plane's border reach half a spacing of 1 / 70 of its side too far on four sides.
    EXPECT_NEAR(sum / expected, 1, std::string(kind) == "plane" ? 0.04 : 0.03) << kind;
  }
}

/// Share of the pixels well inside a unit sphere's silhouette that are not opaque.
double hole_share(const SurfelCloud& cloud, double distance, int size) {
  const Camera camera = camera_at(distance, size);
  const Image image = render_unlit(cloud, camera);
  const double silhouette =
      camera.focal_x * std::tan(std::asin(1 / distance)) - 5;  // Pixels, without its edge.
  std::size_t inside = 0;
  std::size_t holes = 0;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      if (std::hypot(x + 0.5 - size / 2.0, y + 0.5 - size / 2.0) > silhouette) continue;
      ++inside;
      holes += image.pixel(x, y)[3] < 0.99F ? 1 : 0;
    }
  }
  return static_cast<double>(holes) / static_cast<double>(inside);
}

TEST(Estimate, CoverClosesASphereAtAnySizeOnScreen) {
  SurfelCloud cloud = points_of("sphere", 40000);
  for (Vec3f& p : cloud.position) p.normalize();
  for (const double noise : {0.0, 0.1}) {
    const double spacing = std::sqrt(4 * M_PI / 40000);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      cloud.position[i] *= static_cast<float>(
          1 + noise * spacing * (random_uniform(3, i, 0) + random_uniform(3, i, 1) - 1));
    }
    EstimateOptions options;
    options.orientation.method = Orientation::kOutward;
    const SurfelCloud cover = estimate_surfels(cloud, options);
    // From one spacing a pixel to one spacing in six.
    for (const int size : {150, 300, 900}) {
      EXPECT_LT(hole_share(cover, 3, size), 0.0005) << size << " pixels, noise " << noise;
    }
    options.size.rule = VarianceRule::kMaxDistance;
    const auto discs = cloud_statistics(cover).coverage;
    const auto largest = cloud_statistics(estimate_surfels(cloud, options)).coverage;
    ASSERT_TRUE(discs && largest);
    EXPECT_LT(discs->overlap, 0.3 * largest->overlap);
  }
}

/// Two parts of a plane, one seen from above and one from below, in one cloud.
TEST(Estimate, NormalsLookToTheScannerOfEachScan) {
  SurfelCloud cloud;
  cloud.origin = Vec3d(1000, 0, 0);
  ExtraProperty scan{"scan", ScalarType::kUint16, {}};
  for (int i = 0; i < 800; ++i) {
    const auto number = static_cast<std::uint16_t>(i / 400);
    cloud.position.emplace_back(static_cast<float>(i % 20 + 20 * number),
                                static_cast<float>(i / 20 % 20), 0.0F);
    scan.data.resize(scan.data.size() + sizeof(number));
    std::memcpy(scan.data.data() + sizeof(number) * static_cast<std::size_t>(i), &number,
                sizeof(number));
  }
  cloud.extra.push_back(scan);
  cloud.scan_viewpoints = {{.position = {1010, 10, 5}}, {.position = {1030, 10, -5}}};
  EstimateOptions options;
  options.orientation.method = Orientation::kViewpoint;
  const SurfelCloud seen = estimate_surfels(cloud, options);
  ASSERT_EQ(seen.size(), 800U);
  for (std::size_t i = 0; i < 800; ++i) {
    ASSERT_EQ(seen.normal[i], Vec3f(0, 0, i < 400 ? 1 : -1)) << i;
  }
  EXPECT_EQ(seen.scan_viewpoints.size(), 2U);
  options.voxels.emplace().edge = 2;
  const SurfelCloud fewer = estimate_surfels(cloud, options);
  const Array<Vec3d> sensors = fewer.sensors();
  ASSERT_EQ(sensors.size(), fewer.size());
  for (std::size_t i = 0; i < fewer.size(); ++i) {
    EXPECT_EQ(fewer.normal[i][2] > 0, sensors[i][2] > 0) << i;
  }
  // A viewpoint of the options wins; a scan without one leaves nothing to look to.
  options.voxels.reset();
  options.orientation.viewpoint = Vec3d(1020, 10, -5);
  EXPECT_EQ(estimate_surfels(cloud, options).normal[0], Vec3f(0, 0, -1));
  options.orientation.viewpoint.reset();
  cloud.scan_viewpoints.pop_back();
  EXPECT_THROW(estimate_surfels(cloud, options), Error);
}

TEST(Estimate, RefusesBadOptions) {
  const SurfelCloud cloud = points_of("sphere", 50);
  const auto refused = [&](auto change) {
    EstimateOptions options;
    change(options);
    EXPECT_EQ(options.problems().size(), 1U);
    EXPECT_THROW(estimate_surfels(cloud, options), Error);
  };
  refused([](EstimateOptions& o) { o.normals.k = 2; });
  refused([](EstimateOptions& o) { o.orientation.up = Vec3d(0, 0, 0); });
  refused([](EstimateOptions& o) { o.size.cutoff = 0; });
  refused([](EstimateOptions& o) { o.outliers = OutlierOptions{.neighbors = 0}; });
  for (const OutlierOptions& bad :
       {OutlierOptions{.neighbors = 1025}, OutlierOptions{.deviations = 0}}) {
    EXPECT_THROW(inliers(cloud.position, bad), Error);
  }
}

TEST(Estimate, OutliersAreRemoved) {
  SurfelCloud cloud = points_of("sphere", 5000);
  cloud.position[100] *= 3;
  cloud.position[200] *= 0.2F;
  EstimateOptions options;
  options.outliers.emplace();
  options.outliers->deviations = 8;
  EstimateReport report;
  const SurfelCloud out = estimate_surfels(cloud, options, &report);
  EXPECT_EQ(report.outliers, 2U);
  EXPECT_EQ(out.size(), 4998U);
}

TEST(Estimate, DegenerateCloudsAreFlaggedNeverNan) {
  std::vector<SurfelCloud> clouds(4);
  clouds[0].position.assign(1, Vec3f(1, 2, 3));
  clouds[1].position = {Vec3f(0, 0, 0), Vec3f(1, 0, 0)};
  clouds[2].position.assign(500, Vec3f(1, 1, 1));
  for (int i = 0; i < 500; ++i) clouds[3].position.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
  for (const SurfelCloud& cloud : clouds) {
    for (const bool adaptive : {false, true}) {
      EstimateOptions options;
      options.normals.adaptive = adaptive;
      EstimateReport report;
      const SurfelCloud out = estimate_surfels(cloud, options, &report);
      EXPECT_EQ(report.flagged[0] + report.flagged[1], 0U);
      EXPECT_EQ(report.orientation.unknown, cloud.size());
      for (std::size_t i = 0; i < out.size(); ++i) {
        EXPECT_TRUE(out.normal[i].isZero(0));
        EXPECT_TRUE(std::isfinite(out.area[i]));
        EXPECT_TRUE(out.variance.empty() || std::isfinite(out.variance[i]));
      }
    }
  }
  SurfelCloud none;
  none.position.assign(10, Vec3f::Constant(std::nanf("")));
  EXPECT_THROW(estimate_surfels(none, {}), Error);
}

struct PixelCount {
  std::size_t inside = 0;
  std::size_t holes = 0;  ///< Of these, seen through.

  double hole_share() const {
    return inside == 0 ? 1 : static_cast<double>(holes) / static_cast<double>(inside);
  }
};

/// The pixels no further than one local spacing (mean distance of the four nearest) from a point:
/// there the cloud says that there is a surface. What is further away from all is an opening.
std::vector<bool> sampled_pixels(const SurfelCloud& cloud, const Camera& camera) {
  Array<float> spacing(cloud.size());
  make_neighbor_search(cloud.position)
      ->for_each_nearest(5, [&](std::size_t i, std::span<const Neighbor> near, int) {
        double sum = 0;
        for (const Neighbor& n : near) sum += std::sqrt(static_cast<double>(n.distance2));
        spacing[i] = static_cast<float>(sum / static_cast<double>(near.size() - 1));
      });
  std::vector<bool> sampled(static_cast<std::size_t>(camera.width * camera.height));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d world = cloud.position[i].cast<double>() + cloud.origin;
    const Vec3d p = camera.camera_from_world * (world - camera.eye);
    const Vec2d at(camera.focal_x * p.x() / p.z() + camera.center_x - 0.5,
                   camera.focal_y * p.y() / p.z() + camera.center_y - 0.5);
    const double reach = camera.focal_x * static_cast<double>(spacing[i]) / p.z();
    const auto first = [&](double v) {
      return std::max(0, static_cast<int>(std::ceil(v - reach)));
    };
    for (int y = first(at.y()); y < camera.height && y <= at.y() + reach; ++y) {
      for (int x = first(at.x()); x < camera.width && x <= at.x() + reach; ++x) {
        if ((Vec2d(x, y) - at).norm() <= reach) {
          sampled[static_cast<std::size_t>(y * camera.width + x)] = true;
        }
      }
    }
  }
  return sampled;
}

/// Adds the pixels inside of a surface: those sampled, with opaque ones within three pixels on all
/// four sides, the left and the right as well as the upper and the lower of one surface (no steeper
/// than 3 : 1 between them). What is seen through between a near and a far surface is an opening.
void count_holes(const Image& image, const std::vector<bool>& sampled, const Camera& camera,
                 PixelCount& count) {
  const auto opaque = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < image.width && y < image.height && image.pixel(x, y)[3] > 0.99F;
  };
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const auto steps_to_opaque = [&](int dx, int dy) {
        int steps = 1;
        while (steps < 4 && !opaque(x + steps * dx, y + steps * dy)) ++steps;
        return steps;
      };
      const auto within_surface = [&](int dx, int dy) {
        const int after = steps_to_opaque(dx, dy);
        const int before = steps_to_opaque(-dx, -dy);
        if (after == 4 || before == 4) return false;
        const double far = image.pixel(x + after * dx, y + after * dy)[4];
        const double near = image.pixel(x - before * dx, y - before * dy)[4];
        const double width =
            static_cast<double>(before + after) * std::min(far, near) / camera.focal_x;
        return std::abs(far - near) <= 3 * width;
      };
      if (!sampled[static_cast<std::size_t>(y * image.width + x)]) continue;
      if (!within_surface(1, 0) || !within_surface(0, 1)) continue;
      ++count.inside;
      count.holes += image.pixel(x, y)[3] < 0.5F ? 1 : 0;
    }
  }
}

/// Share of hole pixels in unlit pictures of as many pixels that the mean cell at the middle's
/// distance measures one, from all directions together.
double hole_share_at_own_resolution(const SurfelCloud& cloud, const std::vector<Vec3d>& directions,
                                    const Vec3d& up) {
  PixelCount count;
  RenderCloud surfels(cloud);
  double area = 0;
  for (const float a : cloud.area) area += a;
  const double spacing = std::sqrt(area / static_cast<double>(cloud.size()));
  for (const Vec3d& from : directions) {
    CameraOptions options;
    options.from = from;
    options.up = up;
    options.width = options.height = 64;
    const Camera coarse = make_camera(options, surfels.extent());
    const double distance = (cloud.bounds().center() - coarse.eye).norm();
    const double pixels = 64 * distance / (coarse.focal_x * spacing);
    options.width = options.height = std::clamp(static_cast<int>(pixels), 32, 2000);
    const Camera camera = make_camera(options, surfels.extent());
    RenderOptions unlit;
    unlit.lit = false;
    unlit.aovs = true;
    const Scene scene;
    count_holes(Renderer(surfels, scene, unlit).render(camera), sampled_pixels(cloud, camera),
                camera, count);
  }
  return count.hole_share();
}

TEST(Estimate, GeneratedSurfacesAreClosedAtTheirOwnResolution) {
  for (const char* kind : {"plane", "sphere", "torus", "head", "terrain"}) {
    const SurfelCloud cloud = estimate_surfels(points_of(kind, 30000), {});
    EXPECT_LT(hole_share_at_own_resolution(cloud, {{0, 0, 1}, {0.3, 1, 0.8}, {1, 0.4, 0.2}},
                                           Vec3d(0, 1, 0.01)),
              0.0005)
        << kind;
  }
}

TEST(Estimate, RealScansAreClosedAtTheirOwnResolution) {
  SURFEL_REQUIRE_TEST_DATA();
  struct Case {
    const char* file;
    std::vector<Vec3d> directions;
    Vec3d up;
  };
  const std::vector<Vec3d> above{{0.3, -1, 0.8}, {0, 0.01, 1},   {0.3, 1, 0.8},
                                 {1, 0.5, 1},    {-1, 0.5, 1.0}, {-1, -1, 1.5}};
  for (const Case& c :
       {Case{"colour_clouds/fragment_normals_rgb.pcd",
             {{0, -1, -0.6}, {0.3, -1, -0.6}, {-0.3, -1, -1}},
             {0, -1, 0}},
        Case{"colour_clouds/lion_takanawa_third.ply",
             {{-1, 1, 0.3}, {1, 1, 0.3}, {-1, -1, 0.3}, {1, -1, 0.3}, {0, -1, 1}, {0, 1, 1}},
             {0, 0, 1}},
        Case{"colour_clouds/milk_color.pcd", {{0, 0, -1}}, {0, -1, 0}},
        Case{"colour_clouds/table_scene_mug_stereo.pcd", {{0, -0.3, -1}}, {0, -1, 0}},
        Case{"raw_scans/bun000_range_grid.ply", {{0, 0, 1}, {0.3, 0.2, 1}}, {0, 1, 0}},
        Case{"raw_scans/bun0.pcd", {{0, 0, 1}}, {0, 1, 0}},
        Case{"raw_scans/kitten.xyz", {{0.3, 0.2, 1}, {1, 0, 0}, {0, 0.2, -1}}, {0, 1, 0}},
        Case{"raw_scans/oni.xyz",
             {{0.3, 0.2, 1}, {0.3, 0.2, -1}, {1, 0, 0}, {-1, 0.3, 0}, {0.1, 0.5, 1}},
             {0, 1, 0}},
        Case{"lidar/samp11-utm.pcd", above, {0, 0, 1}}}) {
    const SurfelCloud cloud = estimate_surfels(read_cloud((data_folder() / c.file).string()), {});
    EXPECT_LT(hole_share_at_own_resolution(cloud, c.directions, c.up), 0.0005) << c.file;
  }
}

TEST(Estimate, RealScansGetNormalsLikeTheirOwn) {
  SURFEL_REQUIRE_TEST_DATA();
  const SurfelCloud cloud =
      read_cloud((data_folder() / "colour_clouds/fragment_normals_rgb.pcd").string());
  EstimateOptions options;
  options.orientation.method = Orientation::kAlign;
  EstimateReport report;
  const SurfelCloud out = estimate_surfels(cloud, options, &report);
  std::size_t near = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    near += out.normal[i].dot(cloud.normal[i].normalized()) > 0.9F ? 1 : 0;
  }
  EXPECT_GT(static_cast<double>(near), 0.95 * static_cast<double>(out.size()));
}

}  // namespace
}  // namespace surfel::test
