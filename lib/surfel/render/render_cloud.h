#pragma once

#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/cloud/cloud.h>
#include <surfel/io/camera.h>

namespace surfel {

/// Consecutive surfels of a RenderCloud with bounds for culling.
struct Cluster {
  std::uint32_t begin = 0;
  std::uint32_t end = 0;
  Vec3f center{0, 0, 0};       ///< Of a box and a sphere around the surfels' positions.
  Vec3f half_extent{0, 0, 0};  ///< Half the sides of that box.
  float radius = 0;            ///< Of that sphere.
  float max_group_radius = 0;  ///< Largest enlarged radius, scene units; 0 without the column.
  float max_deviation = 0;   ///< Largest standard deviation of the surfels' Gaussians, scene units.
  Vec3f cone_axis{0, 0, 1};  ///< All normals lie within the cone around this axis ...
  float cone_cosine =
      -1;  ///< ... of this cosine; -1 if no cone narrower than a half-space holds them.
};

/// Optional columns of a RenderCloud: most pictures do without.
struct RenderColumns {
  bool groups = false;        ///< `group`.
  bool group_radius = false;  ///< `group_radius`, where the cloud has it.
  /// Copies of splats, made for every group to cover the surface (SP06 section 4.2.2), which would
  /// count twice where groups do not matter. Else the first of those with the same `source` and the
  /// same place stays.
  bool copies = false;
};

/// A cloud made ready for rendering: unusable surfels dropped, the rest sorted along a Morton
/// curve, cut into clusters, and laid out in the columns that splat set-up streams through. Built
/// once, rendered from any number of cameras. Does not depend on the order of the surfels in the
/// cloud, but for which of several copies stays.
class SURFEL_API RenderCloud {
 public:
  static constexpr std::uint32_t kClusterSize = 256;
  /// Zeros past the end of every column, so that SIMD code may read whole vectors.
  static constexpr std::size_t kPadding = 16;

  /// What was left out, and why.
  struct Dropped {
    std::size_t position = 0;  ///< Not finite.
    std::size_t variance = 0;  ///< Variance or enlarged radius not finite, or not positive.
    std::size_t color = 0;     ///< Colour, alpha or area not finite.
    std::size_t total() const { return position + variance + color; }
  };

  /// Most groups: a tile keeps an image of each.
  static constexpr int kMostGroups = 1024;

  /// Throws Error(kInput) if the cloud has no variance, or not the groups that are needed, or more
  /// than kMostGroups of them. Colourless clouds are light grey. A surfel whose normal is zero
  /// always faces the eye.
  explicit RenderCloud(const SurfelCloud& cloud, const RenderColumns& needed = {});

  std::size_t size() const { return size_; }
  const std::vector<Cluster>& clusters() const { return clusters_; }
  const Vec3d& origin() const { return origin_; }
  const Dropped& dropped() const { return dropped_; }
  /// Copies of splats that were left out.
  std::size_t copies() const { return copies_; }
  bool anisotropic() const { return !tangent_x.empty(); }
  /// Some surfel has alpha below 1.
  bool transparent() const { return !alpha.empty(); }
  /// World bounds: a box, and a sphere around each cluster's discs at standard deviation 1.
  const SceneExtent& extent() const { return extent_; }
  /// Groups in use, SP06's K; 0 if groups were not asked for.
  int groups() const { return groups_; }
  /// Mean over the surfels of the larger standard deviation of each; 0 if there are none.
  double mean_deviation() const { return mean_deviation_; }
  std::uint64_t memory_bytes() const;

  // Columns, in Morton order; the optional ones are empty where the scene does not need them.
  Array<float> x, y, z;
  Array<float> normal_x, normal_y, normal_z;
  Array<float> deviation_u;  ///< Square root of the variance, along the tangent.
  Array<float> deviation_v;  ///< Only if anisotropic().
  Array<float> tangent_x, tangent_y, tangent_z;  ///< Only if anisotropic().
  Array<float> area;
  Array<float> red, green, blue;
  Array<float> alpha;             ///< Only if transparent().
  Array<std::uint16_t> material;  ///< Only if the cloud has it.
  Array<std::uint16_t> group;     ///< 0..groups() - 1, in the order of the cloud's numbers.
  Array<float> group_radius;      ///< Enlarged radius (SP06 section 4.2.2), scene units.

 private:
  void number_groups(const SurfelCloud& cloud, const Array<std::uint32_t>& order);
  void make_clusters();

  std::size_t size_ = 0;
  int groups_ = 0;
  double mean_deviation_ = 0;
  Vec3d origin_;
  std::vector<Cluster> clusters_;
  Dropped dropped_;
  std::size_t copies_ = 0;
  SceneExtent extent_;
};

}  // namespace surfel
