#include <cmath>
#include <cstddef>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/truth/volume_march.h>
#include <surfel/volume/gaussians_of_volume.h>

namespace surfel::test {
namespace {

/// A volume of n cubed voxels with the edge 1 / n, centred at the origin.
template <class Field>
Volume volume_of(std::size_t n, const Field& field) {
  Volume volume;
  volume.size = {n, n, n};
  const double edge = 1 / static_cast<double>(n);
  for (Vec3d& step : volume.step) step *= edge;
  volume.origin = Vec3d::Constant((edge - 1) / 2);
  volume.value.resize(volume.voxels());
  for (std::size_t z = 0; z < n; ++z) {
    for (std::size_t y = 0; y < n; ++y) {
      for (std::size_t x = 0; x < n; ++x) {
        const Vec3d voxel(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z));
        volume.value[volume.index(x, y, z)] = static_cast<float>(field(volume.world(voxel)));
      }
    }
  }
  return volume;
}

/// Two lumps in a third.
double lumps(const Vec3d& p) {
  const auto lump = [&](const Vec3d& centre, double size) {
    return std::exp(-(p - centre).squaredNorm() / (2 * size * size));
  };
  return 0.5 * lump({0, 0, 0}, 0.17) + lump({0.1, 0.05, -0.1}, 0.07) + lump({-0.12, 0, 0.08}, 0.05);
}

TransferFunction ramp(double density) {
  return {{{0.05, {0.2F, 0.3F, 0.9F}, 0},
           {0.5, {0.9F, 0.8F, 0.2F}, density / 2},
           {1.2, {0.9F, 0.2F, 0.1F}, density}},
          false};
}

Camera camera(int side) {
  Camera view;
  view.width = view.height = side;
  view.focal_x = view.focal_y = 1.8 * side;
  view.center_x = view.center_y = side / 2.0;
  const Vec3d forward = Vec3d(0.3, -0.2, 1).normalized();
  const Vec3d right = Vec3d(0, 1, 0).cross(forward).normalized();
  view.camera_from_world.row(0) = right;
  view.camera_from_world.row(1) = forward.cross(right);
  view.camera_from_world.row(2) = forward;
  view.eye = -2 * forward;
  return view;
}

Image picture(const GaussianCloud& cloud, const Camera& view) {
  GaussianOptions options;
  options.display = true;
  return GaussianRenderer(cloud, options).render(view);
}

double psnr(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    sum += std::pow(static_cast<double>(a.data[i]) - static_cast<double>(b.data[i]), 2);
  }
  return -10 * std::log10(sum / static_cast<double>(a.data.size()));
}

/// A ray through the middle of a block of constant density has its optical depth in closed form.
TEST(GaussiansOfVolume, ABlockHasItsOpticalDepth) {
  const Volume volume = volume_of(24, [](const Vec3d&) { return 1.0; });
  const TransferFunction constant{{{1, {1, 1, 1}, 1.3}}, false};
  Camera view = camera(33);
  view.camera_from_world.setIdentity();
  view.eye = {0, 0, -2};
  for (const double error : {0.0, 1.0}) {
    GaussiansOfVolumeOptions options;
    options.deviation = 0.6;  // Ripples are below the tolerance.
    options.max_error = error;
    GaussiansOfVolumeReport report;
    const GaussianCloud cloud = gaussians_of_volume(volume, constant, "block", options, &report);
    EXPECT_EQ(cloud.size(), 27U);  // Blocks of 8 cubed.
    EXPECT_EQ(report.merged, volume.voxels());
    EXPECT_EQ(cloud.rule, AmplitudeRule::kDensity);
    const Image image = picture(cloud, view);
    const float* middle = image.pixel(16, 16);
    EXPECT_NEAR(middle[3], 1 - std::exp(-1.3), 0.004);
    EXPECT_NEAR(middle[0], middle[3], 1e-5);
  }
}

/// What is merged is what looks alike.
TEST(GaussiansOfVolume, MergesWhatIsSmooth) {
  const Volume volume = volume_of(32, lumps);
  std::size_t before = volume.voxels() + 1;
  const Image truth = march_volume(volume, ramp(20), camera(64));
  for (const double error : {0.0, 0.02, 0.1}) {
    GaussiansOfVolumeOptions options;
    options.max_error = error;
    options.least_depth = 0;
    GaussiansOfVolumeReport report;
    const GaussianCloud cloud = gaussians_of_volume(volume, ramp(20), "lumps", options, &report);
    EXPECT_LT(cloud.size(), before);
    before = cloud.size();
    EXPECT_GT(psnr(picture(cloud, camera(64)), truth), error < 0.05 ? 40 : 34) << error;
  }
}

