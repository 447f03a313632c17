#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <numbers>
#include <numeric>
#include <string>
#include <vector>

#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <support/message_of.h>
#include <support/test_data.h>
#include <surfel/base/error.h>
#include <surfel/base/timing.h>
#include <surfel/io/mesh_io.h>
#include <surfel/scene/triangle_mesh.h>

#include "io/mesh_files.h"

namespace surfel {
namespace {

using nlohmann::json;
using test::area;
using test::corner;
using test::TemporaryFolder;
using test::volume;

std::string base64(std::string_view bytes) {
  constexpr std::string_view kLetters =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      bits = bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += i + k <= bytes.size() ? kLetters[bits >> (18 - 6 * k) & 63U] : '=';
    }
  }
  return text;
}

std::string u32(std::size_t value) {
  const auto bits = static_cast<std::uint32_t>(value);
  return {reinterpret_cast<const char*>(&bits), 4};
}

/// A glTF document in the making, with one buffer.
struct Document {
  json root = {{"asset", {{"version", "2.0"}}},
               {"scene", 0},
               {"scenes", {{{"nodes", {0}}}}},
               {"nodes", {{{"mesh", 0}}}},
               {"meshes", json::array()}};
  std::string bytes{};

  /// Number of a new view of these bytes.
  std::size_t view(const std::string& content) {
    bytes.resize((bytes.size() + 3) / 4 * 4);
    root["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", bytes.size()}, {"byteLength", content.size()}});
    bytes += content;
    return root["bufferViews"].size() - 1;
  }

  /// Number of a new accessor of these values.
  template <class T>
  std::size_t accessor(const std::vector<T>& values, const char* type, bool normalized = false) {
    const std::map<std::string, std::size_t> sizes{
        {"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}, {"MAT4", 16}};
    const int component = std::is_same_v<T, float>           ? 5126
                          : std::is_same_v<T, std::int8_t>   ? 5120
                          : std::is_same_v<T, std::uint8_t>  ? 5121
                          : std::is_same_v<T, std::int16_t>  ? 5122
                          : std::is_same_v<T, std::uint16_t> ? 5123
                                                             : 5125;
    const std::string content(reinterpret_cast<const char*>(values.data()),
                              values.size() * sizeof(T));
    json made = {{"bufferView", view(content)},
                 {"componentType", component},
                 {"count", values.size() / sizes.at(type)},
                 {"type", type}};
    if (normalized) made["normalized"] = true;
    root["accessors"].push_back(made);
    return root["accessors"].size() - 1;
  }

  /// A mesh of one primitive of these positions, without indices.
  json& add_mesh(const std::vector<float>& positions) {
    const std::size_t position = accessor(positions, "VEC3");
    root["meshes"].push_back({{"primitives", {{{"attributes", {{"POSITION", position}}}}}}});
    return root["meshes"].back()["primitives"][0];
  }

  json with_buffer() const {
    json whole = root;
    whole["buffers"] = {{{"byteLength", bytes.size()}}};
    return whole;
  }
  /// As text, the buffer in a data URI.
  std::string text() const {
    json whole = with_buffer();
    whole["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(bytes);
    return whole.dump();
  }
  std::string glb() const { return glb_of(with_buffer().dump()); }
  std::string glb_of(std::string document) const {
    document.resize((document.size() + 3) / 4 * 4, ' ');
    const std::string body = u32(document.size()) + "JSON" + document + u32(bytes.size()) +
                             std::string("BIN\0", 4) + bytes;
    return "glTF" + u32(2) + u32(12 + body.size()) + body;
  }
};

/// A corner of the unit cube, and its neighbours.
const std::vector<float> kTriangle{0, 0, 0, 1, 0, 0, 0, 1, 0};
const std::vector<float> kTetrahedron{0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1, 0,
                                      0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1};

TriangleMesh read_bytes(const std::string& content, const std::string& name = "mesh.glb") {
  return read_mesh(InputFile(name, std::as_bytes(std::span(content))));
}
TriangleMesh read(const Document& document) { return read_bytes(document.glb()); }

std::string failure(const std::string& content, const std::string& name = "mesh.glb") {
  const std::string message = test::message_of([&] { read_bytes(content, name); });
  EXPECT_EQ(message.find(name), 0U) << message;
  return message;
}
std::string failure(const Document& document) { return failure(document.glb()); }

/// Of a closed mesh whose faces are counter-clockwise from outside.
Vec3d low(const TriangleMesh& mesh) {
  Vec3d least = corner(mesh, 0, 0);
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) least = least.cwiseMin(corner(mesh, f, k));
  }
  return least;
}

