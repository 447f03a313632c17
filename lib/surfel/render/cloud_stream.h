#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <surfel/render/render_cloud.h>
#include <surfel/render/surfel_source.h>

namespace surfel {

struct VisibleCluster;

/// A cloud that stays in its file. One pass over the file bounds the clusters, 256 consecutive
/// surfels each; a picture then fetches the clusters that it sees, nearest first, a batch at a
/// time. Memory is that of the bounds, 110 bytes a cluster, and of a batch. The file is read once
/// for the bounds and once for each picture (of what is seen).
class CloudStream {
 public:
  /// Keeps a reference to the source. `batch` is the most surfels that are fetched at once. Null
  /// if consecutive surfels do not lie close together, and so are no clusters. Those along a Morton
  /// curve, as morton_order() has them, are the same clusters as in memory; scan lines are larger.
  static std::unique_ptr<CloudStream> make(SurfelSource& source, std::size_t batch);

  /// Its clusters are all there; its columns hold the clusters fetched last, where their begin and
  /// end say.
  const RenderCloud& cloud() const { return cloud_; }

  /// Reads the columns of these clusters, at most a batch of surfels.
  void fetch(const VisibleCluster* clusters, std::size_t count);
  /// Tells that these clusters will be fetched next: the system reads them ahead.
  void expect(const VisibleCluster* clusters, std::size_t count) const;

 private:
  /// Consecutive clusters.
  struct Run {
    std::uint32_t first;  ///< Index of a cluster.
    std::uint32_t count;
  };
  std::vector<Run> runs(const VisibleCluster* clusters, std::size_t count,
                        std::size_t longest) const;
  explicit CloudStream(SurfelSource& source) : source_(source) {}
  bool make_index();
  void drop_unusable(RenderCloud& rows, std::size_t begin, std::size_t& end,
                     RenderCloud::Dropped& dropped) const;
  std::size_t surfel(std::uint32_t cluster) const {
    return std::size_t{block_[cluster]} * RenderCloud::kClusterSize;
  }
  std::size_t surfel_end(std::uint32_t cluster) const;

  SurfelSource& source_;
  SurfelAttributes attributes_;  ///< That matter to the picture.
  RenderCloud cloud_;
  std::vector<std::uint32_t> block_;  ///< Of each cluster, its place in the file, in cluster sizes.
};

}  // namespace surfel
