#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Tells where most of some points lie, whatever their order: on each axis, how many coordinates
/// fall into each cell of a sixteenth of a power of two.
class SURFEL_API CoordinateSpread {
 public:
  /// Coordinates that are not finite are left out.
  void add(int axis, std::span<const double> coordinates);
  void add(const CoordinateSpread& other);
  /// Adds the points origin + offsets[i].
  void add(const Vec3d& origin, std::span<const Vec3f> offsets);

  /// Bounds of the coordinates; empty where an axis has none.
  Bounds box() const;
  /// The part of the points' box that an origin should suit: the box itself, but where strays make
  /// it more than kStray times as large as the box of the others. Stray is what lies, on one axis,
  /// further from the middle half of the coordinates than that is long on the longest axis.
  /// \param box  Of the points, as a file tells it or as box() does.
  Bounds core(const Bounds& box) const;

 private:
  static constexpr double kStray = 16;
  /// Coordinates whose doubles begin with the same 16 bits.
  struct Cell {
    std::uint16_t key = 0;  ///< Grows with the coordinates.
    std::uint64_t count = 0;
    double min = 0;
    double max = 0;
  };
  /// The occupied cells of an axis.
  struct Axis {
    std::vector<Cell> cells;  ///< In the order in which they were met.
    /// For each high byte of keys its place in `pages` and 1; 0: no such key was met.
    std::array<std::uint16_t, 256> page{};
    /// For each low byte of keys the cell's place in `cells` and 1; 0: not met.
    std::vector<std::array<std::uint16_t, 256>> pages;

    void add(const Cell& part);
  };
  std::array<Axis, 3> axes_;
};

}  // namespace surfel
