#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <surfel/base/binary_digits.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 16;
constexpr float kInf = std::numeric_limits<float>::infinity();

/// The order of the n points at(i) along the curve through a grid.
template <class At>
Array<std::uint32_t> order_of(std::size_t n, const At& at, const MortonGrid& grid) {
  Array<std::uint64_t> keys(n);
  parallel_each(n, kGrain, [&](std::size_t i) {
    const Vec3f p = at(i);
    keys[i] = p.allFinite() ? grid.code(p) : std::numeric_limits<std::uint64_t>::max();
  });
  Array<std::uint32_t> order = sort_keys(keys);

  const auto before = [&](std::uint32_t a, std::uint32_t b) {
    const Vec3f p = at(a);
    const Vec3f q = at(b);
    return p == q ? a < b : before_on_curve(p, q);
  };
  // Each range orders the cells that begin in it; beyond its end it reads keys only.
  parallel_for(n, kGrain, [&](std::size_t range_begin, std::size_t range_end, int) {
    for (std::size_t i = range_begin; i < range_end; ++i) {
      if (i + 1 == n || keys[i] != keys[i + 1] || (i > 0 && keys[i] == keys[i - 1])) continue;
      std::size_t end = i + 2;
      while (end < n && keys[end] == keys[i]) ++end;
      if (at(order[i]).allFinite()) {
        std::sort(order.begin() + static_cast<std::ptrdiff_t>(i),
                  order.begin() + static_cast<std::ptrdiff_t>(end), before);
      }
    }
  });
  return order;
}

/// The grid around the finite ones among the n points at(i).
template <class At>
MortonGrid grid_around(std::size_t n, const At& at) {
  std::vector<std::pair<Vec3f, Vec3f>> partial((n + kGrain - 1) / kGrain);
  parallel_for(n, kGrain, [&](std::size_t begin, std::size_t end, int) {
    Vec3f lo = Vec3f::Constant(kInf);
    Vec3f hi = -lo;
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3f p = at(i);
      if (!p.allFinite()) continue;
      lo = lo.cwiseMin(p);
      hi = hi.cwiseMax(p);
    }
    partial[begin / kGrain] = {lo, hi};
  });
  Vec3f lo = Vec3f::Constant(kInf);
  Vec3f hi = -lo;
  for (const auto& [l, h] : partial) {
    lo = lo.cwiseMin(l);
    hi = hi.cwiseMax(h);
  }
  return {lo, hi};
}

}  // namespace

bool before_on_curve(const Vec3f& p, const Vec3f& q) {
  const int axis = deciding_axis(p, q).first;
  return p[axis] < q[axis];
}

int step_on_curve(const Vec3f& p, const Vec3f& q) {
  const auto [axis, highest] = deciding_axis(p, q);
  constexpr int kMostDigits = 1000;  // More than floats have.
  return highest < 0 ? 0 : 1 + 3 * std::min(highest, kMostDigits) + axis;
}

MortonGrid morton_grid(std::span<const Vec3f> position) {
  return grid_around(position.size(), [&](std::size_t i) { return position[i]; });
}

Array<std::uint32_t> morton_order(const Array<Vec3f>& position) {
  return morton_order(position, morton_grid(position));
}

Array<std::uint32_t> morton_order(const Array<Vec3f>& position, const MortonGrid& grid) {
  return order_of(
      position.size(), [&](std::size_t i) { return position[i]; }, grid);
}

Array<std::uint32_t> column_morton_order(const PointColumns& points) {
  const auto at = [&](std::size_t i) { return Vec3f(points.x[i], points.y[i], points.z[i]); };
  return order_of(points.count, at, grid_around(points.count, at));
}

MortonGrid::MortonGrid(const Vec3f& min, const Vec3f& max) {
  if (!(min.x() <= max.x())) return;
  // In double, as the extent of finite floats may exceed the largest float.
  low = min.cast<double>();
  const double extent = (max.cast<double>() - low).maxCoeff();
  if (extent > 0) cells_per_unit = 0x1fffff / extent;
}

}  // namespace surfel
