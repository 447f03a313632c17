#include <algorithm>
#include <array>
#include <filesystem>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/io/mesh_builder.h>
#include <surfel/io/named_file.h>
#include <surfel/io/ply.h>
#include <surfel/io/ply_mesh.h>

namespace surfel {
namespace {

constexpr std::string_view kTextureComment = "TextureFile";

class PlyMeshReader {
 public:
  explicit PlyMeshReader(InputFile file)
      : ply_(std::move(file)), mesh_(ply_.name()), vertex_(ply_.header().find("vertex")) {}

  TriangleMesh read() {
    if (!vertex_) throw_input(ply_.name(), "the header has no element 'vertex'");
    read_positions();
    read_colors();
    read_vertex_uv();
    read_vectors<3>({"nx", "ny", "nz"}, mesh_.normal);
    read_materials();
    read_faces();
    read_strips();
    return mesh_.finish();
  }

 private:
  bool has_scalar(std::string_view property) const {
    const PlyProperty* found = vertex_->find(property);
    return found && !found->is_list();
  }

  /// Reads scalar properties as the components of one vector a vertex; false if one is missing.
  template <int kSize>
  bool read_vectors(const std::array<const char*, kSize>& names,
                    Array<Eigen::Matrix<float, kSize, 1>>& to) {
    if (!std::all_of(names.begin(), names.end(), [&](auto name) { return has_scalar(name); })) {
      return false;
    }
    for (int k = 0; k < kSize; ++k) {
      const Array<float> column = ply_.column<float>("vertex", names[static_cast<std::size_t>(k)]);
      to.resize(column.size());
      for (std::size_t i = 0; i < column.size(); ++i) to[i][k] = column[i];
    }
    return true;
  }

  void read_positions() {
    constexpr std::array<const char*, 3> kAxes{"x", "y", "z"};
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const char* name = kAxes[static_cast<std::size_t>(axis)];
      // Only after the file was seen to hold as many vertices as its header promises.
      const Array<double> column = ply_.column<double>("vertex", name);
      mesh_.position.resize(column.size());
      for (std::size_t i = 0; i < column.size(); ++i) {
        if (!std::isfinite(column[i])) {
          throw_input(ply_.name(), fmt::format("{} of vertex {} is {}, not a finite number", name,
                                               i, column[i]));
        }
        mesh_.position[i][axis] = column[i];
      }
      const PlyProperty* property = vertex_->find(name);
      mesh_.double_positions |= property->type == ScalarType::kFloat64;
    }
  }

  /// Integers are sRGB-encoded, floats linear; a value that is no number counts as 1.
  void read_colors() {
    constexpr std::array<const char*, 3> kNames{"red", "green", "blue"};
    if (!read_vectors<3>(kNames, mesh_.color)) return;
    for (int channel = 0; channel < 3; ++channel) {
      const ScalarType type = vertex_->find(kNames[static_cast<std::size_t>(channel)])->type;
      for (Vec3f& color : mesh_.color) color[channel] = decode_color(color[channel], type);
    }
  }

  static float decode_color(float stored, ScalarType type) {
    if (!std::isfinite(stored)) return 1;
    switch (type) {
      case ScalarType::kFloat32:
      case ScalarType::kFloat64:
        return stored;
      case ScalarType::kUint8:
        return srgb8_to_linear(static_cast<std::uint8_t>(stored));
      case ScalarType::kUint16:
        return srgb16_to_linear(static_cast<std::uint16_t>(stored));
      default:
        return srgb_to_linear(stored / 255);
    }
  }

  void read_vertex_uv() {
    constexpr std::array<std::array<const char*, 2>, 4> kNames{
        {{"u", "v"}, {"s", "t"}, {"texture_u", "texture_v"}, {"texture_s", "texture_t"}}};
    uv_per_vertex_ = std::any_of(kNames.begin(), kNames.end(), [&](const auto& names) {
      return read_vectors<2>(names, mesh_.uv);
    });
    for (std::size_t i = 0; i < mesh_.uv.size(); ++i) check_uv(mesh_.uv[i], "vertex", i);
  }

  void check_uv(const Vec2f& uv, const char* element, std::size_t i) const {
    if (uv.allFinite()) return;
    throw_input(ply_.name(),
                fmt::format("a texture coordinate of {} {} is not a finite number", element, i));
  }

  /// MeshLab writes <this> for the mesh's own name.
  void read_materials() {
    const std::filesystem::path path(ply_.name());
    for (const std::string& comment : ply_.header().comments) {
      if (!comment.starts_with(kTextureComment)) continue;
      std::string name = comment.substr(kTextureComment.size());
      name.erase(0, std::min(name.find_first_not_of(" \t"), name.size()));
      constexpr std::string_view kThis = "<this>";
      if (name.starts_with(kThis)) name.replace(0, kThis.size(), path.stem().string());
      if (name.empty()) continue;
      mesh_.material.push_back(
          {.name = name, .texture = named_path(ply_.name(), name), .named_by = ply_.name()});
    }
    textures_ = mesh_.material.size();
    if (textures_ >= std::numeric_limits<std::uint16_t>::max()) {
      throw_input(ply_.name(), "more than 65534 textures are not supported");
    }
  }

