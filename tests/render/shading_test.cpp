#include <bit>
#include <cmath>
#include <cstring>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/shading.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/source_ewa.h>

#include "render/environments.h"
#include "render/scenes.h"

namespace surfel::test {
namespace {

/// A surface that covers its pixel, of alpha 0 where its material is all that is to be seen.
Fragment fragment(const Vec3f& normal, float alpha = 1, std::uint32_t material = 0) {
  Fragment f{};
  f.channel[kWeight] = 1;
  f.channel[kDepth] = -4;
  for (const int c : {kRed, kGreen, kBlue}) f.channel[c] = 0.5F * alpha;
  f.channel[kAlpha] = alpha;
  f.channel[kTag] = std::bit_cast<float>(kFrontTag | material << kMaterialShift);
  for (int k = 0; k < 3; ++k) f.channel[kNormalX + k] = normal[k];
  return f;
}

/// Tilted away from the viewer at +z by an angle, towards +x.
Vec3f tilted(double degrees) {
  const double angle = degrees * M_PI / 180;
  return Vec3d(std::sin(angle), 0, std::cos(angle)).cast<float>();
}

Scene scene_of(const Material& material, Environment environment) {
  Scene scene;
  scene.materials = {material};
  scene.environment = std::move(environment);
  return scene;
}

Material glass(float ior, float dispersion = 0) {
  Material m;
  m.opacity = 0;
  m.ior = ior;
  m.reflectivity = Vec3f::Constant(std::pow((ior - 1) / (ior + 1), 2.0F));
  m.dispersion = dispersion;
  return m;
}

Material mirror() {
  Material m;
  m.reflectivity = {1, 1, 1};
  return m;
}

/// Direction that a colour of direction_environment() stands for.
Vec3f direction_of(const Vec3f& color) { return 2 * color - Vec3f::Ones(); }

TEST(Fresnel, DielectricsAtKnownAngles) {
  for (const float ior : {1.33F, 1.5F, 2.4F}) {
    const float r = std::pow((ior - 1) / (ior + 1), 2.0F);
    const Vec3f normal = Vec3f::Constant(r);
    EXPECT_NEAR(fresnel_reflectance(normal, ior, 1).x(), r, 1e-6F);
    EXPECT_NEAR(fresnel_reflectance(normal, ior, 0).x(), 1, 1e-6F);
    // Brewster's angle, tan = ior: only the perpendicular polarisation is reflected.
    const float brewster = 1 / std::sqrt(1 + ior * ior);
    const float perpendicular = (1 - ior * ior) / (1 + ior * ior);
    EXPECT_NEAR(fresnel_reflectance(normal, ior, brewster).x(), perpendicular * perpendicular / 2,
                1e-5F);
    // From inside, where Snell's law asks for a sine beyond 1.
    const float critical = std::sqrt(1 - 1 / (ior * ior));
    EXPECT_LT(fresnel_reflectance(normal, 1 / ior, critical + 0.02F).x(), 0.9F);
    EXPECT_EQ(fresnel_reflectance(normal, 1 / ior, critical - 0.001F).x(), 1);
  }
}

TEST(Fresnel, SchlickWithoutAnIorAndNothingWithoutReflectivity) {
  const Vec3f gold(1, 0.7F, 0);
  EXPECT_EQ(fresnel_reflectance(gold, std::nullopt, 1), gold);
  EXPECT_EQ(fresnel_reflectance(gold, std::nullopt, 0), Vec3f(1, 1, 0));
  EXPECT_NEAR(fresnel_reflectance(gold, std::nullopt, 0.5F).y(), 0.7 + 0.3 / 32, 1e-6);
  EXPECT_EQ(fresnel_reflectance({0, 0, 0}, 1.5F, 0), Vec3f(0, 0, 0));
}

TEST(Refract, FollowsSnellOncePerLayer) {
  const Vec3f to_eye(0, 0, 1);
  for (const float ior : {1.1F, 1.5F, 0.9F}) {
    for (const double degrees : {0.0, 10.0, 30.0, 45.0}) {
      for (const float layers : {1.0F, 2.5F, 3.0F}) {
        const Vec3f normal = tilted(degrees);
        const RefractedRay ray = refract(to_eye, normal, ior, layers);
        const double sine = std::sin(degrees * M_PI / 180);
        const double refracted = std::pow(1 / static_cast<double>(ior), layers) * sine;
        ASSERT_LT(refracted, 1);
        EXPECT_NEAR(ray.direction.norm(), 1, 1e-6);
        EXPECT_NEAR(normal.cross(-ray.direction).norm(), refracted, 2e-6);
        EXPECT_LT(normal.dot(ray.direction), 0);
        EXPECT_NEAR(ray.direction.y(), 0, 1e-7);  // Stays in the plane of incidence.
        // A denser body turns the ray against the normal, -normal.x() being the side of it.
        if (degrees > 0) {
          EXPECT_EQ(ray.direction.x() < 0, ior > 1);
        }
      }
    }
  }
  EXPECT_LT((refract(to_eye, tilted(70), 1, 3).direction + to_eye).norm(), 1e-6);
}

TEST(Refract, TotalReflectionMirrors) {
  const Vec3f normal = tilted(50);
  const RefractedRay ray = refract({0, 0, 1}, normal, 0.7F, 1);
  EXPECT_LT((ray.direction - tilted(100)).norm(), 1e-6);
  // One layer passes at 40 degrees, three are too many.
  EXPECT_LT(refract({0, 0, 1}, tilted(40), 0.7F, 1).direction.z(), 0);
  EXPECT_LT((refract({0, 0, 1}, tilted(40), 0.7F, 3).direction - tilted(80)).norm(), 1e-6);
}

TEST(Refract, TurnsAsItsDerivativesSay) {
  constexpr double kStep = 0.2;  // Degrees.
  const auto angle = [](const Vec3f& a) { return std::atan2(a.x(), -a.z()) * 180 / M_PI; };
  for (const double degrees : {5.0, 30.0, 60.0}) {
    for (const float ior : {1.2F, 1.6F}) {
      const RefractedRay ray = refract({0, 0, 1}, tilted(degrees), ior, 1);
      const double by_normal =
          (angle(refract({0, 0, 1}, tilted(degrees + kStep), ior, 1).direction) -
           angle(refract({0, 0, 1}, tilted(degrees - kStep), ior, 1).direction)) /
          (2 * kStep);
      EXPECT_NEAR(std::abs(by_normal), ray.by_normal, 2e-3);
      const double by_direction =
          (angle(refract(tilted(kStep), tilted(degrees), ior, 1).direction) -
           angle(refract(tilted(-kStep), tilted(degrees), ior, 1).direction)) /
          (2 * kStep);
      EXPECT_NEAR(std::abs(by_direction), ray.by_direction, 2e-3);
    }
  }
}

/// In a furnace, light the same from everywhere, nothing that keeps all light can be seen.
TEST(Shader, WhatKeepsAllLightVanishesInAFurnace) {
  const Vec3f light(0.5F, 1, 2);
  Material tinted = glass(1.5F, 0.2F);
  tinted.roughness = 0.6F;
  for (const Material& material : {mirror(), glass(1.5F), glass(0.8F), tinted}) {
    const Scene scene = scene_of(material, uniform_environment(light));
    for (const Camera& camera : {square_camera(64), camera_at(3, 64)}) {
      const Shader shader(&scene, camera, 1);
      for (const double degrees : {0.0, 20.0, 60.0, 89.0, 90.0}) {
        for (const float coverage : {1.0F, 0.3F}) {
          const Fragment f = fragment(tilted(degrees), material.opacity);
          Rgba color = shader.shade(f, 20, 40, 1 / coverage);
          SeenThrough surfaces;
          surfaces.add(f, 2, coverage, color.alpha);
          shader.add_environment(color, surfaces, 20, 40);
          EXPECT_LT((Vec3f(color.red, color.green, color.blue) - light).norm(), 1e-5F);
          EXPECT_NEAR(color.alpha, 1, 1e-6F);
        }
      }
    }
  }
}

TEST(Renderers, WhatKeepsAllLightVanishesInAFurnace) {
  const Vec3f light(0.5F, 1, 2);
  const SurfelCloud cloud = fibonacci_sphere(400, 0.8);
  RenderCloud surfels(cloud);
  const Camera camera = camera_at(3, 24);
  for (const Material& material : {mirror(), glass(1.5F, 0.1F)}) {
    const Scene scene = scene_of(material, uniform_environment(light));
    RenderOptions options;
    options.layers = 2;
    const Image images[] = {
        Renderer(surfels, scene, options).render(camera),
        ReferenceRenderer(surfels, scene, options, {.samples = 1}).render(camera),
        SourceEwaRenderer(surfels, scene, options).render(camera)};
    for (const Image& image : images) {
      for (int i = 0; i < 24 * 24; ++i) {
        const float* p = image.pixel(i % 24, i / 24);
        EXPECT_LT((Eigen::Map<const Vec3f>(p) - light).norm(), 1e-4F);
        EXPECT_NEAR(p[3], 1, 1e-5F);
      }
    }
  }
}

TEST(Renderers, MirrorSphereShowsTheReflectedDirections) {
  constexpr int kSize = 64;
  const SurfelCloud cloud = fibonacci_sphere(8000, 0.9);
  RenderCloud surfels(cloud);
  const Scene scene = scene_of(mirror(), direction_environment());
  const Image fast = Renderer(surfels, scene, {}).render(square_camera(kSize));
  const Image truth =
      ReferenceRenderer(surfels, scene, {}, {.samples = 4}).render(square_camera(kSize));
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const double nx = ((x + 0.5) / kSize * 2 - 1) / 0.9;
      const double ny = (1 - (y + 0.5) / kSize * 2) / 0.9;
      if (nx * nx + ny * ny > 0.7 * 0.7) continue;
      // Of the view to +z about n: 2 n_z n - z.
      const double nz = std::sqrt(1 - nx * nx - ny * ny);
      const Vec3f expected(Vec3d(2 * nz * nx, 2 * nz * ny, 2 * nz * nz - 1).cast<float>());
      for (const Image* image : {&fast, &truth}) {
        const Vec3f seen = direction_of(Eigen::Map<const Vec3f>(image->pixel(x, y)));
        EXPECT_LT((seen - expected).norm(), 0.05F) << x << ' ' << y;
      }
    }
  }
}

