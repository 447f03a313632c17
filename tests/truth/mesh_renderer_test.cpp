#include <cmath>
#include <cstring>
#include <numbers>
#include <string>
#include <type_traits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/scene/framing.h>
#include <surfel/truth/mesh_renderer.h>

#include "render/environments.h"
#include "render/scenes.h"
#include "support/message_of.h"

namespace surfel {
namespace {

using test::square_camera;

/// The square [-1, 1]^2 in z = `z`, facing +z, with uv from 0 to `uv`, as two triangles.
void add_square(TriangleMesh& mesh, float z, std::uint16_t material = 0, float uv = 1,
                float half = 1) {
  const auto first = static_cast<std::uint32_t>(mesh.position.size());
  for (const Vec2f& p : {Vec2f(-1, -1), Vec2f(1, -1), Vec2f(1, 1), Vec2f(-1, 1)}) {
    mesh.position.emplace_back(half * p.x(), half * p.y(), z);
  }
  for (const std::array<std::uint32_t, 3>& corner :
       {std::array<std::uint32_t, 3>{0, 1, 2}, std::array<std::uint32_t, 3>{0, 2, 3}}) {
    mesh.face.push_back({first + corner[0], first + corner[1], first + corner[2]});
    std::array<Vec2f, 3> wedges;
    for (int k = 0; k < 3; ++k) {
      wedges[k] = uv / 2 * (mesh.position[first + corner[k]].head<2>() / half + Vec2f(1, 1));
    }
    mesh.wedge_uv.push_back(wedges);
    mesh.face_material.push_back(material);
  }
}

TriangleMesh square(float z = 0, float uv = 1) {
  TriangleMesh mesh;
  add_square(mesh, z, 0, uv);
  return mesh;
}

/// The square [-1, 1]^2 fills the picture exactly, in perspective.
Camera square_perspective(int size) {
  Camera camera = test::camera_at(4, size);
  camera.focal_x = camera.focal_y = 2.0 * size;
  return camera;
}

Image random_image(int width, int height) {
  Image image;
  image.width = width;
  image.height = height;
  image.channels = {"R", "G", "B"};
  for (int i = 0; i < width * height * 3; ++i) {
    image.data.push_back(static_cast<float>(random_uniform(1, static_cast<std::uint64_t>(i), 0)));
  }
  return image;
}

Image uniform_image(const std::array<float, 4>& rgba) {
  Image image;
  image.width = image.height = 1;
  image.channels = {"R", "G", "B", "A"};
  image.data.assign(rgba.begin(), rgba.end());
  return image;
}

TextureSet textured(Image image, WrapMode wrap = WrapMode::kRepeat) {
  TextureSet set;
  set.maps.emplace_back(std::move(image), wrap);
  return set;
}

/// One uniform texture per material.
TextureSet uniform_textures(const std::vector<std::array<float, 4>>& colors) {
  TextureSet set;
  for (const std::array<float, 4>& rgba : colors) {
    set.map_of_material.push_back(set.maps.size());
    set.maps.emplace_back(uniform_image(rgba), WrapMode::kRepeat);
  }
  return set;
}

/// One ray through each pixel's centre: the surface itself.
MeshRenderOptions unfiltered() {
  MeshRenderOptions options;
  options.samples = 1;
  options.lowpass = 0;
  options.lit = false;
  return options;
}

Image render(const TriangleMesh& mesh, const TextureSet* textures, const Camera& camera,
             const MeshRenderOptions& options = unfiltered(), const Scene& scene = {}) {
  return MeshRenderer(mesh, textures, scene, options).render(camera);
}

void expect_pixel(const Image& image, int x, int y, const std::array<float, 4>& rgba,
                  float tolerance = 1e-6F) {
  for (int c = 0; c < 4; ++c) {
    EXPECT_NEAR(image.pixel(x, y)[c], rgba[c], tolerance) << x << ", " << y << ", channel " << c;
  }
}

void expect_all(const Image& image, const std::array<float, 4>& rgba, float tolerance = 1e-6F) {
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) expect_pixel(image, x, y, rgba, tolerance);
  }
}

double covered_pixels(const Image& image) {
  double sum = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) sum += image.pixel(x, y)[3];
  }
  return sum;
}

TEST(MeshRenderOptions, DefaultsAreUsableAndBadValuesAreNamed) {
  EXPECT_TRUE(MeshRenderOptions{}.problems().empty());
  MeshRenderOptions options;
  options.samples = 65;
  options.lowpass = -1;
  options.bounces = 33;
  options.background = {0, 0, 0, 2};
  EXPECT_EQ(options.problems().size(), 4U);
  const TriangleMesh mesh = square();
  const Scene scene;
  EXPECT_THROW(MeshRenderer(mesh, nullptr, scene, options), Error);
}

TEST(MeshRenderer, SquareSeenFrontOnIsItsTexture) {
  const Image image = random_image(16, 16);
  const TextureSet textures = textured(image);
  const TriangleMesh mesh = square();
  for (const Camera& camera : {square_camera(16), square_perspective(16)}) {
    const Image seen = render(mesh, &textures, camera);
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        const float* texel = image.pixel(x, y);
        expect_pixel(seen, x, y, {texel[0], texel[1], texel[2], 1}, 1e-5F);
      }
    }
  }
}

