#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Reach of Gaussians in standard deviations, as far as lines cut them.
inline constexpr double kClipReach = 3;

/// A half-plane in a surfel's tangent plane: what lies further than `distance` from the surfel's
/// centre along `direction` is no part of the surfel.
struct HalfPlane {
  Vec3d direction{0, 0, 0};  ///< Unit; zero: cuts nothing.
  double distance = 0;       ///< Scene units; where negative, the centre is cut off.

  bool cuts() const { return !direction.isZero(0); }
};

/// One of the two half-planes of a surfel (SurfelCloud::clip1, clip2), with a unit direction across
/// the normal. It cuts nothing where the surfel has no normal, where the direction is zero or along
/// the normal, or where a number is not finite.
/// \param which  0 or 1.
SURFEL_API HalfPlane half_plane(const SurfelCloud& cloud, std::size_t i, int which);

/// Number of half-planes that a surfel is cut by.
inline int count_half_planes(const SurfelCloud& cloud, std::size_t i) {
  return static_cast<int>(half_plane(cloud, i, 0).cuts()) +
         static_cast<int>(half_plane(cloud, i, 1).cuts());
}

/// Is a surfel cut by a half-plane?
inline bool is_clipped(const SurfelCloud& cloud, std::size_t i) {
  return count_half_planes(cloud, i) > 0;
}

/// Does a half-plane cut off the surfel's centre? It continues other surfels up to their common
/// line, and stands for no surface where the line is dropped.
inline bool is_cut_off(const SurfelCloud& cloud, std::size_t i) {
  return half_plane(cloud, i, 0).distance < 0 || half_plane(cloud, i, 1).distance < 0;
}

/// A surfel and the half-planes that cut it.
struct CutSurfel {
  Vec3d position{0, 0, 0};
  Vec3d tangent{0, 0, 0};  ///< Of an ellipse; zero of a disc.
  std::array<HalfPlane, 2> cut;
};

SURFEL_API CutSurfel cut_surfel(const SurfelCloud& cloud, std::size_t i);
/// Gives surfel i of a cloud this position, tangent and half-planes, as far as the cloud has these
/// columns.
SURFEL_API void put_cut_surfel(const CutSurfel& surfel, SurfelCloud& cloud, std::size_t i);

/// The mirror image of a surfel in the line of one of its half-planes.
/// \param which  0 or 1.
SURFEL_API CutSurfel mirror_image(const CutSurfel& surfel, std::size_t which);

/// The surfels that go on beyond the half-planes of a surfel whose centre they do not cut off, cut
/// at the same lines: its mirror images in one line, in the other, and in both. With them sums of
/// kernels are as even at the lines as elsewhere. A surfel whose kernel hardly reaches a line has
/// no image there.
/// \param deviation  Of the surfel's Gaussian along the direction of each half-plane, scene units.
SURFEL_API std::vector<CutSurfel> mirror_images(const CutSurfel& surfel,
                                                const std::array<double, 2>& deviation);

/// The surfels that together are what a surfel with a round Gaussian has within either of its two
/// half-planes, as at a reflex corner, and what goes on beyond them there: sums of kernels are as
/// even at the lines as elsewhere. The first one's centre is not cut off. Of the surface within the
/// first half-plane, and of the surface within the second alone, each has its own surfels, so that
/// nothing is there twice. Surfels around one corner must have its lines in the same order.
/// \param deviation  of the Gaussian, scene units.
SURFEL_API std::vector<CutSurfel> within_either(const CutSurfel& surfel, double deviation);

}  // namespace surfel
