#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/instructions.h>
#include <surfel/base/parallel.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/io/gaussian_io.h>

#include "gaussian/gaussian_oracle.h"
#include "gaussian/random_gaussians.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

/// The profiles that the oracle draws.
constexpr GaussianProfile kProfiles[] = {GaussianProfile::kInria, GaussianProfile::kGsplat,
                                         GaussianProfile::kMip, GaussianProfile::k2dgs,
                                         GaussianProfile::kExact};
constexpr GaussianProfile kAllProfiles[] = {GaussianProfile::kInria, GaussianProfile::kGsplat,
                                            GaussianProfile::kMip,   GaussianProfile::k2dgs,
                                            GaussianProfile::kExact, GaussianProfile::kSurfel};
const char* name(GaussianProfile profile) {
  static constexpr const char* kNames[] = {"inria", "gsplat", "mip", "2dgs", "exact", "surfel"};
  return kNames[static_cast<std::size_t>(profile)];
}

constexpr int kAlpha = 3;

/// PSNR of the channels [first, last) of two pictures, dB.
double psnr(const Image& a, const Image& b, int first, int last) {
  double sum = 0;
  std::size_t count = 0;
  for (int y = 0; y < a.height; ++y) {
    for (int x = 0; x < a.width; ++x) {
      for (int c = first; c < last; ++c) {
        const double d = double{a.pixel(x, y)[c]} - double{b.pixel(x, y)[c]};
        sum += d * d;
        ++count;
      }
    }
  }
  return -10 * std::log10(sum / static_cast<double>(count));
}

/// Share of the pixels with something in them whose depths differ by more than `most`, relatively.
double share_off(const Image& a, const Image& b, int channel, float most) {
  std::size_t off = 0;
  std::size_t seen = 0;
  for (int y = 0; y < a.height; ++y) {
    for (int x = 0; x < a.width; ++x) {
      if (b.pixel(x, y)[kAlpha] < 0.1F) continue;
      const float u = a.pixel(x, y)[channel];
      const float v = b.pixel(x, y)[channel];
      ++seen;
      if (!(u == v || std::abs(u - v) < most * std::abs(v))) ++off;
    }
  }
  return static_cast<double>(off) / static_cast<double>(seen);
}

/// Compares a picture with the oracle's. \param least  PSNR of colours and of alpha, dB.
void expect_oracles_picture(const GaussianCloud& cloud, const Camera& camera,
                            GaussianProfile profile, double least) {
  const GaussianOptions options{.profile = profile, .samples = 1, .depth = true, .display = true};
  const Image ours = GaussianRenderer(cloud, options).render(camera);
  const Image truth = gaussian_oracle(cloud, camera, options);
  const double color = psnr(ours, truth, 0, kAlpha);
  const double alpha = psnr(ours, truth, kAlpha, kAlpha + 1);
  EXPECT_GT(color, least) << name(profile);
  EXPECT_GT(alpha, least) << name(profile);
  EXPECT_LT(share_off(ours, truth, 4, 1e-3F), 0.02) << name(profile);
  EXPECT_LT(share_off(ours, truth, 5, 1e-2F), 0.05) << name(profile);
  ::testing::Test::RecordProperty(
      std::string(name(profile)) + "_" + std::to_string(cloud.size()) + "_dB",
      std::to_string(color));
}

struct RandomScene {
  int degree;
  AmplitudeRule rule;
};

class RandomScenes : public ::testing::TestWithParam<RandomScene> {};

TEST_P(RandomScenes, EveryProfileGivesItsRenderersPicture) {
  GaussianCloud cloud = random_gaussians(800, 7, GetParam().degree);
  cloud.rule = GetParam().rule;
  const Camera camera = camera_before(cloud, 90, 61);
  for (const GaussianProfile profile : kProfiles) {
    expect_oracles_picture(cloud, camera, profile, 70);
  }
}

INSTANTIATE_TEST_SUITE_P(GaussianRenderer, RandomScenes,
                         ::testing::Values(RandomScene{3, AmplitudeRule::kOpacity},
                                           RandomScene{0, AmplitudeRule::kOpacity},
                                           RandomScene{4, AmplitudeRule::kCompensated}));

TEST(GaussianRenderer, DensitiesAreIntegratedAlongRays) {
  GaussianCloud cloud = random_gaussians(800, 3);
  cloud.rule = AmplitudeRule::kDensity;
  for (float& density : cloud.amplitude) density *= 20;
  expect_oracles_picture(cloud, camera_before(cloud, 90, 61), GaussianProfile::kExact, 60);
}