TEST(Gltf, IsReadFromAllContainers) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "parts of it");
  Document document;
  document.add_mesh(kTetrahedron);
  json beside = document.with_buffer();
  beside["buffers"][0]["uri"] = "parts%20of%20it/shape.bin";
  std::ofstream(folder / "parts of it/shape.bin", std::ios::binary) << document.bytes;
  std::ofstream(folder / "beside.gltf") << beside.dump();
  for (const TriangleMesh& mesh : {read(document), read_bytes(document.text(), "mesh.gltf"),
                                   read_mesh(folder / "beside.gltf")}) {
    EXPECT_EQ(mesh.face.size(), 4U);
    EXPECT_EQ(mesh.position.size(), 4U) << "corners at one place are one vertex";
    EXPECT_NEAR(volume(mesh), 1.0 / 6, 1e-12);
    EXPECT_EQ(mesh.up, Vec3d(0, 1, 0));
    EXPECT_TRUE(mesh.notes.empty());
  }
}

TEST(Gltf, FilesOutsideOfTheFolderAreNotRead) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "in");
  Document document;
  document.add_mesh(kTriangle);
  std::ofstream(folder / "shape.bin", std::ios::binary) << document.bytes;
  for (const std::string& uri : {std::string("../shape.bin"), std::string("%2e%2e/shape.bin"),
                                 std::string("a/..\\..\\shape.bin"), folder / "shape.bin",
                                 "file://" + (folder / "shape.bin")}) {
    json beside = document.with_buffer();
    beside["buffers"][0]["uri"] = uri;
    std::ofstream(folder / "in/mesh.gltf") << beside.dump();
    const std::string message = test::message_of([&] { read_mesh(folder / "in/mesh.gltf"); });
    EXPECT_NE(message.find("buffers[0].uri"), std::string::npos) << uri << ": " << message;
    EXPECT_NE(message.find("outside of this file's folder"), std::string::npos) << message;
  }
}

