#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/scene/cluster_bounds.h>
#include <surfel/scene/usable_surfels.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/scene/cluster_bounds.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/lane_sums-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// The widest vectors of the target, for results that do not depend on the order of additions.
using Wide = hn::CappedTag<float, kColumnPadding>;
/// For sums, four side by side.
using Four = hn::CappedTag<float, 4>;

/// Consecutive values of columns; the last of them may lie past the columns' end.
template <class D>
class Group {
 public:
  HWY_INLINE Group(std::size_t first, std::size_t count)
      : first_(first), inside_(hn::FirstN(D(), count - first)) {}

  HWY_INLINE std::size_t first() const { return first_; }

  /// Values past the column's end are `other`.
  HWY_INLINE hn::Vec<D> load(const float* column, float other) const {
    return hn::IfThenElse(inside_, hn::LoadU(D(), column + first_), hn::Set(D(), other));
  }
  /// Values past the column's end are NaN.
  HWY_INLINE hn::Vec<D> load(const float* column) const {
    return load(column, std::numeric_limits<float>::quiet_NaN());
  }

 private:
  std::size_t first_;
  hn::Mask<D> inside_;
};

/// Calls visit(Group<D>) until all of `count` values were in one.
template <class D, class Visit>
HWY_INLINE void for_each_group(std::size_t count, const Visit& visit) {
  for (std::size_t i = 0; i < count; i += hn::Lanes(D())) visit(Group<D>(i, count));
}

/// Least and largest of the values that are not NaN; infinity and minus infinity of none.
struct Range {
  using V = hn::Vec<Wide>;
  V lo, hi;

  HWY_INLINE Range()
      : lo(hn::Set(Wide(), std::numeric_limits<float>::infinity())),
        hi(hn::Set(Wide(), -std::numeric_limits<float>::infinity())) {}
  HWY_INLINE void add(V v) {
    lo = hn::IfThenElse(hn::Lt(v, lo), v, lo);
    hi = hn::IfThenElse(hn::Gt(v, hi), v, hi);
  }
  HWY_INLINE float min() const { return hn::GetLane(hn::MinOfLanes(Wide(), lo)); }
  HWY_INLINE float max() const { return hn::GetLane(hn::MaxOfLanes(Wide(), hi)); }
};

/// x[0] y[0] + (x[1] y[1] + x[2] y[2]).
template <class V>
HWY_INLINE V dot(const V (&x)[3], const V (&y)[3]) {
  return hn::Add(hn::Mul(x[0], y[0]), hn::Add(hn::Mul(x[1], y[1]), hn::Mul(x[2], y[2])));
}

/// The cone of normals, if any cone holds them.
HWY_INLINE void bound_normals(const ClusterColumns& s, ClusterBounds& bounds) {
  using V = hn::Vec<Four>;
  LaneSums<Four, 4> sums[3];
  auto unknown = hn::FirstN(Four(), 0);
  for_each_group<Four>(s.count, [&](const Group<Four>& group) {
    V n[3];
    for (int axis = 0; axis < 3; ++axis) {
      n[axis] = group.load(s.normal[axis], 0);
      sums[axis].add(group.first(), n[axis]);
    }
    // Past the end nothing is unknown.
    const V bits = hn::Or(group.load(s.normal[0], 1), hn::Or(n[1], n[2]));
    unknown = hn::Or(unknown, hn::Eq(hn::Abs(bits), hn::Zero(Four())));
  });
  Vec3f sum;
  for (int axis = 0; axis < 3; ++axis) {
    sum[axis] = sums[axis].total();
  }
  const float length = sum.norm();
  if (!hn::AllFalse(Four(), unknown) || !(length > 0)) return;
  const Vec3f axis = sum / length;
  const Range::V along[3] = {hn::Set(Wide(), axis[0]), hn::Set(Wide(), axis[1]),
                             hn::Set(Wide(), axis[2])};
  Range cosines;
  for_each_group<Wide>(s.count, [&](const Group<Wide>& group) {
    cosines.add(
        dot(along, {group.load(s.normal[0]), group.load(s.normal[1]), group.load(s.normal[2])}));
  });
  const float cosine = std::min(1.0F, cosines.min());
  if (cosine > kWidestCone) {
    bounds.cone_axis = axis;
    bounds.cone_cosine = cosine - 1e-6F;  // Rounding must not shrink a bound.
  }
}

