#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/sp06/disc_tree.h>
#include <surfel/sp06/overlap_graph.h>

namespace surfel {
namespace {

constexpr std::size_t kDiscGrain = 1 << 14;

/// One past the last disc at the place of disc `begin`.
std::size_t end_of_place(const Array<Vec3f>& center, std::size_t begin) {
  std::size_t end = begin + 1;
  while (end < center.size() && center[end] == center[begin]) ++end;
  return end;
}

}  // namespace

Discs Discs::gathered(std::span<const std::uint32_t> which) const {
  Discs out;
  out.center.resize(which.size());
  out.normal.resize(which.size());
  out.radius.resize(which.size());
  out.surfel.resize(which.size());
  parallel_for(which.size(), kDiscGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      out.center[i] = center[which[i]];
      out.normal[i] = normal[which[i]];
      out.radius[i] = radius[which[i]];
      out.surfel[i] = surfel[which[i]];
    }
  });
  return out;
}

Discs make_discs(const SurfelCloud& cloud, double cutoff, const std::string& name) {
  if (cloud.normal.empty()) {
    throw_input(name, "has no normals; run surfel-estimate on it first");
  }
  if (!has_variance(cloud)) {
    throw_input(name, "has no variances; run surfel-estimate on it first");
  }
  const Array<std::uint32_t> curve = morton_order(cloud.position);
  Discs all;
  for (const std::uint32_t i : curve) {
    const float radius = splat_radius(cloud, i, cutoff);
    const Vec3f& normal = cloud.normal[i];
    if (radius == 0 || !normal.allFinite() || normal.isZero(0)) continue;
    all.center.push_back(cloud.position[i]);
    all.normal.push_back(normal.normalized());
    all.radius.push_back(radius);
    all.surfel.push_back(i);
  }
  Array<std::uint32_t> order(all.size());
  std::iota(order.begin(), order.end(), 0U);
  for (std::size_t begin = 0; begin < all.size();) {
    const std::size_t end = end_of_place(all.center, begin);
    std::stable_sort(
        order.begin() + static_cast<std::ptrdiff_t>(begin),
        order.begin() + static_cast<std::ptrdiff_t>(end),
        [&](std::uint32_t a, std::uint32_t b) { return all.radius[a] > all.radius[b]; });
    begin = end;
  }
  return all.gathered(order);
}

Array<std::uint32_t> distinct_discs(const Discs& discs) {
  Array<std::uint32_t> distinct;
  for (std::size_t begin = 0; begin < discs.size();) {
    const std::size_t end = end_of_place(discs.center, begin);
    const std::size_t first = distinct.size();
    for (std::size_t i = begin; i < end; ++i) {
      // At most a few directions are more than 90 degrees from one another.
      const bool covered =
          std::any_of(distinct.begin() + static_cast<std::ptrdiff_t>(first), distinct.end(),
                      [&](std::uint32_t j) { return discs.normal[j].dot(discs.normal[i]) > 0; });
      if (!covered) distinct.push_back(static_cast<std::uint32_t>(i));
    }
    begin = end;
  }
  return distinct;
}

TangentPlane::TangentPlane(const Discs& discs, std::size_t disc)
    : center_(discs.center[disc]), normal_(discs.normal[disc]) {
  const Vec3d n = normal_.cast<double>();
  a_ = n.unitOrthogonal();
  b_ = n.cross(a_);
}

DiscTree::DiscTree(const Discs& discs)
    : tree_(discs.size(), [&](std::size_t i) {
        const Vec3f& p = discs.center[i];
        return Node{{p.x(), p.y(), p.z(), 0}, {p.x(), p.y(), p.z(), discs.radius[i]}};
      }) {}

}  // namespace surfel
