#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// The Voronoi cell of a point on a surface, as estimate_splat_sizes() defines it, for the common
/// case: bounded by all neighbours at once, with SIMD. Each neighbour's bisector is a line with a
/// parameter along it, which every other neighbour bounds from one side; where the bounds leave
/// something, that is an edge of the cell. It takes more arithmetic than to cut with one neighbour
/// after the other (VoronoiCell, which remains the truth, and what open cells are made with), but
/// no branch depends on the data. In single precision, in units of the reach: within 1e-4 of
/// VoronoiCell's radius and area; edges that rounding tears apart are kOpen.
struct ClosedCell {
  static constexpr std::size_t kWidth = 16;
  static constexpr std::size_t kMostNeighbors = 64;
  /// A vector is stored whole, however few of its lanes count.
  static constexpr std::size_t kRoom = kMostNeighbors + kWidth;

  Vec3f a{0, 0, 0}, b{0, 0, 0};  ///< Tangent plane that all is in; orthonormal.
  double unit = 0;               ///< All is in units of this.

  alignas(64) float x[kRoom] = {}, y[kRoom] = {};  ///< Neighbours on the surface; zeros behind.
  std::size_t neighbors = 0;
  /// Those of them whose bisectors bound the cell.
  alignas(64) float bound_x[kRoom] = {}, bound_y[kRoom] = {};
  std::size_t bounds = 0;
  alignas(64) float corner_x[kRoom] = {}, corner_y[kRoom] = {};  ///< In no order.
  std::size_t corners = 0;

  float radius2 = 0;             ///< Of the furthest corner.
  float area = 0;                ///< In units squared, and ...
  float xx = 0, xy = 0, yy = 0;  ///< ... second moments about the point, to the fourth.
};

enum class CellState : std::uint8_t {
  kClosed,       ///< Known: no other point can cut it, and the surface goes on at each corner.
  kBeyondReach,  ///< Closed, but points beyond the reach may cut it.
  kOpen,  ///< The surface ends at a corner, or it cannot be told: the cell's values mean nothing.
};

/// The points that cells are of.
struct CellSurface {
  const Array<Vec3f>& position;
  const Array<Vec3f>& normal;
  bool oriented;  ///< What faces the other way is another surface.
};

struct CellLimits {
  float reach;  ///< All points as far away as this are known, > 0.
  float sure;   ///< Up to here the surface surely goes on,
  float most;   ///< ... and beyond this it does not.
};

/// Measures the cell of point i, whose normal is known, from its neighbours (itself among them).
SURFEL_API CellState measure_cell(const CellSurface& surface, std::size_t i,
                                  std::span<const Neighbor> near, const CellLimits& limits,
                                  ClosedCell& cell);

/// The same once more with those neighbours in addition that lie at the reach before or beyond.
/// After kBeyondReach alone.
SURFEL_API CellState extend_cell(const CellSurface& surface, std::size_t i,
                                 std::span<const Neighbor> further, const CellLimits& limits,
                                 ClosedCell& cell);

}  // namespace surfel