TEST(Gltf, StripsAndFansAreTriangles) {
  const std::vector<float> square{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
  const std::vector<float> around{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
  for (const auto& [mode, positions] : {std::pair(5, square), {6, around}}) {
    Document document;
    document.add_mesh(positions)["mode"] = mode;
    const TriangleMesh mesh = read(document);
    ASSERT_EQ(mesh.face.size(), 2U);
    EXPECT_NEAR(area(mesh), 1, 1e-12);
    for (std::size_t f = 0; f < 2; ++f) {
      const Vec3d a = corner(mesh, f, 0);
      EXPECT_GT((corner(mesh, f, 1) - a).cross(corner(mesh, f, 2) - a).z(), 0) << mode;
    }
  }
}

TEST(Gltf, IntegersOfAllKindsAndStridesAreRead) {
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  document.root["nodes"][0]["scale"] = {0.25, 0.25, 0.25};
  const std::vector<std::int8_t> bytes{0, 0, 0, 99, 4, 0, 0, 99, 0, 4, 0, 99};
  primitive["attributes"]["POSITION"] = document.accessor(bytes, "VEC4");
  document.root["accessors"].back()["type"] = "VEC3";
  document.root["bufferViews"].back()["byteStride"] = 4;
  primitive["attributes"]["NORMAL"] =
      document.accessor(std::vector<std::int8_t>{0, 0, 127, 0, 0, 127, 0, 0, 127}, "VEC3", true);
  primitive["attributes"]["TEXCOORD_0"] =
      document.accessor(std::vector<std::uint16_t>{0, 0, 65535, 0, 0, 65535}, "VEC2", true);
  primitive["indices"] = document.accessor(std::vector<std::uint8_t>{2, 0, 1}, "SCALAR");
  const TriangleMesh mesh = read(document);
  EXPECT_NEAR(area(mesh), 0.5, 1e-9);
  ASSERT_EQ(mesh.wedge_normal.size(), 1U);
  EXPECT_EQ(mesh.wedge_normal[0][0], Vec3f(0, 0, 1));
  ASSERT_EQ(mesh.wedge_uv.size(), 1U);
  EXPECT_EQ(mesh.wedge_uv[0][0], Vec2f(0, 0)) << "v is turned: the file's 1 is the last row";
  EXPECT_EQ(mesh.wedge_uv[0][1], Vec2f(0, 1));
  EXPECT_EQ(mesh.wedge_uv[0][2], Vec2f(1, 1));
}

TEST(Gltf, SparseAccessorsReplaceElements) {
  Document document;
  document.add_mesh(kTriangle);
  const std::size_t index = document.view(std::string("\2", 1));
  const std::array<float, 3> moved{0, 3, 0};
  const std::size_t values =
      document.view({reinterpret_cast<const char*>(moved.data()), sizeof(moved)});
  const json sparse = {{"count", 1},
                       {"indices", {{"bufferView", index}, {"componentType", 5121}}},
                       {"values", {{"bufferView", values}}}};
  document.root["accessors"][0]["sparse"] = sparse;
  EXPECT_NEAR(area(read(document)), 1.5, 1e-12);
  // Without bytes of its own the rest is zero: one corner of three has a place.
  document.root["accessors"][0].erase("bufferView");
  EXPECT_NE(failure(document).find("none of the 1 faces has an area"), std::string::npos);
  document.root["accessors"][0]["sparse"]["indices"]["componentType"] = 5123;
  EXPECT_NE(failure(document).find("has room for 0"), std::string::npos);
}

TEST(Gltf, SparseIndicesBeyondTheAccessorAreRefused) {
  Document document;
  document.add_mesh(kTriangle);
  const std::size_t index = document.view(std::string("\3", 1));
  const std::size_t values = document.view(std::string(12, '\0'));
  document.root["accessors"][0]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", index}, {"componentType", 5121}}},
      {"values", {{"bufferView", values}}}};
  EXPECT_NE(failure(document).find("accessors[0].sparse replaces element 3, but there are 3"),
            std::string::npos);
}

TEST(Gltf, NodesMoveTheirMeshesAndMirrorsKeepTheOutside) {
  Document document;
  document.add_mesh(kTetrahedron);
  // The parent turns x to y; the child is mirrored, twice as large, and moved.
  document.root["nodes"] = {
      {{"children", {1, 2}}, {"rotation", {0, 0, std::sqrt(0.5), std::sqrt(0.5)}}},
      {{"mesh", 0}, {"scale", {-2, 2, 2}}, {"translation", {10, 0, 0}}},
      {{"mesh", 0}, {"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1}}}};
  const TriangleMesh mesh = read(document);
  EXPECT_EQ(mesh.face.size(), 8U);
  EXPECT_NEAR(volume(mesh), 8.0 / 6 + 1.0 / 6, 1e-6);
  EXPECT_NEAR((low(mesh) - Vec3d(-2, 0, 0)).norm(), 0, 1e-6);
}

TEST(Gltf, OnlyTheDefaultSceneIsRead) {
  Document document;
  document.add_mesh(kTriangle);
  document.root["nodes"].push_back({{"mesh", 0}, {"translation", {0, 0, 1}}});
  document.root["scenes"].push_back({{"nodes", {1}}});
  document.root["scene"] = 1;
  const TriangleMesh mesh = read(document);
  EXPECT_EQ(mesh.face.size(), 1U);
  EXPECT_NEAR(low(mesh).z(), 1, 1e-12);
  ASSERT_EQ(mesh.notes.size(), 1U);
  EXPECT_EQ(mesh.notes[0], "has 2 scenes; scene 1 is read");
}

TEST(Gltf, CyclesAndSharedNodesAreRefused) {
  for (const json& nodes : {json::parse(R"([{"mesh": 0, "children": [0]}])"),
                            json::parse(R"([{"children": [1, 1]}, {"mesh": 0}])"),
                            json::parse(R"([{"children": [1]}, {"mesh": 0, "children": [0]}])")}) {
    Document document;
    document.add_mesh(kTriangle);
    document.root["nodes"] = nodes;
    EXPECT_NE(failure(document).find("has two parents, or itself among its descendants"),
              std::string::npos);
  }
}

TEST(Gltf, ManyInstancesStandWhereTheirAccessorsSay) {
  Document document;
  document.add_mesh(kTriangle);
  const std::size_t places =
      document.accessor(std::vector<float>{0, 0, 0, 0, 0, 2, 0, 0, 4}, "VEC3");
  document.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
      {"TRANSLATION", places}};
  document.root["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
  const TriangleMesh mesh = read(document);
  ASSERT_EQ(mesh.face.size(), 3U);
  EXPECT_EQ(corner(mesh, 2, 0).z(), 4);
}

TEST(Gltf, ASceneLargerThanMemoryIsRefused) {
  // Three million corners, a hundred thousand times: 300 thousand million in four megabytes.
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  primitive["indices"] = document.accessor(std::vector<std::uint8_t>(3000000, 0), "SCALAR");
  const std::size_t places = document.accessor(std::vector<float>(300000, 0), "VEC3");
  document.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
      {"TRANSLATION", places}};
  EXPECT_NE(failure(document).find("triangles do not fit into memory"), std::string::npos);
}

TEST(Gltf, AnimationsStandAtTheirFirstKey) {
  for (const bool spline : {false, true}) {
    Document document;
    document.add_mesh(kTriangle);
    const std::size_t times = document.accessor(std::vector<float>{0.5, 1}, "SCALAR");
    const std::vector<float> plain{0, 0, 7, 0, 0, 9};
    const std::vector<float> tangents{1, 1, 1, 0, 0, 7, 1, 1, 1, 1, 1, 1, 0, 0, 9, 1, 1, 1};
    const std::size_t places = document.accessor(spline ? tangents : plain, "VEC3");
    document.root["animations"] = {
        {{"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", "translation"}}}}}},
         {"samplers",
          {{{"input", times},
            {"output", places},
            {"interpolation", spline ? "CUBICSPLINE" : "LINEAR"}}}}}};
    EXPECT_EQ(low(read(document)).z(), 7);
  }
}