TEST(GaussianRenderer, WideAnglesAreRightWithTheExactProfile) {
  const GaussianCloud cloud = random_gaussians(800, 5);
  Camera camera = camera_before(cloud, 90, 61);
  camera.focal_x = camera.focal_y = 25;  // 120 degrees.
  expect_oracles_picture(cloud, camera, GaussianProfile::kExact, 60);
}

TEST(GaussianRenderer, ParallelRays) {
  for (const AmplitudeRule rule : {AmplitudeRule::kDensity, AmplitudeRule::kOpacity}) {
    GaussianCloud cloud = random_gaussians(800, 9);
    cloud.rule = rule;
    Camera camera = camera_before(cloud, 90, 61);
    camera.orthographic = true;
    camera.focal_x = 18;
    camera.focal_y = 21;
    for (const GaussianProfile profile : kProfiles) {
      if (rule == AmplitudeRule::kDensity && profile != GaussianProfile::kExact) continue;
      expect_oracles_picture(cloud, camera, profile, 70);
    }
  }
}

TEST(GaussianRenderer, TrainedFiles) {
  const std::string folder = data_folder() / "surfels";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no test data";
  {
    const GaussianCloud cloud = read_gaussians(folder + "/gaussians_train_1000.ply");
    Camera camera = gaussian_camera(45, 31);
    camera.eye = {0, -0.5, -7};
    for (const GaussianProfile profile : kProfiles) {
      expect_oracles_picture(cloud, camera, profile, 55);
    }
  }
  const GaussianCloud cloud = read_gaussians(folder + "/table.splat");
  Camera camera = gaussian_camera(11, 9);
  camera.eye = {-0.45, 0.3, 0};
  for (const GaussianProfile profile : kProfiles) {
    expect_oracles_picture(cloud, camera, profile, 55);
  }
}

/// The bytes of pictures of all profiles.
std::vector<float> all_pictures(const GaussianCloud& cloud, const Camera& camera) {
  std::vector<float> values;
  for (const GaussianProfile profile : kAllProfiles) {
    for (const bool depth : {false, true}) {
      const Image image =
          GaussianRenderer(cloud, {.profile = profile, .depth = depth}).render(camera);
      values.insert(values.end(), image.data.begin(), image.data.end());
    }
  }
  return values;
}

TEST(GaussianRenderer, PicturesDependNeitherOnThreadsNorOnInstructions) {
  const GaussianCloud cloud = random_gaussians(6000, 11);
  const Camera camera = camera_before(cloud, 203, 121);
  const std::vector<float> one = all_pictures(cloud, camera);
  set_thread_count(1);
  EXPECT_TRUE(all_pictures(cloud, camera) == one);
  set_thread_count(0);
  const std::string before = instructions();
  for (const std::string& instructions : available_instructions()) {
    set_instructions(instructions);
    EXPECT_TRUE(all_pictures(cloud, camera) == one) << instructions;
  }
  set_instructions(before);
}

/// One round Gaussian on the axis of a camera, of a grey without harmonics.
GaussianCloud one_gaussian(double z, double scale, double amplitude) {
  GaussianCloud cloud;
  cloud.position = {Vec3f(0, 0, static_cast<float>(z))};
  cloud.scale = {Vec3f::Constant(static_cast<float>(scale))};
  cloud.rotation = {{1, 0, 0, 0}};
  cloud.amplitude = {static_cast<float>(amplitude)};
  cloud.harmonics = {0, 0, 0};
  return cloud;
}

Camera middle_camera(int size) {
  Camera camera;
  camera.width = camera.height = size;
  camera.focal_x = camera.focal_y = size;
  camera.center_x = camera.center_y = 0.5 * size;
  return camera;
}

double sum_of(const Image& image, int channel) {
  double sum = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) sum += image.pixel(x, y)[channel];
  }
  return sum;
}

