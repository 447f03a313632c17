// Khronos, "glTF 2.0 specification", section 3.7: meshes, skins and morph targets.

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/io/gltf.h>
#include <surfel/io/gltf_file.h>
#include <surfel/io/gltf_materials.h>
#include <surfel/io/gltf_nodes.h>
#include <surfel/io/mesh_builder.h>
#include <surfel/io/unique_vectors.h>

namespace surfel {
namespace {

/// OpenGL's numbers of what a primitive is made of.
constexpr std::uint64_t kTriangles = 4;
constexpr std::uint64_t kTriangleStrip = 5;
constexpr std::uint64_t kTriangleFan = 6;

/// Bytes that a triangle takes while a mesh is made, roughly.
constexpr std::uint64_t kTriangleBytes = 256;
/// More corners than any memory holds, where counting them ends.
constexpr std::uint64_t kManyCorners = std::uint64_t{1} << 50;

bool has_triangles(const JsonView& primitive) {
  const std::uint64_t mode = primitive["mode"].count(kTriangles);
  return mode >= kTriangles && mode <= kTriangleFan;
}

/// Joints that move a vertex, and how much each does.
struct SkinWeights {
  GltfAccessor joints;
  GltfAccessor weights;
};

/// What the faces of a primitive are made of.
struct Primitive {
  JsonView description;
  GltfAccessor position;
  std::optional<GltfAccessor> normal{};
  std::optional<GltfAccessor> uv{};
  std::optional<GltfAccessor> color{};
  std::vector<SkinWeights> skin{};
  std::vector<std::optional<GltfAccessor>> moved_position{};  ///< By morph target.
  std::vector<std::optional<GltfAccessor>> moved_normal{};
  GltfMaterials::Use use{};
  Array<std::uint32_t> vertex{};               ///< Vertices of faces, each once.
  Array<std::array<std::uint32_t, 3>> face{};  ///< Places in `vertex`.
};

Vec3d vector_of(const GltfAccessor& from, std::size_t element) {
  std::array<float, GltfAccessor::kMostComponents> values{};
  from.read(element, values.data());
  return {values[0], values[1], values[2]};
}

/// Takes normals along; as long as the transform makes them.
Eigen::Matrix3d normal_transform(const Affine& m) {
  const Eigen::Matrix3d a = m.leftCols<3>();
  Eigen::Matrix3d cofactors;
  cofactors.col(0) = a.col(1).cross(a.col(2));
  cofactors.col(1) = a.col(2).cross(a.col(0));
  cofactors.col(2) = a.col(0).cross(a.col(1));
  return a.determinant() < 0 ? Eigen::Matrix3d(-cofactors) : cofactors;
}

class GltfReader {
 public:
  explicit GltfReader(InputFile file)
      : file_(std::move(file)),
        nodes_(file_),
        materials_(file_, some_colors()),
        mesh_(file_.name()) {}

  TriangleMesh read() {
    check_size();
    for (const auto& [place, instances] : by_mesh_) {
      const JsonView primitives = instances.front()->mesh["primitives"];
      for (std::size_t i = 0; i < primitives.size(); ++i) {
        if (!has_triangles(primitives.at(i))) continue;
        const Primitive primitive = read_primitive(primitives.at(i));
        for (const GltfNodes::Instance* instance : instances) add(primitive, *instance);
      }
    }
    return finish();
  }

 private:
  template <class Visit>
  void for_each_primitive(const Visit& visit) const {
    for (const GltfNodes::Instance& instance : nodes_.instances()) {
      const JsonView primitives = instance.mesh["primitives"];
      for (std::size_t i = 0; i < primitives.size(); ++i) visit(primitives.at(i));
    }
  }

  bool some_colors() const {
    bool found = false;
    for_each_primitive(
        [&](const JsonView& primitive) { found = found || primitive["attributes"]["COLOR_0"]; });
    return found;
  }

