#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// The Voronoi cell of a point on a surface, as estimate_splat_sizes() defines it, for the common
/// case of a cell that is closed: bounded by all neighbours at once, with SIMD. Each neighbour's
/// bisector is a line with a parameter along it, which every other neighbour bounds from one side;
/// a parameter range that is left over is an edge of the cell. This takes more arithmetic than
/// cutting with one neighbour after the other, as VoronoiCell does, but no branch depends on the
/// data. Values are single precision in units of the reach: radius and area are within 1e-4 of
/// VoronoiCell's. Cells whose edges rounding tears apart are kOpen; VoronoiCell makes open cells.
struct ClosedCell {
  static constexpr std::size_t kWidth = 16;          ///< Lanes of the widest vectors.
  static constexpr std::size_t kMostNeighbors = 64;  ///< VoronoiCell measures cells with more.
  /// Length of columns: vectors are stored whole, however few of their lanes count.
  static constexpr std::size_t kRoom = kMostNeighbors + kWidth;

  Vec3f a{0, 0, 0}, b{0, 0, 0};  ///< Axes of the tangent plane of all coordinates; orthonormal.
  double unit = 0;               ///< Scene units of a unit of all lengths below.

  /// Neighbours on the point's sheet; zeros behind the last one.
  alignas(64) float x[kRoom] = {}, y[kRoom] = {};
  std::size_t neighbors = 0;
  /// Neighbours whose bisectors bound the cell.
  alignas(64) float bound_x[kRoom] = {}, bound_y[kRoom] = {};
  std::size_t bounds = 0;
  alignas(64) float corner_x[kRoom] = {}, corner_y[kRoom] = {};  ///< Corners have no order.
  std::size_t corners = 0;

  float radius2 = 0;             ///< Squared distance of the furthest corner.
  float area = 0;                ///< Area of the cell, units squared.
  float xx = 0, xy = 0, yy = 0;  ///< Second moments about the point, in units to the fourth.
};

enum class CellState : std::uint8_t {
  kClosed,       ///< No other point can cut the cell, and the surface goes on at each corner.
  kBeyondReach,  ///< The cell is closed, but points beyond the reach may cut it.
  kOpen,  ///< The surface ends at a corner, or it cannot be told: the cell's values mean nothing.
};

/// Points of a surface, whose cells are measured.
struct CellSurface {
  const Array<Vec3f>& position;
  const Array<Vec3f>& normal;  ///< Unit, or zero = unknown.
  bool oriented;               ///< Normals tell front from back: same_side() (sheet.h) counts.
};

/// Distances from the point whose cell is measured, scene units.
struct CellLimits {
  float reach;  ///< All points up to this distance are known, > 0.
  float sure;   ///< The surface surely goes on up to this distance.
  float most;   ///< The surface does not go on beyond this distance.
};

/// Measures the cell of point i, whose normal is known, from its neighbours (itself among them).
SURFEL_API CellState measure_cell(const CellSurface& surface, std::size_t i,
                                  std::span<const Neighbor> near, const CellLimits& limits,
                                  ClosedCell& cell);

/// Measures a cell that measure_cell() found to be kBeyondReach once more, with neighbours in
/// addition: all points that lie at the reach of that call or beyond, up to the reach of `limits`.
SURFEL_API CellState extend_cell(const CellSurface& surface, std::size_t i,
                                 std::span<const Neighbor> further, const CellLimits& limits,
                                 ClosedCell& cell);

}  // namespace surfel
