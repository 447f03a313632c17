#pragma once

#include <cstddef>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/neighborhood_plane.h>
#include <surfel/estimate/plane_fit.h>

namespace surfel {

/// Neighbours that several points share, by coordinate. Points that are close to one another have
/// nearly the same neighbours, and finding them takes longer than fitting planes to them.
struct SharedWindow {
  std::vector<double> x, y, z;

  void clear() {
    x.clear();
    y.clear();
    z.clear();
  }
  void add(const Vec3d& p) {
    x.push_back(p.x());
    y.push_back(p.y());
    z.push_back(p.z());
  }
  std::size_t size() const { return x.size(); }
};

/// Points that share a window, each with what it weighs the neighbours by.
struct WindowPoints {
  static constexpr std::size_t kSize = PlaneBatch::kSize;
  using Column = PlaneBatch::Column;

  alignas(64) Column x = {}, y = {}, z = {};  ///< The point.
  /// In space: square of the distance from the point up to which neighbours count.
  alignas(64) Column reach2 = {};
  /// In an image: how far off the plane neighbours may be for every unit of their distance from the
  /// point in x and y.
  alignas(64) Column slack = {};
  /// The plane normal . p = offset, whose normal need not have unit length. Neighbours have
  /// the weight (1 - e^2)^2, e < 1 being inverse_scale times what they are off.
  alignas(64) Column normal_x = {}, normal_y = {}, normal_z = {}, offset = {};
  alignas(64) Column inverse_scale = {};  ///< 0: all neighbours have the weight one.

  void set_plane(std::size_t i, const Vec3d& normal, double at) {
    normal_x[i] = normal.x();
    normal_y[i] = normal.y();
    normal_z[i] = normal.z();
    offset[i] = at;
  }
};

/// Weighted sums over a window, for each of the points.
struct WindowMoments {
  using Column = PlaneBatch::Column;

  alignas(64) Column n, x, y, z, xx, xy, xz, yy, yz, zz;

  Moments of(std::size_t i) const {
    return {n[i], x[i], y[i], z[i], xx[i], xy[i], xz[i], yy[i], yz[i], zz[i]};
  }
};

/// Sums over the neighbours within each point's reach, for the first `count` points.
SURFEL_API void sum_in_space(std::size_t count, const SharedWindow& window,
                             const WindowPoints& points, WindowMoments& out);

/// Sums over all neighbours, weighed with each point's slack, for the first `count` points.
SURFEL_API void sum_in_image(std::size_t count, const SharedWindow& window,
                             const WindowPoints& points, WindowMoments& out);

}  // namespace surfel
