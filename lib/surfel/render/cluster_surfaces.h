#pragma once

// What is known of the surfaces that a cluster's surfels lie on.

#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/sheet_search.h>
#include <surfel/render/splat_setup.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// The columns of a cloud from a cluster's first surfel on.
SurfelColumns surfel_columns(const RenderCloud& cloud, const Cluster& cluster);

/// A sheet that a part of a picture draws.
struct SheetInView {
  SurfelBits surfels;
  /// Depth of its middle, as Splat::depth; SheetPatch::depth.
  float depth;
};

/// Finds out how even clusters are; in transparent clouds, which are flat, and sheets. What has
/// been found is kept from picture to picture.
class ClusterSurfaces {
 public:
  /// Keeps a reference to the cloud.
  ClusterSurfaces(const RenderCloud& cloud, bool opaque, bool sheets)
      : cloud_(cloud), opaque_(opaque), sheets_(sheets), known_(cloud.clusters().size()) {}

  /// Begins a part of a picture. The clusters' surfels are in memory.
  /// \param epsilon  FragmentRules::depth_epsilon.
  void begin(std::span<const VisibleCluster> clusters, const SplatView& view, float epsilon);

  // Of the clusters of the part begun last, by their places.

  /// Whether surfels are of planes: most neighbours in their order, which are near to each other in
  /// space, lie in one plane. Where several planes cross, most neighbours still are of one plane.
  bool is_flat(std::size_t place) const { return known_[clusters_[place].index].flat; }
  /// How even the surfaces are that most surfels are of, in opaque clouds.
  const Unevenness& unevenness(std::size_t place) const {
    return known_[clusters_[place].index].uneven;
  }
  /// The cluster's sheets that pass may_sum_up().
  std::span<const SheetInView> sheets(std::size_t place) const {
    return {in_view_.data() + first_in_view_[place],
            first_in_view_[place + 1] - first_in_view_[place]};
  }

 private:
  struct Known {
    bool searched = false;
    bool flat = false;
    Unevenness uneven;
    std::vector<SurfaceSheet> sheets;
  };

  void search(const Cluster& cluster, Known& known) const;

  const RenderCloud& cloud_;
  bool opaque_;
  bool sheets_;               ///< Whether sheets are wanted.
  std::vector<Known> known_;  ///< Parallel to the cloud's clusters.
  std::span<const VisibleCluster> clusters_;
  Array<std::uint8_t> in_use_;          ///< Parallel to clusters_: which sheets are, as bits.
  Array<std::uint32_t> first_in_view_;  ///< Of clusters_, places in in_view_.
  std::vector<SheetInView> in_view_;
};

}  // namespace surfel
