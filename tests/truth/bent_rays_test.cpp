#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/truth/bent_rays.h>

#include "render/environments.h"
#include "render/scenes.h"

namespace surfel {
namespace {

/// The unit ball about the origin, of the scene's first material.
std::optional<MetSurface> ball(const Vec3f& origin, const Vec3f& direction, float from) {
  const float middle = -origin.dot(direction);
  const float half2 = 1 - (origin + middle * direction).squaredNorm();
  if (half2 < 0) return std::nullopt;
  for (const float t : {middle - std::sqrt(half2), middle + std::sqrt(half2)}) {
    if (t < from) continue;
    const Vec3f normal = origin + t * direction;
    const bool front = normal.dot(direction) < 0;
    return MetSurface{t, {1, 1, 1, 1}, front ? normal : Vec3f(-normal), 0, front};
  }
  return std::nullopt;
}

/// A scene of one clear material.
Scene glass(float ior, Environment environment) {
  Scene scene;
  scene.materials[0].opacity = 0;
  scene.materials[0].ior = ior;
  scene.environment = std::move(environment);
  return scene;
}

/// Radiance from `origin` on along `direction`.
Rgba trace(const Scene& scene, int bounces, const Vec3f& origin, const Vec3f& direction) {
  const Shader shader(&scene, test::camera_at(3, 16));
  const auto nearest = [](const Vec3f& from, const Vec3f& along, float least) {
    return ball(from, along, least);
  };
  return BentRays{scene, shader, Vec3f(0, 0, 3), 1e-4F, bounces}.trace(nearest, origin,
                                                                       direction.normalized(), 0);
}

/// Radiance along -z, `away` from the ball's centre.
Rgba trace_beside(const Scene& scene, int bounces, float away) {
  return trace(scene, bounces, {away, 0, 3}, {0, 0, -1});
}

void expect_color(const Rgba& seen, const Vec3f& color, float tolerance) {
  EXPECT_NEAR(seen.red, color.x(), tolerance);
  EXPECT_NEAR(seen.green, color.y(), tolerance);
  EXPECT_NEAR(seen.blue, color.z(), tolerance);
  EXPECT_EQ(seen.alpha, 1);
}

/// Where a ray along -z at this distance from the ball's axis leaves to: twice theta_I - theta_T
/// towards the axis.
Vec3f behind_ball(double away, double ior) {
  const double turn = 2 * (std::asin(away) - std::asin(away / ior));
  return test::direction_color({-std::sin(turn), 0, -std::cos(turn)});
}

// The environment's texels are 0.7 degrees wide, which its colours tell to 0.006.
TEST(BentRays, BallTurnsRaysAsTheClosedFormSays) {
  const Scene scene = glass(1.5F, test::direction_environment());
  for (int i = 0; i < 20; ++i) {
    const float away = 0.05F * static_cast<float>(i);
    SCOPED_TRACE(away);
    expect_color(trace_beside(scene, 2, away), behind_ball(away, 1.5), 0.01F);
  }
}

TEST(BentRays, IndexOneIsNotSeen) {
  const Scene scene = glass(1, test::direction_environment());
  for (const float away : {0.0F, 0.5F, 0.9F}) {
    expect_color(trace_beside(scene, 4, away), test::direction_color({0, 0, -1}), 0.01F);
  }
}

/// Reflection and refraction share the light: where it comes from everywhere alike, glass shows no
/// less and no more of it, from outside and from inside, however often rays are parted.
TEST(BentRays, GlassKeepsAllLight) {
  Scene scene = glass(1.5F, test::uniform_environment({0.5F, 1, 2}));
  scene.materials[0].reflectivity = {0.04F, 0.04F, 0.04F};
  for (const int bounces : {1, 2, 5, 32}) {
    for (const float away : {0.0F, 0.3F, 0.7F, 0.99F}) {
      expect_color(trace_beside(scene, bounces, away), {0.5F, 1, 2}, 1e-4F);
      expect_color(trace(scene, bounces, {away, 0, 0}, {0.2F, 1, 0.1F}), {0.5F, 1, 2}, 1e-4F);
    }
  }
}

/// From 0.9 radii off the centre a ray across meets the surface beyond the critical angle, again
/// and again: it never leaves, and after the last bounce it shows the direction that it has then.
TEST(BentRays, TotalReflectionTurnsByTwiceTheAngle) {
  const Scene scene = glass(1.5F, test::direction_environment());
  const double angle = std::asin(0.9);
  for (int bounces = 1; bounces <= 4; ++bounces) {
    const double turn = bounces * (std::numbers::pi - 2 * angle);
    expect_color(trace(scene, bounces, {0.9F, 0, 0}, {0, 0, -1}),
                 test::direction_color({-std::sin(turn), 0, -std::cos(turn)}), 0.01F);
  }
}

TEST(BentRays, EveryLayerAbsorbs) {
  Scene scene = glass(1.5F, test::uniform_environment({1, 1, 1}));
  scene.materials[0].absorption = {0.5F, 0.1F, 0};
  expect_color(trace_beside(scene, 8, 0.4F), {0.25F, 0.81F, 1}, 1e-5F);
  expect_color(trace(scene, 8, {0, 0, 0}, {0, 0, -1}), {0.5F, 0.9F, 1}, 1e-5F);
}

TEST(BentRays, DispersionGivesEachChannelItsOwnIndex) {
  Scene scene = glass(1.5F, test::direction_environment());
  scene.materials[0].dispersion = 0.2F;
  const Rgba seen = trace_beside(scene, 2, 0.7F);
  EXPECT_NEAR(seen.red, behind_ball(0.7F, 1.35).x(), 0.01F);
  EXPECT_NEAR(seen.green, behind_ball(0.7F, 1.5).y(), 0.01F);
  EXPECT_NEAR(seen.blue, behind_ball(0.7F, 1.65).z(), 0.01F);
}

/// Coloured panes let through straight ahead what they do not hide: as compositing says.
TEST(BentRays, SurfacesWithoutIndexAreComposited) {
  Scene scene = glass(1.5F, test::uniform_environment({1, 1, 1}));
  scene.materials[0].ior.reset();
  scene.materials[0].opacity = 0.25F;
  scene.ambient = {1, 0.5F, 0};
  scene.lights.clear();
  const float left = 0.75F * 0.75F;
  expect_color(trace_beside(scene, 2, 0.5F), {1, left + 0.5F * (1 - left), left}, 1e-5F);
  scene.environment->visible = false;
  EXPECT_NEAR(trace_beside(scene, 2, 0.5F).alpha, 1 - left, 1e-5F);
  EXPECT_EQ(trace_beside(scene, 2, 1.5F).alpha, 0);
}

TEST(BentRays, MirrorsOutsideShowTheMirroredDirection) {
  Scene scene = glass(1.5F, test::direction_environment());
  scene.materials[0].ior.reset();
  scene.materials[0].opacity = 1;
  scene.materials[0].reflectivity = {1, 1, 1};
  const double angle = std::asin(0.6);
  expect_color(trace_beside(scene, 4, 0.6F),
               test::direction_color({std::sin(2 * angle), 0, std::cos(2 * angle)}), 0.01F);
}

}  // namespace
}  // namespace surfel
