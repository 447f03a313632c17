// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017: the tangent frame.

#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/surface/closed_cell.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/surface/closed_cell.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/lane_sums-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
constexpr std::size_t kWidth = ClosedCell::kWidth;
using D = hn::CappedTag<float, kWidth>;
using V = hn::Vec<D>;

constexpr float kRoot3 = 1.7320508F;  ///< The square root of 3.

void set_frame(const Vec3f& n, ClosedCell& cell) {
  const float sign = std::copysign(1.0F, n.z());
  const float a = -1 / (sign + n.z());
  const float b = n.x() * n.y() * a;
  cell.a = {1 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
  cell.b = {b, sign + n.y() * n.y() * a, -n.y()};
}

/// Adds the neighbours on the point's sheet: same_side() and along_sheet() of sheet.h, in vectors.
void add(const CellSurface& surface, std::size_t i, std::span<const Neighbor> near,
         ClosedCell& cell) {
  const D d;
  const V zero = hn::Zero(d);
  const Vec3f origin = surface.position[i];
  const Vec3f n = surface.normal[i];
  const auto scale = static_cast<float>(1 / cell.unit);
  const auto dot = [&](const Vec3f& axis, const V& x, const V& y, const V& z) HWY_ATTR {
    return mul_add(x, hn::Set(d, axis.x()),
                   mul_add(y, hn::Set(d, axis.y()), hn::Mul(z, hn::Set(d, axis.z()))));
  };
  const float* position = surface.position.data()->data();
  const float* normal = surface.normal.data()->data();
  const auto place = [](std::size_t index) { return static_cast<std::int32_t>(3 * index); };
  for (; !near.empty(); near = near.subspan(std::min(kWidth, near.size()))) {
    // The point itself, which is never added, fills up the last vector.
    alignas(64) std::int32_t places[kWidth];
    for (std::size_t k = 0; k < kWidth; ++k) {
      places[k] = place(k < near.size() ? near[k].index : i);
    }
    for (std::size_t k = 0; k < kWidth; k += hn::Lanes(d)) {
      const auto at = hn::Load(hn::RebindToSigned<D>(), places + k);
      const auto offset = [&](int axis) HWY_ATTR {
        const V p = hn::GatherIndex(d, position + axis, at);
        return hn::Mul(hn::Sub(p, hn::Set(d, origin[axis])), hn::Set(d, scale));
      };
      const V ox = offset(0);
      const V oy = offset(1);
      const V oz = offset(2);
      const V x = dot(cell.a, ox, oy, oz);
      const V y = dot(cell.b, ox, oy, oz);
      const V height = dot(n, ox, oy, oz);
      const V length2 = mul_add(x, x, hn::Mul(y, y));
      auto on_surface = hn::And(hn::Gt(length2, zero), hn::Le(hn::Mul(height, height), length2));
      if (surface.oriented) {
        const V product = dot(n, hn::GatherIndex(d, normal, at), hn::GatherIndex(d, normal + 1, at),
                              hn::GatherIndex(d, normal + 2, at));
        on_surface = hn::And(on_surface, hn::Ge(product, zero));
      }
      const Compressor<D> taken(on_surface);
      taken.store(x, d, cell.x + cell.neighbors);
      taken.store(y, d, cell.y + cell.neighbors);
      cell.neighbors += taken.count();
    }
  }
  for (std::size_t k = 0; k < kWidth; k += hn::Lanes(d)) {
    hn::StoreU(zero, d, cell.x + cell.neighbors + k);
    hn::StoreU(zero, d, cell.y + cell.neighbors + k);
  }
}

/// Sums over edges from (0, 0), a and b, and the largest |b|^2.
struct Sums {
  using Sum = LaneSums<D, kWidth>;
  Sum area, xx, xy, yy;
  Sum gap_x, gap_y;
  V radius2;

  HWY_INLINE Sums() : radius2(hn::Zero(D())) {}

  /// Adds the edges from number `first` on.
  HWY_INLINE void add(std::size_t first, const V& ax, const V& ay, const V& bx, const V& by) {
    // Moments of a triangle (0, a, b), as in VoronoiCell::moments(), without the factor 1 / 24.
    const V cx = hn::Add(ax, bx);
    const V cy = hn::Add(ay, by);
    const V cross = mul_sub(ax, by, hn::Mul(ay, bx));
    area.add(first, cross);
    xx.add(first, hn::Mul(cross, mul_add(ax, ax, mul_add(bx, bx, hn::Mul(cx, cx)))));
    xy.add(first, hn::Mul(cross, mul_add(ax, ay, mul_add(bx, by, hn::Mul(cx, cy)))));
    yy.add(first, hn::Mul(cross, mul_add(ay, ay, mul_add(by, by, hn::Mul(cy, cy)))));
    gap_x.add(first, hn::Sub(bx, ax));
    gap_y.add(first, hn::Sub(by, ay));
    radius2 = hn::Max(radius2, mul_add(bx, bx, hn::Mul(by, by)));
  }
};

/// Makes the cell's edges from the bisectors of the `count` neighbours in cell.bound_x and
/// cell.bound_y. False if the edges do not close.
bool intersect(std::size_t count, ClosedCell& cell) {
  constexpr float kFar = 1e18F;  ///< Beyond all places; its square is still finite.
  /// Sines below this are rounding, and quotients by them may be infinite.
  constexpr float kLeast = 1e-30F;
  /// Largest gap between edges, by the radius; rounding makes gaps of 1e-5, larger ones in slivers.
  constexpr float kLargestGap = 1e-4F;
  const D d;
  const V zero = hn::Zero(d);
  const V half = hn::Set(d, 0.5F);
  const V far = hn::Set(d, kFar);
  const V least = hn::Set(d, kLeast);
  const V lanes = hn::Iota(d, 0);
  alignas(64) float kept_x[ClosedCell::kRoom];
  alignas(64) float kept_y[ClosedCell::kRoom];
  std::size_t kept = 0;
  Sums sums;
  for (std::size_t j = 0; j < count; j += hn::Lanes(d)) {
    const V x = hn::Load(d, cell.bound_x + j);
    const V y = hn::Load(d, cell.bound_y + j);
    // A place on the bisector of p is p / 2 + t (-p.y, p.x). It is no further from the origin than
    // from q if t cross(p, q - p) <= q.(q - p) / 2.
    const V place = hn::Add(lanes, hn::Set(d, static_cast<float>(j)));
    V low = hn::Neg(far);
    V high = far;
    for (std::size_t k = 0; k < count; ++k) {
      const V qx = hn::Set(d, cell.bound_x[k]);
      const V qy = hn::Set(d, cell.bound_y[k]);
      const V ex = hn::Sub(qx, x);
      const V ey = hn::Sub(qy, y);
      const V numerator = mul_add(qx, ex, hn::Mul(qy, ey));
      const V denominator = mul_sub(x, ey, hn::Mul(y, ex));
      // Parallel bisectors bound all or nothing; of neighbours at one place in the plane the first
      // has the edge.
      const auto parallel = hn::Le(hn::Abs(denominator), least);
      const V order = hn::Sub(hn::Set(d, static_cast<float>(k)), place);
      const V side = hn::IfThenElse(hn::Eq(numerator, zero), order, numerator);
      const V t =
          hn::IfThenElse(parallel, hn::CopySign(far, side), hn::Div(numerator, denominator));
      const auto rising = hn::Or(parallel, hn::Gt(denominator, zero));
      high = hn::IfThenElse(rising, hn::Min(high, t), high);
      low = hn::IfThenElse(rising, low, hn::Max(low, t));
    }
    const auto edge = hn::And(hn::Lt(low, high), hn::FirstN(d, count - j));
    const auto endless = hn::Or(hn::Ge(high, far), hn::Le(low, hn::Neg(far)));
    if (!hn::AllFalse(d, hn::And(edge, endless))) return false;
    const auto at = [&](const V& t, V& to_x, V& to_y) HWY_ATTR {
      to_x = hn::IfThenElseZero(edge, neg_mul_add(hn::Mul(half, t), y, hn::Mul(half, x)));
      to_y = hn::IfThenElseZero(edge, mul_add(hn::Mul(half, t), x, hn::Mul(half, y)));
    };
    V ax, ay, bx, by;
    at(low, ax, ay);
    at(high, bx, by);
    sums.add(j, ax, ay, bx, by);
    const Compressor<D> edges(edge);
    edges.store(x, d, kept_x + kept);
    edges.store(y, d, kept_y + kept);
    edges.store(bx, d, cell.corner_x + kept);
    edges.store(by, d, cell.corner_y + kept);
    kept += edges.count();
  }
  std::copy(kept_x, kept_x + kept, cell.bound_x);
  std::copy(kept_y, kept_y + kept, cell.bound_y);
  cell.bounds = kept;
  cell.corners = kept;
  cell.radius2 = hn::GetLane(hn::MaxOfLanes(d, sums.radius2));
  const float gap_x = sums.gap_x.total();
  const float gap_y = sums.gap_y.total();
  if (kept < 3 || !(gap_x * gap_x + gap_y * gap_y <= kLargestGap * kLargestGap * cell.radius2)) {
    return false;
  }
  cell.area = sums.area.total() / 2;
  cell.xx = sums.xx.total() / 24;
  cell.xy = sums.xy.total() / 24;
  cell.yy = sums.yy.total() / 24;
  return true;
}

/// Do the neighbours surround the corner, looked at from five sides, 30 degrees apart? on_surface()
/// in estimate/splat_size.cpp has the rule.
HWY_INLINE bool surrounded(float corner_x, float corner_y, const ClosedCell& cell) {
  const D d;
  const V zero = hn::Zero(d);
  const V cx = hn::Set(d, corner_x);
  const V cy = hn::Set(d, corner_y);
  const V distance2 = mul_add(cx, cx, hn::Mul(cy, cy));
  const V root3 = hn::Set(d, kRoot3);
  bool beyond = false, left = false, right = false, far_left = false, far_right = false;
  for (std::size_t k = 0; k < cell.neighbors; k += hn::Lanes(d)) {
    const V x = hn::Load(d, cell.x + k);
    const V y = hn::Load(d, cell.y + k);
    const V along = hn::Sub(mul_add(x, cx, hn::Mul(y, cy)), distance2);
    const V across = mul_sub(cx, y, hn::Mul(cy, x));
    const auto any = [&](const V& v) HWY_ATTR { return !hn::AllFalse(d, hn::Ge(v, zero)); };
    beyond |= any(along);
    left |= any(mul_add(root3, along, across));
    right |= any(mul_sub(root3, along, across));
    far_left |= any(mul_add(root3, across, along));
    far_right |= any(neg_mul_add(root3, across, along));
  }
  return beyond && left && right && far_left && far_right;
}

CellState state(const CellLimits& limits, const ClosedCell& cell) {
  const auto scaled2 = [&](float length) {
    const auto l = static_cast<float>(length / cell.unit);
    return l * l;
  };
  const float sure2 = scaled2(limits.sure);
  if (cell.radius2 <= sure2) return CellState::kClosed;
  if (cell.radius2 > scaled2(limits.most)) return CellState::kOpen;
  if (cell.radius2 > scaled2(limits.reach / 2)) return CellState::kBeyondReach;
  for (std::size_t k = 0; k < cell.corners; ++k) {
    const float x = cell.corner_x[k];
    const float y = cell.corner_y[k];
    if (x * x + y * y > sure2 && !surrounded(x, y, cell)) return CellState::kOpen;
  }
  return CellState::kClosed;
}

}  // namespace

