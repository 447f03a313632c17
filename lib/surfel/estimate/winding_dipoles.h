#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/point_sheets.h>

namespace surfel {

/// Points' areas in a cell of the finest level, of so many points: some 60,000 dipoles are made of
/// them at most, more of more than 25 million points. Sheets are seen that have a few cells.
SURFEL_API double winding_cell_points(std::size_t count);

/// The finest cells in which points are summed.
struct WindingGrid {
  static constexpr int kLevels = 21;  ///< 2^kLevels cells along a side.
  double cell = 0;                    ///< Edge of a cell, units; 0: no point has an area.
  Vec3d middle{0, 0, 0};              ///< Of the grid. Points beyond the grid lie at its border.

  /// Place of a point in cells, within the grid.
  Vec3d place(const Vec3f& position) const;
};

/// The grid for `count` points, of which some are given with their areas (unit^2; 0: unknown): half
/// of them lie on either side of its middle, wherever stray points are.
SURFEL_API WindingGrid winding_grid(std::size_t count, std::span<const Vec3f> position,
                                    std::span<const float> area);

/// Points of one sheet in one cell. Lengths in finest cells.
struct WindingDipole {
  Vec3d center{0, 0, 0};
  Vec3d moment{0, 0, 0};  ///< Sum of areas times normals.
  double area = 0;
  double volume = 0;       ///< Sum of moments times positions.
  std::uint64_t cell = 0;  ///< Morton code.
  std::uint32_t sheet = 0;

  /// \param turned  the other one counts with its other side.
  void add(const WindingDipole& other, bool turned) {
    const double sum = area + other.area;
    if (sum > 0) center += (other.center - center) * (other.area / sum);
    moment += turned ? Vec3d(-other.moment) : other.moment;
    volume += turned ? -other.volume : other.volume;
    area = sum;
  }
};

/// Sums points with normals and areas to dipoles, one for each sheet in each cell. Sums do not
/// depend on the number of threads.
class SURFEL_API WindingDipoles {
 public:
  explicit WindingDipoles(const WindingGrid& grid) : grid_(grid) {}

  /// Adds points, whose sheets get numbers from sheets() on.
  void add(const Array<Vec3f>& position, const Array<Vec3f>& normal, const Array<float>& area,
           const PointSheets& sheets);

  const WindingGrid& grid() const { return grid_; }
  std::uint32_t sheets() const { return sheets_; }
  /// The dipoles, ascending by cell, then by sheet.
  std::vector<WindingDipole> sorted() const;

 private:
  WindingGrid grid_;
  std::uint32_t sheets_ = 0;
  std::vector<WindingDipole> dipoles_;
};

}  // namespace surfel