TEST(MeshRenderer, TexelsAreInterpolatedAndWrapped) {
  // Twice the texels: pixel (x, y) is at texel (x / 2 - 1/4, y / 2 - 1/4), the image from uv 0
  // to 2.
  const Image image = random_image(5, 3);
  const auto at = [&](WrapMode wrap, int x, int y, int c) {
    const auto stored = [&](int i, int count) {
      if (wrap == WrapMode::kClamp) return std::clamp(i, 0, count - 1);
      const int period = wrap == WrapMode::kMirror ? 2 * count : count;
      const int r = (i % period + period) % period;
      return r < count ? r : period - 1 - r;
    };
    return image.pixel(stored(x, 5), stored(y, 3))[c];
  };
  const TriangleMesh mesh = square(0, 2);
  Camera camera = square_camera(20);
  camera.height = 12;
  camera.focal_y = 6;
  camera.center_y = 6;
  for (const WrapMode wrap : {WrapMode::kRepeat, WrapMode::kMirror, WrapMode::kClamp}) {
    const TextureSet textures = textured(image, wrap);
    const Image seen = render(mesh, &textures, camera);
    for (int y = 0; y < 12; ++y) {
      for (int x = 0; x < 20; ++x) {
        // v = 0 is the bottom row of the picture and of the image.
        const double texel_x = x / 2.0 - 0.25;
        const double texel_y = y / 2.0 - 0.25 - 3;
        const int i = static_cast<int>(std::floor(texel_x));
        const int j = static_cast<int>(std::floor(texel_y));
        const auto fx = static_cast<float>(texel_x - i);
        const auto fy = static_cast<float>(texel_y - j);
        for (int c = 0; c < 3; ++c) {
          const float expected =
              (1 - fy) * ((1 - fx) * at(wrap, i, j, c) + fx * at(wrap, i + 1, j, c)) +
              fy * ((1 - fx) * at(wrap, i, j + 1, c) + fx * at(wrap, i + 1, j + 1, c));
          ASSERT_NEAR(seen.pixel(x, y)[c], expected, 1e-5) << x << ", " << y;
        }
      }
    }
  }
}

TEST(MeshRenderer, PlacesFarBeyondTheImageAreSafe) {
  TriangleMesh mesh = square();
  for (auto& wedges : mesh.wedge_uv) {
    wedges = {Vec2f(1e30F, -1e30F), Vec2f(3e30F, 0), Vec2f(0, std::nanf(""))};
  }
  const TextureSet textures = textured(random_image(5, 3));
  const Image seen = render(mesh, &textures, square_camera(4));
  for (const float value : seen.data) EXPECT_TRUE(std::isfinite(value));
}

TEST(MeshRenderer, SphereCoversWhatTheClosedFormSays) {
  const double radius = 0.5;
  TriangleMesh mesh = generate_mesh(procedural_scene("sphere", 1), 512);
  double size = 0;
  for (const Vec3f& p : mesh.position) size = std::max<double>(size, p.norm());
  for (Vec3f& p : mesh.position) p *= static_cast<float>(radius / size);
  MeshRenderOptions options = unfiltered();
  options.samples = 8;
  for (const double lowpass : {0.0, 0.7}) {
    options.lowpass = lowpass;
    const Camera perspective = test::camera_at(1.5, 128);
    const double tangent = radius / std::sqrt(1.5 * 1.5 - radius * radius);
    const double disc = std::numbers::pi * std::pow(tangent * perspective.focal_x, 2);
    EXPECT_NEAR(covered_pixels(render(mesh, nullptr, perspective, options)) / disc, 1, 5e-4);
    const Camera orthographic = square_camera(128);
    EXPECT_NEAR(covered_pixels(render(mesh, nullptr, orthographic, options)),
                std::numbers::pi * radius * radius * 64 * 64, 5e-4 * 64 * 64);
  }
}

TEST(MeshRenderer, ClosedMeshHasNoPinholes) {
  const TriangleMesh mesh = generate_mesh(procedural_scene("sphere", 1), 200);
  Camera camera = test::camera_at(4, 512, 10);
  camera.focal_x = camera.focal_y = 4000;  // Inside the silhouette.
  expect_all(render(mesh, nullptr, camera), {0.55F, 0.55F, 0.55F, 1});
}

TEST(MeshRenderer, NearestFaceIsSeenWhateverTheOrder) {
  const TextureSet textures = uniform_textures({{1, 0, 0, 1}, {0, 1, 0, 1}});
  for (const bool front_first : {false, true}) {
    TriangleMesh mesh;
    add_square(mesh, front_first ? 0.5F : 0, front_first ? 1 : 0);
    add_square(mesh, front_first ? 0 : 0.5F, front_first ? 0 : 1);
    expect_all(render(mesh, &textures, square_camera(8)), {0, 1, 0, 1});
  }
}

