#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/image_io.h>
#include <surfel/render/environment_map.h>
#include <surfel/sample/procedural_sky.h>

#include "render/environments.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

Image random_environment(int height, std::uint64_t seed = 1) {
  std::uint64_t i = 0;
  return lat_long_image(height, [&](const Vec3d&) -> Vec3f {
    ++i;
    return Vec3d(random_uniform(seed, i, 0), random_uniform(seed, i, 1), random_uniform(seed, i, 2))
        .cast<float>();
  });
}

Vec3f random_direction(std::uint64_t i) {
  const double y = 2 * random_uniform(3, i, 0) - 1;
  const double phi = 2 * M_PI * random_uniform(3, i, 1);
  const double r = std::sqrt(1 - y * y);
  return Vec3d(r * std::cos(phi), y, r * std::sin(phi)).cast<float>();
}

TEST(EnvironmentMap, AxesAreThoseOfOpenExr) {
  EXPECT_LT((lat_long_direction(0.5, 0.5) - Vec3d(0, 0, 1)).norm(), 1e-12);
  EXPECT_LT((lat_long_direction(0.25, 0.5) - Vec3d(1, 0, 0)).norm(), 1e-12);
  EXPECT_LT((lat_long_direction(0, 0.5) - Vec3d(0, 0, -1)).norm(), 1e-12);
  EXPECT_LT((lat_long_direction(0.3, 0) - Vec3d(0, 1, 0)).norm(), 1e-12);
  for (std::uint64_t i = 0; i < 100; ++i) {
    const Vec3f d = random_direction(i);
    const Vec2f place = lat_long_place(7 * d);
    EXPECT_LT((lat_long_direction(place.x(), place.y()).cast<float>() - d).norm(), 1e-5F);
  }
}

TEST(EnvironmentMap, TexelsAreSeenWhereTheyLie) {
  const Image image = random_environment(16);
  const EnvironmentMap map(image, "map");
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 32; ++x) {
      const Vec3d d = lat_long_direction((x + 0.5) / 32, (y + 0.5) / 16);
      const Vec3f texel = Eigen::Map<const Vec3f>(image.pixel(x, y));
      EXPECT_LT((map.radiance(d.cast<float>(), 0) - texel).norm(), 1e-3F) << x << ' ' << y;
    }
  }
}

TEST(EnvironmentMap, EveryLevelHasTheMeanOfThePicture) {
  const EnvironmentMap map(random_environment(129), "map");
  ASSERT_GT(map.levels(), 4);
  for (int level = 1; level < map.levels(); ++level) {
    EXPECT_LT((map.mean(level) - map.mean(0)).norm(), 1e-5) << level;
    EXPECT_GT(map.variance(level), map.variance(level - 1));
  }
  // The mean is the one over the sphere: of y^2 it is 1/3.
  const EnvironmentMap square(
      lat_long_image(64,
                     [](const Vec3d& d) -> Vec3f {
                       return Vec3f::Constant(static_cast<float>(d.y() * d.y()));
                     }),
      "map");
  for (int level = 0; level < square.levels(); ++level) {
    EXPECT_NEAR(square.mean(level).x(), 1.0 / 3, 3e-4) << level;
  }
}

/// Brownian motion of a variance leaves exp(-variance) of a linear function of the direction.
TEST(EnvironmentMap, LinearFunctionsFadeByTheMeanCosine) {
  const EnvironmentMap map(lat_long_image(64, direction_color), "map");
  for (int level = 0; level < map.levels(); ++level) {
    const float v = map.variance(level);
    for (std::uint64_t i = 0; i < 200; ++i) {
      const Vec3f d = random_direction(i);
      const Vec3f expected = 0.5F * (std::exp(-v) * d + Vec3f::Ones());
      EXPECT_LT((map.radiance(d, v) - expected).norm(), 0.01F) << level << ' ' << v;
    }
  }
}

/// A spot near a pole looks like one on the equator, from all sides.
TEST(EnvironmentMap, FiltersTheSameEverywhereOnTheSphere) {
  const auto spot = [](const Vec3d& center) {
    return EnvironmentMap(
        lat_long_image(64,
                       [&](const Vec3d& d) -> Vec3f {
                         const double angle = std::atan2(d.cross(center).norm(), d.dot(center));
                         return Vec3f::Constant(
                             static_cast<float>(std::exp(-0.5 * std::pow(angle / 0.12, 2))));
                       }),
        "spot");
  };
  const auto near = [](const Vec3d& center, double angle, double around) -> Vec3f {
    const Vec3d a = center.unitOrthogonal();
    const Vec3d b = center.cross(a);
    return (std::cos(angle) * center +
            std::sin(angle) * (std::cos(around) * a + std::sin(around) * b))
        .cast<float>();
  };
  const Vec3d equator(0, 0, 1);
  const EnvironmentMap at_equator = spot(equator);
  for (const Vec3d& center : {Vec3d(0, 1, 0), Vec3d(0, -1, 0), Vec3d(0.05, 1, 0.02),
                              Vec3d(0.1, 0.7, -0.7), Vec3d(0, 0, -1)}) {
    const Vec3d c = center.normalized();
    const EnvironmentMap map = spot(c);
    for (const float variance : {0.0F, 0.003F, 0.02F, 0.1F}) {
      const float peak = at_equator.radiance(equator.cast<float>(), variance).x();
      for (const double angle : {0.0, 0.1, 0.25, 0.5}) {
        const float expected = at_equator.radiance(near(equator, angle, 0.4), variance).x();
        for (int i = 0; i < 8; ++i) {
          EXPECT_NEAR(map.radiance(near(c, angle, i * M_PI / 4), variance).x(), expected,
                      0.07F * peak)
              << c.transpose() << ", " << variance << ", " << angle;
        }
      }
    }
  }
}

