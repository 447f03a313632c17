#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/stray_points.h>
#include <surfel/scene/surface_sample.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/usable_surfels.h>
#include <surfel/store/cluster_store.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

/// Consecutive surfels of a RenderCloud with bounds for culling.
struct Cluster : ClusterBounds {
  std::uint32_t begin = 0;  ///< First surfel's row in the columns.
  std::uint32_t end = 0;    ///< One past the last surfel's row.
  /// Half the sides of a box around the surfels, centred at `center`. The box around the sphere for
  /// levels of detail that stay in their file, until the cluster has been fetched.
  Vec3f half_extent{0, 0, 0};
  float max_group_radius = 0;  ///< Largest enlarged radius, scene units; 0 without the column.
  bool merged = false;         ///< The surfels replace surfels of a finer level of detail.
  bool copies = false;         ///< The surfels are copies, see RenderColumns::copies.
};

/// Parts of a cloud that only some pictures need.
struct RenderColumns {
  bool groups = false;        ///< The column `group`.
  bool group_radius = false;  ///< The column `group_radius`, if the cloud has it.
  /// Copies of splats that surfel-group made so that every group covers the surface (SP06 section
  /// 4.2.2): of all surfels with equal `source` and position all but the first. They follow all
  /// others, in clusters of their own. If false, they are left out, because they would count twice
  /// in a picture without groups.
  bool copies = false;
  bool levels = false;  ///< All levels of detail of the cloud; if false, the finest alone.
  bool places = false;  ///< The column `place`.
};

/// A cloud made ready for rendering: unusable surfels are dropped, the rest is sorted along a
/// Morton curve, cut into clusters, and laid out in the columns that splat set-up streams through.
/// It is built once and rendered from any number of cameras. The order of the surfels in the cloud
/// only decides which of several copies is kept, or is taken for the original. Where a cluster's
/// worth of surfels or more lie at one place, surfels there that differ in colour, alpha and area
/// alone are one, of all their area. A cloud with levels of detail keeps its order and its
/// clusters.
class SURFEL_API RenderCloud final : public ClusterStore {
 public:
  static constexpr std::uint32_t kClusterSize = kClusterSurfels;
  /// Zeros past the end of every column, so that SIMD code may read whole vectors.
  static constexpr std::size_t kPadding = kColumnPadding;
  /// Surfels that are decoded at a time: few enough to stay in a core's cache.
  static constexpr std::size_t kBlock = 8 * std::size_t{kClusterSize};

  /// Most groups that can be drawn: a tile keeps an image of each group.
  static constexpr int kMostGroups = 1024;

  /// SurfelCloud::clip1 or clip2: a direction is a unit vector of the surfel's plane, or zero.
  struct ClipColumns {
    Array<float> x, y, z, distance;
  };

  /// A cloud without surfels.
  RenderCloud() = default;
  /// Throws Error(kInput) if the cloud has no variance, or if groups are needed and the cloud has
  /// none or more than kMostGroups, or if its levels of detail hold surfels that cannot be drawn;
  /// `name` starts messages. Surfels without colour are light grey. A surfel whose normal is zero
  /// always faces the eye. Keeps no reference to the cloud.
  explicit RenderCloud(const SurfelCloud& cloud, const RenderColumns& needed = {},
                       const std::string& name = {});
  /// Reads a source without levels of detail.
  RenderCloud(SurfelSource& source, const RenderColumns& needed, const std::string& name);
  /// Reads a source with levels of detail.
  RenderCloud(const SurfelSource& source, const ClusterTree& tree, const RenderColumns& needed,
              const std::string& name);