  /// Sorts the instances by mesh, and refuses scenes that repeat meshes until they do not fit into
  /// memory.
  void check_size() {
    for (const GltfNodes::Instance& instance : nodes_.instances()) {
      std::vector<const GltfNodes::Instance*>& same = by_mesh_[number_of(instance)];
      same.push_back(&instance);
    }
    std::uint64_t corners = 0;
    for_each_primitive([&](const JsonView& primitive) {
      if (!has_triangles(primitive)) {
        ++left_out_;
        return;
      }
      const JsonView indices = primitive["indices"];
      const JsonView counted = indices ? indices : primitive["attributes"]["POSITION"];
      corners += std::min<std::uint64_t>(file_.referred("accessors", counted)["count"].count(),
                                         kManyCorners - corners);
    });
    if (const std::uint64_t bytes = corners / 3 * kTriangleBytes;
        bytes > available_memory_for(bytes)) {
      throw_input(file_.name(),
                  fmt::format("the scene's {} triangles do not fit into memory", corners / 3));
    }
  }

  std::uint64_t number_of(const GltfNodes::Instance& instance) const {
    return file_.root()["nodes"].at(instance.node)["mesh"].count();
  }

  GltfAccessor accessor(const JsonView& reference) {
    return file_.accessor(file_.referred("accessors", reference));
  }

  Primitive read_primitive(const JsonView& description) {
    Primitive primitive{.description = description, .position = {}};
    primitive.use = materials_.use(description["material"]);
    const std::string& uv = primitive.use.coordinates;
    const std::array<std::string_view, 8> names = {
        "POSITION", "NORMAL", uv, "COLOR_0", "JOINTS_0", "WEIGHTS_0", "JOINTS_1", "WEIGHTS_1"};
    const JsonView compressed = description["extensions"]["KHR_draco_mesh_compression"];
    GltfFile::Draco draco;
    if (compressed) draco = file_.decode_draco(compressed, names);
    const auto attribute = [&](std::string_view name, std::size_t least, std::size_t most) {
      std::optional<GltfAccessor> found;
      const JsonView reference = description["attributes"][name];
      const auto decoded = draco.attribute.find(std::string(name));
      if (decoded != draco.attribute.end()) {
        found = decoded->second;
      } else if (reference) {
        found = accessor(reference);
      }
      if (!found) return found;
      const bool fits = name == "POSITION" || found->size() == primitive.position.size();
      if (found->components() < least || found->components() > most || !fits) {
        reference.fail(
            fmt::format("has {} elements of {} components, which do not fit; export the "
                        "file again",
                        found->size(), found->components()));
      }
      return found;
    };
    const auto position = attribute("POSITION", 3, 3);
    if (!position) description.fail("has no POSITION; export the file again");
    primitive.position = *position;
    primitive.normal = attribute("NORMAL", 3, 3);
    primitive.uv = attribute(uv, 2, 2);
    primitive.color = attribute("COLOR_0", 3, 4);
    for (const char* const set : {"0", "1"}) {
      const auto joints = attribute(fmt::format("JOINTS_{}", set), 4, 4);
      const auto weights = attribute(fmt::format("WEIGHTS_{}", set), 4, 4);
      if (joints && weights) primitive.skin.push_back({*joints, *weights});
    }
    read_targets(primitive);
    std::optional<GltfAccessor> indices;
    if (compressed) {
      indices = draco.indices;
    } else if (description["indices"]) {
      indices = accessor(description["indices"]);
    }
    read_faces(primitive, indices);
    return primitive;
  }

  void read_targets(Primitive& primitive) {
    const JsonView targets = primitive.description["targets"];
    for (std::size_t i = 0; i < targets.size(); ++i) {
      const auto moved = [&](const char* name) {
        std::optional<GltfAccessor> found;
        const JsonView reference = targets.at(i)[name];
        if (!reference) return found;
        found = accessor(reference);
        if (found->components() != 3 || found->size() != primitive.position.size()) {
          reference.fail("does not fit to the mesh's vertices; export the file again");
        }
        return found;
      };
      primitive.moved_position.push_back(moved("POSITION"));
      primitive.moved_normal.push_back(moved("NORMAL"));
    }
  }

