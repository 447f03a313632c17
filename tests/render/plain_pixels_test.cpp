// With AOVs every pixel is resolved by resolve_pixel(), without them most are not.

#include <cmath>
#include <cstdint>
#include <utility>

#include <gtest/gtest.h>
#include <surfel/sample/mesh_sampler.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr int kOddSize = 150;  // Not a multiple of a tile's.

void expect_same_colors(const SurfelCloud& cloud, const Scene& scene, const Camera& camera,
                        RenderOptions options) {
  RenderCloud surfels(cloud);
  const auto picture = [&](bool aovs) {
    options.aovs = aovs;
    Renderer renderer(surfels, scene, options);
    return renderer.render(camera);
  };
  const Image plain = picture(false);
  const Image truth = picture(true);
  ASSERT_EQ(plain.channels.size(), 4U);
  for (int y = 0; y < kOddSize; ++y) {
    for (int x = 0; x < kOddSize; ++x) {
      for (int c = 0; c < 4; ++c) {
        // Rounding, of powers of cosines above all; opacities at edges have steps of 2^-15.
        ASSERT_NEAR(plain.pixel(x, y)[c], truth.pixel(x, y)[c], 6e-5) << x << " " << y << " " << c;
      }
    }
  }
}

/// A sphere in front of a plane, and another one that sticks through the plane.
SurfelCloud spheres_and_plane() {
  SurfelCloud cloud = jittered_plane(200, 1.2, 0.3);
  const auto add = [&](const SurfelCloud& sphere, const Vec3f& place) {
    for (std::size_t i = 0; i < sphere.size(); ++i) {
      add_surfel(cloud, sphere.position[i] + place, sphere.normal[i], sphere.variance[i],
                 sphere.area[i], sphere.coefficient[i]);
    }
  };
  add(fibonacci_sphere(20000, 0.5, {0.9F, 0.4F, 0.1F}), {0.2F, 0.1F, 0.8F});
  add(fibonacci_sphere(6000, 0.3, {0.1F, 0.3F, 0.8F}), {-0.7F, -0.6F, 0});
  return cloud;
}

TEST(PlainPixels, AreWhatCompositingMakesOfThem) {
  const Scene scene;
  for (const float alpha : {1.0F, 0.6F}) {
    SurfelCloud cloud = spheres_and_plane();
    cloud.alpha.assign(cloud.size(), alpha);
    for (const Camera& camera : {camera_at(2.6, kOddSize), square_camera(kOddSize)}) {
      for (const int layers : {1, 2, 5}) {  // Surfaces are merged, of two; of five there is room.
        for (const bool lit : {false, true}) {
          RenderOptions options;
          options.layers = layers;
          options.lit = lit;
          options.background = {0.2F, 0.4F, 0.6F, 0.5F};
          SCOPED_TRACE(testing::Message()
                       << alpha << " " << camera.orthographic << " " << layers << " " << lit);
          expect_same_colors(cloud, scene, camera, options);
        }
      }
    }
  }
}

/// Surfels end at lines in all directions, at one or two, everywhere or on one side.
TEST(PlainPixels, MayEndAtLines) {
  const Scene scene;
  const SurfelCloud whole = spheres_and_plane();
  for (const float least_x : {-2.0F, 0.0F}) {
    for (const float alpha : {1.0F, 0.6F}) {
      SurfelCloud cloud = whole;
      cloud.alpha.assign(cloud.size(), alpha);
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        const double turn = static_cast<double>(i);
        const bool cut = cloud.position[i].x() > least_x;
        const bool twice = cut && i % 3 == 0;
        const float deviation = std::sqrt(cloud.variance[i]);
        const auto line = [&](double angle, bool exists) -> Vec3f {
          if (!exists) return {0, 0, 0};
          const Vec3f any(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)),
                          0.3F);
          const Vec3f& n = cloud.normal[i];
          return (any - n * n.dot(any)).normalized();
        };
        cloud.clip1.push_back(line(turn, cut));
        cloud.clip1_distance.push_back(deviation);
        cloud.clip2.push_back(line(2 * turn, twice));
        cloud.clip2_distance.push_back(0.3F * deviation);
      }
      for (const bool lit : {false, true}) {
        RenderOptions options;
        options.lit = lit;
        SCOPED_TRACE(testing::Message() << least_x << " " << alpha << " " << lit);
        expect_same_colors(cloud, scene, camera_at(2.6, kOddSize), options);
      }
    }
  }
}

