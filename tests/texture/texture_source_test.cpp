#include <cmath>
#include <fstream>
#include <memory>

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

/// A mesh whose one material has an image of 2 x 2 texels (left half alpha 1, right half 0.25)
/// inside of the mesh.
TriangleMesh with_embedded_image() {
  const test::TemporaryFolder folder;
  write_image(test::make_image(2, 2,
                               [](int x, int) {
                                 const float alpha = x == 0 ? 1 : 0.25F;
                                 return Eigen::Vector4f(alpha, alpha, alpha, alpha);
                               }),
              folder / "white.png");
  const InputFile file(folder / "white.png");
  TriangleMesh mesh = one_triangle();
  mesh.embedded = {{"m.glb: images[0]",
                    std::make_shared<Array<std::byte>>(file.bytes().begin(), file.bytes().end())}};
  mesh.material.resize(1);
  mesh.material[0].texture = mesh.embedded[0].name;
  mesh.face_material = {0};
  return mesh;
}

/// The mean of the material's map; the same for maps in memory and for streamed maps.
TextureSample mean_of(const TriangleMesh& mesh) {
  const TextureSet whole = load_textures({.whole = true}, &mesh, "m.glb");
  const TextureSet streamed = load_textures({.whole = false}, &mesh, "m.glb");
  const TextureSample mean = whole.maps.at(0).mean();
  const TextureSample other = streamed.maps.at(0).mean();
  EXPECT_TRUE(mean.color.isApprox(other.color, 1e-5F)) << mean.color << " " << other.color;
  EXPECT_NEAR(mean.alpha, other.alpha, 1e-5);
  return mean;
}

TEST(LoadTextures, MaterialsMakeOpacityOfAlphaAsTheySay) {
  TriangleMesh mesh = with_embedded_image();
  MeshMaterial& material = mesh.material[0];
  EXPECT_NEAR(mean_of(mesh).alpha, 0.625, 0.01);
  material.opacity = 0.5F;
  EXPECT_NEAR(mean_of(mesh).alpha, 0.3125, 0.01);
  material.opacity = 1;
  material.texture_alpha = TextureAlpha::kNothing;
  EXPECT_EQ(mean_of(mesh).alpha, 1);
  material.texture_alpha = TextureAlpha::kMask;
  EXPECT_EQ(mean_of(mesh).alpha, 0.5F);
  material.alpha_cutoff = 0.2F;
  EXPECT_EQ(mean_of(mesh).alpha, 1);
}

TEST(LoadTextures, FactorsMultiplyTheTexture) {
  TriangleMesh mesh = with_embedded_image();
  mesh.material[0].texture_factor = Vec3f(0.5F, 0.25F, 2);
  EXPECT_TRUE(mean_of(mesh).color.isApprox(Vec3f(0.5F, 0.25F, 2), 1e-3F));
}

TEST(LoadTextures, ImagesAreContinuedAsTheMaterialSaysUnlessAsked) {
  TriangleMesh mesh = with_embedded_image();
  const auto wrap = [&](const TextureSourceOptions& options) {
    return load_textures(options, &mesh, "m.glb").maps.at(0).pyramid().wrap();
  };
  EXPECT_EQ(wrap({}), WrapMode::kRepeat);
  mesh.material[0].wrap = WrapMode::kClamp;
  EXPECT_EQ(wrap({}), WrapMode::kClamp);
  EXPECT_EQ(wrap({.wrap = WrapMode::kMirror}), WrapMode::kMirror);
}

TEST(LoadTextures, VertexColorsMultiplyTheMapsThatAskForThem) {
  TriangleMesh mesh = with_embedded_image();
  EXPECT_FALSE(load_textures({}, &mesh, "m.glb").takes_colors(0));
  mesh.color.assign(3, Vec3f(1, 0, 0));
  EXPECT_FALSE(load_textures({}, &mesh, "m.glb").takes_colors(0));
  mesh.material[0].vertex_factor = true;
  EXPECT_TRUE(load_textures({}, &mesh, "m.glb").takes_colors(0));
}

TEST(LoadTextures, UnlitMaterialsHaveTheColorsOfLight) {
  TriangleMesh mesh = with_embedded_image();
  EXPECT_EQ(load_textures({}, &mesh, "m.glb").light, ColorLight::kReflectance);
  mesh.material[0].unlit = true;
  EXPECT_EQ(load_textures({}, &mesh, "m.glb").light, ColorLight::kRecorded);
  mesh.material.resize(2);
  EXPECT_EQ(load_textures({}, &mesh, "m.glb").light, ColorLight::kMixed);
}

TEST(MissingImages, AreToldByTheFileThatNamesThem) {
  TriangleMesh mesh = one_triangle();
  mesh.face_material = {0};
  mesh.material.resize(2);
  mesh.material[0] = {.name = "bark", .texture = "nowhere/bark.png", .named_by = "tree.mtl"};
  mesh.material[1] = mesh.material[0];
  EXPECT_EQ(failure([&] { load_textures({}, &mesh, "tree.obj"); }),
            "tree.mtl: names the image nowhere/bark.png, which is not there; put it beside this "
            "file, or give an image with `image`");
  EXPECT_TRUE(image_files(mesh).empty());
  TriangleMesh replaced = mesh;
  EXPECT_TRUE(leave_out_missing_images(replaced, "tree.obj", "other.png").empty());
  EXPECT_EQ(leave_out_missing_images(mesh, "tree.obj"),
            std::vector<std::string>{
                "tree.mtl: names the image nowhere/bark.png, which is not there; the material "
                "bark is shown without it; `image` gives another"});
  EXPECT_TRUE(mesh.material[0].texture.empty());
  EXPECT_TRUE(mesh.material[1].texture.empty());
}

}  // namespace
}  // namespace surfel
