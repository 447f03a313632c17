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
  float nearest;        ///< Least depth of the bounding sphere of the cluster's surfels.
  std::uint32_t index;  ///< Index in RenderCloud::clusters().
};

/// Clusters of surfels that pictures are drawn from: resident in memory (RenderCloud), or paged in
/// from a file as pictures need them (CloudStream). The clusters and their bounds are always in
/// memory. The columns of a cluster's surfels are in memory from the fetch() that names the cluster
/// to the next fetch().
class SURFEL_API ClusterStore {
 public:
  static constexpr std::size_t kUnlimited = std::numeric_limits<std::size_t>::max();

  virtual ~ClusterStore() = default;
  /// All clusters, and the columns of the surfels that are in memory.
  virtual const RenderCloud& cloud() const = 0;
  /// Are all surfels always in memory?
  virtual bool resident() const { return true; }
  /// Most clusters that one fetch() may name.
  virtual std::size_t batch_clusters() const { return kUnlimited; }
  /// Bytes that the A-buffers, which a picture keeps from batch to batch, may take together.
  virtual std::size_t picture_bytes() const { return kUnlimited; }
  /// Brings the columns of these clusters' surfels into memory.
  virtual void fetch(std::span<const VisibleCluster> /*clusters*/) {}
  /// Announces the clusters to be fetched next, so that the system may read them ahead.
  virtual void expect(std::span<const VisibleCluster> /*clusters*/) const {}

 protected:
  ClusterStore() = default;
  ClusterStore(const ClusterStore&) = default;
  ClusterStore(ClusterStore&&) = default;
  ClusterStore& operator=(const ClusterStore&) = default;
  ClusterStore& operator=(ClusterStore&&) = default;
};

}  // namespace surfel
