#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// How a splat's variance follows from its neighbourhood.
enum class VarianceRule : std::uint8_t {
  kMaxDistance,  ///< SS01 section 5: the largest distance among the nearest points is h; V = h^2 I.
  kCover,        ///< The disc at the cutoff just covers the point's Voronoi cell on the surface.
};

enum class Anisotropy : std::uint8_t {
  kAuto,  ///< Ellipses where at least one cell in ten is longer than anisotropy_ratio : 1.
  kOn,
  kOff,
};

struct SplatSizeOptions {
  VarianceRule rule = VarianceRule::kCover;
  Anisotropy anisotropy = Anisotropy::kAuto;
  double cutoff = 1;            ///< c of beta < c: the disc that covers reaches sqrt(2 c V), > 0.
  int neighbors = 16;           ///< Nearest points looked at first; more where they do not suffice.
  double anisotropy_ratio = 2;  ///< Long by short side of a cell from which on it is worth it, > 1.
  double margin = 1.05;  ///< Discs are larger than their cells by this factor: neighbouring tangent
                         ///< planes differ where the surface bends.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Of one point; in one piece, as it is read at once and in another order.
struct SplatSize {
  Vec3f tangent;     ///< Of an ellipse the long axis, unit; of a disc any.
  float variance;    ///< Of the disc that covers, unit^2.
  float variance_u;  ///< Of the ellipse that does, along its axis ...
  float variance_v;  ///< ... and across; of a disc both are `variance`.
  float area;        ///< Of the cell, unit^2.
  float spacing;     ///< Mean distance to the four nearest others.

  bool operator==(const SplatSize&) const = default;
};

/// Of all points.
struct SplatSizes {
  Array<SplatSize> of;     ///< Each of them.
  bool ellipses = false;   ///< Instead of discs.
  std::size_t border = 0;  ///< Points whose cell is open: at the surface's border, or alone.
  std::size_t capped =
      0;  ///< Points far from all others, whose splat was cut to their neighbours'.
};

/// Sizes for points with normals (unit; zero = unknown: the cell is measured in a sphere's stead,
/// by distance alone). The covering rule: restricted to the points that face the same way and lie
/// near the tangent plane, a point's Voronoi cell is all that is nearer to it than to them; the
/// smallest disc (or ellipse of the cell's second moments) around the point that holds the cell
/// closes the surface, since the cells tile it, and overlaps its neighbours no more than it must.
/// At a border the cell is open: there it ends at 0.95 of the local spacing, so that silhouettes do
/// not fray. A point alone takes no more than three times its neighbours' spacing.
///
/// \param search  over `position`, in the order of a space-filling curve for speed.
/// \param oriented  whether normals tell front from back; otherwise thin sheets disturb each other.
SURFEL_API SplatSizes estimate_splat_sizes(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                                           bool oriented, const NeighborSearch& search,
                                           const SplatSizeOptions& options = {});

}  // namespace surfel
