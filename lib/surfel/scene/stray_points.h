#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include <surfel/base/bounds.h>
#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>

namespace surfel {

/// Points of a cloud that lie within a sphere.
struct PointGroup {
  Vec3d center{0, 0, 0};
  double radius = 0;
  std::uint64_t count = 0;
};

/// What a picture of a cloud should show at least.
struct CloudCore {
  Bounds box;               ///< Holds all points but the strays.
  std::uint64_t stray = 0;  ///< Points outside of the box, > 0.
};

/// Tells the few points that lie far from a cloud. Unset where there are none, or where leaving
/// them out would make the cloud's box hardly smaller.
///
/// The cloud's size is the diagonal of the box that holds all but the outermost 3 % of the points
/// on each side. Points belong together where a chain of others leads from one to the other: steps
/// of an eighth of the size always are short enough, steps of half the size never. A part of the
/// cloud is stray if it has no more than a thousandth of the points, at least 1 and at most 100:
/// any number of well-populated parts stays, however far apart, and so does what reaches out from
/// the cloud without a gap. All strays together are at most a two-hundredth of the points; if there
/// are more, they are the cloud's own and nothing is left out. The box without them must have less
/// than 4/5 of the diagonal that it has with them.
///
/// The order of the groups does not matter, nor do scale and place. How points are grouped decides
/// what belongs together only within the limits above.
/// \param groups     cover the cloud, each with about as many points. Those that are small against
///     the cloud are taken as a whole, so that time grows with their number.
/// \param points_of  hands on the points of a group that is not small; one call after another.
SURFEL_API std::optional<CloudCore> find_core(
    std::span<const PointGroup> groups,
    FunctionRef<void(std::size_t group, FunctionRef<void(const Vec3d& point)>)> points_of);

}  // namespace surfel