TEST(Shader, SeesTheRefractedDirectionBehind) {
  Scene scene = scene_of(glass(1.5F), direction_environment());
  const Shader shader(&scene, square_camera(64));
  for (const double degrees : {0.0, 15.0, 40.0, 70.0}) {
    const Vec3f normal = tilted(degrees);
    const Fragment f = fragment(normal, 0);
    for (const int layers : {1, 3}) {
      const Vec3f expected = refract({0, 0, 1}, normal, 1.5F, static_cast<float>(layers)).direction;
      EXPECT_LT((direction_of(shader.behind(f, 32, 32, layers)) - expected).norm(), 0.01F);
    }
  }
  const Fragment f = fragment(tilted(40), 0);
  EXPECT_GT((shader.behind(f, 32, 32, 1) - shader.behind(f, 32, 32, 3)).norm(), 0.1F);
  scene.refraction = Refraction::kSingle;
  EXPECT_EQ(shader.behind(f, 32, 32, 1), shader.behind(f, 32, 32, 3));

  scene.materials[0].ior.reset();
  EXPECT_LT((direction_of(shader.behind(f, 32, 32, 3)) - Vec3f(0, 0, -1)).norm(), 0.01F);
  const Scene nowhere;
  EXPECT_TRUE(Shader(&nowhere, square_camera(64)).behind(f, 32, 32, 1).isZero());
}

