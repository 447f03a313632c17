#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/estimate/edge_lines.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// How a splat's variance follows from its neighbourhood.
enum class VarianceRule : std::uint8_t {
  kMaxDistance,  ///< SS01 section 5: the largest distance among the nearest points is h; V = h^2 I.
  kCover,        ///< The disc at the cutoff just covers the point's Voronoi cell on the surface.
};

enum class Anisotropy : std::uint8_t {
  kAuto,  ///< Ellipses if more than one cell in ten is twice as long as wide.
  kOn,
  kOff,
};

/// Rule and limits of estimate_splat_sizes().
struct SplatSizeOptions {
  VarianceRule rule = VarianceRule::kCover;
  Anisotropy anisotropy = Anisotropy::kAuto;
  double cutoff = 1;      ///< c of beta < c, 0.1..16: a disc that covers reaches sqrt(2 c V).
  double max_radius = 3;  ///< How far a splat that covers reaches at most, in local spacings (mean
                          ///< distance to the four nearest others), at least 1; 0 = as far as its
                          ///< cell.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Nearest points that the cell of a point is first made from, the point itself among them; more
/// are looked at where these do not suffice. Of points in even order they close nearly all cells.
inline constexpr std::size_t kSplatNeighbors = 16;

/// Places that consists_of_scan_lines() is told from.
inline constexpr std::size_t kScanLineSample = 512;

/// Does a cloud consist of scan lines, see estimate_splat_sizes()? In others a few points lie along
/// a line by chance.
/// \param sample   PlaceSample of kScanLineSample of its places.
/// \param nearest  Finds the points of the whole cloud that are nearest to a place.
SURFEL_API bool consists_of_scan_lines(std::span<const Vec3f> sample, NearestPlaces nearest);

/// Size of one point's splat. All values of a point are in one piece, as they are read together
/// and in another order than they are made in.
struct SplatSize {
  Vec3f tangent;     ///< Long axis of the ellipse, unit; any tangent where the splat is a disc.
  float variance;    ///< Variance of the disc that covers, unit^2.
  float variance_u;  ///< Variance of the ellipse that covers, along `tangent`, unit^2.
  float variance_v;  ///< Variance across `tangent`, unit^2. Both are `variance` for discs.
  float area;        ///< Area of the point's cell, unit^2.
  float spacing;     ///< Mean distance to the four nearest others.

  bool operator==(const SplatSize&) const = default;
};

/// Where a point lies on its surface.
enum class CellKind : std::uint8_t {
  kClosed,  ///< Its cell is closed: the surface goes on around it.
  kBorder,  ///< Its cell is open: at the surface's border.
  kAlone,   ///< Far from all others.
};

/// Sizes of the splats of all points.
struct SplatSizes {
  Array<SplatSize> of;     ///< Sizes by point.
  Array<CellKind> kind;    ///< By point.
  bool ellipses = false;   ///< Splats are ellipses; else they are discs.
  std::size_t border = 0;  ///< Points whose cell is open: at the surface's border, or alone.
  std::size_t capped = 0;  ///< Points far from all others, with splats cut to their neighbours'.
};

/// Sizes of splats for points with normals (unit; zero = unknown: such a point has no cell, and
/// gets a disc by the distance to its neighbours alone).
///
/// The covering rule: the Voronoi cell of a point is the part of its tangent plane that is nearer
/// to the point than to any other point of its sheet (surface/sheet.h). The smallest disc around
/// the point that holds the cell (or the smallest ellipse of the cell's second moments) closes the
/// surface, since the cells tile it, and overlaps its neighbours no more than it must. At a border
/// the cell is open: there it ends at 0.95 of the local spacing, so that silhouettes do not fray. A
/// point alone takes no more than three times its neighbours' spacing.
///
/// Where points fill space, as leaves do, few of them lie on the sheet of one, its cell is large,
/// and its splat would be a petal that hides the others: no splat reaches further than `max_radius`
/// local spacings. On a surface cells end before. In a cloud of scan lines (a quarter of its points
/// is on one, where the 8 nearest points are less than a third as wide as long) the spacing that
/// counts on a line is the side of the square that each of the 16 nearest would have to itself,
/// sqrt(pi r^2 / 16), r being the distance of the last: lines ten times as far apart as their
/// points stay closed.
///
/// \param position  Points, finite, scene units.
/// \param normal    A unit vector for each point, or zero = unknown.
/// \param oriented  Whether normals tell front from back; otherwise thin sheets disturb each other.
/// \param search    Searches `position`; fastest in the order of a space-filling curve.
/// \param options   The shape of splats, and how far they may reach.
/// \param noise     Standard deviation of each point from the surface, scene units, or empty. Seen
///                  from the side, points so far apart leave gaps: discs and ellipses reach as much
///                  further, but no more than half the local spacing.
/// \param lines     Lines at which the surfaces of points end, a value per point, or empty: there
///                  cells end, and not half-way to the points of the other face.
///
/// Sizes do not depend on the number of threads. Throws Error(kUsage) for bad options.
SURFEL_API SplatSizes estimate_splat_sizes(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                                           bool oriented, const NeighborSearch& search,
                                           const SplatSizeOptions& options = {},
                                           std::span<const float> noise = {},
                                           std::span<const EdgeLines> lines = {});

/// What estimate_splat_sizes() has to know of a cloud of which it sees a part.
struct PartOfCloud {
  std::span<const std::uint8_t> wanted;  ///< By point: 1 where the size is wanted.
  bool scan_lines = false;               ///< consists_of_scan_lines() of the whole cloud.
  /// Called after the points' cells are measured, when a point's size may yet be cut by its
  /// neighbours' spacings.
  FunctionRef<void()> sized;
};

/// Sizes of splats of a part of a cloud: the same as of the whole cloud where `search` finds the
/// same (halo_search.h). With Anisotropy::kAuto SplatSizes::of has ellipses, which are used for the
/// whole cloud if they are worth it. SplatSizes does not count.
SURFEL_API SplatSizes estimate_splat_sizes(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                                           bool oriented, const NeighborSearch& search,
                                           const SplatSizeOptions& options,
                                           const PartOfCloud& part);

/// Is a cell more than twice as long as wide?
SURFEL_API bool elongated(const SplatSize& size, CellKind kind);
/// Are ellipses used for a cloud with so many elongated cells?
SURFEL_API bool worth_ellipses(std::size_t elongated, std::size_t points);

}  // namespace surfel
