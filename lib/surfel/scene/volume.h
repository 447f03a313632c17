#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// A scalar field on a grid of voxels: a CT or MR scan, or a simulation.
struct Volume {
  std::array<std::size_t, 3> size{};  ///< Voxels along the three axes; the first varies fastest.
  Vec3d origin{0, 0, 0};              ///< Centre of the first voxel, scene units.
  /// From a voxel's centre to the next one's along each axis, scene units.
  std::array<Vec3d, 3> step{Vec3d(1, 0, 0), Vec3d(0, 1, 0), Vec3d(0, 0, 1)};
  Array<float> value;
  /// Upward direction where the file says what its axes mean.
  std::optional<Vec3d> up{};
  /// Voxels whose value is not finite in the file; they have the least value of all others.
  std::size_t not_finite = 0;

  std::size_t voxels() const { return size[0] * size[1] * size[2]; }
  std::size_t index(std::size_t x, std::size_t y, std::size_t z) const {
    return (z * size[1] + y) * size[0] + x;
  }
  /// World coordinates of a place in voxels: (0, 0, 0) is the centre of the first one.
  Vec3d world(const Vec3d& voxel) const {
    return origin + voxel.x() * step[0] + voxel.y() * step[1] + voxel.z() * step[2];
  }
};

/// The value at a place in voxels, interpolated linearly; outside it is the nearest voxel's.
SURFEL_API double value_at(const Volume& volume, const Vec3d& voxel);

/// The gradient of the values at a place in voxels, by differences over two voxels: per scene unit,
/// in world coordinates. The axes must be at right angles.
SURFEL_API Vec3d gradient_at(const Volume& volume, const Vec3d& voxel);

/// The values that shares of all voxels do not exceed.
/// \param volume  A volume, one voxel at least.
/// \param share   0..1, in any order.
SURFEL_API std::array<double, 2> value_quantiles(const Volume& volume,
                                                 const std::array<double, 2>& share);

}  // namespace surfel
