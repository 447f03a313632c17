#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Places that planes_often_uncertain() is told from.
inline constexpr std::size_t kNoiseSample = 512;

/// Is there anything to do for remake_noisy_normals()? Not in clouds of fewer than 512 points.
/// \param points  how many points the cloud has.
/// \param sample  PlaceSample of kNoiseSample of its places.
SURFEL_API bool planes_often_uncertain(std::size_t points, std::span<const Vec3f> sample,
                                       NearestPlaces nearest);

/// Does noise hide the surface, see remake_noisy_normals(), where planes are often uncertain and
/// the points are no range image?
/// \param sample  PlaceSample of kNoiseSample of the cloud's places.
SURFEL_API bool noise_hides_surface(std::span<const Vec3f> sample, NearestPlaces nearest);

/// Makes normals anew in clouds whose noise or quantisation exceeds the spacing of their points, as
/// depth cameras': there the nearest points are a lump, or lie on one step of the quantised depth,
/// and their plane stands on its edge (a flake) or along the step. Other clouds are left as they
/// are, after a look at 512 places: only where the plane of the 16 nearest is uncertain at 15 % of
/// them (a standard error of more than 0.1, or thin) is there anything to do. Then, if the points
/// are a range image of the `sensor`, range_normals.h makes their normals, and otherwise:
///
/// Noise is told from shape by how the flatness lambda_0 / lambda_1 changes as a neighbourhood
/// doubles, from 16 points up to 1024. Shape bends more and more; noise, once the neighbourhood is
/// larger than it, does not grow any further, so that the flatness has a peak and falls to a
/// quarter of it. The cloud is noisy if a third of the points have such a peak before 512 points:
/// of scans without noise none has, of leaves 9 %, of a forest seen from the air a quarter.
///
/// Where the peak is over, a plane is certain: noise and extent of the neighbourhood there are
/// noted at one point in 4, 3072 at most. They change with the range, not from point to point, so
/// that each point takes the median extent, enlarged by 15 %, and the median noise of the 16 noted
/// ones around it. Its normal is fitted to all points within the extent (of every second, third,
/// ... point where they are several times 128), refitted three times with weights (1 - e^2)^2, e <
/// 1 being the distances from the plane by s, where they exceed the noise: s falls to 7.5 times the
/// noise, so that faces beyond an edge lose their say. Up to 16 points that are close by, along the
/// order that `points` have, share a search and the noise (window_moments.h): the order of a
/// space-filling curve is fastest.
///
/// Sets normals, quality and counts of `out`, which are estimates of `points`. The result does not
/// depend on the number of threads.
SURFEL_API void remake_noisy_normals(const Array<Vec3f>& points, const NeighborSearch& search,
                                     const std::optional<Vec3d>& sensor, NormalEstimate& out);

}  // namespace surfel
