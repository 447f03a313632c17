#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/estimate/edge_lines.h>
#include <surfel/estimate/normals.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Which edges sharpen_creases() takes for creases.
struct CreaseOptions {
  double crease_angle = 30;  ///< Least angle between the normals of faces beside a crease, degrees,
                             ///< 10..90.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// What sharpen_creases() has found.
struct CreaseReport {
  std::size_t points = 0;  ///< Points beside creases, whose normals are one face's now.
  std::size_t unsure = 0;  ///< Points whose surface bends as at a crease, but may be smooth.
};

/// Finds the points beside creases of a surface that was sampled, gives them the normals of their
/// own faces, and finds the lines at which these faces end.
///
/// The 48 nearest points of a point where the surface bends (three times as many as normals are
/// made from, if that is more) are divided among two planes, or three at a corner. Planes start as
/// the flattest neighbourhoods whose normals differ by the crease angle, and are fitted to the
/// points nearest to them until none changes its plane. There is a crease if
/// - the variance about the planes is less than a third of the variance about a quadric, the smooth
///   surface that has as many parameters as two planes, and less than the square of a quarter
///   spacing;
/// - the planes meet at the crease angle at least, enclose 65 degrees at least, and the standard
///   error of their line's place is less than a fifth of a spacing;
/// - the faces turn towards each other by less than 0.4 of the angle at which the planes meet, as
///   the distances of their points from the planes tell: both halves of a smooth bend turn by
///   twice that angle;
/// - a third of the nearest points see creases as well.
/// From the points that see one the search goes on to their neighbours, for which the faces found
/// are what planes start as. A line cuts a face if the face's points within two spacings lie on one
/// side of it: a face that goes on behind another one's end keeps its points whole. Points between
/// others of one plane take the lines of these. All others keep their normals, and no line cuts
/// them.
///
/// \param position  Points of the surface, finite.
/// \param search    Searches `position`.
/// \param options   The angle from which on an edge is a crease.
/// \param normals   Estimates of `position`: normals and their quality change beside creases.
/// \param lines     A value per point; lines at creases are added, where they are nearer than three
///                  spacings.
///
/// The result does not depend on the number of threads. Throws Error(kUsage) for bad options.
SURFEL_API CreaseReport sharpen_creases(const Array<Vec3f>& position, const NeighborSearch& search,
                                        const CreaseOptions& options, NormalEstimate& normals,
                                        Array<EdgeLines>& lines);

}  // namespace surfel
