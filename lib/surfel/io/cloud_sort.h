#pragma once

// Clouds of any size in space-filling order: an external sort by distribution.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Positions of some surfels of a cloud, evenly over their sequence, which tell how many lie where.
class SURFEL_API PositionSample {
 public:
  void add(const SurfelCloud& piece);
  /// World coordinates of those that are finite.
  const std::vector<Vec3d>& positions() const { return positions_; }

 private:
  static constexpr std::size_t kMost = std::size_t{1} << 20;
  std::vector<Vec3d> positions_;
  std::uint64_t step_ = 1;  ///< Every so many surfels one is taken.
  std::uint64_t count_ = 0;
};

struct CloudSortOptions {
  std::uint64_t memory = 0;  ///< Bytes that the surfels may take; 64 kB at least.
  bool no_clobber = false;
  /// As RowFileOptions has it. A run that goes on reads the cloud again, and writes no surfel
  /// twice.
  std::string job = {};
  /// Bytes that are distributed at most before what was done is kept for a later run.
  std::uint64_t kept_bytes = std::uint64_t{1} << 28;
};

/// Writes a cloud as binary PLY, its surfels in the order of morton_order(), as a reader of the
/// file finds them: the bytes that write_cloud() would write of the sorted cloud.
///
/// Surfels that fit into memory are sorted there. Else they are distributed to parts of the curve,
/// each of which fits, on a scratch file beside the target, which takes as much as the target; then
/// part by part is read, sorted and written. Every surfel is written twice and read once, whatever
/// their number.
class SURFEL_API SortedCloudWriter {
 public:
  /// \param survey  of all pieces that will be written
  /// \param sample  of the same
  /// \param first   the first piece, settled: it decides on the columns and comments of the file.
  ///
  /// Throws Error(kUsage) for a target that is not written as binary PLY, Error(kIo) where it
  /// cannot be written, or where its disk has no room for it and the scratch file.
  SortedCloudWriter(std::string path, const CloudSurvey& survey, const PositionSample& sample,
                    const SurfelCloud& first, const CloudSortOptions& options);
  ~SortedCloudWriter();
  SortedCloudWriter(const SortedCloudWriter&) = delete;
  SortedCloudWriter& operator=(const SortedCloudWriter&) = delete;

  /// Bytes that the scratch file will take; 0 where everything is sorted in memory.
  std::uint64_t scratch_bytes() const;
  /// Surfels that earlier runs have distributed, or written.
  std::uint64_t kept() const;
  /// Takes the next surfels, settled. Throws Error(kIo), and Error(kInput) as CloudWriter does.
  void append(const SurfelCloud& piece);
  /// Sorts and completes the file. Throws Error(kIo), and Error(kInput) where so many surfels lie
  /// at one place that they do not fit into memory.
  void commit();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel
