#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/named_file.h>
#include <surfel/io/scene_file.h>
#include <surfel/io/volume_io.h>
#include <surfel/render/environment_map.h>
#include <surfel/scene/image.h>
#include <surfel/texture/texture_source.h>
#include <sys/stat.h>
#include <unistd.h>

#include "io/splat_files.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

/// Ends the process where a test waits for a pipe.
struct Watchdog {
  Watchdog() { alarm(60); }
  ~Watchdog() { alarm(0); }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;
};

struct AllowOutside {
  AllowOutside() { allow_outside(true); }
  ~AllowOutside() { allow_outside(false); }
  AllowOutside(const AllowOutside&) = delete;
  AllowOutside& operator=(const AllowOutside&) = delete;
};

void put(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

/// A picture of 2 x 1 pixels as PNG.
std::string picture() {
  const TemporaryFolder folder;
  Image image = rgba_image(2, 1);
  image.data.assign(8, 1);
  write_image(image, folder / "a.png");
  return read_text(folder / "a.png");
}

/// Three corners of a triangle, and their texture coordinates.
std::string triangle() {
  const std::vector<float> numbers{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1};
  return {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(float)};
}

const std::string kNrrd =
    "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 3 2\nencoding: raw\ndata file: ";
const std::string kGzippedNrrd =
    "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 3 2\nencoding: gzip\ndata file: ";
const std::string kMetaImage = "NDims = 3\nDimSize = 2 3 2\nElementType = MET_UCHAR\n";
const std::string kValues = "abcdefghijkl";

void load_volume(const std::string& path) {
  const Volume volume = read_volume(path);
  ASSERT_EQ(volume.value.size(), kValues.size());
  for (std::size_t i = 0; i < kValues.size(); ++i) EXPECT_EQ(volume.value[i], kValues[i]);
}

void load_mesh(const std::string& path) {
  const TriangleMesh mesh = read_mesh(path);
  EXPECT_EQ(load_textures({}, &mesh, path).maps.size(), 1U);
}

/// JSON of a triangle with a texture.
std::string gltf(const std::string& buffer, const std::string& image) {
  return R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{
    "primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}]}],"materials":[{
    "pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],
    "images":[{"uri":")" +
         image + R"("}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
    {"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}],"bufferViews":[
    {"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24}],
    "buffers":[{"byteLength":60,"uri":")" +
         buffer + R"("}]})";
}

/// A kind of file that names others.
struct Naming {
  const char* kind;
  std::string content;  ///< Of a file that may be named.
  /// Writes a file that names `name` to a folder and reads it, with all that it names.
  std::function<void(const std::string& folder, const std::string& name)> read;
};

std::ostream& operator<<(std::ostream& out, const Naming& naming) { return out << naming.kind; }

std::vector<Naming> all_namings() {
  const std::string corners =
      "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
  const std::string ply =
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float u\n"
      "property float v\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
      "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
  const auto quoted = [](std::string name) {
    for (std::size_t at = 0; (at = name.find('\\', at)) != std::string::npos; at += 2) {
      name.insert(at, 1, '\\');
    }
    return name;
  };
  return {
      {"MTL", "newmtl m\n",
       [=](const std::string& folder, const std::string& name) {
         put(folder + "/a.obj", "mtllib " + name + "\n" + corners);
         const TriangleMesh mesh = read_mesh(folder + "/a.obj");
         if (!mesh.notes.empty()) throw_input(folder + "/a.obj", mesh.notes.front());
       }},
      {"map_Kd", picture(),
       [=](const std::string& folder, const std::string& name) {
         put(folder + "/m.mtl", "newmtl m\nmap_Kd " + name + "\n");
         put(folder + "/a.obj", "mtllib m.mtl\n" + corners);
         load_mesh(folder + "/a.obj");
       }},
      {"TextureFile", picture(),
       [=](const std::string& folder, const std::string& name) {
         put(folder + "/a.ply", "ply\nformat ascii 1.0\ncomment TextureFile " + name + "\n" + ply);
         load_mesh(folder + "/a.ply");
       }},
      {"NRRD", kValues,
       [](const std::string& folder, const std::string& name) {
         put(folder + "/a.nhdr", kNrrd + name + "\n");
         load_volume(folder + "/a.nhdr");
       }},
      {"gzipped NRRD", gzipped(kValues),
       [](const std::string& folder, const std::string& name) {
         put(folder + "/a.nhdr", kGzippedNrrd + name + "\n");
         load_volume(folder + "/a.nhdr");
       }},
      {"MetaImage", kValues,
       [](const std::string& folder, const std::string& name) {
         put(folder + "/a.mhd", kMetaImage + "ElementDataFile = " + name + "\n");
         load_volume(folder + "/a.mhd");
       }},
      {"environment", picture(),
       [=](const std::string& folder, const std::string& name) {
         put(folder + "/a.toml", "[environment]\nimage = \"" + quoted(name) + "\"\n");
         Scene scene = read_scene(folder + "/a.toml");
         load_environment(scene);
       }},
      {"glTF's buffer", triangle(),
       [=](const std::string& folder, const std::string& name) {
         put(folder + "/skin", picture());
         put(folder + "/a.gltf", gltf(quoted(name), "skin"));
         load_mesh(folder + "/a.gltf");
       }},
      {"glTF's image", picture(),
       [=](const std::string& folder, const std::string& name) {
         put(folder + "/shape", triangle());
         put(folder + "/a.gltf", gltf("shape", quoted(name)));
         load_mesh(folder + "/a.gltf");
       }},
  };
}

/// The folder `in` holds the naming file.
class NamedFiles : public testing::TestWithParam<Naming> {
 protected:
  NamedFiles() {
    fs::create_directories(in_ + "/below");
    put(in_ + "/there", GetParam().content);
    put(in_ + "/below/deep", GetParam().content);
    put(folder_ / "outer", GetParam().content);
    fs::create_symlink("../outer", in_ + "/link");
    fs::create_symlink("there", in_ + "/link inside");
    EXPECT_EQ(mkfifo((in_ + "/pipe").c_str(), 0600), 0);
  }
  /// The message of a file that names `name`; empty if what it names was read.
  std::string message(const std::string& name) const {
    const std::string text = message_of([&] { GetParam().read(in_, name); });
    EXPECT_TRUE(text.empty() || text.starts_with(in_ + "/")) << text;
    return text;
  }

  const Watchdog watchdog_;
  const TemporaryFolder folder_;
  const std::string in_ = folder_ / "in";
};

TEST_P(NamedFiles, AreReadInTheFolderAndBelow) {
  for (const char* const name : {"there", "./there", "below/deep", "below\\deep", "below/../there",
                                 "THERE", "link inside"}) {
    EXPECT_EQ(message(name), "") << name;
  }
  EXPECT_EQ(message(in_ + "/below/deep"), "");
}

TEST_P(NamedFiles, OfOtherMachinesAreFoundBesideTheFile) {
  for (const char* const name :
       {"/home/artist/there", "../../there", "C:\\artist\\there", "D:there", "..\\work\\there"}) {
    EXPECT_EQ(message(name), "") << name;
  }
}

TEST_P(NamedFiles, BesideTheFileCountBeforeOnesOutside) {
  put(folder_ / "there", "wrong");
  EXPECT_EQ(message("../there"), "");
  const AllowOutside allowed;
  EXPECT_EQ(message("../there"), "");
  EXPECT_EQ(message(folder_ / "there"), "");
}

TEST_P(NamedFiles, OutsideNeedPermission) {
  const std::vector<std::string> names{"../outer", folder_ / "outer", "link", "..\\outer"};
  for (const std::string& name : names) {
    EXPECT_NE(message(name).find("lies outside of this file's folder and is read only with "
                                 "`allow_outside`"),
              std::string::npos)
        << name << ": " << message(name);
  }
  EXPECT_NE(message("/etc/passwd").find("/etc/passwd"), std::string::npos);
  EXPECT_NE(message("/etc/passwd").find("outside"), std::string::npos);
  EXPECT_EQ(message("../nowhere").find("is not there"), std::string::npos)
      << "what is outside is not looked at";
  const AllowOutside allowed;
  for (const std::string& name : names) EXPECT_EQ(message(name), "") << name;
}

TEST_P(NamedFiles, PipesDevicesAndFoldersAreRefused) {
  EXPECT_NE(message("pipe").find("is no regular file"), std::string::npos) << message("pipe");
  EXPECT_NE(message("/dev/zero").find("outside"), std::string::npos) << message("/dev/zero");
  EXPECT_NE(message("below").find("is not there"), std::string::npos) << message("below");
  EXPECT_NE(message("gone").find("is not there"), std::string::npos) << message("gone");
  const AllowOutside allowed;
  EXPECT_NE(message("/dev/zero").find("is no regular file"), std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(Kinds, NamedFiles, testing::ValuesIn(all_namings()));

TEST(NamedFile, OpeningDoesNotWaitForAPipe) {
  const Watchdog watchdog;
  const TemporaryFolder folder;
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_NE(message_of([&] { InputFile(folder / "pipe", true); }).find("is no regular file"),
            std::string::npos);
  EXPECT_NE(message_of([&] { InputFile("/dev/zero", true); }).find("is no regular file"),
            std::string::npos);
}

TEST(NamedFile, NoMoreIsReadThanIsPromised) {
  for (const Naming& naming : all_namings()) {
    const std::string kind = naming.kind;
    const bool promises =
        kind.find("NRRD") != std::string::npos || kind == "MetaImage" || kind == "glTF's buffer";
    if (!promises) continue;
    const TemporaryFolder folder;
    put(folder / "data", naming.content);
    fs::resize_file(folder / "data", std::uintmax_t{1} << 40);
    EXPECT_EQ(message_of([&] { naming.read(folder / ".", "data"); }), "") << kind;
    if (kind == "MetaImage") {
      const std::string far = kMetaImage + "CompressedData = True\nHeaderSize = 549755813888\n" +
                              "ElementDataFile = data\n";
      put(folder / "far.mhd", far);
      const std::string message = message_of([&] { read_volume(folder / "far.mhd"); });
      EXPECT_NE(message.find("compressed data is damaged"), std::string::npos) << message;
    }
    fs::resize_file(folder / "data", 11);
    EXPECT_NE(message_of([&] { naming.read(folder / ".", "data"); }), "") << kind;
  }
}

}  // namespace
}  // namespace surfel::test
