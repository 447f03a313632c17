#pragma once

// Which clusters of surfels a part of a picture shows, and where.

#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/render/compositor.h>
#include <surfel/render/frame.h>
#include <surfel/render/render_options.h>
#include <surfel/render/splat.h>
#include <surfel/scene/camera.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// Tiles of a band, the last ones included.
struct TileRange {
  std::uint16_t x0, y0, x1, y1;
};

/// Finds the clusters that a band of a picture shows.
class SURFEL_API ClusterCulling {
 public:
  /// Keeps references to the cloud and the options.
  ClusterCulling(const RenderCloud& cloud, const RenderOptions& options,
                 const SplatListOptions& list)
      : cloud_(cloud), options_(options), list_(list) {}

  /// Begins a band: the clusters that reach into it, nearest first, ties by index.
  std::vector<VisibleCluster> cull(const Camera& camera, const Band& band);

  // Of the band begun last.

  /// Its clip rectangle is the band.
  const SplatView& view() const { return view_; }
  /// Share of the band that splats of one of these clusters reach over, in the mean, about: of 64
  /// of them, spread evenly, or of all where they are fewer; 0 of none.
  double mean_share(std::span<const VisibleCluster> clusters) const;
  /// The tiles that a cluster's splats may touch.
  TileRange tiles_of(const Cluster& cluster) const;

 private:
  SplatView make_view(const Camera& camera, const Band& band) const;
  std::vector<std::uint32_t> level_of_detail(const Camera& camera,
                                             FunctionRef<bool(std::uint32_t)> seen) const;
  bool listed(const Cluster& cluster) const;
  double share(const VisibleCluster& visible) const;
  float disc_radius(const Cluster& cluster) const;
  Vec3f center_in_camera(const Cluster& cluster) const;

  const RenderCloud& cloud_;
  const RenderOptions& options_;
  SplatListOptions list_;
  SplatView view_{};
  int tiles_x_ = 0, tiles_y_ = 0;
};

}  // namespace surfel
