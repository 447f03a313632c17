#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_builder.h>
#include <surfel/io/mtl.h>
#include <surfel/io/named_file.h>
#include <surfel/io/obj.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

constexpr float kWhite = 1;

/// MeshLab, ZBrush and Blender write colours as they are displayed; a value that is no number
/// leaves the vertex white.
float decode_color(double encoded) {
  return std::isfinite(encoded) ? srgb_to_linear(static_cast<float>(encoded)) : kWhite;
}

/// Names of material files that are looked for. Each search reads the folder, which may hold many
/// files; meshes name a few.
constexpr std::size_t kMostLibraries = 1024;

class ObjReader {
 public:
  explicit ObjReader(const InputFile& file)
      : in_(file.name(), as_text(file.bytes()), kMeshText), file_(file.name()), mesh_(file_) {}

  TriangleMesh read() {
    for (; in_.skip_to_content(); in_.next_line()) read_line();
    check_reach(vertex_reach_, mesh_.position.size(), "vertex", "vertices");
    check_reach(uv_reach_, mesh_.uv.size(), "texture coordinate", "texture coordinates");
    check_reach(normal_reach_, mesh_.normal.size(), "normal", "normals");
    if (!mesh_.color.empty()) mesh_.color.resize(mesh_.position.size(), Vec3f::Constant(kWhite));
    define_materials();
    TriangleMesh mesh = mesh_.finish();
    move_uv(mesh);
    mesh.notes = std::move(notes_);
    return mesh;
  }

 private:
  /// Materials that no file defines are grey: white would look as if the file said so.
  void define_materials() {
    std::string missing;
    std::size_t count = 0;
    for (MeshMaterial& material : mesh_.material) {
      const auto defined = library_.find(material.name);
      if (defined != library_.end()) {
        material = defined->second.material;
        moved_.push_back(defined->second);
        continue;
      }
      moved_.emplace_back();
      if (material.name.empty()) continue;
      material.diffuse = SurfelCloud::colorless();
      if (count++ == 0) missing = material.name;
    }
    if (count == 0) return;
    notes_.push_back(fmt::format("the material {}{} is in no material file; its faces are grey",
                                 quoted_excerpt(missing),
                                 count > 1 ? fmt::format(", like {} others,", count - 1) : ""));
  }

  void move_uv(TriangleMesh& mesh) const {
    for (std::size_t f = 0; f < mesh.wedge_uv.size() && !mesh.face_material.empty(); ++f) {
      const MtlMaterial& by = moved_[mesh.face_material[f]];
      if (!by.moves_uv()) continue;
      for (Vec2f& uv : mesh.wedge_uv[f]) uv = uv.cwiseProduct(by.uv_scale) + by.uv_offset;
    }
  }

  /// The largest index of a kind that a face names, and where. Faces may name vertices that follow
  /// them, so that only the end of the file tells whether the index exists.
  struct Reach {
    std::uint32_t index = 0;
    std::size_t position = 0;  ///< Offset in the file; 0 if no face names an index of the kind.
  };

  void read_line() {
    const std::string_view keyword = in_.word();
    if (keyword == "v") {
      read_vertex();
    } else if (keyword == "vt") {
      const double u = in_.number("u of a texture coordinate");
      const double v = in_.at_line_end() ? 0 : in_.number("v of a texture coordinate");
      mesh_.uv.emplace_back(static_cast<float>(u), static_cast<float>(v));
    } else if (keyword == "vn") {
      read_normal();
    } else if (keyword == "f") {
      read_face();
    } else if (keyword == "usemtl") {
      use_material(std::string(in_.rest_of_line()));
    } else if (keyword == "mtllib") {
      read_libraries(in_.rest_of_line());
    }
  }

  void read_vertex() {
    const double x = in_.number("x of a vertex");
    const double y = in_.number("y of a vertex");
    const double z = in_.number("z of a vertex");
    mesh_.position.emplace_back(x, y, z);
    if (in_.at_line_end()) return;
    std::array<double, 4> more{};
    std::size_t count = 0;
    for (; count < more.size() && !in_.at_line_end(); ++count) more[count] = any_number("a vertex");
    if (count < 3) return;
    mesh_.color.resize(mesh_.position.size() - 1, Vec3f::Constant(kWhite));
    mesh_.color.emplace_back(decode_color(more[0]), decode_color(more[1]), decode_color(more[2]));
  }

  /// A number that need not be finite.
  double any_number(const char* of) {
    const std::string_view text = in_.word();
    const auto value = parse_number(text);
    if (!value) in_.fail(fmt::format("{} of {} is not a number", quoted_excerpt(text), of));
    return *value;
  }

  void read_normal() {
    Vec3f normal;
    for (float& component : normal) component = static_cast<float>(any_number("a normal"));
    mesh_.normal.push_back(normal);
  }

