#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Reach and order of smooth_points().
struct SmoothingOptions {
  double spacings = 4;  ///< Radius of a neighbourhood in local spacings s, 1..20: it holds the
                        ///< pi s^2 nearest points, whatever their density.
  int order = 2;        ///< Of the polynomials, 1..5; 1: planes.
  bool normals = true;  ///< Surfels get the normals of the polynomials; else normals are told from
                        ///< the moved points.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Points that smooth_points() has moved, and their normals.
struct SmoothedPoints {
  Array<Vec3f> position;
  Array<Vec3f> normal;     ///< Of the polynomial, unit, of any side; zero where a point stayed.
  std::size_t stayed = 0;  ///< Points that kept their place, having no fit.
  double mean_shift = 0;   ///< Mean length of the moves, scene units.
  double largest_shift = 0;
};

/// Moves every point along the normal of its neighbourhood's plane onto the polynomial that fits
/// the neighbourhood: moving least squares [Alexa et al. 2003], by PCL's MLSResult (in
/// libsurfel_filters.so, loaded when first needed). A neighbour at distance d has the weight
/// exp(-(d / r)^2), r being the distance to the farthest. A point whose neighbourhood has no fit (a
/// line, a single place), or that would move by more than r, stays.
///
/// \param points   Points to move. They keep their order.
/// \param search   Searches `points`, which are finite.
/// \param options  Radius of neighbourhoods, and degree of the polynomials.
///
/// The result does not depend on the number of threads. Throws Error(kUsage) for bad options,
/// Error(kIo) if the plug-in cannot be loaded.
SURFEL_API SmoothedPoints smooth_points(const Array<Vec3f>& points, const NeighborSearch& search,
                                        const SmoothingOptions& options = {});

}  // namespace surfel