  const RenderCloud& cloud() const override { return *this; }
  std::size_t size() const { return size_; }
  /// The clusters; element i belongs to tree()[i] if there are levels of detail.
  const std::vector<Cluster>& clusters() const { return clusters_; }
  /// Levels of detail; empty if the cloud has none, or if they were not asked for.
  const ClusterTree& tree() const { return tree_; }
  /// May surfels be of coarser levels, which stand for others?
  bool has_levels() const { return !tree_.empty(); }
  /// First surfel of the finest level, which goes on to the last surfel.
  std::size_t first_finest() const { return first_finest_; }
  const Vec3d& origin() const { return origin_; }
  const UnusableSurfels& dropped() const { return dropped_; }
  /// Number of surfels that were merged into others at their place, see the class.
  std::size_t coincident() const { return coincident_; }
  /// Number of the copies of splats that were left out.
  std::size_t copies() const { return copies_; }
  /// Does the cloud hold copies?
  bool has_copies() const { return first_copy_ < size_; }
  bool anisotropic() const { return !tangent_x.empty(); }
  /// Are there normals for shading that are not the discs' own?
  bool has_shading() const { return !shading_x.empty(); }
  /// May there be surfels that are cut by half-planes?
  bool has_clips() const { return !clip[0].x.empty() || !clip[1].x.empty(); }
  /// Does a half-plane cut a surfel?
  static bool clips(const ClipColumns& columns, std::size_t surfel) {
    return !columns.x.empty() &&
           (columns.x[surfel] != 0 || columns.y[surfel] != 0 || columns.z[surfel] != 0);
  }
  /// Is a surfel cut by a half-plane, or by two?
  bool is_clipped(std::size_t surfel) const {
    return clips(clip[0], surfel) || clips(clip[1], surfel);
  }
  /// Does a half-plane cut off a surfel's centre? As is_cut_off() of scene/clips.h.
  bool is_cut_off(std::size_t surfel) const {
    return std::any_of(clip.begin(), clip.end(), [&](const ClipColumns& c) {
      return clips(c, surfel) && c.distance[surfel] < 0;
    });
  }
  /// The normal that a surfel is shaded with.
  Vec3f shading(std::size_t surfel) const {
    return has_shading() ? Vec3f(shading_x[surfel], shading_y[surfel], shading_z[surfel])
                         : Vec3f(normal_x[surfel], normal_y[surfel], normal_z[surfel]);
  }
  /// Is the alpha of some surfel below 1?
  bool transparent() const { return !alpha.empty(); }
  /// World bounds of the finest level's discs at standard deviation 1; its support function takes
  /// the sphere around each disc. Surfels whose centres half-planes cut off are left out, so that a
  /// cloud with mirrored surfels is framed as the cloud without. The bounds do not depend on how
  /// surfels are clustered. Its core leaves out what find_core() calls stray. The support functions
  /// refer to this object.
  SceneExtent extent() const&;
  SceneExtent extent() const&& = delete;
  /// Groups in use, SP06's K; 0 if groups were not asked for.
  int groups() const { return groups_; }
  /// Mean over the surfels of larger_deviation(), scene units; 0 without surfels, and for surfels
  /// with levels of detail that stay in their file.
  double mean_deviation() const { return mean_deviation_; }
  /// Bytes that columns, clusters and tree take.
  std::uint64_t memory_bytes() const;
  /// A surfel as SurfaceSample has it.
  SurfaceSample::Point sample_point(std::size_t surfel) const {
    return {{x[surfel], y[surfel], z[surfel]},
            {normal_x[surfel], normal_y[surfel], normal_z[surfel]},
            area[surfel]};
  }
  /// Standard deviation of a surfel along its longer axis, scene units.
  float larger_deviation(std::size_t surfel) const;

