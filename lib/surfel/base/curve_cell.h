#pragma once

// The octree through all of space: cubes whose sides are powers of two and whose corners lie at
// multiples of their sides, without a bounding box, so that the cell of a point does not depend on
// other points. Cells of negative coordinates mirror the cells of positive ones, and the eight
// octants together are the root. The curve through them visits cell by cell, as Morton's does.

#include <string>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// A cube whose side is a power of two and whose corners lie at multiples of it, or all of space.
struct SURFEL_API CurveCell {
  /// Side of the root, which is all of space.
  static constexpr int kAllSpace = 1025;

  int side = kAllSpace;   ///< Sides are 2^side scene units long.
  Vec3d center{0, 0, 0};  ///< 0 for all of space.

  bool contains(const Vec3d& p) const;
  /// "SIDE_X_Y_Z", where the cell begins X, Y and Z of its sides from the origin; "all" for all of
  /// space. Different cells have different names.
  std::string name() const;
};

/// CurveCell::side of the smallest cell that holds two points, both finite; kNoSide where they are
/// equal.
SURFEL_API int common_side(const Vec3d& p, const Vec3d& q);
inline constexpr int kNoSide = -2000;

/// The cell of this side around a finite point. Throws Error(kInput) where double precision does
/// not tell so small cells apart.
SURFEL_API CurveCell cell_around(const Vec3d& p, int side);

/// Whether p comes before q, both finite, along the curve: as before_on_curve(), in double
/// precision.
SURFEL_API bool before_in_space(const Vec3d& p, const Vec3d& q);

}  // namespace surfel
