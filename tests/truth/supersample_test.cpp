#include <Eigen/Geometry>
#include <atomic>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/truth/supersample.h>

namespace surfel::test {
namespace {

Camera picture(int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  return camera;
}

/// Distribution function of the standard normal distribution.
double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

TEST(Supersample, KeepsConstantsUpToTheBorder) {
  for (const int samples : {1, 2, 3, 16}) {
    for (const double lowpass : {0.0, 0.01, 0.1, 0.5, 1.0, 3.0}) {
      const Image image = supersample(picture(5, 3), {samples, lowpass}, [](double, double, int) {
        return Rgba{0.25F, 0.5F, 1, 1};
      });
      ASSERT_EQ(image.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
      for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < 5; ++x) {
          EXPECT_NEAR(image.pixel(x, y)[0], 0.25, 1e-6) << samples << " " << lowpass;
          EXPECT_NEAR(image.pixel(x, y)[1], 0.5, 1e-6);
          EXPECT_NEAR(image.pixel(x, y)[3], 1, 1e-6);
        }
      }
    }
  }
}

TEST(Supersample, KeepsLinearRamps) {
  const Image image = supersample(picture(12, 9), {3, 0.8}, [](double x, double y, int) {
    return Rgba{static_cast<float>(x), static_cast<float>(y), 0, 1};
  });
  for (int y = 0; y < 9; ++y) {
    for (int x = 0; x < 12; ++x) {
      EXPECT_NEAR(image.pixel(x, y)[0], x + 0.5, 1e-4);
      EXPECT_NEAR(image.pixel(x, y)[1], y + 0.5, 1e-4);
    }
  }
}

TEST(Supersample, EdgeIsTheIntegralOfTheGaussian) {
  const double edge = 10.3;
  for (const double lowpass : {0.5, 1.0, 2.0}) {
    const auto right = [&](double x, double, int) { return Rgba{0, 0, 0, x > edge ? 1.0F : 0.0F}; };
    const auto below = [&](double, double y, int) { return Rgba{0, 0, 0, y > edge ? 1.0F : 0.0F}; };
    const Image columns = supersample(picture(20, 2), {64, lowpass}, right);
    const Image rows = supersample(picture(2, 20), {64, lowpass}, below);
    for (int i = 0; i < 20; ++i) {
      const double expected = normal_cdf((i + 0.5 - edge) / lowpass);
      // Half a sample's weight, and what lies beyond the filter's end.
      const double tolerance = 0.4 / (2 * 64 * lowpass) + 1e-4;
      EXPECT_NEAR(columns.pixel(i, 1)[3], expected, tolerance);
      EXPECT_NEAR(rows.pixel(1, i)[3], expected, tolerance);
    }
  }
}

TEST(Supersample, WithoutLowpassPixelsAreMeansOfTheirSquares) {
  const Image image = supersample(picture(8, 8), {4, 0}, [](double x, double y, int) {
    return Rgba{x > 3.25 && y < 5.5 ? 1.0F : 0.0F, 0, 0, 1};
  });
  EXPECT_EQ(image.pixel(2, 2)[0], 0);
  EXPECT_NEAR(image.pixel(3, 2)[0], 0.75, 1e-6);
  EXPECT_NEAR(image.pixel(4, 5)[0], 0.5, 1e-6);
  EXPECT_NEAR(image.pixel(4, 2)[0], 1, 1e-6);
}

TEST(Supersample, SameBytesForAnyNumberOfThreadsAndProgressEndsAtOne) {
  const auto pattern = [](double x, double y, int) {
    return Rgba{static_cast<float>(std::sin(x * y)), static_cast<float>(std::cos(x + y * y)), 0, 1};
  };
  std::vector<Image> images;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    std::atomic<int> calls{0};
    std::atomic<bool> finished{false};
    images.push_back(supersample(picture(37, 23), {5, 1.3}, pattern, [&](double share) {
      ++calls;
      EXPECT_GT(share, 0);
      EXPECT_LE(share, 1);
      if (share == 1) finished = true;
    }));
    EXPECT_GT(calls, 1);
    EXPECT_TRUE(finished);
  }
  set_thread_count(0);
  EXPECT_EQ(images[0].data, images[1].data);
  EXPECT_EQ(images[0].data, images[2].data);
}

TEST(Supersample, BandsOfRowsLeaveNoSeam) {
  // So wide that rows of samples are filtered in several bands.
  const int width = 65536;
  const Image image = supersample(picture(width, 24), {2, 1}, [](double, double y, int) {
    return Rgba{static_cast<float>(y), 0, 0, 1};
  });
  for (int y = 0; y < 24; ++y) {
    for (const int x : {0, 1, width / 2, width - 1}) {
      EXPECT_NEAR(image.pixel(x, y)[0], y + 0.5, 1e-4);
      EXPECT_NEAR(image.pixel(x, y)[3], 1, 1e-6);
    }
  }
}

TEST(Supersample, BadOptionsAreRefused) {
  const auto trace = [](double, double, int) { return Rgba{}; };
  for (const SupersampleOptions& options :
       {SupersampleOptions{0, 1}, SupersampleOptions{65, 1}, SupersampleOptions{4, -1},
        SupersampleOptions{4, 17}, SupersampleOptions{4, std::nan("")}}) {
    EXPECT_THROW(supersample(picture(2, 2), options, trace), Error);
  }
}

TEST(CompositeOver, PutsAStraightBackgroundBehindPremultipliedColors) {
  Image image = supersample(picture(2, 2), {1, 0}, [](double, double, int) {
    return Rgba{0.25F, 0, 0, 0.5F};
  });
  composite_over(image, {0, image.height}, {0, 0.5F, 1, 0.5F});
  const float* p = image.pixel(1, 1);
  EXPECT_FLOAT_EQ(p[0], 0.25F);
  EXPECT_FLOAT_EQ(p[1], 0.125F);
  EXPECT_FLOAT_EQ(p[2], 0.25F);
  EXPECT_FLOAT_EQ(p[3], 0.75F);
}

TEST(ViewRay, ProjectsBackToItsPicture) {
  for (const bool orthographic : {false, true}) {
    Camera camera = picture(640, 480);
    camera.orthographic = orthographic;
    camera.focal_x = 300;
    camera.focal_y = 250;
    camera.center_x = 310;
    camera.center_y = 200;
    camera.camera_from_world = Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized()).matrix();
    camera.eye = Vec3d(1, 2, 3);
    const ViewRay ray = view_ray(camera, 100.5, 333.25);
    for (const double t : {0.5, 4.0}) {
      const Vec3d p = camera.camera_from_world * (ray.origin + t * ray.direction);
      const double w = orthographic ? 1 : p.z();
      EXPECT_NEAR(p.z(), t, 1e-12);
      EXPECT_NEAR(camera.focal_x * p.x() / w + camera.center_x, 100.5, 1e-9);
      EXPECT_NEAR(camera.focal_y * p.y() / w + camera.center_y, 333.25, 1e-9);
    }
  }
}

}  // namespace
}  // namespace surfel::test