TEST(MeshRenderer, OfFacesThatCoincideTheFirstCountsAlone) {
  const TextureSet textures = uniform_textures({{1, 0, 0, 0.5F}, {0, 1, 0, 0.5F}});
  TriangleMesh mesh;
  add_square(mesh, 0, 0);
  add_square(mesh, 0, 1);
  expect_all(render(mesh, &textures, square_camera(8)), {0.5F, 0, 0, 0.5F});
  std::swap(mesh.face_material.front(), mesh.face_material[2]);
  std::swap(mesh.face_material[1], mesh.face_material[3]);
  expect_all(render(mesh, &textures, square_camera(8)), {0, 0.5F, 0, 0.5F});
}

TEST(MeshRenderer, TransparentFacesAreComposited) {
  const TextureSet textures =
      uniform_textures({{0.2F, 0.4F, 0.8F, 1}, {1, 0.5F, 0, 0.25F}, {0, 0, 0, 0}});
  TriangleMesh mesh;
  add_square(mesh, 0, 0);
  add_square(mesh, 0.5F, 1);
  add_square(mesh, 0.7F, 2);
  // Rays through the squares' diagonals, too, meet each once.
  for (const Camera& camera : {square_camera(8), square_perspective(9)}) {
    expect_all(render(mesh, &textures, camera), {0.4F, 0.425F, 0.6F, 1});
  }
  Scene scene;
  scene.materials.resize(2);
  scene.materials[0].opacity = 0;
  scene.materials[1].opacity = 0.5F;
  expect_all(render(mesh, &textures, square_camera(8), unfiltered(), scene),
             {0.125F, 0.0625F, 0, 0.125F});
}

TEST(MeshRenderer, BackgroundShowsThrough) {
  const TextureSet textures = uniform_textures({{1, 0.5F, 0, 0.25F}});
  MeshRenderOptions options = unfiltered();
  options.background = {0, 0.4F, 0.8F, 0.5F};
  expect_all(render(square(), &textures, square_camera(4), options),
             {0.25F, 0.125F + 0.15F, 0.3F, 0.25F + 0.375F});
}

TEST(MeshRenderer, NothingNearerThanTheNearPlaneIsSeen) {
  const TextureSet textures = uniform_textures({{1, 0, 0, 1}, {0, 1, 0, 1}});
  TriangleMesh mesh;
  add_square(mesh, 0, 0, 1, 2);
  add_square(mesh, 0.5F, 1, 1, 2);
  for (Camera camera : {square_camera(8), square_perspective(8)}) {
    camera.near = 3.49;
    expect_all(render(mesh, &textures, camera), {0, 1, 0, 1});
    camera.near = 3.51;
    expect_all(render(mesh, &textures, camera), {1, 0, 0, 1});
    camera.near = 4.01;
    expect_all(render(mesh, &textures, camera), {0, 0, 0, 0});
    camera.near = 0;
    camera.eye.z() = 0.25;
    expect_all(render(mesh, &textures, camera), {1, 0, 0, 1});
  }
}

TEST(MeshRenderer, CullsFacesSeenFromBehind) {
  const TextureSet textures = uniform_textures({{1, 0, 0, 1}, {0, 1, 0, 1}});
  TriangleMesh mesh;
  add_square(mesh, 0, 0);
  add_square(mesh, 0.5F, 1);
  for (std::size_t f = 2; f < 4; ++f) {
    std::swap(mesh.face[f][1], mesh.face[f][2]);
    std::swap(mesh.wedge_uv[f][1], mesh.wedge_uv[f][2]);
  }
  MeshRenderOptions options = unfiltered();
  expect_all(render(mesh, &textures, square_camera(8), options), {0, 1, 0, 1});
  options.cull_back = true;
  expect_all(render(mesh, &textures, square_camera(8), options), {1, 0, 0, 1});
}

TEST(MeshRenderer, ColoursWithoutTextures) {
  TriangleMesh mesh = square();
  mesh.face_material.clear();
  expect_all(render(mesh, nullptr, square_camera(4)), {0.55F, 0.55F, 0.55F, 1});
  mesh.face_material = {1, 1};
  mesh.material.resize(2);
  mesh.material[1].diffuse = Vec3f(0.1F, 0.2F, 0.3F);
  expect_all(render(mesh, nullptr, square_camera(4)), {0.1F, 0.2F, 0.3F, 1});
  // Red grows to the right, green upwards.
  for (const Vec3f& p : mesh.position) mesh.color.emplace_back(p.x(), p.y(), 0.0F);
  for (Vec3f& color : mesh.color) color = (color + Vec3f(1, 1, 1)) / 2;
  const Image seen = render(mesh, nullptr, square_camera(4));
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 4; ++x) {
      const auto red = (static_cast<float>(x) + 0.5F) / 4;
      const auto green = 1 - (static_cast<float>(y) + 0.5F) / 4;
      expect_pixel(seen, x, y, {red, green, 0.5F, 1});
    }
  }
}

TEST(MeshRenderer, RefusesTexturesThatDoNotFit) {
  const Scene scene;
  const TextureSet textures = uniform_textures({{1, 0, 0, 1}});
  TriangleMesh without_uv = square();
  without_uv.wedge_uv.clear();
  EXPECT_THROW(MeshRenderer(without_uv, &textures, scene, {}), Error);
  TriangleMesh mesh;
  add_square(mesh, 0, 1);
  EXPECT_THROW(MeshRenderer(mesh, &textures, scene, {}), Error);
}

