#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/cloud/morton.h>

namespace surfel {

namespace {

constexpr std::size_t kGrain = 1 << 16;

}  // namespace

MortonGrid morton_grid(std::span<const Vec3f> position) {
  const std::size_t n = position.size();
  std::vector<std::pair<Vec3f, Vec3f>> partial((n + kGrain - 1) / kGrain);
  constexpr float kInf = std::numeric_limits<float>::infinity();
  parallel_for(n, kGrain, [&](std::size_t begin, std::size_t end, int) {
    Vec3f lo = Vec3f::Constant(kInf);
    Vec3f hi = -lo;
    for (std::size_t i = begin; i < end; ++i) {
      if (!position[i].allFinite()) continue;
      lo = lo.cwiseMin(position[i]);
      hi = hi.cwiseMax(position[i]);
    }
    partial[begin / kGrain] = {lo, hi};
  });
  Vec3f lo = Vec3f::Constant(kInf);
  Vec3f hi = -lo;
  for (const auto& [l, h] : partial) {
    lo = lo.cwiseMin(l);
    hi = hi.cwiseMax(h);
  }
  if (!(lo.x() <= hi.x())) return {};
  // Double, as the extent of finite floats may exceed the largest float.
  MortonGrid grid;
  grid.low = lo.cast<double>();
  const double extent = (hi.cast<double>() - grid.low).maxCoeff();
  grid.cells_per_unit = extent > 0 ? 0x1fffff / extent : 0;
  return grid;
}

Array<std::uint32_t> morton_order(const Array<Vec3f>& position) {
  const std::size_t n = position.size();
  const MortonGrid grid = morton_grid(position);
  Array<std::uint64_t> keys(n);
  parallel_for(n, kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      keys[i] = position[i].allFinite() ? grid.code(position[i])
                                        : std::numeric_limits<std::uint64_t>::max();
    }
  });
  Array<std::uint32_t> order = sorted_order(keys);

  const auto before = [&](std::uint32_t a, std::uint32_t b) {
    const Vec3f& p = position[a];
    const Vec3f& q = position[b];
    return std::make_tuple(p.x(), p.y(), p.z(), a) < std::make_tuple(q.x(), q.y(), q.z(), b);
  };
  for (std::size_t begin = 0; begin < n;) {
    std::size_t end = begin + 1;
    while (end < n && keys[order[end]] == keys[order[begin]]) ++end;
    if (end - begin > 1 && position[order[begin]].allFinite()) {
      std::sort(order.begin() + static_cast<std::ptrdiff_t>(begin),
                order.begin() + static_cast<std::ptrdiff_t>(end), before);
    }
    begin = end;
  }
  return order;
}

}  // namespace surfel