CellState measure(const CellSurface& surface, std::size_t i, std::span<const Neighbor> near,
                  const CellLimits& limits, ClosedCell& cell) {
  set_frame(surface.normal[i], cell);
  cell.unit = limits.reach;
  cell.neighbors = 0;
  add(surface, i, near, cell);
  std::copy(cell.x, cell.x + cell.neighbors, cell.bound_x);
  std::copy(cell.y, cell.y + cell.neighbors, cell.bound_y);
  return intersect(cell.neighbors, cell) ? state(limits, cell) : CellState::kOpen;
}

CellState extend(const CellSurface& surface, std::size_t i, std::span<const Neighbor> further,
                 const CellLimits& limits, ClosedCell& cell) {
  const std::size_t before = cell.neighbors;
  add(surface, i, further, cell);
  // A bisector that bounds nothing will not with more neighbours either.
  std::size_t bounds = cell.bounds;
  for (std::size_t k = before; k < cell.neighbors; ++k) {
    const float x = cell.x[k];
    const float y = cell.y[k];
    if (x * x + y * y > 4 * cell.radius2) continue;
    cell.bound_x[bounds] = x;
    cell.bound_y[bounds++] = y;
  }
  if (bounds > cell.bounds && !intersect(bounds, cell)) return CellState::kOpen;
  return state(limits, cell);
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(measure);
HWY_EXPORT(extend);

}  // namespace

CellState measure_cell(const CellSurface& surface, std::size_t i, std::span<const Neighbor> near,
                       const CellLimits& limits, ClosedCell& cell) {
  // Coordinates are gathered by places of 32 bits.
  constexpr std::size_t kMostPoints = std::numeric_limits<std::int32_t>::max() / 3;
  if (near.size() > ClosedCell::kMostNeighbors || surface.position.size() > kMostPoints) {
    return CellState::kOpen;
  }
  return HWY_DYNAMIC_DISPATCH(measure)(surface, i, near, limits, cell);
}

CellState extend_cell(const CellSurface& surface, std::size_t i, std::span<const Neighbor> further,
                      const CellLimits& limits, ClosedCell& cell) {
  if (cell.neighbors + further.size() > ClosedCell::kMostNeighbors) return CellState::kOpen;
  return HWY_DYNAMIC_DISPATCH(extend)(surface, i, further, limits, cell);
}

}  // namespace surfel
#endif
