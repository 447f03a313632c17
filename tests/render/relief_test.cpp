#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/render/relief.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr int kSide = 200;

/// Shares of a picture whose surface has the depth z(x, y) at pixel centres; infinite: nothing.
template <class Depth>
Array<float> shares_of(const Camera& camera, Relief relief, const Depth& z) {
  NearnessPicture nearness;
  nearness.reset(camera.width, {0, camera.height}, relief_margin(relief, camera));
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const double depth = z(x + 0.5, y + 0.5);
      if (!std::isfinite(depth)) continue;
      *nearness.at(x, y) = static_cast<float>(camera.orthographic ? -depth : 1 / depth);
    }
  }
  return relief_shares(nearness, camera, relief);
}

float least(const Array<float>& shares) { return *std::min_element(shares.begin(), shares.end()); }

/// Depth of the plane through (0, 0, 2) with that slope, seen at a pixel.
double tilted_plane(const Camera& camera, double slope, double x) {
  const double across = (x - camera.center_x) / camera.focal_x;
  return camera.orthographic ? 2 + slope * across : 2 / (1 - slope * across);
}

TEST(Relief, ATiltedPlaneIsNotOccluded) {
  for (const Camera& camera : {camera_at(2, kSide), square_camera(kSide)}) {
    for (const double slope : {0.0, 0.5, 2.0}) {
      const auto shares = shares_of(camera, Relief::kOcclusion, [&](double x, double) {
        return tilted_plane(camera, slope, x);
      });
      EXPECT_GT(least(shares), 0.999F) << slope;
    }
  }
}

/// Two planes, at 45 degrees to the view.
TEST(Relief, TheBottomOfAValleyIsDarkAndItsRidgeIsNot) {
  const Camera camera = square_camera(kSide);
  const auto folded = [&](double sign) {
    return shares_of(camera, Relief::kOcclusion, [&](double x, double) {
      return 2 - sign * std::abs(x - camera.center_x) / camera.focal_x;
    });
  };
  const auto valley = folded(1);
  const auto middle = static_cast<std::size_t>(kSide / 2 * kSide + kSide / 2);
  // The mean of cos^2 e over the directions, tan e being their slope: 1 / sqrt(2).
  EXPECT_NEAR(valley[middle], 0.707F, 0.03F);
  EXPECT_GT(valley[middle + kSide / 4], 0.999F);  // Further away than the reach.
  EXPECT_GT(least(folded(-1)), 0.999F);
}

/// A pixel of a silhouette may show what lies close behind it.
TEST(Relief, OnePixelBehindItsNeighboursIsNoDot) {
  const Camera camera = square_camera(kSide);
  const auto shares = shares_of(camera, Relief::kOcclusion, [](double x, double y) {
    return std::floor(x) == 90 && std::floor(y) == 110 ? 2.05 : 2;
  });
  EXPECT_GT(least(shares), 0.95F);
}

/// Neither the background nor what is far before a wall leaves a halo.
TEST(Relief, SilhouettesHaveNoHalo) {
  for (const Camera& camera : {camera_at(2, kSide), square_camera(kSide)}) {
    for (const double behind : {100.0, HUGE_VAL}) {
      const auto shares = shares_of(camera, Relief::kOcclusion, [&](double x, double y) {
        return std::hypot(x - kSide / 2.0, y - kSide / 2.0) < kSide / 4.0
                   ? tilted_plane(camera, 0.5, x)
                   : behind;
      });
      EXPECT_GT(least(shares), 0.999F) << behind;
    }
  }
}

/// The same scene in another unit, and in more pixels, has the same relief.
TEST(Relief, FollowsNeitherUnitNorResolution) {
  const auto bumps = [](const Camera& camera, double unit, double x, double y) {
    const double u = (x - camera.center_x) / camera.focal_x;
    const double v = (y - camera.center_y) / camera.focal_y;
    return unit * (2 + 0.05 * std::sin(60 * u) * std::sin(60 * v));
  };
  for (const Relief relief : {Relief::kOcclusion, Relief::kEyeDome}) {
    const auto at = [&](int size, double unit) {
      const Camera camera = camera_at(2, size);
      return shares_of(camera, relief,
                       [&](double x, double y) { return bumps(camera, unit, x, y); });
    };
    const auto shares = at(kSide, 1);
    EXPECT_LT(least(shares), 0.93F);
    const auto scaled = at(kSide, 1000);
    const auto finer = at(3 * kSide, 1);
    double off = 0;
    for (int y = 20; y < kSide - 20; ++y) {
      for (int x = 20; x < kSide - 20; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * kSide + x;
        ASSERT_NEAR(shares[i], scaled[i], 1e-3);
        const float fine = finer[static_cast<std::size_t>(3 * y + 1) * 3 * kSide + 3 * x + 1];
        off += std::pow(shares[i] - fine, 2) / std::pow(kSide - 40, 2);
      }
    }
    EXPECT_LT(std::sqrt(off), 0.04);
  }
}

Image picture_of_spheres(const Camera& camera, RenderOptions options) {
  SurfelCloud cloud = jittered_plane(200, 1.2, 0.3);
  const SurfelCloud sphere = fibonacci_sphere(20000, 0.5, {0.9F, 0.4F, 0.1F});
  for (std::size_t i = 0; i < sphere.size(); ++i) {
    add_surfel(cloud, sphere.position[i], sphere.normal[i], sphere.variance[i], sphere.area[i],
               sphere.coefficient[i]);
  }
  RenderCloud surfels(cloud);
  const Scene scene;
  return Renderer(surfels, scene, options).render(camera);
}

/// Pixels that are resolved one by one have the same depths as those resolved by vectors.
TEST(Relief, IsTheSameBesideOtherChannelsAndForAnyThreads) {
  const Camera camera = camera_at(4, 150);
  RenderOptions options;
  options.relief = Relief::kOcclusion;
  options.background = {0.2F, 0.4F, 0.6F, 0.5F};
  const Image plain = picture_of_spheres(camera, options);
  const int threads = thread_count();
  set_thread_count(1);
  const Image alone = picture_of_spheres(camera, options);
  set_thread_count(threads);
  EXPECT_EQ(plain.data, alone.data);
  options.aovs = true;
  const Image channels = picture_of_spheres(camera, options);
  options.relief = Relief::kNone;
  const Image flat = picture_of_spheres(camera, options);
  float darkest = 1;
  for (int y = 0; y < 150; ++y) {
    for (int x = 0; x < 150; ++x) {
      for (int c = 0; c < 4; ++c) {
        ASSERT_NEAR(plain.pixel(x, y)[c], channels.pixel(x, y)[c], 1e-4) << x << " " << y;
      }
      ASSERT_NEAR(flat.pixel(x, y)[3], plain.pixel(x, y)[3], 1e-5);
      ASSERT_EQ(flat.pixel(x, y)[4], channels.pixel(x, y)[4]);
      if (flat.pixel(x, y)[0] > 0.1F) {
        darkest = std::min(darkest, plain.pixel(x, y)[0] / flat.pixel(x, y)[0]);
      }
    }
  }
  EXPECT_LT(darkest, 0.8F);  // Where the sphere goes through the plane.
  for (int c = 0; c < 4; ++c) {
    EXPECT_FLOAT_EQ(plain.pixel(0, 0)[c], flat.pixel(0, 0)[c]) << c;  // The background.
  }
}

}  // namespace
}  // namespace surfel::test
