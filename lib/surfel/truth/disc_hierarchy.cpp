#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <surfel/truth/disc_hierarchy.h>

namespace surfel {
namespace {

constexpr std::uint32_t kLeafSize = 4;  ///< Discs, which are met one by one.
constexpr double kRounding = 1e-14;     ///< Of coordinates, relative; a hundred times the unit's.

Vec3d center_of(const RenderCloud& cloud, std::uint32_t i) {
  return {cloud.x[i], cloud.y[i], cloud.z[i]};
}

/// Whether the beam meets the box, rounded towards yes. Along each axis, the beam's ball at t is
/// within reach of a side of the box where a t <= b, with a = +-direction - spread: six half lines
/// of t that must have a point in common. (At the box's edges balls are taken for cubes.) What is
/// far away along an axis is rounded in units of its own coordinate, so that one disc far from all
/// others does not make the boxes of the others thicker.
bool meets(const Beam& beam, const Eigen::AlignedBox3d& box) {
  double from = 0;
  double to = std::numeric_limits<double>::infinity();
  const auto restrict_to = [&](double a, double b) {
    if (a > 0) {
      to = std::min(to, b / a);
    } else if (a < 0) {
      from = std::max(from, b / a);
    } else if (b < 0) {
      to = -1;
    }
  };
  const auto rounding = [](double a, double b) { return kRounding * (std::abs(a) + std::abs(b)); };
  for (int axis = 0; axis < 3; ++axis) {
    const double o = beam.origin[axis];
    const double d = beam.direction[axis];
    const double high = box.max()[axis];
    const double low = box.min()[axis];
    restrict_to(d - beam.spread, high - o + beam.radius + rounding(high, o));
    restrict_to(-d - beam.spread, o - low + beam.radius + rounding(low, o));
  }
  return from <= to;
}

}  // namespace

DiscHierarchy::DiscHierarchy(const RenderCloud& cloud, double reach, Bound bound)
    : order_(cloud.size()) {
  std::iota(order_.begin(), order_.end(), 0U);
  if (!order_.empty()) build(cloud, reach, bound, 0, static_cast<std::uint32_t>(order_.size()));
}

DiscHierarchy::Box DiscHierarchy::bound_of(const RenderCloud& cloud, std::uint32_t i, double reach,
                                           Bound bound) {
  const double u = reach * cloud.deviation_u[i];
  const double v = cloud.anisotropic() ? reach * cloud.deviation_v[i] : u;
  const Vec3d n(cloud.normal_x[i], cloud.normal_y[i], cloud.normal_z[i]);
  Vec3d half;
  if (bound == Bound::kBall || n.isZero()) {
    half.setConstant(std::max(u, v));
  } else if (cloud.anisotropic()) {
    // The ellipse u cos(a) t + v sin(a) b reaches sqrt((u t_i)^2 + (v b_i)^2) along axis i.
    const Vec3d t(cloud.tangent_x[i], cloud.tangent_y[i], cloud.tangent_z[i]);
    half = ((u * t).cwiseAbs2() + (v * n.cross(t)).cwiseAbs2()).cwiseSqrt();
  } else {
    // With t_i^2 + b_i^2 + n_i^2 = 1.
    half = u * (1 - n.array().square()).cwiseMax(0).sqrt().matrix();
  }
  // Normals and tangents are unit and perpendicular to single precision only.
  half.array() += 1e-6 * std::max(u, v);
  const Vec3d center = center_of(cloud, i);
  return {Vec3d(center - half), Vec3d(center + half)};
}

void DiscHierarchy::build(const RenderCloud& cloud, double reach, Bound bound, std::uint32_t begin,
                          std::uint32_t end) {
  const std::size_t at = nodes_.size();
  nodes_.push_back({Box(), begin, end, 0});
  if (end - begin <= kLeafSize) {
    for (std::uint32_t k = begin; k < end; ++k) {
      nodes_[at].box.extend(bound_of(cloud, order_[k], reach, bound));
    }
    return;
  }
  Box centers;
  for (std::uint32_t k = begin; k < end; ++k) centers.extend(center_of(cloud, order_[k]));
  int axis = 0;
  centers.sizes().maxCoeff(&axis);
  const Array<float>& coordinate = axis == 0 ? cloud.x : axis == 1 ? cloud.y : cloud.z;
  const std::uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](std::uint32_t a, std::uint32_t b) {
                     return std::pair(coordinate[a], a) < std::pair(coordinate[b], b);
                   });
  build(cloud, reach, bound, begin, middle);
  const std::size_t second = nodes_.size();
  build(cloud, reach, bound, middle, end);
  nodes_[at].second_child = static_cast<std::uint32_t>(second);
  nodes_[at].box = nodes_[at + 1].box.merged(nodes_[second].box);
}

void DiscHierarchy::for_each(const Beam& beam,
                             FunctionRef<void(std::uint32_t surfel)> visit) const {
  if (nodes_.empty()) return;
  // Halving 2^32 surfels ends after 32 levels; each leaves one node for later.
  std::array<std::uint32_t, 40> later;
  std::size_t count = 0;
  later[count++] = 0;
  while (count > 0) {
    const std::uint32_t at = later[--count];
    const Node& node = nodes_[at];
    if (!meets(beam, node.box)) continue;
    if (node.second_child == 0) {
      for (std::uint32_t k = node.begin; k < node.end; ++k) visit(order_[k]);
    } else {
      later[count++] = node.second_child;
      later[count++] = at + 1;
    }
  }
}

}  // namespace surfel
