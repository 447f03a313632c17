// Khronos, "glTF 2.0 specification", sections 3.5 and 3.11, and the extensions
// EXT_mesh_gpu_instancing and KHR_node_visibility.

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/gltf_nodes.h>
#include <surfel/io/promises.h>

namespace surfel {
namespace {

/// Translation, rotation (a quaternion x y z w, of any length) and scale.
Affine composed(const Vec3d& translation, const Vec4d& rotation, const Vec3d& scale) {
  const double length2 = rotation.squaredNorm();
  const Vec4d q = length2 > 0 ? Vec4d(rotation / std::sqrt(length2)) : Vec4d(0, 0, 0, 1);
  const double x = q[0];
  const double y = q[1];
  const double z = q[2];
  const double w = q[3];
  Affine m;
  m << 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), translation.x(),
      2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), translation.y(),
      2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), translation.z();
  m.leftCols<3>() *= scale.asDiagonal();
  return m;
}

/// The components of an accessor's element.
template <class Vector>
void read_element(const GltfAccessor& from, std::size_t element, Vector& to) {
  std::array<float, GltfAccessor::kMostComponents> values{};
  from.read(element, values.data());
  for (Eigen::Index i = 0; i < to.size(); ++i) {
    to[i] = static_cast<double>(values[static_cast<std::size_t>(i)]);
  }
}

void require_finite(const JsonView& place, const Affine& transform) {
  if (!transform.allFinite()) place.fail("has a transform that is not finite");
}

}  // namespace

Affine chained(const Affine& then, const Affine& first) {
  Affine both;
  both.leftCols<3>() = then.leftCols<3>() * first.leftCols<3>();
  both.col(3) = then.leftCols<3>() * first.col(3) + then.col(3);
  return both;
}

GltfNodes::GltfNodes(GltfFile& file) : file_(file), nodes_(file.root()["nodes"]) {
  read_animation();
  visit(roots());
}

std::optional<Affine> GltfNodes::world(std::size_t node) const {
  const auto found = world_.find(node);
  if (found == world_.end()) return std::nullopt;
  return found->second;
}

void GltfNodes::read_animation() {
  const JsonView animations = file_.root()["animations"];
  if (animations.size() == 0) return;
  if (animations.size() > 1) {
    notes.push_back(
        fmt::format("has {} animations; the mesh is as it stands where the first one "
                    "begins",
                    animations.size()));
  }
  const JsonView first = animations.at(0);
  const JsonView channels = first["channels"];
  for (std::size_t i = 0; i < channels.size(); ++i) read_channel(first, channels.at(i));
}

/// Takes the first key of a channel.
void GltfNodes::read_channel(const JsonView& animation, const JsonView& channel) {
  const JsonView target = channel["target"];
  const std::string path = target["path"].text("");
  if (!target["node"]) return;
  Pose& pose = pose_[target["node"].count()];
  const JsonView samplers = animation["samplers"];
  const std::uint64_t index = channel["sampler"].count();
  if (index >= samplers.size()) {
    channel["sampler"].fail(fmt::format("is {}, but there are {}", index, samplers.size()));
  }
  const JsonView sampler = samplers.at(index);
  const GltfAccessor output = file_.accessor(file_.referred("accessors", sampler["output"]));
  // A key of a cubic spline has a tangent before its value, and another behind it.
  const bool spline = sampler["interpolation"].text("") == "CUBICSPLINE";
  const std::size_t values_a_key = spline ? 3 : 1;
  const auto element = [&](std::size_t components) {
    if (output.components() != components || output.size() < values_a_key) {
      sampler["output"].fail(fmt::format("has no value of {} components for {}", components, path));
    }
    return spline ? std::size_t{1} : std::size_t{0};
  };
  if (path == "translation") read_element(output, element(3), pose.translation.emplace());
  if (path == "scale") read_element(output, element(3), pose.scale.emplace());
  if (path == "rotation") read_element(output, element(4), pose.rotation.emplace());
  if (path == "weights") {
    element(1);
    const GltfAccessor keys = file_.accessor(file_.referred("accessors", sampler["input"]));
    const std::size_t weights =
        output.size() / (values_a_key * std::max<std::size_t>(1, keys.size()));
    pose.weights.resize(weights);
    for (std::size_t i = 0; i < weights; ++i) {
      Eigen::Matrix<double, 1, 1> weight;
      read_element(output, (spline ? weights : 0) + i, weight);
      pose.weights[i] = weight[0];
    }
  }
}