  void read_faces() {
    const PlyElement* face = ply_.header().find("face");
    if (!face || face->count == 0) return;
    const char* name = face->find("vertex_index") ? "vertex_index" : "vertex_indices";
    const PlyLists<std::uint32_t> polygons = ply_.lists<std::uint32_t>("face", name);
    const PlyProperty* texcoord = face->find("texcoord");
    PlyLists<float> uv;
    if (texcoord && texcoord->is_list()) uv = ply_.lists<float>("face", "texcoord");
    Array<std::int32_t> texture;
    if (textures_ > 0 && face->find("texnumber")) {
      texture = ply_.column<std::int32_t>("face", "texnumber");
    }
    std::vector<MeshBuilder::Corner> corners;
    for (std::size_t i = 0; i < face->count; ++i) {
      const std::span indices(polygons.value.data() + polygons.offset[i],
                              polygons.offset[i + 1] - polygons.offset[i]);
      if (indices.size() < 3) {
        throw_input(ply_.name(), fmt::format("face {} has {} corners; it needs three at least", i,
                                             indices.size()));
      }
      corners.clear();
      for (const std::uint32_t vertex : indices) corners.push_back(corner(vertex, "face", i));
      if (!uv.offset.empty()) {
        add_face_uv({uv.value.data() + uv.offset[i], uv.offset[i + 1] - uv.offset[i]}, i, corners);
      }
      mesh_.add_polygon(corners, texture.empty() ? std::uint16_t{0} : material_of(texture[i], i));
    }
  }

  MeshBuilder::Corner corner(std::uint32_t vertex, const char* element, std::size_t i) const {
    if (vertex >= vertex_->count) {
      throw_input(
          ply_.name(),
          fmt::format("{} {} names vertex {}, but there are {} vertices; export the mesh again",
                      element, i, vertex, vertex_->count));
    }
    return {.vertex = vertex,
            .uv = uv_per_vertex_ ? vertex : MeshBuilder::kNone,
            .normal = mesh_.normal.empty() ? MeshBuilder::kNone : vertex};
  }

  /// A face without texture coordinates has an empty list.
  void add_face_uv(std::span<const float> uv, std::size_t face,
                   std::vector<MeshBuilder::Corner>& corners) {
    if (uv.empty()) return;
    if (uv.size() != 2 * corners.size()) {
      throw_input(ply_.name(), fmt::format("face {} has {} corners, but {} texcoord values; it "
                                           "needs two per corner",
                                           face, corners.size(), uv.size()));
    }
    for (std::size_t k = 0; k < corners.size(); ++k) {
      corners[k].uv = static_cast<std::uint32_t>(mesh_.uv.size());
      check_uv(mesh_.uv.emplace_back(uv[2 * k], uv[2 * k + 1]), "face", face);
    }
  }

  /// Faces without a texture (-1) share a material of their own, the last.
  std::uint16_t material_of(std::int32_t texture, std::size_t face) {
    if (texture >= 0) {
      if (static_cast<std::size_t>(texture) >= textures_) {
        throw_input(ply_.name(), fmt::format("face {} has texnumber {}, but the header names {} "
                                             "TextureFile",
                                             face, texture, textures_));
      }
      return static_cast<std::uint16_t>(texture);
    }
    if (mesh_.material.size() == textures_) mesh_.material.emplace_back();
    return static_cast<std::uint16_t>(textures_);
  }

  /// Every second triangle of a strip is turned; -1 starts the next strip.
  void read_strips() {
    const PlyElement* strips = ply_.header().find("tristrips");
    if (!strips || strips->count == 0) return;
    const char* name = strips->find("vertex_index") ? "vertex_index" : "vertex_indices";
    const PlyLists<std::int32_t> lists = ply_.lists<std::int32_t>("tristrips", name);
    for (std::size_t i = 0; i < strips->count; ++i) {
      std::size_t length = 0;
      std::array<MeshBuilder::Corner, 3> last;
      for (std::size_t k = lists.offset[i]; k < lists.offset[i + 1]; ++k) {
        if (lists.value[k] == -1) {
          length = 0;
          continue;
        }
        // Any other negative number is out of range as an unsigned one, too.
        last = {last[1], last[2],
                corner(static_cast<std::uint32_t>(lists.value[k]), "tristrips", i)};
        if (++length < 3) continue;
        if (length % 2 == 1) {
          mesh_.add_polygon(last);
        } else {
          mesh_.add_polygon(std::array{last[1], last[0], last[2]});
        }
      }
    }
  }

  PlyFile ply_;
  MeshBuilder mesh_;
  const PlyElement* vertex_;
  std::size_t textures_ = 0;
  bool uv_per_vertex_ = false;
};

}  // namespace

TriangleMesh read_ply_mesh(InputFile file) { return PlyMeshReader(std::move(file)).read(); }

}  // namespace surfel