/// What a mesh is refused for; empty if it is not.
std::string refusal(const TriangleMesh& mesh, const TextureSet* textures = nullptr) {
  const Scene scene;
  try {
    const MeshRenderer renderer(mesh, textures, scene, unfiltered());
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(MeshRenderer, RefusesFacesThatNameWhatTheMeshLacks) {
  TriangleMesh mesh = square();
  EXPECT_NE(refusal(mesh).find("`face_material` of face 0 of the mesh is 0"), std::string::npos);
  mesh.material.resize(2);
  EXPECT_EQ(refusal(mesh), "");
  mesh.face_material[1] = 2;
  EXPECT_NE(refusal(mesh).find("`face_material` of face 1 of the mesh is 2"), std::string::npos);
  mesh.face_material[1] = 1;
  mesh.face[1][2] = 4;
  EXPECT_NE(refusal(mesh).find("`face` of face 1 of the mesh is 4"), std::string::npos);
}

TEST(MeshRenderer, RefusesColumnsOfAnotherLength) {
  const auto shorter = [](auto column) {
    TriangleMesh mesh = square();
    mesh.material.resize(1);
    mesh.color.resize(4, Vec3f(1, 1, 1));
    mesh.wedge_normal.resize(2);
    EXPECT_EQ(refusal(mesh), "");
    (mesh.*column).pop_back();
    return refusal(mesh);
  };
  EXPECT_NE(shorter(&TriangleMesh::color).find("`color`"), std::string::npos);
  EXPECT_NE(shorter(&TriangleMesh::wedge_uv).find("`wedge_uv`"), std::string::npos);
  EXPECT_NE(shorter(&TriangleMesh::wedge_normal).find("`wedge_normal`"), std::string::npos);
  EXPECT_NE(shorter(&TriangleMesh::face_material).find("`face_material`"), std::string::npos);
}

TEST(MeshRenderer, RefusesTextureSetsWithoutTheMapThatAFaceNeeds) {
  const TriangleMesh mesh = square();
  TextureSet textures = uniform_textures({{1, 0, 0, 1}});
  textures.map_of_material = {0};
  EXPECT_EQ(refusal(mesh, &textures), "");
  textures.map_of_material = {1};
  EXPECT_NE(refusal(mesh, &textures).find("`map_of_material`"), std::string::npos);
  const TextureSet none;
  EXPECT_NE(refusal(mesh, &none).find("no textures"), std::string::npos);
}

TEST(MeshRenderer, MeshWithoutFacesIsNotSeen) {
  const TriangleMesh mesh;
  const Scene scene;
  const MeshRenderer renderer(mesh, nullptr, scene, unfiltered());
  expect_all(renderer.render(square_camera(4)), {0, 0, 0, 0});
  EXPECT_TRUE(renderer.extent().box.empty());
}

/// A mesh with seams, transparent parts and faces that coincide.
struct Tangle {
  TriangleMesh mesh = generate_mesh(procedural_scene("torus", 1), 24);
  TextureSet textures = uniform_textures({{1, 0, 0, 0.5F}, {0, 1, 0, 0.25F}, {0, 0, 1, 1}});
  Scene scene;
  MeshRenderOptions options;

  Tangle() {
    const std::size_t faces = mesh.face.size();
    mesh.face_material.resize(faces);
    for (std::size_t f = 0; f < faces; ++f) {
      mesh.face_material[f] = static_cast<std::uint16_t>(f % 3);
    }
    for (std::size_t f = 0; f < faces; f += 2) {
      mesh.face.push_back(mesh.face[f]);
      mesh.wedge_uv.push_back(mesh.wedge_uv[f]);
      if (!mesh.wedge_normal.empty()) mesh.wedge_normal.push_back(mesh.wedge_normal[f]);
      mesh.face_material.push_back(static_cast<std::uint16_t>((f + 1) % 3));
    }
    options.samples = 3;
    Material shiny;
    shiny.specular = Vec3f(0.5F, 0.5F, 0.5F);
    scene.materials.assign(3, shiny);
    scene.lights.push_back({Light::Type::kPoint, {1, 2, 3}, {0.5F, 0.5F, 0.5F}});
  }
  Image seen(const Camera& camera) const {
    return MeshRenderer(mesh, &textures, scene, options).render(camera);
  }
};

bool same_bytes(const Image& a, const Image& b) {
  return a.data.size() == b.data.size() &&
         std::memcmp(a.data.data(), b.data.data(), a.data.size() * sizeof(float)) == 0;
}

TEST(MeshRenderer, SameBytesForAnyNumberOfThreads) {
  const Tangle tangle;
  const Camera camera = test::camera_at(4, 96);
  set_thread_count(1);
  const Image one = tangle.seen(camera);
  EXPECT_GT(covered_pixels(one), 100);
  for (const int threads : {2, 5}) {
    set_thread_count(threads);
    EXPECT_TRUE(same_bytes(tangle.seen(camera), one)) << threads << " threads";
  }
  set_thread_count(0);
}

TEST(MeshRenderer, DistanceFromTheOriginCostsNoPrecision) {
  Tangle tangle;
  Camera camera = test::camera_at(4, 64);
  const Image here = tangle.seen(camera);
  const Vec3d far(1e7, -1e7, 1e7);
  tangle.mesh.origin += far;
  tangle.scene.lights.back().vector += far;
  camera.eye += far;
  EXPECT_TRUE(same_bytes(tangle.seen(camera), here));
}

TEST(MeshRenderer, DistanceOfTheEyeCostsNoPrecision) {
  const TextureSet textures = textured(random_image(16, 16));
  const TriangleMesh mesh = square();
  const Image near = render(mesh, &textures, square_perspective(16));
  Camera camera = square_perspective(16);
  camera.eye.z() = 4e7;
  camera.focal_x = camera.focal_y = 16 * 2e7;
  const Image far = render(mesh, &textures, camera);
  for (std::size_t i = 0; i < near.data.size(); ++i) EXPECT_NEAR(far.data[i], near.data[i], 1e-5);
}

TEST(MeshRenderer, ScaleDoesNotMatter) {
  Tangle tangle;
  Camera camera = test::camera_at(4, 64);
  const Image image = tangle.seen(camera);
  const TriangleMesh mesh = tangle.mesh;
  for (const double scale : {0x1p-20, 0x1p20}) {
    for (std::size_t v = 0; v < mesh.position.size(); ++v) {
      tangle.mesh.position[v] = static_cast<float>(scale) * mesh.position[v];
    }
    camera.eye = scale * Vec3d(0, 0, 4);
    tangle.scene.lights.back().vector = scale * Vec3d(1, 2, 3);
    EXPECT_TRUE(same_bytes(tangle.seen(camera), image)) << scale;
  }
}

TEST(MeshRenderer, LitAsSurfelsAre) {
  Scene scene;
  scene.materials[0].specular = Vec3f(0.5F, 0.5F, 0.5F);
  scene.lights.push_back({Light::Type::kPoint, {0.5, 0.5, 1}, {0.5F, 0.6F, 0.7F}});
  const TextureSet textures = uniform_textures({{0.3F, 0.5F, 0.7F, 1}});
  SurfelCloud cloud = test::jittered_plane(128, 2, 0);
  for (Vec3f& color : cloud.coefficient) color = Vec3f(0.3F, 0.5F, 0.7F);
  RenderCloud surfels(cloud);
  TriangleMesh mesh;
  add_square(mesh, 0, 0, 1, 2);
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  for (const Camera& camera : {square_camera(32), square_perspective(32)}) {
    const Image expected = Renderer(surfels, scene, {}).render(camera);
    const Image seen = render(mesh, &textures, camera, options, scene);
    for (std::size_t i = 0; i < seen.data.size(); ++i) {
      EXPECT_NEAR(seen.data[i], expected.data[i], 1e-4);
    }
  }
}

TEST(MeshRenderer, NormalsAreSmoothWhereTheFileHasNone) {
  // Edges of a box are sharper than the crease angle, those of a sphere are not.
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  TriangleMesh sphere = generate_mesh(procedural_scene("sphere", 1), 96);
  const Camera camera = test::camera_at(5, 64);
  const Image exact = render(sphere, nullptr, camera, options);
  sphere.wedge_normal.clear();
  const Image smooth = render(sphere, nullptr, camera, options);
  for (std::size_t i = 0; i < smooth.data.size(); ++i) {
    EXPECT_NEAR(smooth.data[i], exact.data[i], 2e-2);
  }
}

/// The icosahedron in the unit sphere, whose vertices have the sphere's normals, askew.
TriangleMesh smooth_icosahedron() {
  TriangleMesh mesh;
  const Eigen::Quaternionf turn = Eigen::Quaternionf(1, 0.3F, 0.2F, 0.1F).normalized();
  const auto golden = static_cast<float>((1 + std::sqrt(5.0)) / 2);
  for (const int axis : {0, 1, 2}) {
    for (const Vec2f& sign : {Vec2f(1, 1), Vec2f(-1, 1), Vec2f(1, -1), Vec2f(-1, -1)}) {
      Vec3f p(0, 0, 0);
      p[(axis + 1) % 3] = sign.x();
      p[(axis + 2) % 3] = sign.y() * golden;
      mesh.position.push_back(turn * p.normalized());
    }
  }
  const float edge = 2 / std::sqrt(golden * golden + 1);
  const auto touch = [&](std::uint32_t a, std::uint32_t b) {
    return (mesh.position[a] - mesh.position[b]).norm() < 1.01F * edge;
  };
  for (std::uint32_t a = 0; a < 12; ++a) {
    for (std::uint32_t b = a + 1; b < 12; ++b) {
      for (std::uint32_t c = b + 1; c < 12; ++c) {
        if (!touch(a, b) || !touch(b, c) || !touch(c, a)) continue;
        const Vec3f& p = mesh.position[a];
        const Vec3f across = (mesh.position[b] - p).cross(mesh.position[c] - p);
        mesh.face.push_back({a, across.dot(p) > 0 ? b : c, across.dot(p) > 0 ? c : b});
      }
    }
  }
  for (const auto& [a, b, c] : mesh.face) {
    mesh.wedge_normal.push_back({mesh.position[a], mesh.position[b], mesh.position[c]});
  }
  return mesh;
}

SurfelCloud sampled(const TriangleMesh& mesh, double spacing) {
  MeshSampleOptions options;
  options.spacing = spacing;
  return sample_mesh(mesh, options);
}

TEST(MeshRenderer, SmoothNormalsAreOnTheSideOfTheirFace) {
  // The light comes from behind, where smooth normals at the rim look away from the eye. The normal
  // of a place of the body is the mean of its face's corners, which is that place.
  const TriangleMesh mesh = smooth_icosahedron();
  ASSERT_EQ(mesh.face.size(), 20U);
  const Vec3f to_light = Vec3f(0.8F, 0.3F, -0.6F).normalized();
  Scene scene;
  scene.ambient = {0, 0, 0};
  scene.lights = {{Light::Type::kDirectional, (-to_light).cast<double>(), {1, 1, 1}}};
  scene.materials[0].diffuse = {1, 1, 1};
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  const Image seen = render(mesh, nullptr, square_camera(64), options, scene);
  RenderCloud surfels(sampled(mesh, 0.01));
  const Image drawn = Renderer(surfels, scene, {}).render(square_camera(64));
  int away = 0;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      if (seen.pixel(x, y)[3] < 1) continue;
      const Vec2f at((static_cast<float>(x) + 0.5F) / 32 - 1,
                     1 - (static_cast<float>(y) + 0.5F) / 32);
      std::optional<Vec3f> nearest;
      for (const auto& [a, b, c] : mesh.face) {
        Eigen::Matrix3f corners;
        corners << mesh.position[a], mesh.position[b], mesh.position[c];
        Eigen::Matrix3f flat = corners;
        flat.row(2).setOnes();
        const Vec3f weight = flat.inverse() * Vec3f(at.x(), at.y(), 1);
        if (weight.minCoeff() < 0) continue;
        const Vec3f place = corners * weight;
        if (!nearest || place.z() > nearest->z()) nearest = place;
      }
      ASSERT_TRUE(nearest.has_value()) << x << ", " << y;
      const float expected =
          SurfelCloud::colorless().x() * std::max(0.0F, nearest->normalized().dot(to_light));
      EXPECT_NEAR(seen.pixel(x, y)[0], expected, 1e-4F) << x << ", " << y;
      if (nearest->z() < 0) ++away;
      if (drawn.pixel(x, y)[3] < 0.999F) continue;
      EXPECT_NEAR(drawn.pixel(x, y)[0], expected, 0.02F) << x << ", " << y;
    }
  }
  EXPECT_GT(away, 10);
}

