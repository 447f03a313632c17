#pragma once

// Which half-planes cut a surfel that stands for several: what levels of detail and simplification
// have in common.

#include <array>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// A line at which a surfel ends, in scene coordinates: nothing is left where direction . x >
/// offset.
struct CutLine {
  Vec3f direction;  ///< Unit, in the surfel's plane; zero: cuts nothing.
  float offset;

  bool cuts() const { return !direction.isZero(0); }
  /// Distance of a place from the line, positive on the side that is left, scene units.
  float inside(const Vec3f& place) const { return offset - direction.dot(place); }
};

/// A surfel as far as lines are concerned.
struct LinedSurfel {
  Vec3f position;
  float area;  ///< Scene unit^2, >= 0.
  std::array<CutLine, 2> lines;

  /// The centre is cut off: the surfel continues others up to their common line. Offsets do not
  /// tell it of centres on their line.
  bool cut_off;

  bool is_cut() const { return lines[0].cuts() || lines[1].cuts(); }
};

/// Does one of a surfel's lines belong to the edge that another line follows? Lines of one edge are
/// taken for the same though the edge is a curve or the lines were estimated, as long as they keep
/// to one another within a fifth of the surfel's size.
SURFEL_API bool is_on_line(const LinedSurfel& surfel, const CutLine& own, const CutLine& line);

/// Would a line cut off some of the surface that a surfel stands for? Not where one of the
/// surfel's own lines is that line, nor where it lies within the line by half of its size.
SURFEL_API bool goes_on_beyond(const LinedSurfel& surfel, const CutLine& line);

/// A surfel that stands for others, as far as its lines depend on it.
struct MergedPlace {
  Vec3f position;
  Vec3f normal;                     ///< Unit, or zero = unknown.
  std::array<float, 6> covariance;  ///< xx xy xz yy yz zz of its Gaussian, scene unit^2.
};

/// The lines at which a merged surfel ends, at most two, nearest first. Lines of one edge become
/// one line through the mean of their places, in the merged surfel's plane. A line is left out
/// - beyond which some member goes on: a hole is worse than what overhangs;
/// - that the merged surfel does not reach (kClipReach);
/// - that has almost the direction of a nearer one.
/// \param merged   The surfel that stands for the members.
/// \param members  Surfels that the merged one stands for, one at least.
/// \param beside   Further surfels whose lines the merged one may reach.
SURFEL_API std::array<CutLine, 2> merged_lines(const MergedPlace& merged,
                                               std::span<const LinedSurfel* const> members,
                                               std::span<const LinedSurfel* const> beside = {});

}  // namespace surfel