TEST(Gltf, MorphTargetsCountByTheirWeights) {
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  const std::size_t moved =
      document.accessor(std::vector<float>{0, 0, 4, 0, 0, 4, 0, 0, 4}, "VEC3");
  primitive["targets"] = {{{"POSITION", moved}}};
  EXPECT_EQ(low(read(document)).z(), 0);
  document.root["meshes"][0]["weights"] = {0.5};
  EXPECT_EQ(low(read(document)).z(), 2);
  document.root["nodes"][0]["weights"] = {0.25};
  EXPECT_EQ(low(read(document)).z(), 1);
}

TEST(Gltf, SkinsFollowTheirJoints) {
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  primitive["attributes"]["JOINTS_0"] =
      document.accessor(std::vector<std::uint8_t>{0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0}, "VEC4");
  primitive["attributes"]["WEIGHTS_0"] =
      document.accessor(std::vector<float>{1, 0, 0, 0, 0, 1, 0, 0, .5, .5, 0, 0}, "VEC4");
  const std::vector<float> identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  std::vector<float> bind = identity;
  bind.insert(bind.end(), identity.begin(), identity.end());
  bind[16 + 14] = -1;  // The second joint was bound at z = 1.
  document.root["skins"] = {
      {{"joints", {1, 2}}, {"inverseBindMatrices", document.accessor(bind, "MAT4")}}};
  // The node's own transform does not count.
  document.root["nodes"] = {{{"mesh", 0}, {"skin", 0}, {"translation", {50, 50, 50}}},
                            {{"translation", {0, 0, 3}}},
                            {{"translation", {0, 0, 6}}}};
  document.root["scenes"][0]["nodes"] = {0, 1, 2};
  const TriangleMesh mesh = read(document);
  EXPECT_EQ(corner(mesh, 0, 0), Vec3d(0, 0, 3));
  EXPECT_EQ(corner(mesh, 0, 1), Vec3d(1, 0, 5));
  EXPECT_EQ(corner(mesh, 0, 2), Vec3d(0, 1, 4));
}

/// A textured triangle whose material the caller describes.
Document textured(const json& material) {
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  primitive["attributes"]["TEXCOORD_0"] =
      document.accessor(std::vector<float>{0, 0, 1, 0, 0, 1}, "VEC2");
  primitive["attributes"]["TEXCOORD_1"] =
      document.accessor(std::vector<float>{.5, .5, .5, .25, .25, .25}, "VEC2");
  primitive["material"] = 0;
  document.root["images"] = {{{"name", "picture"},
                              {"mimeType", "image/png"},
                              {"bufferView", document.view("no image, but bytes")}}};
  document.root["samplers"] = {{{"wrapS", 33071}, {"wrapT", 33071}}};
  document.root["textures"] = {{{"source", 0}, {"sampler", 0}}};
  document.root["materials"] = json::array({material});
  return document;
}

