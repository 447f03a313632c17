#pragma once

// A file of surfels as a page shows it: piece by piece, in few bytes.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include <surfel/base/export.h>
#include <surfel/store/cloud_loader.h>

namespace surfel {

/// Memory of a ViewCloud, and the attribute that its surfels have.
struct ViewCloudOptions {
  /// Bytes that the surfels may take; unset: see CloudLoadOptions::memory. Files with levels of
  /// detail are streamed whatever it is.
  std::optional<std::uint64_t> memory{};
  /// The attribute that surfels may be coloured by besides their colours, a name as
  /// AttributeValues::find() takes it. Left out where the file does not have it.
  std::string attribute = "confidence";
};

/// Bounds of a cluster as pages read them: little-endian, one after the other.
struct ClusterRecord {
  float center[3];  ///< Sphere around the surfels, relative to the cloud's origin.
  float radius;
  float max_deviation;  ///< Largest standard deviation.
  float spacing;        ///< TreeCluster::spacing; 0 without levels of detail.
  std::uint32_t first_child;
  std::uint16_t child_count;
  std::uint16_t count;   ///< Surfels.
  std::uint32_t merged;  ///< 1: the surfels stand for others of a finer level.
  std::uint32_t reserved;
};
static_assert(sizeof(ClusterRecord) == 40);

/// Surfels of a file, in memory or streamed from it. Functions that read surfels may be called from
/// several threads at once; they wait for one another.
class SURFEL_API ViewCloud {
 public:
  /// Reads a file of surfels. Throws what LoadedCloud throws, and Error(kInput) where there is no
  /// surfel, or where none has a normal.
  ViewCloud(const std::string& path, const ViewCloudOptions& options);
  ~ViewCloud();
  ViewCloud(const ViewCloud&) = delete;
  ViewCloud& operator=(const ViewCloud&) = delete;

  const LoadedCloud& loaded() const;
  const std::string& path() const;
  std::size_t clusters() const;
  bool has_levels() const;
  /// Does the file have colours?
  bool colored() const;
  /// The attribute that the surfels have, as its file names it; empty: none.
  const std::string& attribute() const;
  /// The values that stand for 0 and 1 of a packed attribute.
  std::pair<double, double> attribute_range() const;
  /// A sentence about what the file has and pages do not show; empty: nothing.
  std::string not_shown() const;
  /// Most bytes that a page takes for the surfels.
  std::uint64_t most_bytes() const;

  /// Appends the records of clusters [first, end).
  void append_records(std::size_t first, std::size_t end, std::string& to) const;
  /// Appends packed clusters (packed_cluster.h).
  /// \param clusters  Numbers of clusters, at most kMostAtOnce.
  /// \param to        Gets the bytes.
  void append_clusters(std::span<const std::uint32_t> clusters, std::string& to) const;
  static constexpr std::size_t kMostAtOnce = 4096;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