TEST(Shader, DispersionGivesEachColourItsOwnIor) {
  const Fragment f = fragment(tilted(45), 0);
  const auto behind = [&](float ior, float dispersion) -> Vec3f {
    const Scene scene = scene_of(glass(ior, dispersion), direction_environment());
    return Shader(&scene, square_camera(64)).behind(f, 32, 32, 1);
  };
  const Vec3f spread = behind(1.6F, 0.25F);
  EXPECT_EQ(spread.x(), behind(1.6F * 0.875F, 0).x());
  EXPECT_EQ(spread.y(), behind(1.6F, 0).y());
  EXPECT_EQ(spread.z(), behind(1.6F * 1.125F, 0).z());
  EXPECT_LT((behind(1.6F, 1e-6F) - behind(1.6F, 0)).norm(), 1e-5F);
}

TEST(Shader, LayersAbsorbByEquation11) {
  Material material = glass(1);
  material.absorption = {0, 0.25F, 1};
  const Scene scene = scene_of(material, uniform_environment({1, 1, 1}));
  const Vec3f seen = Shader(&scene, square_camera(64)).behind(fragment({0, 0, 1}, 0), 9, 9, 3);
  EXPECT_LT((seen - Vec3f(1, 0.421875F, 0)).norm(), 1e-5F);
}