  void read_faces(Primitive& primitive, const std::optional<GltfAccessor>& indices) {
    const std::size_t vertices = primitive.position.size();
    const std::size_t corners = indices ? indices->size() : vertices;
    const std::uint64_t mode = primitive.description["mode"].count(kTriangles);
    slot_.resize(std::max(slot_.size(), vertices), MeshBuilder::kNone);
    const auto corner = [&](std::size_t i) {
      const std::size_t vertex = indices ? indices->integer(i) : i;
      if (vertex >= vertices) {
        primitive.description.fail(fmt::format(
            "names vertex {}, but there are {}; export the file again", vertex, vertices));
      }
      if (slot_[vertex] == MeshBuilder::kNone) {
        slot_[vertex] = static_cast<std::uint32_t>(primitive.vertex.size());
        primitive.vertex.push_back(static_cast<std::uint32_t>(vertex));
      }
      return slot_[vertex];
    };
    if (mode == kTriangles) {
      for (std::size_t i = 0; i + 2 < corners; i += 3) {
        primitive.face.push_back({corner(i), corner(i + 1), corner(i + 2)});
      }
    } else {
      // Every second triangle of a strip is turned; all triangles of a fan share one corner.
      for (std::size_t i = 2; i < corners; ++i) {
        const std::size_t first = mode == kTriangleFan ? 0 : i - 2;
        const bool turned = mode == kTriangleStrip && i % 2 == 1;
        const std::array<std::uint32_t, 3> face = {corner(first), corner(turned ? i : i - 1),
                                                   corner(turned ? i - 1 : i)};
        primitive.face.push_back(face);
      }
    }
    for (const std::uint32_t vertex : primitive.vertex) slot_[vertex] = MeshBuilder::kNone;
  }

  /// The transforms of a skin's joints; none where the mesh has no skin.
  std::vector<Affine> joints_of(const GltfNodes::Instance& instance, const Primitive& primitive) {
    const JsonView reference = file_.root()["nodes"].at(instance.node)["skin"];
    if (!reference || primitive.skin.empty()) return {};
    const JsonView skin = file_.referred("skins", reference);
    const JsonView joints = skin["joints"];
    std::optional<GltfAccessor> bind;
    if (const JsonView matrices = skin["inverseBindMatrices"]) {
      bind = accessor(matrices);
      if (bind->components() != 16 || bind->size() < joints.size()) {
        matrices.fail(fmt::format("must hold a matrix for each of {} joints", joints.size()));
      }
    }
    std::vector<Affine> transforms;
    for (std::size_t k = 0; k < joints.size(); ++k) {
      const auto world = nodes_.world(joints.at(k).count());
      if (!world) {
        joints.at(k).fail("is no node of the scene; export the file again");
      }
      Affine inverse = Affine::Identity();
      if (bind) {
        Eigen::Matrix4f stored;
        bind->read(k, stored.data());
        inverse = stored.cast<double>().topRows<3>();
      }
      transforms.push_back(chained(*world, inverse));
    }
    return transforms;
  }

  /// The mean of the joints' transforms by the vertex' weights.
  Affine skinned(const Primitive& primitive, const std::vector<Affine>& joints,
                 std::uint32_t vertex, const Affine& world) const {
    Affine sum = Affine::Zero();
    double total = 0;
    for (const SkinWeights& set : primitive.skin) {
      std::array<float, GltfAccessor::kMostComponents> weight{};
      set.weights.read(vertex, weight.data());
      for (std::size_t k = 0; k < 4; ++k) {
        if (!(weight[k] > 0)) continue;
        const std::uint32_t joint = set.joints.integer(vertex, k);
        if (joint >= joints.size()) {
          primitive.description.fail(
              fmt::format("names joint {} of vertex {}, but there are {}; "
                          "export the file again",
                          joint, vertex, joints.size()));
        }
        const auto w = static_cast<double>(weight[k]);
        sum += w * joints[joint];
        total += w;
      }
    }
    return total > 0 ? Affine(sum / total) : world;
  }

  static Vec3d morphed(const std::vector<std::optional<GltfAccessor>>& moved,
                       const std::vector<double>& weights, std::uint32_t vertex, Vec3d base) {
    for (std::size_t k = 0; k < moved.size(); ++k) {
      if (moved[k] && weights[k] != 0) base += weights[k] * vector_of(*moved[k], vertex);
    }
    return base;
  }

