#pragma once

// From surfels to the splats of every tile: culling, SS01 sections 3.3 and 4, binning, sorting.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/cluster_culling.h>
#include <surfel/render/cluster_surfaces.h>
#include <surfel/render/compositor.h>
#include <surfel/render/depth_sort.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/render/frame.h>
#include <surfel/render/render_options.h>
#include <surfel/render/sheet.h>
#include <surfel/render/splat.h>
#include <surfel/render/splat_setup.h>
#include <surfel/render/tile_raster.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/scene.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// The splats that a sheet sums up.
struct NotedSheet {
  std::uint32_t first, end;  ///< The patches that have the sums, by SheetPatch::sums.
  std::vector<Splat> splats;
  std::vector<std::uint32_t> surfels;  ///< Parallel to `splats`: rows in the cloud's columns.
};

/// Sets up the splats of a frame and lists them by tile, a block of tiles at a time. Keeps its
/// memory from frame to frame. Nothing depends on the number of threads, nor on the order of the
/// surfels in the file.
class SplatLists {
 public:
  /// Keeps references to the cloud, the scene and the options, which are usable.
  /// \param layout of the tiles' A-buffers: it decides whether splats carry normals and alpha.
  SplatLists(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
             const ABufferLayout& layout, const SplatListOptions& lists);

  const SplatListOptions& options() const { return lists_; }
  /// Begins a band: the clusters that reach into it, nearest first, ties by index.
  std::vector<VisibleCluster> cull(const Camera& camera, const Band& band) {
    return culling_.cull(camera, band);
  }
  /// Of the band begun last.
  const ClusterCulling& culling() const { return culling_; }
  /// Lists clusters of the frame, whose surfels are in memory, by block, in their order. Keeps a
  /// reference to the frame.
  void bin(const Frame& frame, std::span<const VisibleCluster> clusters);

  /// Clusters of a block.
  std::size_t clusters(std::size_t block) const {
    return block_begin_[block + 1] - block_begin_[block];
  }
  /// Sets up the splats of clusters [begin, end) of a block in the worker's memory.
  void load(std::size_t block, std::size_t begin, std::size_t end, int worker);
  /// The loaded splats of the tile in column x and row y of the block, nearest first. Valid until
  /// the worker's next call.
  TileJob job(int x, int y, int worker);

  /// Whether load() notes the surfels of splats and the members of sheets from the next call on, as
  /// explanations of pixels want them.
  void note_surfels(bool note) { notes_surfels_ = note; }
  /// Row in the cloud's columns of the surfel of one of the worker's splats.
  std::uint32_t surfel_of(std::uint32_t splat, int worker) {
    return workers_[worker].surfels[splat];
  }
  /// The splats that are summed up in one of the worker's sheets.
  const NotedSheet& sheet_of(const SheetPatch& sheet, int worker);

  /// Splats loaded since the last call, each counted once though it may be in several blocks ...
  std::size_t take_splat_count();
  /// ... and the splats with exact kernels among them.
  std::size_t take_exact_count();
  /// Pixels of splats in sheets since the last call, see FrameStatistics::fragments.
  std::uint64_t take_fragment_count();
  /// Splats that tiles have left out since the last call, see thin_out().
  std::size_t take_thinned_count();

 private:
  /// The splats of a tile, without the splats that cover the whole block.
  struct TileList {
    Array<std::uint32_t> splats;  ///< Ascending.
    Array<float> depths;
    std::size_t count = 0;
    std::size_t clipped = 0;  ///< Splats that half-planes cut.
    /// Of a tile, and sorted by sort_sheets().
    std::vector<SheetPatch> sheets, sorted_sheets;
    std::array<std::uint32_t, kTilePixels / kPatchPixels + 1> sheets_begin{};
    std::size_t large = 0;  ///< Splats whose box is as wide and as high as a tile, or more.
  };
  /// The splats that one worker has loaded, and its scratch memory.
  struct Worker {
    SetUpSplats set_up;
    Array<float> deviation_u, deviation_v;  ///< Enlarged or widened deviations of a cluster.
    std::size_t count = 0;                  ///< Number of splats.
    std::size_t loaded = 0;   ///< Without the copies that thin_out() makes for a tile.
    std::uint64_t loads = 0;  ///< How many times splats have been loaded.
    Array<Splat> splats;
    Array<SplatNormal> normals;
    Array<std::uint16_t> groups;
    Array<ExactSplat> exact;  ///< Where k is kExactKernel.
    Array<SplatClip> clips;   ///< Where kClippedTag is set.
    std::vector<TileList> tiles;
    SheetSums sheets;
    std::vector<std::uint32_t> surfels;    ///< Parallel to `splats`, if they are noted.
    std::vector<NotedSheet> noted_sheets;  ///< Ascending, if they are noted.
    /// Splats whose boxes hold all pixels of the block, ascending: each tile has all of them.
    std::vector<std::uint32_t> covering;
    std::size_t clipped_covering = 0;   ///< Splats among them that half-planes cut.
    std::vector<std::uint32_t> copies;  ///< Scratch of thin_out().
    PixelBox block{};                   ///< All pixels of the block.
    DepthSortScratch sort;
    Array<std::uint32_t> order;
    std::size_t splats_seen = 0;
    std::size_t exact_seen = 0;
    std::size_t thinned = 0;
  };

  const SplatView& band_view() const { return culling_.view(); }
  float enlargement(std::size_t surfel) const;
  void enlarge(const Cluster& cluster, const Array<float>& deviation, float* out) const;
  /// Least standard deviation that a cluster's surfel is drawn with; 0 for surfels of the finest
  /// level.
  float covering_deviation(const Cluster& cluster, std::size_t surfel) const;
  SurfelColumns columns_of(const Cluster& cluster, Worker& worker) const;
  SurfelInCamera in_camera(const Cluster& cluster, std::size_t surfel) const;
  /// Makes room for `more` further splats; a block's splats will be `most` in all at most.
  void reserve(Worker& worker, std::size_t more, std::size_t most) const;
  static void add_covering(TileList& list, const Worker& worker);
  void thin_out(TileList& list, Worker& worker) const;
  void complete(std::size_t place, std::size_t begin, const std::uint32_t* surfels, Worker& worker);
  void take_sheets(std::size_t place, const SplatView& view, std::size_t begin,
                   const std::uint32_t* surfels, Worker& worker);
  void add_by_tags(const SplatView& view, const SheetSplats& sheet, std::uint32_t* members,
                   const std::uint32_t* surfels, Worker& worker) const;
  static void sort_sheets(TileList& list);
  void add_splats(std::size_t begin, Worker& worker);

  const RenderCloud& cloud_;
  const Scene& scene_;
  const RenderOptions& options_;
  ABufferLayout layout_;
  SplatListOptions lists_;
  ClusterCulling culling_;
  std::optional<ClusterSurfaces> surfaces_;  ///< Of transparent clouds.
  FragmentRules rules_;
  bool notes_surfels_ = false;   ///< See note_surfels().
  bool materials_fade_ = false;  ///< Whether some material has an opacity of its own.
  /// The least variance of surfels of coarser levels, see covering_variance(); 0: their Gaussians
  /// are drawn as they are.
  float covering_ = 0;
  const Frame* frame_ = nullptr;  ///< The frame being drawn.
  const VisibleCluster* clusters_ = nullptr;
  Array<TileRange> tiles_;               ///< Parallel to clusters_.
  Array<std::uint32_t> block_begin_;     ///< Into block_clusters_.
  Array<std::uint32_t> block_clusters_;  ///< Places in clusters_, ascending.
  PerWorker<Worker> workers_;
};

}  // namespace surfel