TEST(MeshRenderer, ReliefDarkensCreasesAsInPicturesOfSurfels) {
  TriangleMesh valley;
  for (const float x : {-2.0F, 0.0F, 2.0F}) {
    for (const float y : {-2.0F, 2.0F}) valley.position.emplace_back(x, y, std::abs(x));
  }
  valley.face = {{0, 2, 1}, {1, 2, 3}, {2, 4, 3}, {3, 4, 5}};
  RenderCloud surfels(sampled(valley, 0.02));
  const Scene scene;
  RenderOptions drawn;
  MeshRenderOptions traced = unfiltered();
  traced.lit = true;
  const auto draw = [&] { return Renderer(surfels, scene, drawn).render(square_camera(64)); };
  const auto trace = [&] { return render(valley, nullptr, square_camera(64), traced, scene); };
  const Image drawn_plain = draw();
  const Image traced_plain = trace();
  drawn.relief = traced.relief = Relief::kOcclusion;
  const Image drawn_shaded = draw();
  const Image traced_shaded = trace();
  const float kept = drawn_shaded.pixel(32, 32)[0] / drawn_plain.pixel(32, 32)[0];
  EXPECT_LT(kept, 0.9F);
  EXPECT_NEAR(traced_shaded.pixel(32, 32)[0] / traced_plain.pixel(32, 32)[0], kept, 0.03F);
  EXPECT_NEAR(traced_shaded.pixel(10, 32)[0], traced_plain.pixel(10, 32)[0], 1e-3F);
  EXPECT_EQ(traced_shaded.pixel(32, 32)[3], 1);
}

