// Faces that meet at a crease are lit each by its own normal.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include <gtest/gtest.h>
#include <surfel/sample/mesh_sampler.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

constexpr int kCreaseSize = 96;
const double kSine = std::sqrt(0.5);

/// Two faces that are turned from the eye by 45 degrees to either side and meet at x = z = 0.
TriangleMesh folded_sheet() {
  TriangleMesh mesh;
  for (const float side : {-1.0F, 1.0F}) {
    const auto first = static_cast<std::uint32_t>(mesh.position.size());
    for (const float y : {-1.1F, 1.1F}) {
      mesh.position.emplace_back(0.0F, y, 0.0F);
      mesh.position.emplace_back(1.1F * side, y, -1.1F);
    }
    const std::uint32_t turn = side > 0 ? 0 : 1;
    mesh.face.push_back({first, first + 1 + turn, first + 2 - turn});
    mesh.face.push_back({first + 3, first + 2 - turn, first + 1 + turn});
  }
  return mesh;
}

/// The brightness of the left and the right face under distant lights, without highlights.
std::array<double, 2> face_values(const Scene& scene) {
  std::array<double, 2> values{};
  for (const int i : {0, 1}) {
    const Vec3d normal(i == 0 ? -kSine : kSine, 0, kSine);
    values[i] = scene.ambient.x();
    for (const Light& light : scene.lights) {
      const Vec3d along =
          light.type == Light::Type::kHeadlight ? Vec3d(0, 0, -1) : light.vector.normalized();
      values[i] += std::max(0.0, -normal.dot(along)) * static_cast<double>(light.color.x());
    }
  }
  return values;
}

/// Pictures of the sheet, by vectors and by single pixels, must nowhere leave the range of the
/// faces' values by more than `tolerance`.
void expect_within_faces(const Scene& scene, double tolerance) {
  const std::array<double, 2> values = face_values(scene);
  const double least = std::min(values[0], values[1]) - tolerance;
  const double most = std::max(values[0], values[1]) + tolerance;
  for (const double spacing : {0.5, 2.0, 6.0}) {
    MeshSampleOptions sampling;
    sampling.spacing = spacing * 2 / kCreaseSize;
    SurfelCloud cloud = sample_mesh(folded_sheet(), sampling);
    cloud.coefficient.assign(cloud.size(), Vec3f(1, 1, 1));
    RenderCloud surfels(cloud);
    for (const double cutoff : {1.0, 2.0, 4.0}) {
      for (const bool aovs : {false, true}) {
        RenderOptions options;
        options.cutoff = cutoff;
        options.aovs = aovs;
        const Image image = Renderer(surfels, scene, options).render(square_camera(kCreaseSize));
        for (int y = 8; y < kCreaseSize - 8; ++y) {
          for (int x = 8; x < kCreaseSize - 8; ++x) {
            // The colour without what the pixel lacks in coverage.
            const float value = image.pixel(x, y)[0] / image.pixel(x, y)[3];
            ASSERT_TRUE(least <= value && value <= most)
                << value << " at " << x << " " << y << ", spacing " << spacing << ", cutoff "
                << cutoff << ", aovs " << aovs;
          }
        }
      }
    }
  }
}

Light distant_light(const Vec3d& along, float color) {
  return {Light::Type::kDirectional, along, Vec3f::Constant(color)};
}

TEST(Creases, AreAsBrightAsTheirFaces) {
  Scene scene;
  scene.lights = {Light{Light::Type::kHeadlight, {0, 0, 1}, {0.8F, 0.8F, 0.8F}}};
  scene.ambient.setZero();
  EXPECT_NEAR(face_values(scene)[0], 0.566, 1e-3);
  expect_within_faces(scene, 0.02);
  scene.lights = {distant_light({0.3, -0.2, -1}, 0.4F), distant_light({-0.5, 0.4, -0.9}, 0.5F)};
  scene.ambient.setConstant(0.1F);
  expect_within_faces(scene, 0.02);
}

TEST(Creases, HaveNoLineWhereALightIsBehindOneOfTheirFaces) {
  Scene scene;
  scene.lights = {distant_light({1, 0, -0.2}, 0.8F)};
  expect_within_faces(scene, 0.02);
}

TEST(Creases, HaveNoHighlightThatTheirFacesDoNotHave) {
  Scene scene;
  scene.lights = {Light{Light::Type::kHeadlight, {0, 0, 1}, {0.8F, 0.8F, 0.8F}}};
  scene.materials[0].specular.setConstant(0.6F);  // At 45 degrees below 1e-4 of it.
  expect_within_faces(scene, 0.05);
}

}  // namespace
}  // namespace surfel::test