TEST(Gltf, MaterialsKeepColorImageWrapAndAlpha) {
  const TriangleMesh mesh = read(textured(
      {{"name", "leaf"},
       {"alphaMode", "MASK"},
       {"alphaCutoff", 0.3},
       {"pbrMetallicRoughness",
        {{"baseColorFactor", {0.5, 0.25, 1, 0.5}}, {"baseColorTexture", {{"index", 0}}}}}}));
  ASSERT_EQ(mesh.material.size(), 1U);
  const MeshMaterial& material = mesh.material[0];
  EXPECT_EQ(material.name, "leaf");
  EXPECT_EQ(material.texture, "mesh.glb: images[0] 'picture'");
  EXPECT_EQ(material.texture_factor, Vec3f(0.5F, 0.25F, 1));
  EXPECT_EQ(material.wrap, WrapMode::kClamp);
  EXPECT_EQ(material.texture_alpha, TextureAlpha::kMask);
  EXPECT_FLOAT_EQ(material.alpha_cutoff, 0.6F);
  EXPECT_EQ(material.opacity, 1);
  ASSERT_EQ(mesh.embedded.size(), 1U);
  EXPECT_EQ(mesh.embedded[0].name, material.texture);
  EXPECT_EQ(as_text(std::span(mesh.embedded[0].bytes->data(), mesh.embedded[0].bytes->size())),
            "no image, but bytes");
}

TEST(Gltf, OpaqueMaterialsHaveNoAlphaAndBlendedOnesTheirOwn) {
  const auto material = [](const char* mode) {
    return read(textured({{"alphaMode", mode},
                          {"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 1, 0.25}}}}}))
        .material[0];
  };
  EXPECT_EQ(material("OPAQUE").opacity, 1);
  EXPECT_EQ(material("OPAQUE").texture_alpha, TextureAlpha::kNothing);
  EXPECT_EQ(material("BLEND").opacity, 0.25F);
  EXPECT_EQ(material("BLEND").texture_alpha, TextureAlpha::kOpacity);
  EXPECT_EQ(material("MASK").opacity, 0) << "0.25 is less than the cutoff 0.5";
}

TEST(Gltf, TextureTransformsMoveTheCoordinates) {
  const double angle = std::numbers::pi / 2;
  const TriangleMesh mesh = read(
      textured({{"pbrMetallicRoughness",
                 {{"baseColorTexture",
                   {{"index", 0},
                    {"extensions",
                     {{"KHR_texture_transform",
                       {{"offset", {0.5, 0.25}}, {"rotation", angle}, {"scale", {2, 4}}}}}}}}}}}));
  ASSERT_EQ(mesh.wedge_uv.size(), 1U);
  // The extension's matrix: (u, v) -> offset + (4 v, -2 u) for a quarter turn.
  EXPECT_NEAR((mesh.wedge_uv[0][0] - Vec2f(0.5F, 1 - 0.25F)).norm(), 0, 1e-6);
  EXPECT_NEAR((mesh.wedge_uv[0][1] - Vec2f(0.5F, 1 - (0.25F - 2))).norm(), 0, 1e-6);
  EXPECT_NEAR((mesh.wedge_uv[0][2] - Vec2f(4.5F, 1 - 0.25F)).norm(), 0, 1e-6);
}

TEST(Gltf, TheMaterialChoosesTheSetOfCoordinates) {
  const TriangleMesh mesh = read(textured(
      {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}, {"texCoord", 1}}}}}}));
  EXPECT_EQ(mesh.wedge_uv.at(0)[1], Vec2f(0.5F, 0.75F));
}

TEST(Gltf, UnlitGlowingAndGlossyMaterials) {
  const auto material = [](const json& described) { return read(textured(described)).material[0]; };
  EXPECT_TRUE(material({{"extensions", {{"KHR_materials_unlit", json::object()}}}}).unlit);
  const MeshMaterial glowing =
      material({{"pbrMetallicRoughness", {{"baseColorFactor", {0, 0, 0, 1}}}},
                {"emissiveFactor", {0.5, 0, 0}},
                {"emissiveTexture", {{"index", 0}}}});
  EXPECT_TRUE(glowing.unlit);
  EXPECT_EQ(glowing.texture_factor, Vec3f(0.5F, 0, 0));
  EXPECT_FALSE(glowing.texture.empty());
  const MeshMaterial glossy =
      material({{"extensions",
                 {{"KHR_materials_pbrSpecularGlossiness",
                   {{"diffuseFactor", {0, 1, 0, 1}}, {"diffuseTexture", {{"index", 0}}}}}}}});
  EXPECT_EQ(glossy.diffuse, Vec3f(0, 1, 0));
  EXPECT_FALSE(glossy.texture.empty());
  EXPECT_FALSE(glossy.unlit);
}

