#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/render/lens_picture.h>
#include <surfel/scene/lens.h>

namespace surfel::test {
namespace {

Camera wide_camera() {
  Camera camera;
  camera.width = 200;
  camera.height = 150;
  camera.focal_x = 120;
  camera.focal_y = 125;
  camera.center_x = 96;
  camera.center_y = 80;
  return camera;
}

std::vector<Lens> lenses() {
  Lens radial;
  radial.k = {-0.12, 0.03};
  Lens opencv;
  opencv.k = {0.1, -0.02, 0.01, 0.02, 0.01, 0.005};
  opencv.p = {0.003, -0.002};
  Lens fisheye;
  fisheye.model = Lens::Model::kFisheye;
  fisheye.k = {0.05, -0.01, 0.002, -0.001};
  Lens around;
  around.model = Lens::Model::kEquirectangular;
  return {radial, opencv, fisheye, around};
}

TEST(Lens, RaysAndPlacesAreInverses) {
  for (const Lens& lens : lenses()) {
    SCOPED_TRACE(static_cast<int>(lens.model));
    const LensRays rays(wide_camera(), lens);
    for (double y = 0.5; y < 150; y += 7) {
      for (double x = 0.5; x < 200; x += 7) {
        const auto ray = rays(x, y);
        ASSERT_TRUE(ray) << x << " " << y;
        EXPECT_NEAR(ray->norm(), 1, 1e-12);
        const auto place = rays.place(*ray);
        ASSERT_TRUE(place);
        EXPECT_LT((*place - Eigen::Vector2d(x, y)).norm(), 1e-6);
      }
    }
  }
}

TEST(Lens, DistortionIsThatOfOpenCv) {
  Lens lens;
  lens.k = {0.1, 0.02, -0.03, 0.04, 0.05, 0.06};
  lens.p = {0.01, -0.02};
  const double x = 0.3;
  const double y = -0.2;
  const double s = x * x + y * y;
  const double radial = (1 + 0.1 * s + 0.02 * s * s - 0.03 * s * s * s) /
                        (1 + 0.04 * s + 0.05 * s * s + 0.06 * s * s * s);
  const double u = x * radial + 2 * 0.01 * x * y - 0.02 * (s + 2 * x * x);
  const double v = y * radial + 0.01 * (s + 2 * y * y) - 2 * 0.02 * x * y;
  const auto place = LensRays(wide_camera(), lens).place(Vec3d(2 * x, 2 * y, 2));
  ASSERT_TRUE(place);
  EXPECT_NEAR(place->x(), 120 * u + 96, 1e-9);
  EXPECT_NEAR(place->y(), 125 * v + 80, 1e-9);
}

TEST(Lens, NothingIsSeenWhereDistortionTurnsBack) {
  Lens lens;
  lens.k = {-0.5};  // r - 0.5 r^3 grows up to r = 0.816, where it is 0.544.
  const LensRays rays(wide_camera(), lens);
  EXPECT_TRUE(rays(96 + 120 * 0.54, 80));
  EXPECT_FALSE(rays(96 + 120 * 0.56, 80));
  EXPECT_FALSE(rays.place(Vec3d(1, 0, 1)));
  EXPECT_FALSE(rays.place(Vec3d(0, 0, -1)));
}

TEST(Lens, PanoramasHaveTheirAxisInTheMiddle) {
  Lens lens;
  lens.model = Lens::Model::kEquirectangular;
  const LensRays rays(wide_camera(), lens);
  EXPECT_LT((*rays(100, 75) - Vec3d(0, 0, 1)).norm(), 1e-12);
  EXPECT_LT((*rays(150, 75) - Vec3d(1, 0, 0)).norm(), 1e-12);  // A quarter of the width: right.
  EXPECT_LT((*rays(33, 0) - Vec3d(0, -1, 0)).norm(), 1e-12);   // The top row: up.
}

/// A world of soft stripes around the eye, by direction, drawn as a pinhole sees it, filtered by
/// the pixel's Gaussian as splats are; with the depth of a sphere of radius 2.
double world(const Vec3d& direction) {
  const Vec3d d = direction.normalized();
  return 0.5 + 0.2 * std::sin(5 * d.x()) + 0.15 * std::cos(4 * d.y() + 2) +
         0.1 * std::sin(5 * d.z());
}

Image pinhole_of_world(const Camera& camera) {
  Image image{camera.width, camera.height, {"R", "G", "B", "A", "Z"}, {}};
  image.data.resize(5 * static_cast<std::size_t>(camera.width) *
                    static_cast<std::size_t>(camera.height));
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Vec3d ray((x + 0.5 - camera.center_x) / camera.focal_x,
                      (y + 0.5 - camera.center_y) / camera.focal_y, 1);
      const auto value = static_cast<float>(world(camera.camera_from_world.transpose() * ray));
      float* pixel = image.pixel(x, y);
      pixel[0] = pixel[1] = pixel[2] = value;
      pixel[3] = 1;
      pixel[4] = static_cast<float>(2 / ray.norm());
    }
  }
  return image;
}

