#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/surface_sample.h>
#include <surfel/store/render_cloud.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

struct CloudStreamOptions {
  std::size_t batch = std::size_t{1} << 20;  ///< Most surfels fetched at once, >= 256.
  /// Bytes that the A-buffers of a picture may take. A picture that needs more is made in bands,
  /// each of which fetches the clusters that it sees.
  std::size_t picture_bytes = std::size_t{1} << 28;
  bool places = false;  ///< RenderColumns::places.

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// A cloud that stays in its file. Its clusters are 256 consecutive surfels each, whose bounds are
/// measured in one pass over the file, or the clusters that a file with levels of detail stores
/// with their bounds. A picture fetches the clusters that it sees, nearest first, a batch at a
/// time; clusters that an earlier picture fetched are kept while there is room. The bounds take 120
/// bytes a cluster; a batch of surfels is in memory besides.
class SURFEL_API CloudStream final : public ClusterStore {
 public:
  /// Streams a source without levels of detail, to which it keeps a reference. Null if consecutive
  /// surfels do not lie close together, so that clusters of them would be too large to be culled.
  /// Surfels in the order of morton_order() make the clusters that a RenderCloud makes of them;
  /// scan lines make larger ones. Throws Error(kUsage) for unusable options.
  static std::unique_ptr<CloudStream> make(SurfelSource& source, const CloudStreamOptions& options);
  /// Streams a source with levels of detail: all levels, or the finest alone if `levels` is false.
  /// Keeps a reference to the source, not to the tree. Surfels are not read before a picture
  /// fetches them, except that alpha, where the source has it, is read once to find a value below 1
  /// in the finest level. Throws Error(kUsage) for unusable options; fetch() throws Error(kInput)
  /// for surfels that cannot be drawn, with a message that `name` starts.
  static std::unique_ptr<CloudStream> make(SurfelSource& source, const ClusterTree& tree,
                                           bool levels, const CloudStreamOptions& options,
                                           const std::string& name);

  /// A sample of surfels [begin, end) of a source, which reads them once.
  static SurfaceSample sample(const SurfelSource& source, std::size_t begin, std::size_t end);
  /// Do the surfels have one colour? Some thousand are looked at, spread evenly; true where there
  /// are none.
  static bool have_one_color(const SurfelSource& source);
  /// Have all surfels the colour black, which some programs write where there is none? False where
  /// there are no colours, or no surfels. Reads surfels up to the first that is not black.
  static bool all_black(const SurfelSource& source);

  /// All clusters, and columns that hold the surfels of the clusters fetched last, at the rows
  /// Cluster::begin to Cluster::end, and of as many other clusters as there is room for.
  const RenderCloud& cloud() const override { return cloud_; }

  bool resident() const override { return false; }
  std::size_t batch_clusters() const override { return options_.batch / RenderCloud::kClusterSize; }
  std::size_t picture_bytes() const override { return options_.picture_bytes; }

  /// Reads the clusters whose columns are not in memory. `clusters` are a batch at most.
  void fetch(std::span<const VisibleCluster> clusters) override;
  /// Announces the clusters to be fetched next, so that the system reads them ahead.
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
  bool finest_transparent(const ClusterTree& tree) const;
  void allocate();
  void drop_unusable(RenderCloud& rows, std::size_t begin, std::size_t& end,
                     UnusableSurfels& dropped) const;
  std::size_t surfel_end(std::uint32_t cluster) const;

  SurfelSource& source_;
  CloudStreamOptions options_;
  std::string name_;
  SurfelAttributes attributes_;  ///< Attributes that matter to the picture.
  RenderCloud cloud_;
  bool from_tree_ = false;             ///< The file stores the clusters as levels of detail.
  std::vector<std::uint64_t> surfel_;  ///< First surfel in the file of each cluster.
  // The columns are cut into slots of kClusterSize rows; a slot holds one cluster.
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::vector<std::uint32_t> slot_;    ///< Slot of each cluster, or kNone.
  std::vector<std::uint32_t> holder_;  ///< Cluster in each slot, or kNone.
  std::size_t next_slot_ = 0;          ///< Slot that the next new cluster takes, if it is not kept.
};

}  // namespace surfel
