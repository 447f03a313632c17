#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/render/render_cloud.h>
#include <surfel/render/surfel_source.h>

namespace surfel {

struct VisibleCluster;

struct CloudStreamOptions {
  std::size_t batch = std::size_t{1} << 20;  ///< Most surfels fetched at once, 256 at least.
  /// What a picture's A-buffer may take while its surfels are fetched; larger pictures are made in
  /// bands, for each of which what it sees is read.
  std::size_t picture_bytes = std::size_t{1} << 28;
};

/// A cloud that stays in its file. One pass over the file bounds the clusters, 256 consecutive
/// surfels each; a picture then fetches the clusters that it sees, nearest first, a batch at a
/// time. Memory is that of the bounds, 110 bytes a cluster, and of a batch. The file is read once
/// for the bounds and once for each picture (of what is seen).
class SURFEL_API CloudStream {
 public:
  /// Keeps a reference to the source. Null if consecutive surfels do not lie close together, and so
  /// are no clusters. Those along a Morton curve, as morton_order() has them, are the same clusters
  /// as in memory; scan lines are larger.
  static std::unique_ptr<CloudStream> make(SurfelSource& source, const CloudStreamOptions& options);

  /// Its clusters are all there; its columns hold the clusters fetched last, where their begin and
  /// end say.
  const RenderCloud& cloud() const { return cloud_; }

  /// Clusters that are fetched at once, at most.
  std::size_t batch_clusters() const { return options_.batch / RenderCloud::kClusterSize; }
  std::size_t picture_bytes() const { return options_.picture_bytes; }

  /// Reads the columns of these clusters, a batch at most.
  void fetch(std::span<const VisibleCluster> clusters);
  /// Tells that these clusters will be fetched next: the system reads them ahead.
  void expect(std::span<const VisibleCluster> clusters) const;

 private:
  /// Consecutive clusters.
  struct Run {
    std::uint32_t first;  ///< Index of a cluster.
    std::uint32_t count;
  };
  std::vector<Run> runs(std::span<const VisibleCluster> clusters, std::size_t longest) const;
  CloudStream(SurfelSource& source, const CloudStreamOptions& options)
      : source_(source), options_(options) {}
  bool make_index();
  void drop_unusable(RenderCloud& rows, std::size_t begin, std::size_t& end,
                     UnusableSurfels& dropped) const;
  std::size_t surfel(std::uint32_t cluster) const {
    return std::size_t{block_[cluster]} * RenderCloud::kClusterSize;
  }
  std::size_t surfel_end(std::uint32_t cluster) const;

  SurfelSource& source_;
  CloudStreamOptions options_;
  SurfelAttributes attributes_;  ///< That matter to the picture.
  RenderCloud cloud_;
  std::vector<std::uint32_t> block_;  ///< Of each cluster, its place in the file, in cluster sizes.
};

}  // namespace surfel
