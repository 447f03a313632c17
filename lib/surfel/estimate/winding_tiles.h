#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/estimate/winding_dipoles.h>
#include <surfel/estimate/winding_sides.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Places from which the grid of several tiles is told.
inline constexpr std::size_t kWindingSample = 512;

/// The grid for points that are not in memory at once: from the areas of some places.
SURFEL_API WindingGrid sampled_grid(std::size_t count, std::span<const Vec3f> places,
                                    const NearestPlaces& nearest);

/// Sides by the winding number of points that need not be in memory at once. They come in tiles of
/// consecutive points along a space-filling curve, each of which is cut into sheets of its own
/// (point_sheets.h). Sheets that go on in another tile are told by the same energies as sheets that
/// end at a gap: no edge has to lead from tile to tile.
class SURFEL_API WindingTiles {
 public:
  /// \param count  points of all tiles.
  /// \param grid   unset: there is one tile, whose points tell the grid.
  WindingTiles(std::size_t count, const std::optional<WindingGrid>& grid);

  /// Cuts the points of the next tile into sheets.
  /// \param search  searches `position`
  /// \param normal  unit, or zero where unknown; the normals of a sheet are turned to one side.
  /// \return the sheet of each point, among all tiles' sheets; PointSheets::kNone without a normal.
  Array<std::uint32_t> add(const Array<Vec3f>& position, const NeighborSearch& search,
                           Array<Vec3f>& normal);
  /// The same, with a search of its own.
  Array<std::uint32_t> add(const Array<Vec3f>& position, Array<Vec3f>& normal);

  /// Finds the sides of all sheets. To be called once, after the last tile.
  void finish();
  const WindingSides& sides() const { return sides_; }
  /// Takes the sides that another process has found of the same tiles, in place of finish().
  void set_sides(WindingSides sides);
  /// The side of a point as a vector: a normal that add() has turned, on the side of its sheet.
  /// Its length is 1 + certainty, in steps of 1/256 (certainty_of()); zero without a normal.
  Vec3f side(const Vec3f& normal, std::uint32_t sheet) const;

 private:
  std::size_t count_;
  std::optional<WindingDipoles> dipoles_;
  WindingSides sides_;
};

/// Certainty of a sheet's side, from the vector that tells it.
inline float certainty_of(const Vec3f& side) { return std::round((side.norm() - 1) * 256) / 256; }

}  // namespace surfel
