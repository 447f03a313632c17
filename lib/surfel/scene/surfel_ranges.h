#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/base/morton.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Surfels or points of which any range can be read, whether the others are in memory or not.
class SURFEL_API SurfelRanges {
 public:
  SurfelRanges() = default;
  virtual ~SurfelRanges() = default;
  SurfelRanges(const SurfelRanges&) = delete;
  SurfelRanges& operator=(const SurfelRanges&) = delete;

  virtual std::size_t size() const = 0;
  /// The surfels [begin, end), with all columns and all that holds for the whole cloud. The columns
  /// and the origin are the same for all ranges. Callable from any thread.
  virtual SurfelCloud read(std::size_t begin, std::size_t end) const = 0;
  /// The positions of the surfels [begin, end), as read() has them. Callable from any thread.
  virtual Array<Vec3f> positions(std::size_t begin, std::size_t end) const {
    return read(begin, end).position;
  }
  /// The grid around the finite positions, relative to the origin of the ranges: the one of
  /// morton_order().
  virtual MortonGrid grid() const = 0;
};

/// A cloud in memory, in the order of morton_order(). Keeps a reference to it.
class SURFEL_API OrderedCloud final : public SurfelRanges {
 public:
  explicit OrderedCloud(const SurfelCloud& cloud);
  explicit OrderedCloud(SurfelCloud&& cloud) = delete;

  std::size_t size() const override { return cloud_.size(); }
  SurfelCloud read(std::size_t begin, std::size_t end) const override;
  MortonGrid grid() const override { return grid_; }

 private:
  const SurfelCloud& cloud_;
  MortonGrid grid_;
  Array<std::uint32_t> order_;
};

}  // namespace surfel