  // Columns, in Morton order; optional columns are empty if the picture does not need them.
  Array<float> x, y, z;
  Array<float> normal_x, normal_y, normal_z;
  /// SurfelCloud::shading_normal, nowhere zero where a normal is known; only if has_shading().
  Array<float> shading_x, shading_y, shading_z;
  Array<float> deviation_u;  ///< Square root of the variance, along the tangent.
  Array<float> deviation_v;  ///< Only if anisotropic().
  Array<float> tangent_x, tangent_y, tangent_z;  ///< Only if anisotropic().
  Array<float> area;
  std::array<ClipColumns, 2> clip;  ///< Each only if the cloud has it.
  Array<float> red, green, blue;
  Array<float> alpha;             ///< Only if transparent().
  Array<std::uint16_t> material;  ///< Only if the cloud has materials.
  Array<std::uint16_t> group;     ///< 0..groups() - 1, in the order of the cloud's numbers.
  Array<float> group_radius;      ///< Enlarged radius (SP06 section 4.2.2), scene units.
  /// Places of the surfels in the cloud or file that they come from, 0 first; only if asked for. Of
  /// surfels that were merged at one place, one of their places.
  Array<std::uint64_t> place;

 private:
  friend class CloudStream;      // Fills the columns with a part of a file at a time.
  friend class AttributeValues;  // Likewise.

  void allocate(std::size_t rows, const SurfelAttributes& attributes, const RenderColumns& needed,
                const std::string& name);
  /// Pointers to all columns of floats of a RenderCloud, const or not.
  template <class Cloud>
  static auto float_columns(Cloud& c) {
    return std::array{&c.x,           &c.y,           &c.z,         &c.normal_x,
                      &c.normal_y,    &c.normal_z,    &c.shading_x, &c.shading_y,
                      &c.shading_z,   &c.tangent_x,   &c.tangent_y, &c.tangent_z,
                      &c.deviation_u, &c.deviation_v, &c.area,      &c.red,
                      &c.green,       &c.blue,        &c.alpha,     &c.group_radius,
                      &c.clip[0].x,   &c.clip[0].y,   &c.clip[0].z, &c.clip[0].distance,
                      &c.clip[1].x,   &c.clip[1].y,   &c.clip[1].z, &c.clip[1].distance};
  }
  bool usable(std::size_t row, UnusableSurfels& dropped) const;
  ClusterColumns columns(std::size_t begin, std::size_t end) const;
  SurfelTotals totals(std::size_t begin, std::size_t end) const;
  SurfelTotals make_cluster(std::size_t begin, std::size_t end, Cluster& cluster) const;
  void measure(Cluster& cluster, const SurfelTotals& totals) const;
  Array<std::uint32_t> drawing_order();
  void move_copies(const SurfelSource& source, bool keep, Array<std::uint32_t>& order);
  std::vector<SurfelTotals> make_clusters();
  void number_rows(std::size_t begin, std::size_t end, std::uint64_t first);
  void gather(const Array<std::uint32_t>& order);
  Array<std::uint32_t> merge_coincident();
  void number_groups(const std::string& name);
  void take_clusters(const ClusterTree& tree, bool levels);
  SurfelTotals check_levels(const Cluster& cluster, const std::string& name) const;
  void make_box(const Vec3f& reach_min, const Vec3f& reach_max);
  using RowVisitor = FunctionRef<void(const RenderCloud& rows, std::size_t begin, std::size_t end)>;
  void visit_rows(std::uint32_t cluster, RenderCloud& scratch, RowVisitor visit) const;
  double support(const Vec3d& a, double b, const std::optional<Bounds>& within, bool cut_off) const;
  double reach(std::size_t row, const Vec3d& a, double b) const;
  std::optional<CloudCore> core() const;

  std::size_t size_ = 0;
  std::size_t first_finest_ = 0;
  int groups_ = 0;
  double mean_deviation_ = 0;
  Vec3d origin_{0, 0, 0};
  std::vector<Cluster> clusters_;
  ClusterTree tree_;
  UnusableSurfels dropped_;
  std::size_t coincident_ = 0;
  std::size_t copies_ = 0;
  std::size_t first_copy_ = std::numeric_limits<std::size_t>::max();
  Bounds box_;  ///< See extent().
  /// Reads the surfels of a cluster; only if they stay in their file.
  std::function<void(std::uint32_t cluster, RenderCloud& scratch, RowVisitor visit)> read_rows_;
};

}  // namespace surfel
