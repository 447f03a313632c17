// MortonGrid::in_order().

#include <algorithm>
#include <vector>

#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/base/morton_in_order.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<double, 8>;
using I = hn::Rebind<std::int32_t, D>;

/// May point i + 1 follow point i?
bool pair_in_order(const MortonGrid& grid, const PointColumns& points, std::size_t i) {
  const auto at = [&](std::size_t k) { return Vec3f(points.x[k], points.y[k], points.z[k]); };
  const Vec3f here = at(i);
  const Vec3f next = at(i + 1);
  const std::uint64_t code = grid.code(here);
  const std::uint64_t next_code = grid.code(next);
  return code != next_code ? code < next_code : !before_on_curve(next, here);
}

/// Along one axis: the bits in which the cells of points and of the points after them differ, and
/// how much higher the points after them are.
struct Step {
  hn::Vec<I> differing, rise;

  HWY_INLINE Step(const float* column, double low, double cells_per_unit) {
    const auto cell = [&](const float* from) {
      const hn::Vec<D> p = hn::PromoteTo(D(), hn::LoadU(hn::Rebind<float, D>(), from));
      return hn::DemoteTo(I(),
                          hn::Mul(hn::Sub(p, hn::Set(D(), low)), hn::Set(D(), cells_per_unit)));
    };
    const hn::Vec<I> here = cell(column);
    const hn::Vec<I> next = cell(column + 1);
    differing = hn::Xor(here, next);
    rise = hn::Sub(next, here);
  }
};

/// The step whose highest differing bit is the higher one, `a` if both have one bit highest:
/// a < b and a < (a ^ b) where b has the higher highest bit.
HWY_INLINE Step leading(const Step& a, const Step& b) {
  const auto second = hn::And(hn::Lt(a.differing, b.differing),
                              hn::Lt(a.differing, hn::Xor(a.differing, b.differing)));
  Step result = a;
  result.differing = hn::IfThenElse(second, b.differing, a.differing);
  result.rise = hn::IfThenElse(second, b.rise, a.rise);
  return result;
}

/// Are points [begin, end] in order?
bool in_order_simd(const MortonGrid& grid, const PointColumns& points, std::size_t begin,
                   std::size_t end) {
  const auto one_by_one = [&](std::size_t first, std::size_t last) {
    for (; first < last; ++first) {
      if (!pair_in_order(grid, points, first)) return false;
    }
    return true;
  };
  constexpr std::size_t kPairs = hn::MaxLanes(D());
  const hn::Vec<I> zero = hn::Zero(I());
  for (; begin + kPairs <= end; begin += kPairs) {
    const auto step = [&](const float* column, int axis) {
      return Step(column + begin, grid.low[axis], grid.cells_per_unit);
    };
    // Codes compare as the coordinates do whose highest differing bit is highest, z's before y's
    // before x's.
    const Step first = leading(leading(step(points.z, 2), step(points.y, 1)), step(points.x, 0));
    if (!hn::AllFalse(I(), hn::Lt(first.rise, zero))) return false;
    // Points in one cell are ordered by before_on_curve().
    if (!hn::AllFalse(I(), hn::Eq(first.differing, zero)) && !one_by_one(begin, begin + kPairs)) {
      return false;
    }
  }
  return one_by_one(begin, end);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(in_order_simd);

bool MortonGrid::in_order(const PointColumns& points) const {
  if (points.count < 2) return true;
  constexpr std::size_t kPairsGrain = 1 << 16;
  const std::size_t pairs = points.count - 1;
  std::vector<std::uint8_t> sorted((pairs + kPairsGrain - 1) / kPairsGrain);
  parallel_for(pairs, kPairsGrain, [&](std::size_t begin, std::size_t end, int) {
    sorted[begin / kPairsGrain] = HWY_DYNAMIC_DISPATCH(in_order_simd)(*this, points, begin, end);
  });
  return std::all_of(sorted.begin(), sorted.end(), [](std::uint8_t s) { return s != 0; });
}

}  // namespace surfel
#endif
