#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/peers.h>
#include <surfel/render/cluster_culling.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/cluster_tree.h>
#include <surfel/store/cloud_loader.h>
#include <surfel/store/gathered_clusters.h>

namespace surfel {

/// Draws pictures of a cloud of which several processes hold a part each (LoadedCloud::part()). For
/// each picture a process cuts the levels of its part, culls, reads the clusters that are drawn and
/// sends each to the processes whose rows it reaches into; these draw what has come, in the order
/// that one process draws it in. So pictures have the bytes of one process that holds all, whatever
/// the number of processes, provided that it draws what a picture shows in one batch.
///
/// What is sent are clusters, not splats: the columns of a surfel take 40 to 60 bytes, its splat 64
/// to 150, of which several are made where it reaches over several blocks.
///
/// Memory: the part and its batch of surfels, and as much again for what has come. Rows that show
/// more are drawn one part after another; all processes take as many parts.
class SURFEL_API SharedRenderer {
 public:
  /// All peers make one together, with the same scene and options. Keeps references to the cloud,
  /// which has a part, the peers and the scene. Throws as Renderer does.
  SharedRenderer(const LoadedCloud& loaded, Peers& peers, const Scene& scene,
                 const RenderOptions& options);

  /// Draws the camera's rows; each peer calls it for one picture, with rows of its own, which may
  /// be none. Rows of a picture without any are not set. FrameStatistics::milliseconds is without
  /// the time of cutting, reading and sending, which is in its stages.
  Image render(const Camera& camera, FrameStatistics* statistics = nullptr);

 private:
  PictureLoad load_of(std::span<const VisibleCluster> visible);
  std::vector<RowRange> rows_of_all(const RowRange& rows);
  int parts_of(const Camera& camera, std::span<const RowRange> rows,
               std::span<const VisibleCluster> visible);
  void gather(std::span<const RowRange> seen, std::span<const VisibleCluster> visible,
              FrameStatistics& statistics);
  template <class Visit>
  void visit_receivers(std::span<const RowRange> seen, std::uint32_t cluster,
                       const Visit& visit) const;

  ClusterStore& store_;
  const TreePart& part_;
  Peers& peers_;
  GatheredClusters gathered_;
  RenderOptions options_;
  Renderer renderer_;
  ClusterCulling culling_;  ///< Of the own part.
};

}  // namespace surfel