TEST(Shader, TurnsTheEnvironmentAboutTheUpAxis) {
  Environment environment = direction_environment();
  environment.rotation = 90;
  environment.intensity = 2;
  const Scene scene = scene_of(mirror(), environment);
  // Facing the eye at +z: what the map has at -x has been turned there, and is twice as bright.
  const Rgba seen = Shader(&scene, square_camera(64)).shade(fragment({0, 0, 1}), 32, 32, 1);
  EXPECT_LT((direction_of(Vec3f(seen.red, seen.green, seen.blue) / 2) - Vec3f(-1, 0, 0)).norm(),
            0.01F);
}

TEST(Shader, RoughnessAndBentNormalsBlur) {
  // Light from +z alone, a hemisphere of it.
  Environment environment;
  environment.map = std::make_shared<const EnvironmentMap>(
      lat_long_image(64, [](const Vec3d& d) -> Vec3f { return Vec3f::Constant(d.z() > 0); }),
      "map");
  const auto seen = [&](float roughness, float normal_length) {
    Material material = mirror();
    material.roughness = roughness;
    const Scene scene = scene_of(material, environment);
    return Shader(&scene, square_camera(64))
        .shade(fragment(normal_length * tilted(40)), 32, 32, 1)
        .red;
  };
  EXPECT_NEAR(seen(0, 1), 1, 1e-5F);
  EXPECT_GT(seen(0.3F, 1), seen(0.7F, 1));
  EXPECT_GT(seen(0.7F, 1), 0.5F);
  // Normals of variance alpha^2 / 2 are what microfacets of width alpha = roughness^2 are.
  const float alpha = 0.5F * 0.5F;
  EXPECT_NEAR(seen(0, std::exp(-alpha * alpha / 2)), seen(0.5F, 1), 1e-5F);
}

/// A surface lit by one light from the viewer's side, 30 degrees off, seen from +z.
Scene scene_with_highlight(float shininess) {
  Scene scene;
  scene.ambient = {0, 0, 0};
  scene.lights = {{Light::Type::kDirectional, -tilted(30).cast<double>(), {1, 1, 1}}};
  scene.materials[0].specular = {1, 1, 1};
  scene.materials[0].shininess = shininess;
  return scene;
}

/// A surface sees (1 + cos) / 2 of the sky, whatever the camera and however long `up` is.
TEST(Shader, SkyAndGroundShareASurfaceByItsTilt) {
  Scene scene;
  scene.ambient = {0, 0, 0};
  scene.lights.clear();
  scene.sky = Sky{Vec3d(0, 0, 5), {0.8F, 0.6F, 0.4F}, {0.1F, 0.2F, 0.3F}};
  for (const bool mapped : {false, true}) {
    const Shader shader(&scene, square_camera(64), 0, mapped);
    for (const double angle : {0.0, 30.0, 80.0}) {
      const double sky = 0.5 + 0.5 * std::cos(angle * M_PI / 180);
      const Rgba seen = shader.shade(fragment(tilted(angle)), 32, 32, 1);
      EXPECT_NEAR(2 * seen.red, 0.1 + 0.7 * sky, 1e-5) << angle;
      EXPECT_NEAR(2 * seen.blue, 0.3 + 0.1 * sky, 1e-5) << angle;
    }
  }
  scene.sky->up = Vec3d(0, 0, -1);
  EXPECT_NEAR(Shader(&scene, square_camera(64)).shade(fragment(tilted(0)), 32, 32, 1).red, 0.05,
              1e-5);
}