  /// The index from 0 of the element that a face names, which counts from 1 on, or backwards from
  /// the last element read.
  std::uint32_t read_index(std::size_t count, Reach& reach, const char* what) {
    const std::size_t position = in_.position();
    const std::int64_t index = in_.integer("an index of a face");
    if (index == 0) in_.fail(fmt::format("index 0 of a {}; they count from 1", what));
    const std::int64_t from_zero = index > 0 ? index - 1 : static_cast<std::int64_t>(count) + index;
    if (from_zero < 0 || from_zero >= MeshBuilder::kNone) {
      in_.fail(
          fmt::format("index {} of a {} is out of range; {} were read so far", index, what, count));
    }
    const auto result = static_cast<std::uint32_t>(from_zero);
    if (reach.position == 0 || result > reach.index) reach = {result, position};
    return result;
  }

  MeshBuilder::Corner read_corner() {
    const auto index_follows = [&] {
      const char next = in_.peek();
      return next == '-' || next == '+' || (next >= '0' && next <= '9');
    };
    MeshBuilder::Corner corner;
    corner.vertex = read_index(mesh_.position.size(), vertex_reach_, "vertex");
    if (in_.skip('/') && index_follows()) {
      corner.uv = read_index(mesh_.uv.size(), uv_reach_, "texture coordinate");
    }
    if (in_.skip('/') && index_follows()) {
      corner.normal = read_index(mesh_.normal.size(), normal_reach_, "normal");
    }
    if (!in_.at_word_end()) {
      in_.fail(fmt::format("{} does not belong into a face", quoted_excerpt(in_.word())));
    }
    return corner;
  }

  void read_face() {
    corners_.clear();
    while (!in_.at_line_end()) corners_.push_back(read_corner());
    if (corners_.size() < 3) {
      in_.fail(fmt::format("a face with {} corners; it needs three at least", corners_.size()));
    }
    if (!material_ && !mesh_.material.empty()) use_material("");
    mesh_.add_polygon(corners_, material_.value_or(0));
  }

  void use_material(const std::string& name) {
    // Faces before the first usemtl have the material without a name.
    if (mesh_.material.empty() && mesh_.polygon_count() > 0 && !name.empty()) use_material("");
    const auto [entry, added] =
        material_index_.try_emplace(name, static_cast<std::uint16_t>(mesh_.material.size()));
    if (added) {
      if (mesh_.material.size() > std::numeric_limits<std::uint16_t>::max()) {
        in_.fail("more than 65536 materials are not supported");
      }
      mesh_.material.push_back({.name = name, .texture = {}});
    }
    material_ = entry->second;
  }

  /// One file whose name may hold blanks, or several with blanks between them.
  void read_libraries(std::string_view names) {
    // Exporters repeat the line before each object.
    if (!lines_read_.emplace(names).second || read_library(names)) return;
    std::vector<std::string_view> missing;
    std::size_t found = 0;
    for (TextScanner words({}, names); !words.at_line_end();) {
      const std::string_view name = words.word();
      if (name.size() < names.size() && read_library(name)) {
        ++found;
      } else {
        missing.push_back(name);
      }
    }
    if (found == 0) missing = {names};
    for (const std::string_view name : missing) {
      notes_.push_back(fmt::format("names the material file {}, which {}; put it beside this file",
                                   quoted_excerpt(name),
                                   named_problem(file_, named_path(file_, name))));
    }
  }

  bool read_library(std::string_view name) {
    if (++names_tried_ > kMostLibraries) {
      in_.fail(fmt::format("more than {} names of material files are not supported; leave some out",
                           kMostLibraries));
    }
    const std::string path = named_path(file_, name);
    if (!named_problem(file_, path).empty()) return false;
    if (!libraries_read_.insert(path).second) return true;
    for (MtlMaterial& material : read_mtl(open_named(file_, path))) {
      library_.try_emplace(material.material.name, std::move(material));
    }
    return true;
  }

  void check_reach(const Reach& reach, std::size_t count, const char* what, const char* plural) {
    if (reach.position == 0 || reach.index < count) return;
    in_.fail_at(reach.position,
                fmt::format("a face names {} {}, but there are {} {}; export the mesh again", what,
                            reach.index + std::size_t{1}, count, plural));
  }

  TextScanner in_;
  std::string file_;
  MeshBuilder mesh_;
  std::vector<MeshBuilder::Corner> corners_;
  Reach vertex_reach_;
  Reach uv_reach_;
  Reach normal_reach_;
  std::optional<std::uint16_t> material_;
  std::unordered_map<std::string, std::uint16_t> material_index_;
  std::unordered_map<std::string, MtlMaterial> library_;
  std::unordered_set<std::string> lines_read_;      ///< Names of material files, a line each.
  std::unordered_set<std::string> libraries_read_;  ///< Paths.
  std::size_t names_tried_ = 0;
  std::vector<MtlMaterial> moved_;  ///< By material of the mesh.
  std::vector<std::string> notes_;
};

}  // namespace

TriangleMesh read_obj(const InputFile& file) { return ObjReader(file).read(); }

}  // namespace surfel
