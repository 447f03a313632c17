#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/random.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr double kOneInByte = 1 / 255.0;

TEST(Transparency, StackedPlanesMatchTheExactComposite) {
  for (const int layers : {1, 2, 3, 5, 8}) {
    for (int k = 1; k <= layers; ++k) {
      const Stack stack = stacked_planes(k);
      RenderOptions options;
      options.layers = layers;
      FrameStatistics statistics;
      const Image image = render_unlit(stack.cloud, camera_at(2.5, 96), options, &statistics);
      EXPECT_LT(worst_error(image, stack.expected), kOneInByte) << k << " planes, " << layers;
      EXPECT_EQ(statistics.merged, 0);
    }
  }
}

TEST(Transparency, MoreSurfacesThanLayersAreMergedAndReported) {
  RenderOptions options;
  options.layers = 3;
  for (const int k : {4, 6, 9}) {
    const Stack stack = stacked_planes(k);
    FrameStatistics statistics;
    const Image image = render_unlit(stack.cloud, camera_at(2.5, 96), options, &statistics);
    EXPECT_GT(statistics.merged, 0);
    // Planes arrive front to back, so that what is merged is complete: the error stays small.
    EXPECT_LT(worst_error(image, stack.expected), 3 * kOneInByte) << k;
    EXPECT_LT(statistics.late_weight_share, 0.01);
  }
}

/// How many pixels two panes that cross at 60 degrees take for one surface, which is less opaque
/// than two. Their normals vary by up to `roughness` radians.
int mixed_pixels(float roughness) {
  SurfelCloud cloud;
  for (const float turn : {0.5236F, -0.5236F}) {
    const SurfelCloud pane = jittered_plane(64, 1.5, 0.25, turn > 0 ? 1 : 2);
    const Eigen::AngleAxisf rotation(turn, Vec3f::UnitY());
    for (std::size_t i = 0; i < pane.size(); ++i) {
      const auto tilt = static_cast<float>(2 * random_uniform(7, i) - 1) * roughness;
      const Vec3f normal = Eigen::AngleAxisf(tilt, Vec3f::UnitX()) * pane.normal[i];
      add_surfel(cloud, rotation * pane.position[i], rotation * normal, pane.variance[i],
                 pane.area[i], {1, 1, 1});
    }
  }
  cloud.alpha.assign(cloud.size(), 0.5F);
  const Image image = render_unlit(cloud, camera_at(3, 96, 20));
  int pixels = 0;
  for (int y = 24; y < 72; ++y) {
    for (int x = 0; x < 96; ++x) pixels += image.pixel(x, y)[3] < 0.65F ? 1 : 0;
  }
  return pixels;
}

TEST(Transparency, FlatPanesThatCrossAreMixedInANarrowerStripThanRoughOnes) {
  const int rough = mixed_pixels(0.2F);
  EXPECT_GT(rough, 0);
  EXPECT_LT(mixed_pixels(0), 0.7 * rough);
}

TEST(Transparency, SlantedStackKeepsItsOrder) {
  Stack stack = stacked_planes(3);
  const Eigen::AngleAxisf turn(0.9F, Vec3f(0.3F, 1, 0).normalized());
  for (std::size_t i = 0; i < stack.cloud.size(); ++i) {
    stack.cloud.position[i] = turn * stack.cloud.position[i];
    stack.cloud.normal[i] = turn * stack.cloud.normal[i];
  }
  const Image image = render_unlit(stack.cloud, camera_at(4, 64, 12));
  EXPECT_LT(worst_error(image, stack.expected), kOneInByte);
}

TEST(Transparency, SmallSplatsThatAreSummedUpFirstGiveTheSumsOfSplatAfterSplat) {
  // Opaque splats are added one after the other; small transparent ones are summed up as sheets.
  SurfelCloud cloud = jittered_plane(220, 0.9, 0.3);
  const Eigen::AngleAxisf turn(0.7F, Vec3f(0.4F, 1, 0).normalized());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i] = turn * cloud.position[i];
    cloud.normal[i] = turn * cloud.normal[i];
  }
  const Camera camera = camera_at(3, 110);
  const Image opaque = render_unlit(cloud, camera);
  cloud.alpha.assign(cloud.size(), 0.5F);
  const Image transparent = render_unlit(cloud, camera);
  for (int y = 40; y < 70; ++y) {
    for (int x = 40; x < 70; ++x) {
      for (int c = 0; c < 4; ++c) {
        ASSERT_NEAR(transparent.pixel(x, y)[c], 0.5F * opaque.pixel(x, y)[c], 1e-5F)
            << x << ' ' << y << ' ' << c;
      }
    }
  }
}