TEST(GaussianRenderer, ExactKernelsKeepTheirMassWhenMinified) {
  // A Gaussian of a quarter of a pixel, whose opacity times its area is 0.8 2 pi / 16.
  const GaussianCloud cloud = one_gaussian(4, 4 * 0.25 / 64, 0.8);
  const double expected = 0.8 * 2 * M_PI / 16;
  const Camera camera = middle_camera(64);
  const double exact =
      sum_of(GaussianRenderer(cloud, {.profile = GaussianProfile::kExact}).render(camera), kAlpha);
  const double inria =
      sum_of(GaussianRenderer(cloud, {.profile = GaussianProfile::kInria}).render(camera), kAlpha);
  EXPECT_NEAR(exact, expected, 0.01 * expected);
  EXPECT_NEAR(inria, expected * (1 + 0.3 * 16), 0.05 * inria);
}

TEST(GaussianRenderer, OpticalDepthOfABall) {
  // Through the middle: density sigma sqrt(2 pi), all of it as the filter is small.
  const GaussianCloud cloud = [] {
    GaussianCloud made = one_gaussian(10, 1, 0.5);
    made.rule = AmplitudeRule::kDensity;
    return made;
  }();
  const Image image =
      GaussianRenderer(cloud, {.profile = GaussianProfile::kExact}).render(middle_camera(201));
  EXPECT_NEAR(image.pixel(100, 100)[kAlpha], 1 - std::exp(-0.5 * std::sqrt(2 * M_PI)), 1e-3);
}

/// A faint kernel is as good as linear, so that it does not matter when the filter is applied.
TEST(GaussianRenderer, SamplesAreFilteredAsAFaintKernelIs) {
  const GaussianCloud cloud = one_gaussian(4, 0.3, 0.02);
  Camera camera = middle_camera(97);
  camera.center_x = 12.3;  // The kernel reaches over the picture's border.
  for (const double lowpass : {0.1, 0.5477, 16.0}) {
    GaussianOptions options{
        .profile = GaussianProfile::kExact, .lowpass = lowpass, .samples = 1, .depth = true};
    const Image expected = GaussianRenderer(cloud, options).render(camera);
    for (const int samples : {2, 3, 4}) {
      options.samples = samples;
      const Image image = GaussianRenderer(cloud, options).render(camera);
      for (int y = 0; y < image.height; ++y) {
        // Filters reach less far at the border, where what is beyond it is unknown.
        for (int x = static_cast<int>(3 * lowpass) + 1; x < image.width; ++x) {
          const float* a = image.pixel(x, y);
          const float* b = expected.pixel(x, y);
          ASSERT_NEAR(a[kAlpha], b[kAlpha], 2e-4) << x << ' ' << y << ' ' << samples;
          ASSERT_NEAR(a[0], b[0], 2e-4);
          if (b[kAlpha] > 1e-3F) {
            ASSERT_NEAR(a[5], b[5], 0.02 * b[5]);
          }
        }
      }
    }
  }
}

/// What is left of the light by many kernels is a product: each kernel filtered by itself, an
/// opaque body would be larger by the filter.
TEST(GaussianRenderer, OpaqueBodiesOfFaintKernelsKeepTheirSize) {
  GaussianCloud cloud;
  constexpr int kCount = 400;
  for (int i = 0; i < kCount; ++i) {
    const GaussianCloud one = one_gaussian(4, 4 * 3.0 / 64, 0.1);  // 3 pixels.
    cloud.position.push_back(one.position[0]);
    cloud.scale.push_back(one.scale[0]);
    cloud.rotation.push_back(one.rotation[0]);
    cloud.amplitude.push_back(one.amplitude[0]);
    cloud.harmonics.insert(cloud.harmonics.end(), {0, 0, 0});
  }
  double area = 0;
  constexpr double kStep = 0.01;  // Pixels.
  for (double r = kStep / 2; r < 20; r += kStep) {
    const double left = std::pow(1 - 0.1 * std::exp(-r * r / (2 * 9)), kCount);
    area += 2 * M_PI * r * kStep * (1 - left);
  }
  const auto area_of = [&](int samples) {
    const Image image =
        GaussianRenderer(cloud, {.profile = GaussianProfile::kExact, .samples = samples})
            .render(middle_camera(64));
    return sum_of(image, kAlpha);
  };
  EXPECT_NEAR(area_of(3), area, 0.02 * area);
  EXPECT_GT(area_of(1), 1.04 * area);
}