TEST(Gltf, VertexColorsMultiplyTheMaterials) {
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  primitive["attributes"]["COLOR_0"] = document.accessor(
      std::vector<std::uint8_t>{255, 0, 0, 9, 255, 0, 0, 9, 255, 0, 0, 9}, "VEC4", true);
  primitive["material"] = 0;
  document.root["materials"] = {{{"pbrMetallicRoughness", {{"baseColorFactor", {.5, .5, .5, 1}}}}}};
  const TriangleMesh mesh = read(document);
  ASSERT_EQ(mesh.color.size(), 3U);
  EXPECT_EQ(mesh.color[0], Vec3f(1, 0, 0));
  EXPECT_EQ(mesh.color_at(0, {1, 0, 0}), Vec3f(0.5F, 0, 0));
}

TEST(Gltf, PointsAndLinesAreLeftOut) {
  Document document;
  document.add_mesh(kTriangle);
  document.root["meshes"][0]["primitives"].push_back(document.root["meshes"][0]["primitives"][0]);
  document.root["meshes"][0]["primitives"][1]["mode"] = 1;
  const TriangleMesh mesh = read(document);
  EXPECT_EQ(mesh.face.size(), 1U);
  EXPECT_EQ(mesh.notes, std::vector<std::string>{"1 parts are points or lines and left out"});
  document.root["meshes"][0]["primitives"][0]["mode"] = 0;
  EXPECT_NE(failure(document).find("only points or lines"), std::string::npos);
}

/// A square of two triangles, compressed by Draco.
std::string draco_square(bool edgebreaker) {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(2);
  const int position =
      builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int uv = builder.AddAttribute(draco::GeometryAttribute::TEX_COORD, 2, draco::DT_FLOAT32);
  const std::array<std::array<float, 3>, 4> p{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}};
  for (const auto& [face, c] :
       {std::pair(0U, std::array{0, 1, 2}), std::pair(1U, std::array{0, 2, 3})}) {
    builder.SetAttributeValuesForFace(position, draco::FaceIndex(face), p[c[0]].data(),
                                      p[c[1]].data(), p[c[2]].data());
    builder.SetAttributeValuesForFace(uv, draco::FaceIndex(face), p[c[0]].data(), p[c[1]].data(),
                                      p[c[2]].data());
  }
  draco::Encoder encoder;
  encoder.SetEncodingMethod(edgebreaker ? draco::MESH_EDGEBREAKER_ENCODING
                                        : draco::MESH_SEQUENTIAL_ENCODING);
  draco::EncoderBuffer coded;
  EXPECT_TRUE(encoder.EncodeMeshToBuffer(*builder.Finalize(), &coded).ok());
  return {coded.data(), coded.size()};
}

