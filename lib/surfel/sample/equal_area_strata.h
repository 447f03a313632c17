#pragma once

#include <cstddef>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/sample/procedural_surface.h>

namespace surfel {

/// Partition of a parametric surface into exactly `count` cells of equal area, nearly square: rows
/// of constant v about as high as a cell is wide, each cut along u. The density comes from a table
/// of the area element, so that cells are equal in area up to the table's resolution.
class EqualAreaStrata {
 public:
  /// Cost: one evaluation of the surface per cell of the table, which has about as many cells as
  /// there are strata (4096 to 4 million).
  /// \param count  Number of strata, >= 1.
  EqualAreaStrata(const ParametricSurface& surface, std::size_t count);

  /// Area of the surface, by quadrature over the table.
  double area() const { return area_; }
  std::size_t row_count() const { return first_.size() - 1; }
  /// Cells first(row) to first(row + 1) - 1 make up the row.
  std::size_t first(std::size_t row) const { return first_[row]; }

  /// Share of the row's area to the left of each column boundary of the table, for u_at().
  std::vector<double> row_profile(std::size_t row) const;
  /// u at a share in [0, 1] of the row's area, and v at a share of the row's height by area.
  double u_at(const std::vector<double>& profile, double share) const;
  double v_at(std::size_t row, double share) const;

 private:
  std::size_t table_size_;
  Array<float> element_;            ///< Area element at the cell centres, rows of constant v.
  std::vector<double> below_;       ///< Share of the area below each row boundary of the table.
  std::vector<std::size_t> first_;  ///< Index of the first cell of each row, then the count.
  double area_ = 0;
};

}  // namespace surfel