TEST(GaussianRenderer, DepthsOfSamplesAreOfTheNearerHalf) {
  const GaussianCloud cloud = one_gaussian(4, 0.5, 0.9);
  for (const int samples : {1, 2, 4}) {
    const Image image = GaussianRenderer(cloud, {.profile = GaussianProfile::kExact,
                                                 .samples = samples,
                                                 .background = {1, 1, 1, 1},
                                                 .depth = true})
                            .render(middle_camera(65));
    EXPECT_NEAR(image.pixel(32, 32)[4], 4, 1e-2);
    EXPECT_NEAR(image.pixel(32, 32)[5], 4, 1e-2);
    EXPECT_EQ(image.pixel(32, 32)[kAlpha], 1);
    EXPECT_TRUE(std::isinf(image.pixel(0, 0)[4]));
    EXPECT_TRUE(std::isinf(image.pixel(0, 0)[5]));
  }
}

TEST(GaussianRenderer, ColorsBecomeLinearAndBackgroundsAreBlendedAsDisplaysDo) {
  const GaussianCloud cloud = one_gaussian(4, 1, 0.6);
  const Image image =
      GaussianRenderer(cloud, {.profile = GaussianProfile::kInria, .background = {1, 1, 1, 1}})
          .render(middle_camera(33));
  const float* middle = image.pixel(16, 16);
  EXPECT_NEAR(middle[0], srgb_to_linear(0.6F * 0.5F + 0.4F), 1e-5);
  EXPECT_FLOAT_EQ(middle[kAlpha], 1);
  const Image clear =
      GaussianRenderer(cloud, {.profile = GaussianProfile::kInria}).render(middle_camera(33));
  EXPECT_NEAR(clear.pixel(16, 16)[0], 0.6F * srgb_to_linear(0.5F), 1e-5);
}

TEST(GaussianRenderer, WhatCannotBeDrawnIsRefused) {
  GaussianCloud cloud = one_gaussian(4, 1, 0.6);
  for (const double lowpass : {0.0, 0.09, 16.1, std::nan("")}) {
    EXPECT_THROW(GaussianRenderer(cloud, {.lowpass = lowpass}), Error);
  }
  EXPECT_THROW(GaussianRenderer(cloud, {.samples = kMostSamples + 1}), Error);
  Camera large = middle_camera(16);
  large.width = Camera::kMostSide / 2 + 1;
  EXPECT_THROW(GaussianRenderer(cloud, {.samples = 2}).render(large), Error);
  EXPECT_THROW(GaussianRenderer(cloud, {.background = {0, 0, 0, 2}}), Error);
  cloud.rule = AmplitudeRule::kDensity;
  EXPECT_THROW(GaussianRenderer(cloud, {.profile = GaussianProfile::kMip}), Error);
  EXPECT_THROW(GaussianRenderer(cloud, {.profile = GaussianProfile::kSurfel}), Error);
  EXPECT_EQ(profile_of(cloud), GaussianProfile::kExact);
  cloud.rule = AmplitudeRule::kSurfel;
  EXPECT_THROW(GaussianRenderer(cloud, {.profile = GaussianProfile::kExact}), Error);
  EXPECT_EQ(profile_of(cloud), GaussianProfile::kSurfel);
}

TEST(GaussianRenderer, ExtremeGaussiansLeaveNoNumbersThatAreNone) {
  GaussianCloud cloud;
  cloud.degree = 0;
  for (const float z : {-1.0F, 0.0F, 1e-30F, 0.21F, 1.0F, 1e9F, 1e30F}) {
    for (const float scale : {0.0F, 1e-30F, 1.0F, 1e15F, 1e30F}) {
      cloud.position.push_back(Vec3f(z * 0.1F, 0.01F, z));
      cloud.scale.push_back(Vec3f(scale, scale * 0.5F, 0));
      cloud.rotation.push_back({0.5F, 0.5F, 0.5F, 0.5F});
      cloud.amplitude.push_back(0.5F);
      cloud.harmonics.insert(cloud.harmonics.end(), {0.1F, 0.2F, 0.3F});
    }
  }
  for (const GaussianProfile profile : kAllProfiles) {
    const Image image = GaussianRenderer(cloud, {.profile = profile}).render(middle_camera(40));
    for (const float value : image.data) ASSERT_TRUE(std::isfinite(value)) << name(profile);
  }
}

TEST(GaussianRenderer, NothingIsAnEmptyPicture) {
  const Image image = GaussianRenderer(GaussianCloud(), {}).render(middle_camera(20));
  EXPECT_EQ(sum_of(image, kAlpha), 0);
}

}  // namespace
}  // namespace surfel::test