TEST(EnvironmentMap, HasNoSeamAndNoStepAtThePoles) {
  const EnvironmentMap map(random_environment(16), "map");
  for (const float variance : {0.0F, 0.01F, 0.1F, 1.0F}) {
    for (int i = 0; i < 64; ++i) {
      const double v = (i + 0.5) / 64;
      const auto at = [&](double u, double w) {
        return map.radiance(lat_long_direction(u, w).cast<float>(), variance);
      };
      EXPECT_LT((at(1e-5, v) - at(1 - 1e-5, v)).norm(), 2e-3F);
      EXPECT_LT((at(v, 1e-5) - at(0.3, 1e-5)).norm(), 2e-3F);
      EXPECT_LT((at(v, 1 - 1e-5) - at(0.3, 1 - 1e-5)).norm(), 2e-3F);
    }
  }
}

TEST(EnvironmentMap, UniformLightStaysWhatItIs) {
  const Vec3f light(0.25F, 1, 40);
  const Environment environment = uniform_environment(light);
  for (std::uint64_t i = 0; i < 50; ++i) {
    for (const float variance : {0.0F, 0.01F, 0.3F, 2.0F, 50.0F}) {
      const Vec3f seen = environment.map->radiance(random_direction(i), variance);
      EXPECT_LT((seen - light).norm(), 1e-5F * light.norm());
    }
  }
  const EnvironmentMap smallest(lat_long_image(1, [&](const Vec3d&) { return light; }), "map");
  EXPECT_LT((smallest.radiance(Vec3f(0, -1, 0), 0.2F) - light).norm(), 1e-4F);
}

TEST(EnvironmentMap, DoesNotDependOnThreads) {
  const Image sky = procedural_sky(64, 32);
  std::vector<float> seen[2];
  for (const int threads : {1, 4}) {
    set_thread_count(threads);
    const EnvironmentMap map(sky, "sky");
    for (std::uint64_t i = 0; i < 300; ++i) {
      const Vec3f color = map.radiance(random_direction(i), 0.01F * static_cast<float>(i));
      seen[threads == 1 ? 0 : 1].insert(seen[threads == 1 ? 0 : 1].end(), color.begin(),
                                        color.end());
    }
  }
  set_thread_count(0);
  EXPECT_EQ(std::memcmp(seen[0].data(), seen[1].data(), seen[0].size() * sizeof(float)), 0);
}

TEST(EnvironmentMap, RefusesWhatIsNoLatLongMap) {
  Image wide = random_environment(4);
  wide.height = 2;
  EXPECT_NE(message_of([&] { EnvironmentMap(wide, "wide.exr"); }).find("wide.exr: is 8x2"),
            std::string::npos);
  Image broken = random_environment(4);
  broken.pixel(3, 2)[1] = std::numeric_limits<float>::infinity();
  EXPECT_NE(message_of([&] { EnvironmentMap(broken, "map"); }).find("pixel (3, 2)"),
            std::string::npos);
}

TEST(LoadEnvironment, MakesTheSkyReadsFilesAndNamesBadOnes) {
  const TemporaryFolder folder;
  Scene scene;
  load_environment(scene);
  EXPECT_FALSE(scene.environment);
  scene.environment = Environment{.image = folder / "map.hdr"};
  EXPECT_NE(message_of([&] { load_environment(scene); }).find("map.hdr"), std::string::npos);
  write_text(scene.environment->image, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X");
  EXPECT_NE(message_of([&] { load_environment(scene); }).find("map.hdr"), std::string::npos);

  const Image directions = lat_long_image(16, direction_color);
  write_image(directions, scene.environment->image);
  load_environment(scene);
  const Vec3f seen = scene.environment->map->radiance({0, 0, 1}, 0);
  EXPECT_LT((seen - Vec3f(0.5F, 0.5F, 1)).norm(), 0.02F);  // HDR has 8 bits of mantissa.

  const auto loaded = scene.environment->map;
  load_environment(scene);
  EXPECT_EQ(scene.environment->map, loaded);
}

}  // namespace
}  // namespace surfel::test