/// The nodes that the default scene starts from; without scenes, the nodes that are no one's child.
std::vector<std::size_t> GltfNodes::roots() {
  const JsonView scenes = file_.root()["scenes"];
  std::vector<std::size_t> found;
  if (scenes.size() > 0) {
    const std::uint64_t index = file_.root()["scene"].count(0);
    if (index >= scenes.size()) {
      file_.root()["scene"].fail(fmt::format("is {}, but there are {}", index, scenes.size()));
    }
    if (scenes.size() > 1) {
      notes.push_back(fmt::format("has {} scenes; scene {} is read", scenes.size(), index));
    }
    const JsonView nodes = scenes.at(index)["nodes"];
    for (std::size_t i = 0; i < nodes.size(); ++i) found.push_back(nodes.at(i).count());
    return found;
  }
  std::vector<bool> is_child(nodes_.size(), false);
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const JsonView children = nodes_.at(i)["children"];
    for (std::size_t k = 0; k < children.size(); ++k) {
      const std::uint64_t child = children.at(k).count();
      if (child < is_child.size()) is_child[child] = true;
    }
  }
  for (std::size_t i = 0; i < is_child.size(); ++i) {
    if (!is_child[i]) found.push_back(i);
  }
  return found;
}

void GltfNodes::visit(const std::vector<std::size_t>& roots) {
  struct Step {
    std::size_t node;
    Affine parent;
  };
  std::vector<Step> open;
  // The last of the open steps is the next.
  for (auto root = roots.rbegin(); root != roots.rend(); ++root) {
    open.push_back({*root, Affine::Identity()});
  }
  while (!open.empty()) {
    const Step step = open.back();
    open.pop_back();
    if (step.node >= nodes_.size()) {
      nodes_.fail(fmt::format("are {}, but node {} is named; export the file again", nodes_.size(),
                              step.node));
    }
    const JsonView node = nodes_.at(step.node);
    const Affine world = chained(step.parent, local(step.node, node));
    require_finite(node, world);
    if (!world_.try_emplace(step.node, world).second) {
      node.fail("has two parents, or itself among its descendants; export the file again");
    }
    if (!node["extensions"]["KHR_node_visibility"]["visible"].flag(true)) continue;
    add_instances(step.node, node, world);
    const JsonView children = node["children"];
    for (std::size_t k = children.size(); k-- > 0;) {
      open.push_back({children.at(k).count(), world});
    }
  }
}

Affine GltfNodes::local(std::size_t index, const JsonView& node) const {
  const auto found = pose_.find(index);
  const JsonView matrix = node["matrix"];
  const bool moved = found != pose_.end() &&
                     (found->second.translation || found->second.rotation || found->second.scale);
  if (matrix && !moved) {
    Eigen::Matrix4d stored;  // Column by column, as Eigen's.
    matrix.numbers(stored);
    return stored.topRows<3>();
  }
  Vec3d translation(0, 0, 0);
  Vec4d rotation(0, 0, 0, 1);
  Vec3d scale(1, 1, 1);
  node["translation"].numbers(translation);
  node["rotation"].numbers(rotation);
  node["scale"].numbers(scale);
  if (moved) {
    translation = found->second.translation.value_or(translation);
    rotation = found->second.rotation.value_or(rotation);
    scale = found->second.scale.value_or(scale);
  }
  return composed(translation, rotation, scale);
}

void GltfNodes::add_instances(std::size_t index, const JsonView& node, const Affine& world) {
  if (!node["mesh"]) return;
  const JsonView mesh = file_.referred("meshes", node["mesh"]);
  const JsonView many = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
  if (!many) {
    instances_.push_back({index, world, mesh});
    return;
  }
  constexpr std::array<const char*, 3> kNames = {"TRANSLATION", "ROTATION", "SCALE"};
  std::array<std::optional<GltfAccessor>, 3> part;
  std::optional<std::size_t> count;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    const JsonView reference = many[kNames[k]];
    if (!reference) continue;
    part[k] = file_.accessor(file_.referred("accessors", reference));
    const std::size_t components = k == 1 ? 4 : 3;
    if (part[k]->components() != components || part[k]->size() != count.value_or(part[k]->size())) {
      reference.fail(
          fmt::format("must have {} components, and as many elements as the others", components));
    }
    count = part[k]->size();
  }
  for (std::size_t i = 0; i < count.value_or(0); ++i) {
    Vec3d translation(0, 0, 0);
    Vec4d rotation(0, 0, 0, 1);
    Vec3d scale(1, 1, 1);
    if (part[0]) read_element(*part[0], i, translation);
    if (part[1]) read_element(*part[1], i, rotation);
    if (part[2]) read_element(*part[2], i, scale);
    instances_.push_back({index, chained(world, composed(translation, rotation, scale)), mesh});
    require_finite(node, instances_.back().world);
  }
}

std::vector<double> GltfNodes::weights(const Instance& instance, std::size_t count) const {
  std::vector<double> result;
  const auto found = pose_.find(instance.node);
  if (found != pose_.end()) result = found->second.weights;
  if (result.empty()) {
    const JsonView own = nodes_.at(instance.node)["weights"];
    const JsonView weights = own ? own : instance.mesh["weights"];
    for (std::size_t i = 0; i < weights.size(); ++i) {
      result.push_back(weights.at(i).number(0));
    }
  }
  result.resize(count, 0);
  return result;
}

}  // namespace surfel