  void add(const Primitive& primitive, const GltfNodes::Instance& instance) {
    const std::vector<Affine> joints = joints_of(instance, primitive);
    const std::vector<double> weights = nodes_.weights(instance, primitive.moved_position.size());
    const Affine& placed = joints.empty() ? instance.world : joints.front();
    const bool mirrored = placed.leftCols<3>().determinant() < 0;
    const Eigen::Matrix3d turned = normal_transform(instance.world);
    Array<MeshBuilder::Corner> corner(primitive.vertex.size());
    for (std::size_t i = 0; i < corner.size(); ++i) {
      const std::uint32_t vertex = primitive.vertex[i];
      const Affine m =
          joints.empty() ? instance.world : skinned(primitive, joints, vertex, instance.world);
      const Vec3d stored =
          morphed(primitive.moved_position, weights, vertex, vector_of(primitive.position, vertex));
      const Vec3d position = m.leftCols<3>() * stored + m.col(3);
      if (!position.allFinite()) {
        primitive.description["attributes"]["POSITION"].fail(
            fmt::format("has a coordinate of vertex {} that is not a finite number", vertex));
      }
      corner[i].vertex = welded(primitive, vertex, position);
      if (primitive.uv) corner[i].uv = uv_of(primitive, vertex);
      if (primitive.normal) {
        const Vec3d normal =
            morphed(primitive.moved_normal, weights, vertex, vector_of(*primitive.normal, vertex));
        corner[i].normal = static_cast<std::uint32_t>(mesh_.normal.size());
        mesh_.normal.push_back(((joints.empty() ? turned : normal_transform(m)) * normal)
                                   .stableNormalized()
                                   .cast<float>());
      }
    }
    for (const auto& [a, b, c] : primitive.face) {
      mesh_.add_polygon(mirrored ? std::array{corner[a], corner[c], corner[b]}
                                 : std::array{corner[a], corner[b], corner[c]},
                        primitive.use.material);
    }
  }

  /// The number of a vertex; vertices of one place and one colour share it.
  std::uint32_t welded(const Primitive& primitive, std::uint32_t vertex, const Vec3d& position) {
    Eigen::Matrix<double, 6, 1> key;
    key << position, 1, 1, 1;
    if (primitive.color) {
      for (int k = 3; k < 6; ++k) {
        const double c = vector_of(*primitive.color, vertex)[k - 3];
        key[k] = std::isfinite(c) ? c : 1;
      }
    }
    return vertex_.index_of(key);
  }

  std::uint32_t uv_of(const Primitive& primitive, std::uint32_t vertex) {
    std::array<float, GltfAccessor::kMostComponents> stored{};
    primitive.uv->read(vertex, stored.data());
    const Vec2f uv = primitive.use.place(stored.data());
    if (!uv.allFinite()) {
      primitive.description.fail(
          fmt::format("has texture coordinates of vertex {} that are not finite numbers", vertex));
    }
    mesh_.uv.push_back(uv);
    return static_cast<std::uint32_t>(mesh_.uv.size() - 1);
  }

  TriangleMesh finish() {
    if (mesh_.polygon_count() == 0) {
      throw_input(file_.name(),
                  fmt::format("holds no triangles in its scene{}",
                              left_out_ > 0 ? ", only points or lines; a surface is needed" : ""));
    }
    const bool colors = some_colors();
    mesh_.position.reserve(vertex_.values().size());
    for (const Eigen::Matrix<double, 6, 1>& v : vertex_.values()) {
      mesh_.position.push_back(v.head<3>());
      if (colors) mesh_.color.push_back(v.tail<3>().cast<float>());
    }
    mesh_.material = std::move(materials_.material);
    TriangleMesh mesh = mesh_.finish();
    mesh.embedded = std::move(materials_.embedded);
    mesh.up = Vec3d(0, 1, 0);
    mesh.notes = std::move(nodes_.notes);
    mesh.notes.insert(mesh.notes.end(), materials_.notes.begin(), materials_.notes.end());
    if (left_out_ > 0) {
      mesh.notes.push_back(fmt::format("{} parts are points or lines and left out", left_out_));
    }
    return mesh;
  }

  GltfFile file_;
  GltfNodes nodes_;
  GltfMaterials materials_;
  MeshBuilder mesh_;
  UniqueVectors<6, double> vertex_;
  std::map<std::uint64_t, std::vector<const GltfNodes::Instance*>> by_mesh_;
  Array<std::uint32_t> slot_;  ///< Place of a vertex in Primitive::vertex; kNone between calls.
  std::size_t left_out_ = 0;
};

}  // namespace

TriangleMesh read_gltf(InputFile file) { return GltfReader(std::move(file)).read(); }

}  // namespace surfel
