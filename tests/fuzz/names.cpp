#include <array>
#include <climits>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include <surfel/base/error.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/named_file.h>
#include <surfel/io/scene_file.h>
#include <surfel/io/volume_io.h>
#include <surfel/texture/texture_source.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include "fuzz/checks.h"
#include "support/test_data.h"

namespace surfel::fuzz {
namespace {

namespace fs = std::filesystem;

/// What the files hold that may be read: voxels, or coordinates of a triangle.
constexpr std::string_view kInside = "<<=====<<===<===<===<===<<==<<==<<==<===========";

/// A folder `in` with files that may be named, links and what is no file, beside a folder `out`
/// whose files must not be opened.
class NamedFiles {
 public:
  NamedFiles() {
    fs::create_directories(in() + "/sub");
    fs::create_directory(out());
    for (const char* name : {"/data.raw", "/Data.RAW", "/sub/data.raw", "/sub/a b.png"}) {
      std::ofstream(in() + name) << kInside;
    }
    std::ofstream(in() + "/m.mtl") << "newmtl m\nmap_Kd data.raw\n";
    for (const char* name : {"/data.raw", "/secret.raw", "/m.mtl"}) {
      std::ofstream(out() + name) << "newmtl m\nmap_Kd ../out/secret.raw\n";
    }
    fs::create_symlink("sub/data.raw", in() + "/good");
    fs::create_symlink("../out/secret.raw", in() + "/link");
    fs::create_symlink(out() + "/secret.raw", in() + "/whole");
    fs::create_symlink("../out", in() + "/away");
    fs::create_symlink("loop", in() + "/loop");
    fs::create_symlink("/dev/zero", in() + "/zero");
    require(mkfifo((in() + "/pipe").c_str(), S_IRWXU) == 0, "no pipe");
    watch_ = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    require(watch_ >= 0 && inotify_add_watch(watch_, out().c_str(), IN_OPEN | IN_ACCESS) >= 0,
            "opened files cannot be watched");
  }
  ~NamedFiles() { close(watch_); }
  NamedFiles(const NamedFiles&) = delete;
  NamedFiles& operator=(const NamedFiles&) = delete;

  const std::string& root() const { return root_; }
  std::string in() const { return root_ + "/in"; }
  std::string out() const { return root_ + "/out"; }

  /// Throws a Finding where a file of the folder `out` has been opened since the last call.
  void require_untouched() const {
    alignas(inotify_event) std::array<char, 4096> events{};
    const ssize_t got = read(watch_, events.data(), events.size());
    for (ssize_t at = 0; at < got;) {
      const auto* event = reinterpret_cast<const inotify_event*>(events.data() + at);
      require((event->mask & IN_ISDIR) != 0, "a file outside of the folder was opened");
      at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
    }
  }

 private:
  test::TemporaryFolder folder_;
  const std::string root_ = fs::canonical(folder_ / ".").string();
  int watch_ = -1;
};

/// Opens what a file names, as readers do.
void open_name(const NamedFiles& files, const std::string& naming, const std::string& path) {
  const InputFile file = open_named(naming, path);
  const std::string real = fs::canonical(path).string();
  require(real.starts_with(files.in() + "/"), "a name leads out of the folder");
  require(fs::is_regular_file(real), "a name leads to what is no regular file");
  file.bytes();
}

/// Reads a mesh with the images of its materials.
void read_named_mesh(const std::string& path, std::string_view text) {
  const TriangleMesh mesh = read_mesh({path, std::as_bytes(std::span(text.data(), text.size()))});
  for (const MeshMaterial& material : mesh.material) {
    if (!material.texture.empty()) material_image(mesh, material, material.texture, path).bytes();
  }
}

void read_named_volume(const std::string& path, std::string_view text) {
  const Volume volume = read_volume({path, std::as_bytes(std::span(text.data(), text.size()))});
  for (const float value : volume.value) {
    require(value == '<' || value == '=', "a volume has other values than the files inside");
  }
}

/// The JSON of a triangle whose corners are in a file of this name, short since its parser takes
/// most of the time.
std::string gltf(const std::string& buffer, const std::string& more) {
  const std::string material = more.empty() ? "" : R"(,"material":0)";
  return R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{
      "primitives":[{"attributes":{"POSITION":0})" +
         material + R"(}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,
      "type":"VEC3"}],"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,
      "uri":")" +
         buffer + R"("}])" + more + "}";
}

}  // namespace

/// The first byte is a kind of file that names others, the others are the name and what follows in
/// the file; in these, the byte 1 stands for the path of a folder. Nothing outside of the file's
/// folder is opened, and all ends well or with a message that names the file.
void names(Bytes bytes) {
  static const NamedFiles files;
  if (bytes.empty()) return;
  // Half of the kinds do no more than open the file, which takes a fifth of the time.
  const auto kind = std::to_integer<unsigned>(bytes.front()) % 16;
  std::string name;
  for (const char c : as_text(bytes.subspan(1))) {
    if (c == '\1') {
      name += files.root();
    } else {
      name += c;
    }
  }
  const std::string file = files.in() + "/file";
  const std::string corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
  try {
    switch (kind) {
      case 1:
        read_named_volume(
            file + ".nhdr",
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 3\nencoding: raw\ndata file: " + name);
        break;
      case 2:
        // Then the values follow in the file itself.
        if (name.find("LOCAL") != std::string::npos) break;
        read_named_volume(file + ".mhd",
                          "NDims = 3\nDimSize = 4 4 3\nElementType = MET_UCHAR\n"
                          "ElementDataFile = " +
                              name);
        break;
      case 3:
        read_named_mesh(file + ".obj", "mtllib " + name + "\n" + corners);
        break;
      case 4:
        read_named_mesh(
            file + ".ply",
            "ply\nformat ascii 1.0\ncomment TextureFile " + name +
                "\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                "property float u\nproperty float v\nelement face 1\n"
                "property list uchar int vertex_indices\nend_header\n"
                "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n");
        break;
      case 5:
        read_named_mesh(file + ".gltf", gltf(name, ""));
        break;
      case 6:
        read_named_mesh(file + ".gltf", gltf("data.raw", R"(,"images":[{"uri":")" + name + R"("}],
                "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],
                "textures":[{"source":0}])"));
        break;
      case 7: {
        const std::string text = "[environment]\nimage = \"" + name + "\"\n";
        const Scene scene =
            read_scene({file + ".toml", std::as_bytes(std::span(text.data(), text.size()))});
        const std::string image = scene.environment ? scene.environment->image : kSkyName;
        if (image != kSkyName) open_name(files, scene.environment->named_by, image);
        break;
      }
      default:
        open_name(files, file, named_path(file, name));
    }
  } catch (const Error& error) {
    require(std::string_view(error.what()).find(files.in()) != std::string_view::npos,
            std::string("a message does not name a file of the folder: ") + error.what());
  }
  files.require_untouched();
}

}  // namespace surfel::fuzz
