#pragma once

// From surfels to the splats of every tile: culling, SS01 sections 3.3 and 4, binning, sorting.

#include <cstdint>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/base/timing.h>
#include <surfel/base/types.h>
#include <surfel/io/camera.h>
#include <surfel/render/ewa_kernel.h>
#include <surfel/render/render_cloud.h>
#include <surfel/render/renderer.h>
#include <surfel/render/splat.h>
#include <surfel/render/splat_setup.h>
#include <surfel/render/tile_raster.h>

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
};

/// Cluster seen by the camera.
struct VisibleCluster {
  float nearest;  ///< Least z of its surfels' bounding sphere.
  std::uint32_t index;
  double references;  ///< Upper estimate of the tile list entries of its splats.
};

/// What is drawn of a cloud, and how.
struct SplatListOptions {
  bool normals = false;  ///< Splats carry their normals.
  bool groups = false;   ///< Splats carry their groups.
  bool opaque = true;    ///< No surfel, nor material, has an opacity below 1.
  /// Discs have the enlarged radius of their group (SP06 section 4.2.2) instead of their own.
  bool enlarged = false;
  double lowpass =
      1;  ///< Standard deviation of the pixel filter; that of the RenderOptions or not.
};

/// Sets up the splats of a frame and lists them by tile, a batch of clusters at a time. Keeps its
/// memory from frame to frame. Nothing depends on the number of threads, nor on the order of the
/// surfels in the file.
class SplatLists {
 public:
  /// Keeps references to the cloud and the scene. `options` are usable.
  SplatLists(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
             const SplatListOptions& lists);

  /// Begins a band: the clusters that reach into it, nearest first, ties by index.
  std::vector<VisibleCluster> cull(const Camera& camera, const Band& band);
  /// End of the batch of clusters that starts at `begin`: as many as fit RenderOptions::batch.
  std::size_t end_of_batch(const std::vector<VisibleCluster>& clusters, std::size_t begin) const;

  /// Sets up the splats of `count` clusters, and lists them. Adds to the stages setup and bin.
  /// Returns how many are seen.
  std::size_t make(const Camera& camera, const Band& band, const VisibleCluster* clusters,
                   std::size_t count, StageTimes& stages);

  std::size_t count(std::size_t tile) const { return tile_begin_[tile + 1] - tile_begin_[tile]; }
  /// A tile's splats, nearest first. Valid until the worker's next call.
  TileJob job(std::size_t tile, int worker);

  /// Splats with exact kernels since the last call.
  std::size_t take_exact_count();

 private:
  /// A tile list's entry.
  struct Reference {
    std::uint32_t splat;
    float depth;
  };
  /// Scratch memory of one worker.
  struct Worker {
    SplatColumns columns;
    Array<float> deviation_u, deviation_v;  ///< Enlarged or widened ones of a cluster.
    std::vector<std::uint32_t> order;
    std::vector<std::uint32_t> other;
    std::vector<std::uint32_t> keys;
    std::size_t exact_splats = 0;
  };

  SplatView view(const Camera& camera, const Band& band) const;
  std::vector<std::uint32_t> level_of_detail(const Camera& camera,
                                             FunctionRef<bool(std::uint32_t)> seen) const;
  float disc_radius(const Cluster& cluster) const;
  double enlargement(std::size_t surfel) const;
  /// Least standard deviation that a surfel is drawn with; 0 for those of the finest level.
  float covering_deviation(std::size_t surfel) const;
  SurfelColumns columns_of(const Cluster& cluster, Worker& worker) const;
  SurfelInCamera in_camera(const Camera& camera, std::size_t surfel) const;
  std::size_t set_up(const Camera& camera, const Band& band, const VisibleCluster* clusters,
                     std::size_t count, std::size_t per_segment);
  void add_splat(const Band& band, std::size_t surfel, const Splat& splat, const TileRange& range,
                 std::size_t at, std::vector<std::uint32_t>& seen, std::uint32_t* tile_counts);
  void bin(const Band& band, std::size_t segments);
  static void sort_front_to_back(const Reference* list, std::size_t count, Worker& worker);

  const RenderCloud& cloud_;
  const Scene& scene_;
  RenderOptions options_;
  SplatListOptions lists_;
  /// Of levels of detail: see covering_variance(). 0: their Gaussians are drawn as they are.
  float covering_ = 0;
  SplatView view_{};  ///< Of the band being made.
  std::vector<Worker> workers_;
  Array<Splat> splats_;
  Array<SplatNormal> normals_;
  Array<std::uint16_t> groups_;
  Array<ExactSplat> exact_;  ///< Parallel to `splats_`; where k is kExactKernel.
  Array<TileRange> ranges_;
  std::vector<std::vector<std::uint32_t>> kept_;  ///< Per segment: splats that are seen.
  Array<std::uint32_t> histogram_;                ///< Segments x tiles.
  Array<std::uint32_t> tile_begin_;
  Array<Reference> references_;
};

}  // namespace surfel
