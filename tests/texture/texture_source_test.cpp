#include <cmath>
#include <fstream>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>
#include <surfel/texture/texture_source.h>

#include "support/test_data.h"
#include "texture_support.h"

namespace surfel {
namespace {

/// The message, and "usage: " before it where the options are wrong.
template <class Call>
std::string failure(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return (error.kind() == ErrorKind::kUsage ? "usage: " : "") + std::string(error.what());
  }
  return "";
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// One triangle with the whole lower left half of the image.
TriangleMesh one_triangle() {
  TriangleMesh mesh;
  mesh.position = {Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)};
  mesh.face = {{0, 1, 2}};
  mesh.wedge_uv = {{Vec2f(0, 0), Vec2f(1, 0), Vec2f(0, 1)}};
  return mesh;
}

TEST(LoadTextureImage, RasterisesProceduralTexturesAtTheFrequencyAsked) {
  const Image image = load_texture_image("checker:2");
  ASSERT_EQ(image.width, 2048);
  ASSERT_EQ(image.height, 2048);
  // Dark where floor(2u) + floor(2v) is even; row 0 is at v = 1.
  EXPECT_EQ(image.pixel(10, 10)[0], 1);
  EXPECT_EQ(image.pixel(10, 2000)[0], 0);
  EXPECT_EQ(image.pixel(2000, 2000)[0], 1);
  const Image by_default = load_texture_image("checker");
  EXPECT_NE(by_default.pixel(10, 2040)[0], by_default.pixel(10 + 128, 2040)[0]);
}

TEST(LoadTextures, RefusesImagesThatEndInNothing) {
  const TextureSourceOptions options{.image = "checker:2", .wrap = WrapMode::kNothing};
  EXPECT_TRUE(failure([&] { load_textures(options, nullptr, ""); }).starts_with("usage: `wrap`"));
}

TEST(LoadTextureImage, RefusesAFrequencyThatIsNone) {
  for (const std::string frequency : {"", "0", "-3", "x", "4x", "nan", "1e9"}) {
    const std::string name = "noise:" + frequency;
    const std::string message = failure([&] { load_texture_image(name); });
    EXPECT_TRUE(message.starts_with("usage: ")) << name << ": " << message;
    EXPECT_TRUE(contains(message, name)) << message;
  }
}

TEST(LoadTextureImage, NamesTheFileThatIsMissingOrDamaged) {
  EXPECT_TRUE(contains(failure([] { load_texture_image("missing.png"); }), "missing.png"));
  const test::TemporaryFolder folder;
  const std::string damaged = folder / "damaged.png";
  std::ofstream(damaged) << "\x89PNG\r\n\x1a\n and then nothing";
  EXPECT_TRUE(contains(failure([&] { load_texture_image(damaged); }), damaged));
}

TEST(LoadTextures, TakesTheMaterialsImagesOnceEachAndTheirColoursElse) {
  const test::TemporaryFolder folder;
  Image image = test::make_image(4, 4, [](int, int) { return Eigen::Vector4f(1, 0, 0, 1); });
  write_image(image, folder / "red.png");
  TriangleMesh mesh = one_triangle();
  mesh.material.resize(3);
  mesh.material[0].texture = folder / "red.png";
  mesh.material[1].diffuse = Vec3f(0, 0.5F, 0);
  mesh.material[2].texture = folder / "red.png";
  const TextureSet textures = load_textures({}, &mesh, "m.obj");
  ASSERT_EQ(textures.maps.size(), 2U);
  EXPECT_EQ(textures.map_of_material, (std::vector<std::size_t>{0, 1, 0}));
  EXPECT_TRUE(textures.maps[0].mean().color.isApprox(Vec3f(1, 0, 0)));
  EXPECT_TRUE(textures.maps[1].mean().color.isApprox(Vec3f(0, 0.5F, 0)));
  ASSERT_TRUE(textures.charts);
  EXPECT_EQ(textures.charts->count(), 1U);
  EXPECT_FALSE(load_textures({.charts = false}, &mesh, "m.obj").charts);
}

TEST(LoadTextures, OneImageWinsOverTheMaterials) {
  TriangleMesh mesh = one_triangle();
  mesh.material.resize(2);
  mesh.material[0].texture = "missing.png";
  const TextureSet textures = load_textures({.image = "checker"}, &mesh, "m.obj");
  EXPECT_EQ(textures.maps.size(), 1U);
  EXPECT_TRUE(textures.map_of_material.empty());
}

TEST(LoadTextures, SaysWhatIsMissing) {
  TriangleMesh mesh = one_triangle();
  EXPECT_TRUE(failure([] { load_textures({}, nullptr, ""); }).starts_with("usage: "));
  EXPECT_TRUE(contains(failure([&] { load_textures({}, &mesh, "m.obj"); }),
                       "m.obj: the mesh has no materials"));
  mesh.wedge_uv.clear();
  EXPECT_TRUE(contains(failure([&] { load_textures({.image = "checker"}, &mesh, "m.obj"); }),
                       "m.obj: the mesh has no texture coordinates"));
}

}  // namespace
}  // namespace surfel
