#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Which side normals are turned to.
enum class Orientation : std::uint8_t {
  kAuto,       ///< As kViewpoint where a viewpoint or sensors are known, else as kWinding.
  kWinding,    ///< Out of what the surface encloses, which is told from the winding number
               ///< (winding_sides.h); parts that enclose little, such as terrain, look up.
  kMst,        ///< Consistent along the surface; of each part the highest point looks up.
  kOutward,    ///< Consistent along the surface; of each part the outermost points look outward.
  kViewpoint,  ///< Towards OrientationOptions::viewpoint, or towards each point's own sensor.
  kUp,         ///< Towards OrientationOptions::up.
  kAlign,      ///< To the side of given normals. Points without a given normal follow the surface
               ///< from the nearest points that have one; parts of the surface without any are
               ///< turned as by kMst.
  kNone        ///< Normals stay as they are.
};

/// How normals get their side.
struct OrientationOptions {
  Orientation method = Orientation::kAuto;
  /// World coordinates. Unset: the viewpoint that the cloud tells, or each of its scans.
  std::optional<Vec3d> viewpoint = {};
  Vec3d up{0, 0, 1};  ///< Any length but zero.
  /// Points whose sheets are cut at once by kWinding; more points are more tiles.
  std::size_t tile_points = std::size_t{1} << 18;
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Edges of each point in the graph along which signs spread: as many as a point of a square grid
/// has around it. More edges cost time and lead across gaps, fewer leave parts of the surface
/// apart.
inline constexpr std::size_t kOrientationNeighbors = 8;

/// What orient_normals() has turned, and how sure it is.
struct OrientationReport {
  Orientation method = Orientation::kNone;  ///< The one asked for, or chosen by kAuto.
  std::size_t components = 0;  ///< Parts of the surface that signs spread along; 0 without
                               ///< spreading. With kAlign all parts that hold given normals count
                               ///< as one.
  std::size_t flipped = 0;     ///< Normals that were turned.
  std::size_t unknown = 0;     ///< Points without a normal.
};

/// Turns unit normals (zero = unknown, stays so) to a side. Signs spread along the minimum spanning
/// tree of the graph of nearest neighbours [Hoppe et al. 1992, section 3.3] with weights
///   1 - |n_i . n_j| (1 - s^2),  s = the larger sine between the edge and either tangent plane,
/// so that signs rather spread around sharp bends, and never along edges steeper than 51 degrees to
/// a tangent plane, which lead to another sheet. Where the surface bends by more than 45 degrees
/// n_i is first mirrored at the plane half-way between the points [Koenig, Gumhold 2009], if that
/// makes the product larger: at a right-angled edge the product itself is near zero, and its sign
/// chance. The tree is found on weights of 16 bits; signs are parities of its sets
/// (spanning_forest.h), so that the tree itself is never stored: 2 bytes an edge and about 30 a
/// point besides the search and its rows. Parts that the graph leaves apart (scan lines) are joined
/// along the minimum spanning forest of the edges of weight below 0.1 that lead from points of all
/// parts but the largest to another part, among the 64 nearest points.
///
/// kWinding cuts the points into sheets first, of winding_cell_points() times four points at least
/// (point_sheets.h), tile by tile (winding_tiles.h), and turns whole sheets.
///
/// \param position    Points, relative to `origin`.
/// \param origin      Origin of the positions, world coordinates: the viewpoint is seen from there.
/// \param search      Searches `position`.
/// \param previous    Given normals for kAlign, of any length (zero or not finite = none), or
///                    empty; for kViewpoint and kAuto, where the options have no viewpoint,
///                    directions to the points' sensors.
/// \param options     The method, its viewpoint and its direction.
/// \param normal      A unit vector for each point, or zero. Some are turned.
/// \param confidence  If not null, how sure the side of each normal is, 0..1; empty by kNone, 0
///                    without a normal. By kViewpoint and kUp the cosine to the direction; else the
///                    share of the edges to the nearest points that carry this side over, less the
///                    share of the others, each by 1 - weight; by kWinding times the sheet's
///                    certainty.
///
/// Sides do not depend on the number of threads. Throws Error(kUsage) for bad options, and for
/// kViewpoint where neither options nor `previous` tell a direction.
SURFEL_API OrientationReport orient_normals(const Array<Vec3f>& position, const Vec3d& origin,
                                            const NeighborSearch& search,
                                            const Array<Vec3f>& previous,
                                            const OrientationOptions& options, Array<Vec3f>& normal,
                                            Array<float>* confidence = nullptr);

/// Turns normals to sides that are known, as kWinding does in the end.
/// \param position    Points, relative to their origin.
/// \param search      Searches `position`.
/// \param side        By point: a vector on the normal's side, see WindingTiles::side(); zero:
///                    unknown.
/// \param normal      A unit vector for each point, or zero. Some are turned.
/// \param confidence  If not null, as orient_normals() has it with kWinding.
SURFEL_API void turn_to_sides(const Array<Vec3f>& position, const NeighborSearch& search,
                              const Array<Vec3f>& side, Array<Vec3f>& normal,
                              Array<float>* confidence = nullptr);

}  // namespace surfel