Document draco_document(const std::string& coded) {
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  primitive["attributes"]["TEXCOORD_0"] = 0;
  primitive["indices"] = 0;
  primitive["extensions"]["KHR_draco_mesh_compression"] = {
      {"bufferView", document.view(coded)}, {"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 1}}}};
  document.root["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  return document;
}

TEST(Gltf, DracoIsDecoded) {
  for (const bool edgebreaker : {false, true}) {
    const TriangleMesh mesh = read(draco_document(draco_square(edgebreaker)));
    EXPECT_EQ(mesh.face.size(), 2U);
    EXPECT_NEAR(area(mesh), 1, 1e-3);
    for (std::size_t f = 0; f < 2; ++f) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d p = corner(mesh, f, k);
        EXPECT_NEAR((mesh.wedge_uv.at(f)[k] - Vec2f(p.x(), 1 - p.y()).cast<float>()).norm(), 0,
                    1e-2);
      }
    }
  }
}

TEST(Gltf, DamagedDracoIsRefused) {
  const std::string whole = draco_square(true);
  for (std::size_t size = 0; size < whole.size(); size += 3) {
    EXPECT_NE(failure(draco_document(whole.substr(0, size))).find("KHR_draco_mesh_compression"),
              std::string::npos)
        << size;
  }
  // A header that counts billions of points.
  const std::string huge("DRACO\2\2\1\0\0\0\xff\xff\xff\xff\x0f\xff\xff\xff\xff\x0f", 21);
  EXPECT_NE(failure(draco_document(huge)).find("is damaged"), std::string::npos);
}

TEST(Gltf, UnknownRequiredExtensionsAreRefusedByName) {
  Document document;
  document.add_mesh(kTriangle);
  document.root["extensionsRequired"] = {"KHR_materials_clearcoat"};
  EXPECT_EQ(read(document).face.size(), 1U);
  document.root["extensionsRequired"] = {"KHR_texture_basisu"};
  EXPECT_NE(failure(document).find("needs the extension 'KHR_texture_basisu'"), std::string::npos);
}

TEST(Gltf, DamagedContainersAreRefused) {
  Document document;
  document.add_mesh(kTriangle);
  const std::string glb = document.glb();
  // Each length has bytes missing, of the header, the JSON, or the buffer.
  for (std::size_t size = 4; size < glb.size(); size += 7) {
    EXPECT_NE(failure(glb.substr(0, size)).find("truncated"), std::string::npos) << size;
  }
  std::string longer = glb;
  longer.replace(12, 4, u32(1U << 31));
  EXPECT_NE(failure(longer).find("truncated"), std::string::npos);
  std::string old = glb;
  old[4] = 1;
  EXPECT_NE(failure(old).find("only version 2 is read"), std::string::npos);
  EXPECT_NE(failure("glTF" + u32(2) + u32(12)).find("no part with JSON"), std::string::npos);
  EXPECT_NE(failure("{\"asset\": {\"version\": \"1.0\"}}", "m.gltf").find("only glTF 2.0"),
            std::string::npos);
  EXPECT_NE(failure("{\n\n\"asset\": ]", "m.gltf").find("line 3: is not valid JSON"),
            std::string::npos);
  EXPECT_NE(failure("[1e999]", "m.gltf").find("beyond all bounds"), std::string::npos);
  EXPECT_NE(failure(std::string(1000, '['), "m.gltf").find("more than 64 others"),
            std::string::npos);
}

/// A parser that looks through all values of an array after each takes 19 seconds.
TEST(Gltf, ThousandsOfSiblingsTakeNoTime) {
  Document document;
  document.add_mesh(kTriangle);
  constexpr std::size_t kNodes = 40000;
  std::vector<std::size_t> children(kNodes);
  std::iota(children.begin(), children.end(), std::size_t{1});
  document.root["nodes"] = {{{"children", children}}};
  for (std::size_t i = 0; i < kNodes; ++i) document.root["nodes"].push_back({{"mesh", 0}});
  const std::string text = document.text();
  const Timer timer;
  EXPECT_EQ(read_bytes(text, "m.gltf").face.size(), kNodes);
  EXPECT_LT(timer.milliseconds(), 5000);
  // Brackets in texts make nothing deep.
  document.root["asset"]["generator"] = std::string(1000, '[') + "\"\\" + std::string(1000, '{');
  document.root["nodes"] = {{{"mesh", 0}}};
  EXPECT_EQ(read_bytes(document.text(), "m.gltf").face.size(), 1U);
}

TEST(Gltf, WhatDoesNotFitIsRefusedWithItsPlace) {
  using Change = std::function<void(json&)>;
  const std::vector<std::pair<Change, const char*>> cases{
      {[](json& r) { r["accessors"][0]["count"] = 4; }, "has 4 elements, but bufferViews[0]"},
      {[](json& r) { r["accessors"][0]["count"] = 1ULL << 62; }, "accessors[0].count is"},
      {[](json& r) { r["accessors"][0]["count"] = -1; }, "accessors[0].count is -1"},
      {[](json& r) { r["accessors"][0]["count"] = 0.5; }, "accessors[0].count is 0.5"},
      {[](json& r) { r["accessors"][0].erase("count"); }, "accessors[0].count is missing"},
      {[](json& r) { r["accessors"][0]["byteOffset"] = 4; }, "has room for 2"},
      {[](json& r) { r["accessors"][0]["byteOffset"] = 1ULL << 52; }, "has room for 0"},
      {[](json& r) { r["accessors"][0]["componentType"] = 5124; }, "componentType is 5124"},
      {[](json& r) { r["accessors"][0]["type"] = "MAT3"; }, "accessors[0].type is 'MAT3'"},
      {[](json& r) { r["accessors"][0]["type"] = "VEC2"; }, "elements of 2 components"},
      {[](json& r) { r["accessors"][0]["bufferView"] = 7; }, "is 7, but there are 1 bufferViews"},
      {[](json& r) { r["bufferViews"][0]["byteStride"] = 0; }, "byteStride is 0, less than"},
      {[](json& r) { r["bufferViews"][0]["byteLength"] = 37; }, "bufferViews[0] is 37 bytes"},
      {[](json& r) { r["bufferViews"][0]["byteOffset"] = 1ULL << 52; }, "but the buffer has 36"},
      {[](json& r) { r["bufferViews"][0]["buffer"] = 1; }, "is 1, but there are 1 buffers"},
      {[](json& r) { r["buffers"][0]["byteLength"] = 40; }, "has 36 bytes, 40 are promised"},
      {[](json& r) { r["buffers"][0]["uri"] = "data:;base64,????"; }, "is no base64 data"},
      {[](json& r) { r["buffers"][0]["uri"] = "https://example.com/a.bin"; }, "buffers[0].uri"},
      {[](json& r) { r["nodes"][0]["mesh"] = "0"; }, "nodes[0].mesh is a string"},
      {[](json& r) {
         r["nodes"][0]["translation"] = {1, 2};
       },
       "an array of 3 numbers"},
      {[](json& r) {
         r["nodes"][0]["scale"] = {1e300, 1e300, 1e300};
       },
       "1e+300 is beyond single precision"},
      {[](json& r) { r["nodes"] = 3; }, "nodes is 3, and must be an array"},
      {[](json& r) { r["scene"] = 1; }, "scene is 1, but there are 1"},
      {[](json& r) { r["scenes"][0]["nodes"] = {5}; }, "node 5 is named"},
      {[](json& r) { r["meshes"][0]["primitives"][0]["attributes"] = json::object(); }, "POSITION"},
      {[](json& r) { r["meshes"][0]["primitives"][0]["material"] = 0; }, "there are 0 materials"},
      {[](json& r) {
         r["accessors"][0]["sparse"] = {{"count", 1ULL << 52}};
       },
       "sparse"},
      {[](json& r) {
         r["accessors"][0].erase("bufferView");
         r["accessors"][0]["count"] = 1ULL << 20;
       },
       "promises 1048576 elements"}};
  for (const auto& [change, message] : cases) {
    Document document;
    document.add_mesh(kTriangle);
    json root = document.with_buffer();
    change(root);
    const std::string found = failure(document.glb_of(root.dump()));
    EXPECT_NE(found.find(message), std::string::npos) << message << " in: " << found;
  }
}

TEST(Gltf, IndicesBeyondTheVerticesAreRefused) {
  Document document;
  json& primitive = document.add_mesh(kTriangle);
  primitive["indices"] = document.accessor(std::vector<std::uint16_t>{0, 1, 3}, "SCALAR");
  EXPECT_NE(failure(document).find("names vertex 3, but there are 3"), std::string::npos);
}

TEST(Gltf, RealFiles) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = test::data_folder() / "formats/gltf";
  struct Expected {
    const char* file;
    std::size_t vertices;
    std::size_t faces;
    double area;
  };
  for (const Expected& expected :
       {Expected{"BoxInterleaved.glb", 8, 12, 6}, Expected{"BoxTextured.glb", 8, 12, 6},
        Expected{"BoxTextured_meshopt.glb", 8, 12, 6}, Expected{"cubevc.glb", 26, 48, 24},
        Expected{"nested.glb", 24, 36, 0}, Expected{"Duck.glb", 2108, 4212, 0}}) {
    const TriangleMesh mesh = read_mesh((folder / expected.file).string());
    EXPECT_EQ(mesh.position.size(), expected.vertices) << expected.file;
    EXPECT_EQ(mesh.face.size(), expected.faces) << expected.file;
    if (expected.area > 0) {
      EXPECT_NEAR(area(mesh) / expected.area, 1, 1e-3) << expected.file;
    }
    EXPECT_GT(volume(mesh), 0) << expected.file;
  }
  const std::string infinite =
      test::message_of([&] { read_mesh((folder / "BoxWithInfinites.glb").string()); });
  EXPECT_NE(infinite.find("not a finite number"), std::string::npos) << infinite;
}

