#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/scene/surfel_ranges.h>

namespace surfel {

/// Surfels or points that stay in their file, binary PLY of either byte order, of which any range
/// is read when it is asked for. All ranges together are what read_cloud() gives: of a file with
/// levels of detail the finest alone.
class SURFEL_API CloudRanges final : public SurfelRanges {
 public:
  /// Opens a file and reads its coordinates once. Null for files that are no binary PLY with
  /// scalar properties of the points alone, for standard input and for range grids; range_advice()
  /// tells what to do then. Throws as read_cloud() does.
  static std::unique_ptr<CloudRanges> open(const std::string& path);
  ~CloudRanges() override;

  const std::string& name() const;  ///< Of the file, for messages.
  std::size_t size() const override;
  SurfelCloud read(std::size_t begin, std::size_t end) const override;
  Array<Vec3f> positions(std::size_t begin, std::size_t end) const override;
  MortonGrid grid() const override;
  /// Of the finite positions, world coordinates.
  const Bounds& bounds() const;
  const Vec3d& origin() const;  ///< SurfelCloud::origin of all ranges.
  /// Bytes of a point's record in the file.
  std::size_t stride() const;

 private:
  struct Impl;
  explicit CloudRanges(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// What to do about a file whose points cannot be read in ranges, or are not in the order of
/// morton_order(): half a sentence for messages.
SURFEL_API std::string range_advice(const std::string& path);

}  // namespace surfel