TEST(Transparency, SurfacesOfSmallSplatsAreComposited) {
  // Planes that lie five pixels one behind the other, each of splats far below a pixel.
  constexpr int kPlanes = 4;
  const Eigen::AngleAxisf turn(0.7F, Vec3f(0.4F, 1, 0).normalized());
  SurfelCloud cloud;
  for (int k = 0; k < kPlanes; ++k) {
    const SurfelCloud plane = jittered_plane(220, 0.9, 0.3, k + 1);
    for (std::size_t i = 0; i < plane.size(); ++i) {
      const Vec3f offset(0, 0, 0.1F * static_cast<float>(k));
      add_surfel(cloud, turn * (plane.position[i] + offset), turn * plane.normal[i],
                 plane.variance[i], plane.area[i], {1, 1, 1});
    }
  }
  cloud.alpha.assign(cloud.size(), 0.3F);
  const double expected = 1 - std::pow(0.7, kPlanes);
  for (const int layers : {3, 8}) {
    RenderOptions options;
    options.layers = layers;
    const Image image = render_unlit(cloud, camera_at(3, 110), options);
    for (int y = 45; y < 65; ++y) {
      for (int x = 45; x < 65; ++x) {
        ASSERT_NEAR(image.pixel(x, y)[3], expected, 2 * kOneInByte)
            << layers << ' ' << x << ' ' << y;
      }
    }
  }
}

TEST(Transparency, SheetsAreToldApartWhateverTheCutoff) {
  // Discs of radius 0.18, which cut off at 4 reach 0.35; sheets 0.25 apart.
  const SurfelCloud near = jittered_plane(24, 1.5, 0.25, 1);
  const SurfelCloud far = jittered_plane(24, 1.5, 0.25, 2, -0.25);
  SurfelCloud cloud;
  for (const SurfelCloud* sheet : {&near, &far}) {
    for (std::size_t i = 0; i < sheet->size(); ++i) {
      add_surfel(cloud, sheet->position[i], sheet->normal[i], sheet->variance[i], sheet->area[i],
                 {1, 1, 1});
    }
  }
  cloud.alpha.assign(cloud.size(), 0.5F);
  for (const double cutoff : {1.0, 4.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    const Image image = render_unlit(cloud, camera_at(2.5, 96, 20), options);
    EXPECT_LT(worst_error(image, {0.75F, 0.75F, 0.75F, 0.75F}), kOneInByte) << cutoff;
  }
}

TEST(Transparency, BackgroundShowsThroughByItsAlpha) {
  const Stack stack = stacked_planes(1);
  RenderOptions options;
  options.background = {1, 0.5F, 0, 1};
  const Image image = render_unlit(stack.cloud, camera_at(2.5, 96), options);
  Rgba expected = stack.expected;
  expected.composite({1, 0.5F, 0, 1});
  EXPECT_LT(worst_error(image, expected), kOneInByte);
}

TEST(Transparency, OppositeSidesOfAThinSheetAreNotMixed) {
  // Red faces the eye, green faces away, closer than the depth threshold.
  SurfelCloud cloud = jittered_plane(48, 1.5, 0.25, 1);
  const SurfelCloud back = jittered_plane(48, 1.5, 0.25, 2, -1e-4);
  for (Vec3f& c : cloud.coefficient) c = {1, 0, 0};
  for (std::size_t i = 0; i < back.size(); ++i) {
    add_surfel(cloud, back.position[i], -back.normal[i], back.variance[i], back.area[i], {0, 1, 0});
  }
  const Image image = render_unlit(cloud, camera_at(2.5, 96));
  EXPECT_LT(worst_error(image, {1, 0, 0, 1}), 1e-5);
}

/// A shell round a sphere that nobody sees leaves the picture of the sphere as it is, edges, depths
/// and normals included.
TEST(Transparency, InvisibleSurfelsAreAsIfTheyWereNotThere) {
  const SurfelCloud sphere = fibonacci_sphere(4000, 0.6);
  const SurfelCloud shell = fibonacci_sphere(6000, 0.8);
  SurfelCloud both = sphere;
  both.alpha.assign(sphere.size(), 1.0F);
  for (std::size_t i = 0; i < shell.size(); ++i) {
    add_surfel(both, shell.position[i], shell.normal[i], shell.variance[i], shell.area[i],
               {0, 1, 0});
    both.alpha.push_back(0);
  }
  const Image alone = render_unlit(sphere, camera_at(2.5, 96));
  const Image image = render_unlit(both, camera_at(2.5, 96));
  // The order of splats, and so rounding, depends on the box of all surfels; opacities at edges
  // have steps of 1 / 4096.
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int c = 0; c < image.channel_count(); ++c) {
        const float a = alone.pixel(x, y)[c];
        const float b = image.pixel(x, y)[c];
        if (a == b) continue;
        EXPECT_NEAR(a, b, 5e-4 * (1 + std::abs(a))) << x << ' ' << y << ' ' << c;
      }
    }
  }
  // A cloud of nothing else is an empty picture.
  SurfelCloud nothing = shell;
  nothing.alpha.assign(nothing.size(), 0.0F);
  EXPECT_EQ(render_unlit(nothing, camera_at(2.5, 96)).pixel(48, 48)[3], 0);
}

TEST(Transparency, CompositingIsAssociative) {
  const Rgba a{0.1F, 0.2F, 0.1F, 0.3F};
  const Rgba b{0.3F, 0.0F, 0.2F, 0.5F};
  const Rgba c{0.2F, 0.6F, 0.1F, 0.8F};
  Rgba left = a;
  left.composite(b);
  left.composite(c);
  Rgba bc = b;
  bc.composite(c);
  Rgba right = a;
  right.composite(bc);
  EXPECT_NEAR(left.red, right.red, 1e-6);
  EXPECT_NEAR(left.green, right.green, 1e-6);
  EXPECT_NEAR(left.alpha, right.alpha, 1e-6);
}

}  // namespace
}  // namespace surfel::test
