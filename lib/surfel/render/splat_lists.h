#pragma once

// From surfels to the splats of every tile: culling, SS01 sections 3.3 and 4, binning, sorting.

#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/render/depth_sort.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/render/renderer.h>
#include <surfel/render/splat.h>
#include <surfel/render/splat_setup.h>
#include <surfel/render/tile_raster.h>
#include <surfel/scene/camera.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// Tiles along the side of `pixels` pixels.
constexpr int tiles_along(int pixels) { return (pixels + kTileSize - 1) / kTileSize; }

/// One horizontal band of a frame.
struct Band {
  int y0, y1;  ///< Rows of pixels.
  int tiles_x, tiles_y;

  Band(const Camera& camera, int first_row, int last_row)
      : y0(first_row),
        y1(last_row),
        tiles_x(tiles_along(camera.width)),
        tiles_y(tiles_along(last_row - first_row)) {}
  std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * tiles_y; }
  /// Place of the tile in column x and row y among all, row by row.
  std::size_t tile(int x, int y) const { return static_cast<std::size_t>(y) * tiles_x + x; }
};

/// Square groups of tiles that a band is drawn in: as many as one worker's caches hold the splats
/// of, so that what is set up is drawn at once and never goes to memory.
struct BlockGrid {
  int shift = 1;  ///< A block has 2^shift tiles a side.
  int blocks_x = 0, blocks_y = 0;

  BlockGrid() = default;
  /// \param surfels  seen in the band, about.
  BlockGrid(const Band& band, std::size_t surfels);
  std::size_t blocks() const { return static_cast<std::size_t>(blocks_x) * blocks_y; }
  int size() const { return kTileSize << shift; }  ///< Pixels.
  int first_tile_x(std::size_t block) const { return static_cast<int>(block % blocks_x) << shift; }
  int first_tile_y(std::size_t block) const { return static_cast<int>(block / blocks_x) << shift; }
};

/// What is drawn of a cloud, and how.
struct SplatListOptions {
  bool normals = false;                  ///< Splats carry their normals.
  bool groups = false;                   ///< Splats carry their groups.
  bool opaque = true;                    ///< No surfel, nor material, has an opacity below 1.
  DepthOrder order = DepthOrder::kFine;  ///< Of a tile's splats.
  /// Discs have the enlarged radius of their group (SP06 section 4.2.2) instead of their own.
  bool enlarged = false;
  double lowpass =
      1;  ///< Standard deviation of the pixel filter; that of the RenderOptions or not.
};

/// Sets up the splats of a frame and lists them by tile, a block of tiles at a time. Keeps its
/// memory from frame to frame. Nothing depends on the number of threads, nor on the order of the
/// surfels in the file.
class SplatLists {
 public:
  /// Keeps references to the cloud and the scene. `options` are usable.
  SplatLists(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
             const SplatListOptions& lists);

  /// Begins a band: the clusters that reach into it, nearest first, ties by index.
  std::vector<VisibleCluster> cull(const Camera& camera, const Band& band);
  /// Lists clusters of that band, whose surfels are there, by block, in their order. They and the
  /// camera are kept by reference.
  void bin(const Camera& camera, const Band& band, const BlockGrid& grid,
           std::span<VisibleCluster> clusters);

  /// Clusters of a block.
  std::size_t clusters(std::size_t block) const {
    return block_begin_[block + 1] - block_begin_[block];
  }
  /// Sets up the splats of clusters [begin, end) of a block in the worker's memory.
  void load(std::size_t block, std::size_t begin, std::size_t end, int worker);
  /// The loaded splats of the tile in column x and row y of the block, nearest first. Valid until
  /// the worker's next call.
  TileJob job(int x, int y, int worker);

  /// Splats loaded since the last call, each counted once though it may be in several blocks ...
  std::size_t take_splat_count();
  /// ... and those of them with exact kernels.
  std::size_t take_exact_count();

 private:
  /// The splats of a tile.
  struct TileList {
    Array<std::uint32_t> splats;
    Array<float> depths;
    std::size_t count = 0;
  };
  /// What one worker has loaded, and scratch memory.
  struct Worker {
    SetUpSplats set_up;
    Array<float> deviation_u, deviation_v;  ///< Enlarged or widened ones of a cluster.
    std::size_t count = 0;                  ///< Of splats.
    Array<Splat> splats;
    Array<SplatNormal> normals;
    Array<std::uint16_t> groups;
    Array<ExactSplat> exact;  ///< Where k is kExactKernel.
    std::vector<TileList> tiles;
    DepthSortScratch sort;
    Array<std::uint32_t> order;
    std::size_t splats_seen = 0;
    std::size_t exact_seen = 0;
  };

  SplatView view(const Camera& camera, const Band& band) const;
  std::vector<std::uint32_t> level_of_detail(const Camera& camera,
                                             FunctionRef<bool(std::uint32_t)> seen) const;
  float disc_radius(const Cluster& cluster) const;
  Vec3f center_in_camera(const Cluster& cluster) const;
  void bound(const Band& band, VisibleCluster& visible) const;
  double enlargement(std::size_t surfel) const;
  /// Least standard deviation that a cluster's surfel is drawn with; 0 for those of the finest
  /// level.
  float covering_deviation(const Cluster& cluster, std::size_t surfel) const;
  SurfelColumns surfel_columns(const Cluster& cluster) const;
  SurfelColumns columns_of(const Cluster& cluster, Worker& worker) const;
  SurfelInCamera in_camera(const Cluster& cluster, std::size_t surfel) const;
  /// Room for that many `more` splats, of which there will be `most` at most.
  void reserve(Worker& worker, std::size_t more, std::size_t most) const;
  void add_splats(std::size_t begin, const std::uint32_t* surfels, Worker& worker) const;

  const RenderCloud& cloud_;
  const Scene& scene_;
  RenderOptions options_;
  SplatListOptions lists_;
  /// Of levels of detail: see covering_variance(). 0: their Gaussians are drawn as they are.
  float covering_ = 0;
  const Camera* camera_ = nullptr;
  const VisibleCluster* clusters_ = nullptr;
  SplatView view_{};  ///< Of the band being drawn.
  BlockGrid grid_;
  Array<std::uint32_t> block_begin_;     ///< Into block_clusters_.
  Array<std::uint32_t> block_clusters_;  ///< Places in clusters_, ascending.
  std::vector<Worker> workers_;
};

}  // namespace surfel