/// Lit by one light that is not the eye's.
Scene lit_from_the_side() {
  Scene scene;
  scene.ambient = {0, 0, 0};
  scene.lights = {{Light::Type::kDirectional, {-1, 0.5, -1}, {1, 1, 1}}};
  scene.materials[0].specular = {0.5F, 0.5F, 0.5F};
  return scene;
}

TEST(MeshRenderer, NormalMapsBendNormals) {
  const Scene scene = lit_from_the_side();
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  const Vec3f tilt = Vec3f(0.3F, 0.4F, 0.8F).normalized();
  for (const bool mirrored : {false, true}) {
    TriangleMesh mesh = square();
    mesh.face_material.clear();
    if (mirrored) {
      for (auto& wedges : mesh.wedge_uv) {
        for (Vec2f& uv : wedges) uv.x() = 1 - uv.x();
      }
    }
    NormalMaps maps;
    maps.kind = {ReliefKind::kNormals};
    maps.first = uniform_textures({{tilt.x(), tilt.y(), tilt.z(), 1}});
    options.normal_maps = &maps;
    const Image seen = render(mesh, nullptr, square_camera(8), options, scene);
    options.normal_maps = nullptr;
    const Vec3f turned(mirrored ? -tilt.x() : tilt.x(), tilt.y(), tilt.z());
    mesh.wedge_normal.assign(2, {turned, turned, turned});
    const Image expected = render(mesh, nullptr, square_camera(8), options, scene);
    for (std::size_t i = 0; i < seen.data.size(); ++i) {
      EXPECT_NEAR(seen.data[i], expected.data[i], 1e-5F);
    }
  }
}