TEST(GaussiansOfVolume, PicturesAreAsMarchedOnes) {
  const Volume volume = volume_of(64, lumps);
  for (const double density : {3.0, 100.0}) {
    for (const double shading : {0.0, 0.8}) {
      GaussiansOfVolumeOptions options;
      options.shading = shading;
      VolumeMarchOptions march;
      march.shading = shading;
      const GaussianCloud cloud = gaussians_of_volume(volume, ramp(density), "lumps", options);
      EXPECT_EQ(cloud.degree, shading > 0 ? 1 : 0);
      const Image truth = march_volume(volume, ramp(density), camera(96), march);
      EXPECT_GT(psnr(picture(cloud, camera(96)), truth), 40) << density << ' ' << shading;
    }
  }
}

/// Opaque bodies whose values jump within a fifth of a voxel have the surfaces that rays find: an
/// error of a tenth of a voxel all around is 37 dB in these pictures.
TEST(GaussiansOfVolume, OpaqueSurfacesAreWhereRaysFindThem) {
  const Volume volume = volume_of(32, [](const Vec3d& p) {
    const double ball = (0.33 - p.norm()) * 32;
    const double bar = (0.08 - Vec3d(p.x() - 0.3, p.y(), 0).norm()) * 32;
    return 1 / (1 + std::exp(-2 * std::max(ball, bar)));
  });
  // A voxel's edge has an optical depth of 1, as bone has, and of 10.
  for (const auto& [density, least] : {std::pair{32.0, 37.0}, std::pair{320.0, 31.0}}) {
    const TransferFunction bone{{{0.4, {0.9F, 0.9F, 0.8F}, 0}, {0.5, {0.9F, 0.9F, 0.8F}, density}},
                                false};
    const GaussianCloud cloud = gaussians_of_volume(volume, bone, "bone");
    const Image truth = march_volume(volume, bone, camera(36), {.step = 0.1, .rays = 8});
    EXPECT_GT(psnr(picture(cloud, camera(36)), truth), least) << density;
  }
}

/// Axes may be turned, mirrored and of different lengths.
TEST(GaussiansOfVolume, FollowsTheAxesOfTheVolume) {
  Volume volume = volume_of(24, lumps);
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(0.7, Vec3d(1, 2, -1).normalized()).toRotationMatrix();
  volume.step = {turn * volume.step[0] * 1.5, turn * volume.step[1], -turn * volume.step[2] * 0.8};
  volume.origin = {0, 0, 0};
  volume.origin = -volume.world(Vec3d::Constant(11.5));
  const GaussianCloud cloud = gaussians_of_volume(volume, ramp(20), "turned");
  const Image truth = march_volume(volume, ramp(20), camera(64));
  EXPECT_GT(psnr(picture(cloud, camera(64)), truth), 40);
}

TEST(GaussiansOfVolume, SameForAnyNumberOfThreads) {
  const Volume volume = volume_of(32, lumps);
  const GaussianCloud expected = gaussians_of_volume(volume, ramp(20), "lumps");
  for (const int threads : {1, 3}) {
    set_thread_count(threads);
    const GaussianCloud cloud = gaussians_of_volume(volume, ramp(20), "lumps");
    set_thread_count(0);
    EXPECT_TRUE(cloud.position == expected.position);
    EXPECT_TRUE(cloud.amplitude == expected.amplitude);
    EXPECT_TRUE(cloud.harmonics == expected.harmonics);
  }
}

TEST(GaussiansOfVolume, RefusesWhatCannotBeSeen) {
  const Volume volume = volume_of(8, [](const Vec3d&) { return 0.0; });
  EXPECT_THROW(gaussians_of_volume(volume, ramp(1), "dark"), Error);
  GaussiansOfVolumeOptions options;
  options.deviation = 3;
  EXPECT_THROW(gaussians_of_volume(volume, ramp(1), "dark", options), Error);
}

}  // namespace
}  // namespace surfel::test
