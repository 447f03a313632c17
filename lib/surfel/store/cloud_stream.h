#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/store/render_cloud.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

struct CloudStreamOptions {
  std::size_t batch = std::size_t{1} << 20;  ///< Most surfels fetched at once, >= 256.
  /// What a picture's A-buffer may take while its surfels are fetched; larger pictures are made in
  /// bands, for each of which what it sees is read.
  std::size_t picture_bytes = std::size_t{1} << 28;

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// A cloud that stays in its file. One pass over the file bounds the clusters, 256 consecutive
/// surfels each, unless it brings them, as levels of detail do; a picture then fetches the clusters
/// that it sees, nearest first, a batch at a time, but for those that it still has from the
/// pictures before. Memory is that of the bounds, 120 bytes a cluster, and of a batch.
class SURFEL_API CloudStream final : public ClusterStore {
 public:
  /// Keeps a reference to the source. Null if consecutive surfels do not lie close together, and so
  /// are no clusters. Those along a Morton curve, as morton_order() has them, are the same clusters
  /// as in memory; scan lines are larger.
  static std::unique_ptr<CloudStream> make(SurfelSource& source, const CloudStreamOptions& options);
  /// With levels of detail, all or (`levels` false) the finest. Of the file, nothing is read before
  /// a picture wants it, except where surfels have alpha: whether any of the finest is below 1.
  /// fetch() throws Error(kInput) for surfels that cannot be drawn; `name` starts its message.
  static std::unique_ptr<CloudStream> make(SurfelSource& source, const ClusterTree& tree,
                                           bool levels, const CloudStreamOptions& options,
                                           const std::string& name);

  /// Its clusters are all there; its columns hold the clusters fetched last, where their begin and
  /// end say, and as many others as there is room for.
  const RenderCloud& cloud() const override { return cloud_; }

  bool resident() const override { return false; }
  std::size_t batch_clusters() const override { return options_.batch / RenderCloud::kClusterSize; }
  std::size_t picture_bytes() const override { return options_.picture_bytes; }

  /// Reads the columns of those of these clusters, a batch at most, that are not there.
  void fetch(std::span<const VisibleCluster> clusters) override;
  /// Tells that these clusters will be fetched next: the system reads them ahead.
  void expect(std::span<const VisibleCluster> clusters) const override;

 private:
  /// Consecutive clusters, whose surfels follow one another in the file.
  struct Run {
    std::uint32_t first;  ///< Index of a cluster.
    std::uint32_t count;
  };
  std::vector<std::uint32_t> missing(std::span<const VisibleCluster> clusters) const;
  std::vector<Run> runs(const std::vector<std::uint32_t>& clusters, std::size_t longest) const;
  void make_room(std::span<const VisibleCluster> clusters,
                 const std::vector<std::uint32_t>& missing);
  CloudStream(SurfelSource& source, const CloudStreamOptions& options, const std::string& name);
  const RenderCloud& read(std::size_t begin, std::size_t end, RenderCloud& rows) const;
  bool make_index();
  bool finest_transparent(std::size_t first) const;
  void allocate();
  double support(const Vec3d& along, double outward) const;
  void drop_unusable(RenderCloud& rows, std::size_t begin, std::size_t& end,
                     UnusableSurfels& dropped) const;
  std::size_t surfel_end(std::uint32_t cluster) const;

  SurfelSource& source_;
  CloudStreamOptions options_;
  std::string name_;
  SurfelAttributes attributes_;  ///< That matter to the picture.
  RenderCloud cloud_;
  bool from_tree_ = false;             ///< The clusters are those of levels of detail.
  std::vector<std::uint64_t> surfel_;  ///< Of each cluster, its first surfel in the file.
  // The columns are slots of kClusterSize rows, one a cluster.
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::vector<std::uint32_t> slot_;    ///< Of each cluster, or kNone.
  std::vector<std::uint32_t> holder_;  ///< Of each slot the cluster, or kNone.
  std::size_t next_slot_ = 0;          ///< To be taken from its holder next: the oldest, about.
};

}  // namespace surfel