TEST(LensPicture, ShowsTheWorldAlongItsRays) {
  for (const Lens& lens : lenses()) {
    SCOPED_TRACE(static_cast<int>(lens.model));
    Camera camera = wide_camera();
    camera.camera_from_world << 0, 0, 1, 1, 0, 0, 0, 1, 0;
    int pictures = 0;
    const auto draw = [&](const Camera& pinhole) {
      ++pictures;
      return pinhole_of_world(pinhole);
    };
    const Image image = draw_through_lens(camera, lens, draw, {});
    const LensRays rays(camera, lens);
    EXPECT_EQ(pictures > 1, needs_cube(camera, lens));
    double sum = 0;
    double worst_depth = 0;
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const auto ray = rays(x + 0.5, y + 0.5);
        if (!ray) {
          EXPECT_EQ(image.pixel(x, y)[3], 0);
          continue;
        }
        const float* pixel = image.pixel(x, y);
        const double error = pixel[0] - world(camera.camera_from_world.transpose() * *ray);
        sum += error * error;
        EXPECT_NEAR(pixel[3], 1, 1e-6);
        const double depth = lens.model == Lens::Model::kEquirectangular ? 2 : 2 * ray->z();
        worst_depth = std::max(worst_depth, std::abs(pixel[4] - depth));
      }
    }
    // The pixel filter takes some of the stripes' contrast.
    EXPECT_LT(std::sqrt(sum / (camera.width * camera.height)), 2e-3);
    EXPECT_LT(worst_depth, 0.02);
  }
}

/// What a pinhole's pixels see of values by direction, -1 to 1, through their Gaussian.
Image filtered_pinhole(const Camera& camera, double (*value_of)(const Vec3d&)) {
  Image image = rgba_image(camera.width, camera.height);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      double sum = 0;
      double total = 0;
      for (double dy = -3; dy <= 3; dy += 1) {
        for (double dx = -3; dx <= 3; dx += 1) {
          const Vec3d ray((x + 0.5 + dx - camera.center_x) / camera.focal_x,
                          (y + 0.5 + dy - camera.center_y) / camera.focal_y, 1);
          const Vec3d d = camera.camera_from_world.transpose() * ray;
          const double weight = std::exp(-(dx * dx + dy * dy) / 2);
          sum += weight * value_of(d);
          total += weight;
        }
      }
      const auto value = static_cast<float>(0.5 + 0.4 * sum / total);
      std::fill_n(image.pixel(x, y), 3, value);
      image.pixel(x, y)[3] = 1;
    }
  }
  return image;
}

/// Meridians, eight light and eight dark ones.
double meridians(const Vec3d& d) { return std::sin(8 * std::atan2(d.x(), d.z())); }

/// A light cap about each pole, which ends beside a square about it that is drawn more finely.
constexpr double kCap = 0.13;
double caps(const Vec3d& d) { return std::hypot(d.x(), d.z()) < kCap * std::abs(d.y()) ? 1 : -1; }

TEST(LensPicture, EdgesNearThePolesOfPanoramasAreAsSoftAsElsewhere) {
  Lens around;
  around.model = Lens::Model::kEquirectangular;
  Camera camera = wide_camera();
  camera.width = 192;
  camera.height = 96;
  const Image image = draw_through_lens(
      camera, around, [](const Camera& pinhole) { return filtered_pinhole(pinhole, caps); }, {});
  const double step = std::numbers::pi / camera.height;
  for (int y = 2; y < 10; ++y) {
    const double rows = std::atan(kCap) / step - (y + 0.5);
    const double expected = 0.5 + 0.4 * std::erf(rows / std::numbers::sqrt2);
    for (int x = 0; x < camera.width; ++x) {
      EXPECT_NEAR(image.pixel(x, y)[0], expected, 0.04) << x << ' ' << y;
    }
  }
}

TEST(LensPicture, PanoramasAreAsSharpAtTheirPolesAsElsewhere) {
  Lens around;
  around.model = Lens::Model::kEquirectangular;
  Camera camera = wide_camera();
  camera.width = 96;
  camera.height = 48;
  const Image image = draw_through_lens(
      camera, around, [](const Camera& pinhole) { return filtered_pinhole(pinhole, meridians); },
      {});
  const double step = 2 * std::numbers::pi / camera.width;
  const double contrast = 0.4 * std::exp(-std::pow(8 * step, 2) / 2);
  for (int y = 3; y < camera.height - 3; ++y) {
    double sum = 0;
    for (int x = 0; x < camera.width; ++x) {
      const double expected = 0.5 + contrast * std::sin(8 * (x + 0.5 - 48) * step);
      sum += std::pow(image.pixel(x, y)[0] - expected, 2);
    }
    EXPECT_LT(std::sqrt(sum / camera.width), 0.02) << y;
  }
}

TEST(LensPicture, BackgroundIsWhereTheLensShowsNothing) {
  Lens lens;
  lens.k = {-0.5};
  const Image image = draw_through_lens(wide_camera(), lens, pinhole_of_world,
                                        {.background = {0.25F, 0.5F, 0.75F, 1}});
  EXPECT_EQ(image.pixel(199, 149)[2], 0.75F);
  EXPECT_TRUE(std::isinf(image.pixel(199, 149)[4]));
  EXPECT_FALSE(std::isinf(image.pixel(96, 80)[4]));
}

}  // namespace
}  // namespace surfel::test
