#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/peers.h>
#include <surfel/store/cluster_store.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// Clusters for some rows of a picture, which peers have read, each from the part of the cloud that
/// it holds, and sent as messages. They lie in the order of their numbers in the whole tree, so
/// that a picture of them is drawn as one of the whole cloud is.
class SURFEL_API GatheredClusters final : public ClusterStore {
 public:
  /// No clusters, of a cloud of which `part` is this process's part: the parts have the same
  /// columns.
  explicit GatheredClusters(const RenderCloud& part);

  /// Adds a cluster of a part, whose surfels are in memory, to a message.
  /// \param number  of the cluster in the whole tree.
  static void pack(const RenderCloud& part, std::uint32_t cluster, std::uint32_t number, Bytes& to);

  /// Forgets all clusters.
  void clear();
  /// Takes the clusters of a message.
  void add(const Bytes& message);
  /// Makes the clusters ready to be drawn.
  /// \param load  of the whole picture.
  void finish(const PictureLoad& load);

  const RenderCloud& cloud() const override { return cloud_; }
  std::optional<PictureLoad> picture_load() const override { return load_; }

 private:
  void make_rows(std::size_t rows);

  RenderCloud cloud_;
  PictureLoad load_;
  std::vector<std::uint32_t> number_;  ///< Of each cluster.
};

}  // namespace surfel
