#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include <surfel/base/export.h>

namespace surfel {

class RenderCloud;

/// Cluster seen by the camera.
struct VisibleCluster {
  float nearest;  ///< Least z of its surfels' bounding sphere.
  std::uint32_t index;
  /// Tiles of the band that its splats may touch, last included; set by SplatLists::bin().
  std::uint16_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

/// Clusters of surfels that pictures are drawn from: resident in memory (RenderCloud), or paged in
/// from a file as pictures want them (CloudStream). The clusters and their bounds are always there;
/// the columns of a cluster's surfels are there from the fetch() that names it to the next one.
class SURFEL_API ClusterStore {
 public:
  static constexpr std::size_t kUnlimited = std::numeric_limits<std::size_t>::max();

  virtual ~ClusterStore() = default;
  /// All clusters, and the columns of the surfels that are there.
  virtual const RenderCloud& cloud() const = 0;
  /// All surfels are always there.
  virtual bool resident() const { return true; }
  /// Most clusters that one fetch() may name.
  virtual std::size_t batch_clusters() const { return kUnlimited; }
  /// Bytes that the A-buffers of all tiles may take, which a picture keeps from batch to batch.
  virtual std::size_t picture_bytes() const { return kUnlimited; }
  /// Makes the columns of these clusters' surfels be there.
  virtual void fetch(std::span<const VisibleCluster> /*clusters*/) {}
  /// Tells that these clusters will be fetched next, so that the system may read them ahead.
  virtual void expect(std::span<const VisibleCluster> /*clusters*/) const {}

 protected:
  ClusterStore() = default;
  ClusterStore(const ClusterStore&) = default;
  ClusterStore(ClusterStore&&) = default;
  ClusterStore& operator=(const ClusterStore&) = default;
  ClusterStore& operator=(ClusterStore&&) = default;
};

}  // namespace surfel
