#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Points in the cells of a uniform grid: all points within a radius, at a cost that follows their
/// number where the radius is about a cell. Cells without points take no memory.
class SURFEL_API PointGrid {
 public:
  /// \param points  finite; the grid copies them.
  /// \param cell    edge of a cell, scene units, > 0; enlarged where the grid would have more than
  ///                2^20 cells along an axis.
  PointGrid(const Array<Vec3f>& points, float cell);

  float cell() const { return cell_; }

  /// Calls body(i, d) for every point i with |d| <= radius, d = points[i] - center; in an order
  /// that depends on the points, the cell and the centre alone.
  template <class Body>
  void within(const Vec3f& center, float radius, Body&& body) const {
    const float radius2 = radius * radius;
    const Cell first = cell_of(center - Vec3f::Constant(radius));
    const Cell last = cell_of(center + Vec3f::Constant(radius));
    for (std::int32_t z = first.z; z <= last.z; ++z) {
      for (std::int32_t y = first.y; y <= last.y; ++y) {
        for (std::int32_t x = first.x; x <= last.x; ++x) {
          const std::size_t place = find(key({x, y, z}));
          if (place == kNone) continue;
          for (std::uint32_t i = cell_begin_[place]; i < cell_begin_[place + 1]; ++i) {
            const Vec3f d = sorted_[i] - center;
            if (d.squaredNorm() <= radius2) body(index_[i], d);
          }
        }
      }
    }
  }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  struct Cell {
    std::int32_t x, y, z;
  };
  /// Clamped to the cells of the grid.
  Cell cell_of(const Vec3f& p) const {
    const auto along = [&](int axis) {
      const float at = std::floor((p[axis] - min_[axis]) * inverse_cell_);
      return static_cast<std::int32_t>(std::fmin(std::fmax(at, 0.0F), most_[axis]));
    };
    return {along(0), along(1), along(2)};
  }
  static std::uint64_t key(const Cell& c) {
    return static_cast<std::uint64_t>(c.z) << 42 | static_cast<std::uint64_t>(c.y) << 21 |
           static_cast<std::uint64_t>(c.x);
  }
  static std::uint64_t hash(std::uint64_t key) { return (key * 0x9E3779B97F4A7C15U) >> 20; }
  /// Place of a cell among those with points.
  std::size_t find(std::uint64_t key) const {
    for (std::size_t slot = hash(key) & mask_;; slot = (slot + 1) & mask_) {
      const std::uint32_t place = slot_[slot];
      if (place == kFree) return kNone;
      if (cell_key_[place] == key) return place;
    }
  }
  static constexpr std::uint32_t kFree = static_cast<std::uint32_t>(-1);

  Vec3f min_{0, 0, 0};
  Vec3f most_{0, 0, 0};  ///< Index of the last cell along each axis.
  float cell_ = 1;
  float inverse_cell_ = 1;
  Array<Vec3f> sorted_;  ///< Points by cell, those of a cell by index.
  Array<std::uint32_t> index_;
  Array<std::uint64_t> cell_key_;
  Array<std::uint32_t> cell_begin_;  ///< Into sorted_, and its end.
  Array<std::uint32_t> slot_;        ///< Open-addressing table of places.
  std::uint64_t mask_ = 0;
};

}  // namespace surfel