/// Compressed or not, the box is the same.
TEST(Gltf, MeshoptIsDecoded) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::filesystem::path folder = test::data_folder() / "formats/gltf";
  const TriangleMesh plain = read_mesh((folder / "BoxTextured.glb").string());
  const TriangleMesh coded = read_mesh((folder / "BoxTextured_meshopt.glb").string());
  const auto corners = [](const TriangleMesh& mesh) {
    // Place, normal and texture coordinates of all corners, in a unique order.
    std::vector<std::array<long, 8>> all;
    for (std::size_t f = 0; f < mesh.face.size(); ++f) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d p = corner(mesh, f, k);
        const Vec3f& n = mesh.wedge_normal.at(f)[k];
        const Vec2f& uv = mesh.wedge_uv.at(f)[k];
        std::array<long, 8> rounded{};
        for (int i = 0; i < 3; ++i) rounded[i] = std::lround(p[i] * 100);
        for (int i = 0; i < 3; ++i) rounded[i + 3] = std::lround(n[i] * 20);
        for (int i = 0; i < 2; ++i) rounded[i + 6] = std::lround(uv[i] * 100);
        all.push_back(rounded);
      }
    }
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
  };
  EXPECT_EQ(corners(plain), corners(coded));
}

}  // namespace
}  // namespace surfel
