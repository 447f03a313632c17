#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/io/gltf_file.h>
#include <surfel/io/json_view.h>

namespace surfel {

/// Rotation, scale and shear, then translation.
using Affine = Eigen::Matrix<double, 3, 4>;

/// `first`, then `then`.
Affine chained(const Affine& then, const Affine& first);

/// The scene graph of a glTF file at the start of its first animation. Internal to the io module.
class GltfNodes {
 public:
  /// A mesh where a node has it.
  struct Instance {
    std::size_t node = 0;
    Affine world;
    JsonView mesh;
  };

  /// Goes through the default scene. Throws Error(kInput) where a node has two parents, or itself
  /// among its descendants.
  explicit GltfNodes(GltfFile& file);

  const std::vector<Instance>& instances() const { return instances_; }
  /// Where a node of the scene stands; nullopt where the scene does not hold it.
  std::optional<Affine> world(std::size_t node) const;
  /// Weights of a node's morph targets, at most `count`; those left out are 0.
  std::vector<double> weights(const Instance& instance, std::size_t count) const;

  std::vector<std::string> notes;

 private:
  /// What the first animation sets of a node.
  struct Pose {
    std::optional<Vec3d> translation;
    std::optional<Vec4d> rotation;
    std::optional<Vec3d> scale;
    std::vector<double> weights;
  };

  void read_animation();
  void read_channel(const JsonView& animation, const JsonView& channel);
  std::vector<std::size_t> roots();
  void visit(const std::vector<std::size_t>& roots);
  Affine local(std::size_t index, const JsonView& node) const;
  void add_instances(std::size_t index, const JsonView& node, const Affine& world);

  GltfFile& file_;
  JsonView nodes_;
  std::unordered_map<std::size_t, Pose> pose_;
  std::unordered_map<std::size_t, Affine> world_;
  std::vector<Instance> instances_;
};

}  // namespace surfel