/// Heights whose slopes change along x only, between the texels as bilinear interpolation has it.
TEST(MeshRenderer, BumpMapsBendNormalsByTheirSlopes) {
  const Scene scene = lit_from_the_side();
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  constexpr int kTexels = 16;  // 8 texels a scene unit: the square is two units wide.
  Image first;
  first.width = kTexels;
  first.height = 1;
  first.channels = {"R", "G", "B"};
  for (int x = 0; x < kTexels; ++x) {
    const auto h_x = static_cast<float>(0.01 * x);
    first.data.insert(first.data.end(), {h_x, 0, h_x * h_x});
  }
  NormalMaps maps;
  maps.kind = {ReliefKind::kHeights};
  maps.first = textured(std::move(first), WrapMode::kClamp);
  options.normal_maps = &maps;
  TriangleMesh mesh = square();
  mesh.face_material.clear();
  const Image seen = render(mesh, nullptr, square_camera(32), options, scene);
  options.normal_maps = nullptr;
  for (const int x : {3, 10, 25}) {
    // The pixel's centre in texels, less the half texel that the first centre lies in.
    const double h_x = 0.01 * ((x + 0.5) * kTexels / 32 - 0.5);
    TriangleMesh bent = mesh;
    const Vec3f normal = Vec3d(-h_x * 8, 0, 1).normalized().cast<float>();
    bent.wedge_normal.assign(2, {normal, normal, normal});
    const Image expected = render(bent, nullptr, square_camera(32), options, scene);
    for (int c = 0; c < 4; ++c) {
      EXPECT_NEAR(seen.pixel(x, 16)[c], expected.pixel(x, 16)[c], 1e-5F) << x;
    }
  }
}

TEST(MeshRenderer, NormalMapsNeedTextureCoordinates) {
  TriangleMesh mesh = square();
  mesh.wedge_uv.clear();
  NormalMaps maps;
  maps.kind = {ReliefKind::kNormals};
  maps.first = uniform_textures({{0, 0, 1, 1}});
  const Scene scene;
  MeshRenderOptions options;
  options.normal_maps = &maps;
  EXPECT_THROW(MeshRenderer(mesh, nullptr, scene, options), Error);
}

/// Embree ends the process on them.
TEST(MeshRenderer, RefusesCoordinatesThatRaysCannotMeet) {
  TriangleMesh mesh = square();
  mesh.position[2] = Vec3f(1, -1e20F, 0);
  const Scene scene;
  EXPECT_EQ(test::message_of([&] { MeshRenderer(mesh, nullptr, scene, {}); }),
            "vertex 2 has a coordinate as large as 1e+20; meshes with coordinates up to 1e+18 are "
            "taken, scale the mesh down");
}

