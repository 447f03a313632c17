#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Interleaves the low 21 bits of three numbers: bit i of x goes to bit 3 i, of y to 3 i + 1, of z
/// to 3 i + 2 (Morton 1966).
constexpr std::uint64_t morton_code(std::uint32_t x, std::uint32_t y, std::uint32_t z) {
  constexpr auto spread = [](std::uint64_t v) {
    v &= 0x1fffff;
    v = (v | v << 32) & 0x001f00000000ffffULL;
    v = (v | v << 16) & 0x001f0000ff0000ffULL;
    v = (v | v << 8) & 0x100f00f00f00f00fULL;
    v = (v | v << 4) & 0x10c30c30c30c30c3ULL;
    v = (v | v << 2) & 0x1249249249249249ULL;
    return v;
  };
  return spread(x) | spread(y) << 1 | spread(z) << 2;
}

/// `count` points as three columns, which may be longer.
struct PointColumns {
  const float* x = nullptr;
  const float* y = nullptr;
  const float* z = nullptr;
  std::size_t count = 0;
};

/// The cube around points, divided into 2^21 cells a side.
struct SURFEL_API MortonGrid {
  Vec3d low{0, 0, 0};
  double cells_per_unit = 0;  ///< 0 where all points are at one place.

  MortonGrid() = default;
  /// Makes the grid around finite bounds; empty bounds (min > max) stand for no points.
  MortonGrid(const Vec3f& min, const Vec3f& max);

  /// Morton code of a point in the cube.
  std::uint64_t code(const Vec3f& p) const {
    const Vec3d cell = (p.cast<double>() - low) * cells_per_unit;
    return morton_code(static_cast<std::uint32_t>(cell.x()), static_cast<std::uint32_t>(cell.y()),
                       static_cast<std::uint32_t>(cell.z()));
  }
  /// Whether morton_order() would leave these points, all in the cube, as they are. Neighbours are
  /// compared without making their codes: a fraction of the cost of an order.
  bool in_order(const PointColumns& points) const;
};

/// The grid around the points that are finite; there may be none.
SURFEL_API MortonGrid morton_grid(std::span<const Vec3f> position);

/// Whether p comes before q, both finite, along a Morton curve through all of space whose cells
/// become as small as floats tell apart: the axis decides in whose binary digits the highest one
/// differs. Points of a cell of a MortonGrid are ordered so, of which one point far away from all
/// others leaves a single cell.
SURFEL_API bool before_on_curve(const Vec3f& p, const Vec3f& q);

/// How large the cells are whose border the curve of before_on_curve() crosses between two points,
/// both finite: larger numbers stand for larger cells, 0 for equal points. Of two steps along one
/// axis the higher digit is the larger one, and of one digit z's is larger than y's, and y's than
/// x's.
SURFEL_API int step_on_curve(const Vec3f& p, const Vec3f& q);

/// Order of points along a Morton curve through the cube around the finite ones (2^21 cells a
/// side). Points that are not finite come last, by index. Points in one cell are in the order of
/// before_on_curve(), equal ones by index, so that a shuffled cloud gives the same sequence of
/// points, and neighbours are near each other whatever the ratio of the cloud's scales.
SURFEL_API Array<std::uint32_t> morton_order(const Array<Vec3f>& position);

/// Order of points, all finite, along the curve through a given cube that holds them.
SURFEL_API Array<std::uint32_t> morton_order(const Array<Vec3f>& position, const MortonGrid& grid);

/// Order of points in columns, as morton_order() makes it.
SURFEL_API Array<std::uint32_t> column_morton_order(const PointColumns& points);

}  // namespace surfel