TEST(PlainPixels, AreLitByEveryKindOfLightAndMaterial) {
  Scene scene;
  scene.ambient = {0.1F, 0.2F, 0.05F};
  scene.lights = {{Light::Type::kHeadlight, {0.3, 0.4, 1}, {0.5F, 0.4F, 0.3F}},
                  {Light::Type::kDirectional, {-1, -0.5, -0.2}, {0.2F, 0.4F, 0.5F}},
                  {Light::Type::kPoint, {0.5, 1, 2}, {0.6F, 0.1F, 0.4F}}};
  for (const float shininess : {0.0F, 0.01F, 8.0F, 300.0F}) {
    Material& material = scene.materials.emplace_back();
    material.ambient = {0.5F, 1, 0.2F};
    material.diffuse = {0.3F, 0.9F, 0.6F};
    material.specular = {0.4F, 0.2F, 0.8F};
    material.shininess = shininess;
  }
  SurfelCloud cloud = spheres_and_plane();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.material.push_back(cloud.position[i].x() > 0 ? static_cast<std::uint16_t>(1 + i % 4) : 0);
  }
  // What has no direction looks at the eye.
  for (std::size_t i = 0; i < cloud.size(); i += 5) {
    if (cloud.position[i].y() > 0.3F) cloud.normal[i].setZero();
  }
  for (const Camera& camera : {camera_at(2.6, kOddSize), square_camera(kOddSize)}) {
    expect_same_colors(cloud, scene, camera, {});
  }
  // Means of a normal map.
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto wave = static_cast<float>(std::sin(0.1 * static_cast<double>(i)));
    cloud.shading_normal.emplace_back((0.8F + 0.15F * wave) *
                                      (cloud.normal[i] + Vec3f(0, wave, 0.3F)).normalized());
  }
  for (const Camera& camera : {camera_at(2.6, kOddSize), square_camera(kOddSize)}) {
    expect_same_colors(cloud, scene, camera, {});
  }
}

/// Before the far sides of a box its near sides cover parts of pixels at creases.
TEST(PlainPixels, LeaveBacksBehindAPartOfThePixel) {
  TriangleMesh box;
  const Eigen::Matrix3d turn =
      (Eigen::AngleAxisd(0.44, Vec3d::UnitX()) * Eigen::AngleAxisd(0.58, Vec3d::UnitY()))
          .toRotationMatrix();
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-0.5, 0.5}) {
      const auto first = static_cast<std::uint32_t>(box.position.size());
      for (const auto& [u, v] :
           {std::pair(-1, -1), std::pair(1, -1), std::pair(-1, 1), std::pair(1, 1)}) {
        Vec3d corner;
        corner[axis] = side;
        corner[(axis + 1) % 3] = u * side;
        corner[(axis + 2) % 3] = 0.5 * v;
        box.position.push_back((turn * corner).cast<float>());
      }
      box.face.push_back({first, first + 1, first + 2});
      box.face.push_back({first + 3, first + 2, first + 1});
    }
  }
  MeshSampleOptions sampling;
  sampling.spacing = 2 * 2.0 / kOddSize;
  for (const double cutoff : {2.0, 4.0}) {
    RenderOptions options;
    options.cutoff = cutoff;
    expect_same_colors(sample_mesh(box, sampling), {}, square_camera(kOddSize), options);
  }
}

/// Discs that do not overlap: the sums of rho are less than tau between them.
TEST(PlainPixels, AreThinWhereTheSurfaceIs) {
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  SurfelCloud cloud = jittered_plane(40, 1.2, 0.3);
  for (float& v : cloud.variance) v *= 0.2F;
  expect_same_colors(cloud, scene, camera_at(2.6, kOddSize), options);
  cloud = fibonacci_sphere(400, 0.8, {0.5F, 0.6F, 0.7F});
  expect_same_colors(cloud, scene, camera_at(2.6, kOddSize), options);
}

/// A surface that ends at every column of a tile: its last pixels are thin while all around is not.
TEST(PlainPixels, KnowAnEdgeNextToTheirTile) {
  const Scene scene;
  RenderOptions options;
  options.lit = false;
  for (int column = 0; column < kTileSize; ++column) {
    const double half = 0.8 + column * 2.0 / kOddSize;
    expect_same_colors(jittered_plane(260, half, 0.2), scene, square_camera(kOddSize), options);
  }
}

}  // namespace
}  // namespace surfel::test
