#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/usable_surfels.h>
#include <surfel/store/cluster_store.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

/// Consecutive surfels of a RenderCloud with bounds for culling.
struct Cluster : ClusterBounds {
  std::uint32_t begin = 0;
  std::uint32_t end = 0;
  Vec3f half_extent{0, 0, 0};  ///< Half the sides of a box around the surfels at `center`.
  float max_group_radius = 0;  ///< Largest enlarged radius, scene units; 0 without the column.
  bool merged = false;         ///< The surfels stand for those of a finer level.
};

/// Optional columns of a RenderCloud: most pictures do without.
struct RenderColumns {
  bool groups = false;        ///< `group`.
  bool group_radius = false;  ///< `group_radius`, where the cloud has it.
  /// Copies of splats, made for every group to cover the surface (SP06 section 4.2.2), which would
  /// count twice where groups do not matter. Else the first of those with the same `source` and the
  /// same place stays.
  bool copies = false;
  bool levels = false;  ///< All levels of detail, where the cloud has them: else the finest.
};

/// A cloud made ready for rendering: unusable surfels dropped, the rest sorted along a Morton
/// curve, cut into clusters, and laid out in the columns that splat set-up streams through. Built
/// once, rendered from any number of cameras. Does not depend on the order of the surfels in the
/// cloud, but for which of several copies stays. A cloud with levels of detail keeps its order and
/// its clusters.
class SURFEL_API RenderCloud final : public ClusterStore {
 public:
  static constexpr std::uint32_t kClusterSize = kClusterSurfels;
  /// Zeros past the end of every column, so that SIMD code may read whole vectors.
  static constexpr std::size_t kPadding = kColumnPadding;
  /// Surfels that are decoded at a time: they stay in a core's cache.
  static constexpr std::size_t kBlock = 8 * std::size_t{kClusterSize};

  /// Most groups: a tile keeps an image of each.
  static constexpr int kMostGroups = 1024;

  /// No surfels.
  RenderCloud() = default;
  /// Throws Error(kInput) if the cloud has no variance, or not the groups that are needed, or more
  /// than kMostGroups of them, or levels of detail with surfels that cannot be drawn. Colourless
  /// clouds are light grey. A surfel whose normal is zero always faces the eye.
  /// `name` starts messages.
  explicit RenderCloud(const SurfelCloud& cloud, const RenderColumns& needed = {},
                       const std::string& name = {});
  /// The same of any source without levels of detail ...
  RenderCloud(SurfelSource& source, const RenderColumns& needed, const std::string& name);
  /// ... and of one with these.
  RenderCloud(const SurfelSource& source, const ClusterTree& tree, const RenderColumns& needed,
              const std::string& name);

  const RenderCloud& cloud() const override { return *this; }
  std::size_t size() const { return size_; }
  /// Of all levels of detail, parallel to tree(), if that is not empty.
  const std::vector<Cluster>& clusters() const { return clusters_; }
  /// Levels of detail; empty without, or if they were not asked for.
  const ClusterTree& tree() const { return tree_; }
  /// First surfel of the finest level; all after it are of that level, too.
  std::size_t first_finest() const { return first_finest_; }
  const Vec3d& origin() const { return origin_; }
  const UnusableSurfels& dropped() const { return dropped_; }
  /// Copies of splats that were left out.
  std::size_t copies() const { return copies_; }
  bool anisotropic() const { return !tangent_x.empty(); }
  /// Some surfel has alpha below 1.
  bool transparent() const { return !alpha.empty(); }
  /// World bounds of the finest level's discs at standard deviation 1, each within a sphere. They
  /// depend on the surfels alone, not on their clusters, and refer to this.
  SceneExtent extent() const;
  /// Groups in use, SP06's K; 0 if groups were not asked for.
  int groups() const { return groups_; }
  /// Mean over the surfels of the larger standard deviation of each; 0 if there are none, and while
  /// surfels with levels of detail are in their file.
  double mean_deviation() const { return mean_deviation_; }
  std::uint64_t memory_bytes() const;
  /// Standard deviation of a surfel along its longer axis, scene units.
  float larger_deviation(std::size_t surfel) const;

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
  friend class CloudStream;  // Fills the columns with a part of a file at a time.

  void allocate(std::size_t rows, const SurfelAttributes& attributes, const RenderColumns& needed,
                const std::string& name);
  std::vector<Array<float>*> float_columns();
  bool usable(std::size_t row, UnusableSurfels& dropped) const;
  ClusterColumns columns(std::size_t begin, std::size_t end) const;
  SurfelTotals totals(std::size_t begin, std::size_t end) const;
  SurfelTotals make_cluster(std::size_t begin, std::size_t end, Cluster& cluster) const;
  void measure(Cluster& cluster, const SurfelTotals& totals) const;
  Array<std::uint32_t> drawing_order(const SurfelSource& source, bool copies);
  void gather(const Array<std::uint32_t>& order);
  void number_groups(const std::string& name);
  void take_clusters(const ClusterTree& tree, bool levels);
  SurfelTotals check_levels(const Cluster& cluster, const std::string& name) const;
  void make_box(const Vec3f& reach_min, const Vec3f& reach_max);
  using ClusterSupport = FunctionRef<double(std::uint32_t cluster, const Vec3d& a, double b)>;
  double support(const Vec3d& a, double b, const ClusterSupport& of_cluster) const;
  double support(std::size_t begin, std::size_t end, const Vec3d& a, double b) const;

  std::size_t size_ = 0;
  std::size_t first_finest_ = 0;
  int groups_ = 0;
  double mean_deviation_ = 0;
  Vec3d origin_{0, 0, 0};
  std::vector<Cluster> clusters_;
  ClusterTree tree_;
  UnusableSurfels dropped_;
  std::size_t copies_ = 0;
  SceneExtent extent_;  ///< With a support function if the surfels are in their file.
};

}  // namespace surfel