ClusterBounds cluster_bounds_simd(const ClusterColumns& s) {
  ClusterBounds bounds;
  Range positions[3];
  Range deviations;
  for_each_group<Wide>(s.count, [&](const Group<Wide>& group) {
    for (int axis = 0; axis < 3; ++axis) positions[axis].add(group.load(s.position[axis]));
    deviations.add(group.load(s.deviation_u));
    deviations.add(group.load(s.deviation_v));
  });
  Range::V center[3];
  for (int axis = 0; axis < 3; ++axis) {
    const float lo = positions[axis].min();
    bounds.center[axis] = lo + (positions[axis].max() - lo) / 2;
    center[axis] = hn::Set(Wide(), bounds.center[axis]);
  }
  bounds.max_deviation = std::max(0.0F, deviations.max());
  Range squares;
  for_each_group<Wide>(s.count, [&](const Group<Wide>& group) {
    Range::V offset[3];
    for (int axis = 0; axis < 3; ++axis) {
      offset[axis] = hn::Sub(group.load(s.position[axis]), center[axis]);
    }
    squares.add(dot(offset, offset));
  });
  // Rounding must not shrink a bound.
  bounds.radius = std::sqrt(std::max(0.0F, squares.max())) * (1.0F + 1e-6F);
  bound_normals(s, bounds);
  return bounds;
}

SurfelTotals surfel_totals_simd(const ClusterColumns& s, const float* area, const float* alpha,
                                std::span<const float* const> positive,
                                std::span<const float* const> bounded) {
  Range positions[3];
  Range reaches_down[3];
  Range reaches_up[3];
  Range alphas;
  const Range::V most = hn::Set(Wide(), kMostMagnitude);
  auto usable = hn::FirstN(Wide(), hn::Lanes(Wide()));
  for_each_group<Wide>(s.count, [&](const Group<Wide>& group) {
    const Range::V reach = group.load(s.deviation_u);
    for (int axis = 0; axis < 3; ++axis) {
      const Range::V position = group.load(s.position[axis]);
      positions[axis].add(position);
      reaches_down[axis].add(hn::Sub(position, reach));
      reaches_up[axis].add(hn::Add(position, reach));
    }
    if (alpha) alphas.add(group.load(alpha));
    for (const float* column : positive) {
      usable = hn::And(usable, hn::Gt(group.load(column, 1), hn::Zero(Wide())));
    }
    for (const float* column : bounded) {
      usable = hn::And(usable, hn::Le(hn::Abs(group.load(column, 0)), most));
    }
    // most_area(), with the same roundings.
    const Range::V density =
        hn::Mul(hn::Mul(hn::Set(Wide(), kMostDensity), group.load(s.deviation_u, 1)),
                group.load(s.deviation_v, 1));
    usable = hn::And(usable,
                     hn::Le(hn::Abs(group.load(area, 0)), hn::Min(hn::Mul(most, most), density)));
  });
  double deviations[4] = {};
  for (std::size_t i = 0; i < s.count; ++i) {
    deviations[i % 4] += std::max(s.deviation_u[i], s.deviation_v[i]);
  }
  SurfelTotals totals;
  for (int axis = 0; axis < 3; ++axis) {
    totals.min[axis] = positions[axis].min();
    totals.max[axis] = positions[axis].max();
    totals.reach_min[axis] = reaches_down[axis].min();
    totals.reach_max[axis] = reaches_up[axis].max();
  }
  totals.deviations = (deviations[0] + deviations[1]) + (deviations[2] + deviations[3]);
  totals.usable = hn::AllTrue(Wide(), usable);
  totals.transparent = alpha && alphas.min() < 1;
  totals.invisible = alpha && alphas.min() <= 0;
  return totals;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(cluster_bounds_simd);
HWY_EXPORT(surfel_totals_simd);

ClusterBounds cluster_bounds(const ClusterColumns& surfels) {
  return HWY_DYNAMIC_DISPATCH(cluster_bounds_simd)(surfels);
}

SurfelTotals added_up(std::span<const SurfelTotals> parts) {
  SurfelTotals sum;
  sum.min = sum.reach_min = Vec3f::Constant(std::numeric_limits<float>::infinity());
  sum.max = sum.reach_max = -sum.min;
  for (const SurfelTotals& part : parts) {
    sum.min = sum.min.cwiseMin(part.min);
    sum.max = sum.max.cwiseMax(part.max);
    sum.reach_min = sum.reach_min.cwiseMin(part.reach_min);
    sum.reach_max = sum.reach_max.cwiseMax(part.reach_max);
    sum.deviations += part.deviations;
    sum.usable = sum.usable && part.usable;
    sum.transparent = sum.transparent || part.transparent;
    sum.invisible = sum.invisible || part.invisible;
  }
  return sum;
}

SurfelTotals surfel_totals(const ClusterColumns& surfels, const float* area, const float* alpha,
                           std::span<const float* const> positive,
                           std::span<const float* const> bounded) {
  return HWY_DYNAMIC_DISPATCH(surfel_totals_simd)(surfels, area, alpha, positive, bounded);
}

}  // namespace surfel
#endif