TEST(MeshRenderer, ExtentHoldsTheFacesAlone) {
  TriangleMesh mesh = generate_mesh(procedural_scene("sphere", 1), 400);
  mesh.origin = Vec3d(1e6, 2, 3);
  double radius = 0;
  for (const Vec3f& p : mesh.position) radius = std::max<double>(radius, p.norm());
  mesh.position.emplace_back(100.0F, 100.0F, 100.0F);  // Of no face.
  const Scene scene;
  const SceneExtent extent = MeshRenderer(mesh, nullptr, scene, {}).extent();
  EXPECT_LT((extent.box.max - mesh.origin - Vec3d::Constant(radius)).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_LT((extent.box.min - mesh.origin + Vec3d::Constant(radius)).cwiseAbs().maxCoeff(), 1e-6);
  for (const Vec3d& a : {Vec3d(1, 2, 3), Vec3d(-1, 0, 0), Vec3d(0.2, -5, 1)}) {
    const double reach = extent.support(a, 0) - a.dot(mesh.origin);
    EXPECT_LE(reach, radius * a.norm() + 1e-6);
    EXPECT_GT(reach, 0.95 * radius * a.norm());
  }
  // The picture shows all of it, and little else.
  CameraOptions options;
  options.width = options.height = 64;
  const Image seen = render(mesh, nullptr, make_camera(options, extent));
  EXPECT_NEAR(covered_pixels(seen) / (64 * 64 * std::numbers::pi / 4), 0.95 * 0.95, 0.05);
}

TEST(MeshRenderer, ShadesEachFaceWithItsOwnMaterial) {
  TriangleMesh mesh;
  for (int i = 0; i < 4; ++i) add_square(mesh, 0, static_cast<std::uint16_t>(i), 1, 0.25F);
  for (std::size_t v = 0; v < mesh.position.size(); ++v) {
    mesh.position[v].x() += static_cast<float>(v / 4) * 0.5F - 0.75F;
  }
  Scene scene;
  scene.lights.clear();
  scene.ambient = {1, 1, 1};
  scene.materials.clear();
  for (int i = 0; i < 4; ++i) {
    scene.materials.emplace_back().ambient = Vec3f::Constant(0.25F * static_cast<float>(i));
  }
  const TextureSet white = uniform_textures({4, {1, 1, 1, 1}});
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  const Image image = render(mesh, &white, square_camera(8), options, scene);
  for (int i = 0; i < 4; ++i) {
    const float shade = 0.25F * static_cast<float>(i);
    expect_pixel(image, 2 * i, 4, {shade, shade, shade, 1});
  }
}

/// A glass pane in front of a mirror, both of which keep all light.
TEST(MeshRenderer, SeesTheEnvironment) {
  TriangleMesh mesh;
  add_square(mesh, 0.5F, 0, 1, 0.5F);
  add_square(mesh, 0, 1, 1, 0.75F);
  mesh.material.resize(2);
  Scene scene;
  scene.materials.resize(2);
  scene.materials[0].opacity = 0;
  scene.materials[0].ior = 1.5F;
  scene.materials[1].reflectivity = {1, 1, 1};
  scene.environment = test::uniform_environment({0.5F, 1, 2});
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  const Image image = render(mesh, nullptr, square_perspective(16), options, scene);
  for (int i = 0; i < 16; ++i) expect_pixel(image, i, 8, {0.5F, 1, 2, 1}, 1e-5F);
  const Image empty = render({}, nullptr, square_perspective(4), options, scene);
  expect_pixel(empty, 1, 1, {0.5F, 1, 2, 1}, 1e-5F);
}

/// A red wall behind a pane of glass, and the whole behind a mirror: rays that are bent or mirrored
/// meet the mesh again, where rays that go straight on would see the environment.
TEST(MeshRenderer, BentRaysMeetTheMeshAgain) {
  TriangleMesh mesh;
  add_square(mesh, 0, 0, 1, 0.5F);
  add_square(mesh, 3, 1, 1, 0.75F);  // Behind the eye's near plane: the mirror alone shows it.
  mesh.material.resize(2);
  mesh.material[1].diffuse = {1, 0, 0};
  Scene scene;
  scene.materials.resize(2);
  scene.materials[0].reflectivity = {1, 1, 1};
  scene.ambient = {1, 1, 1};
  scene.lights.clear();
  scene.environment = test::uniform_environment({0, 1, 0});
  MeshRenderOptions options = unfiltered();
  options.lit = true;
  Camera camera = square_perspective(16);
  camera.near = 2;
  const Image straight = render(mesh, nullptr, camera, options, scene);
  expect_pixel(straight, 8, 8, {0, 1, 0, 1}, 1e-5F);
  options.bounces = 2;
  const Image bent = render(mesh, nullptr, camera, options, scene);
  expect_pixel(bent, 8, 8, {1, 0, 0, 1}, 1e-5F);
  expect_pixel(bent, 0, 0, {0, 1, 0, 1}, 1e-5F);
  scene.materials[0].reflectivity = {0, 0, 0};  // Glass, whose way back is free.
  scene.materials[0].opacity = 0;
  scene.materials[0].ior = 1.5F;
  expect_pixel(render(mesh, nullptr, camera, options, scene), 8, 8, {0, 1, 0, 1}, 1e-5F);
}

TEST(MeshRenderer, BouncesNeedAnEnvironment) {
  TriangleMesh mesh = square();
  mesh.face_material.clear();
  MeshRenderOptions options;
  options.bounces = 1;
  Scene scene;
  EXPECT_THROW(MeshRenderer(mesh, nullptr, scene, options), Error);
  scene.environment = test::uniform_environment({1, 1, 1});
  EXPECT_NO_THROW(MeshRenderer(mesh, nullptr, scene, options));
  options.lit = false;
  EXPECT_THROW(MeshRenderer(mesh, nullptr, scene, options), Error);
}

// A MeshRenderer keeps references: temporaries do not bind.
static_assert(std::is_constructible_v<MeshRenderer, const TriangleMesh&, const TextureSet*,
                                      const Scene&, MeshRenderOptions>);
static_assert(!std::is_constructible_v<MeshRenderer, TriangleMesh, const TextureSet*, const Scene&,
                                       MeshRenderOptions>);
static_assert(!std::is_constructible_v<MeshRenderer, const TriangleMesh&, const TextureSet*, Scene,
                                       MeshRenderOptions>);

TEST(MeshRenderer, ScenesAndCamerasThatCannotBeAreRefused) {
  TriangleMesh mesh = square();
  mesh.face_material.clear();  // Of materials that the mesh does not have.
  Scene bare;
  bare.materials.clear();
  EXPECT_THROW(MeshRenderer(mesh, nullptr, bare, {}), Error);
  const Scene scene;
  const MeshRenderer renderer(mesh, nullptr, scene, {});
  EXPECT_NO_THROW(renderer.render(test::camera_at(3, 16)));
  for (const Camera& camera : test::unusable_cameras())
    EXPECT_THROW(renderer.render(camera), Error);
}

}  // namespace
}  // namespace surfel