/// White surfaces of any tilt stay below 1 in the light that nobody chose, and grey does what it is
/// called.
TEST(Shader, TheDefaultLightSaturatesNothing) {
  Scene scene = default_scene();
  scene.sky->up = Vec3d(0, 1, 0);
  const Shader shader(&scene, square_camera(64));
  float most = 0;
  for (double turn = 0; turn < 360; turn += 10) {
    for (double angle = 0; angle < 90; angle += 5) {
      const Vec3f n =
          Eigen::AngleAxisf(static_cast<float>(turn * M_PI / 180), Vec3f::UnitZ()) * tilted(angle);
      const Rgba seen = shader.shade(fragment(n), 32, 32, 1);
      most = std::max({most, 2 * seen.red, 2 * seen.green, 2 * seen.blue});
    }
  }
  EXPECT_LT(most, 1);
  EXPECT_GT(most, 0.85F);
  const float facing = 2 * shader.shade(fragment(tilted(0)), 32, 32, 1).green;
  EXPECT_GT(facing * SurfelCloud::colorless().y(), 0.3F);
  EXPECT_LT(facing * SurfelCloud::colorless().y(), 0.5F);
}

TEST(Shader, MappedNormalsOfUnitLengthAreLitAsOthers) {
  const Scene scene = scene_with_highlight(20);
  for (const double angle : {0.0, 20.0, 60.0}) {
    const auto seen = [&](bool mapped) {
      return Shader(&scene, square_camera(64), 0, mapped)
          .shade(fragment(tilted(angle)), 32, 32, 1)
          .red;
    };
    EXPECT_NEAR(seen(true), seen(false), 1e-6F) << angle;
  }
}

/// Normals that vary as a Gaussian make of the light's highlight about what Toksvig says, and of
/// Lambert's law exactly what the mean normal does.
TEST(Shader, ShortMeanNormalsWidenHighlights) {
  const float shininess = 60;
  const Scene scene = scene_with_highlight(shininess);
  constexpr double kDeviation = 0.12;  // Radians along each axis.
  std::mt19937 generator(7);
  std::normal_distribution<double> tilt(0, kDeviation);
  const Shader plain(&scene, square_camera(64));
  const Shader mapped(&scene, square_camera(64), 0, true);
  for (const double angle : {0.0, 15.0, 30.0}) {
    const Vec3d n = tilted(angle).cast<double>();
    const Vec3d across = n.cross(Vec3d::UnitY()).normalized();
    Vec3d mean(0, 0, 0);
    double truth = 0;
    constexpr int kCount = 20000;
    for (int i = 0; i < kCount; ++i) {
      const Vec3d bent =
          (n + tilt(generator) * across + tilt(generator) * Vec3d::UnitY()).normalized();
      mean += bent / kCount;
      truth += plain.shade(fragment(bent.cast<float>()), 32, 32, 1).red / kCount;
    }
    const double found = mapped.shade(fragment(mean.cast<float>()), 32, 32, 1).red;
    EXPECT_NEAR(found, truth, 0.04) << angle;
    const double unit = plain.shade(fragment(n.cast<float>()), 32, 32, 1).red;
    EXPECT_GT(std::abs(unit - truth), 3 * std::abs(found - truth)) << angle;
  }
}

/// A side that faces the eye keeps a mapped normal that does not.
TEST(Shader, MappedNormalsAreTurnedByTheSideAlone) {
  const Scene scene = scene_with_highlight(0.5F);
  const Shader shader(&scene, square_camera(64), 0, true);
  Fragment away = fragment(tilted(150));
  const float front = shader.shade(away, 32, 32, 1).red;
  EXPECT_NEAR(front, 0, 1e-6F);  // It looks away from the light, too.
  away.channel[kTag] = 0;
  EXPECT_GT(shader.shade(away, 32, 32, 1).red, 0.1F);
}

TEST(Shader, InvisibleEnvironmentsShowByReflectionAndRefractionOnly) {
  Environment environment = uniform_environment({1, 1, 1});
  environment.visible = false;
  Material clear = glass(1.5F);
  clear.ior.reset();
  clear.reflectivity = {0, 0, 0};
  for (const auto& [material, alpha] : {std::pair{glass(1.5F), 1.0F}, {clear, 0.0F}}) {
    const Scene scene = scene_of(material, environment);
    const Shader shader(&scene, square_camera(64), 1);
    const Fragment f = fragment({0, 0, 1}, 0);
    Rgba color = shader.shade(f, 32, 32, 1);
    SeenThrough surfaces;
    surfaces.add(f, 1, 1, color.alpha);
    shader.add_environment(color, surfaces, 32, 32);
    EXPECT_NEAR(color.alpha, alpha, 1e-6F);
    Rgba nothing;
    shader.add_environment(nothing, SeenThrough{}, 32, 32);
    EXPECT_EQ(nothing.alpha, 0);
  }
}

TEST(SeenThrough, SharesThePixelAmongItsFrontSurfaces) {
  SeenThrough surfaces;
  EXPECT_EQ(surfaces.uncovered(), 1);
  surfaces.add(fragment(tilted(10)), 1, 0.25F, 0.1F);
  surfaces.add(fragment(tilted(20)), 1, 0.125F, 0.1F);
  surfaces.add(fragment(tilted(30)), 2, 0.75F, 1);
  surfaces.add(fragment(tilted(40)), 1, 1, 1);
  ASSERT_EQ(surfaces.count(), 2);
  EXPECT_EQ(surfaces.share(0), 0.25F);
  EXPECT_EQ(surfaces.share(1), 0.5F);
  EXPECT_EQ(surfaces.surface(1).channel[kNormalX], tilted(30).x());
  EXPECT_EQ(surfaces.uncovered(), 0.25F);
  EXPECT_EQ(surfaces.layers(), 0.25F + 0.125F + 1.5F);
  SeenThrough many;
  for (int i = 1; i <= 16; ++i) many.add(fragment(tilted(i)), 1, static_cast<float>(i) / 16, 0);
  float sum = 0;
  for (int i = 0; i < many.count(); ++i) sum += many.share(i);
  EXPECT_EQ(sum, 1);
}

/// A glass pane behind another counts, also where the A-buffer has merged them.
TEST(Renderers, CountLayersThroughMergedFragments) {
  Material material = glass(1);
  material.absorption = {0, 0.5F, 0.9F};
  const Scene scene = scene_of(material, uniform_environment({1, 1, 1}));
  SurfelCloud cloud;
  for (int i = 0; i < 4; ++i) {
    const SurfelCloud pane = jittered_plane(30, 1.5, 0.2, 7, -0.5 * i);
    for (std::size_t s = 0; s < pane.size(); ++s) {
      add_surfel(cloud, pane.position[s], pane.normal[s], pane.variance[s], pane.area[s],
                 {1, 1, 1});
    }
  }
  RenderCloud surfels(cloud);
  for (const int layers : {1, 2, 3, 8}) {
    RenderOptions options;
    options.layers = layers;
    const Image image = Renderer(surfels, scene, options).render(camera_at(2.5, 16));
    EXPECT_NEAR(image.pixel(8, 8)[1], layers == 1 ? 0.5F : 0.0625F, 0.01F) << layers;
  }
}

TEST(Renderers, EnvironmentsDoNotDependOnThreads) {
  const SurfelCloud cloud = fibonacci_sphere(1000, 0.8);
  RenderCloud surfels(cloud);
  const Scene scene = scene_of(glass(1.4F, 0.1F), direction_environment(32));
  set_thread_count(1);
  const Image one = Renderer(surfels, scene, {}).render(camera_at(3, 48));
  set_thread_count(4);
  const Image four = Renderer(surfels, scene, {}).render(camera_at(3, 48));
  set_thread_count(0);
  EXPECT_EQ(std::memcmp(one.data.data(), four.data.data(), one.data.size() * sizeof(float)), 0);
}

TEST(Shader, WantsTheEnvironmentLoaded) {
  Scene scene;
  scene.environment = Environment{.image = "map.exr"};
  EXPECT_THROW(Shader(&scene, square_camera(8)), Error);
}

}  // namespace
}  // namespace surfel::test
