#include <algorithm>
#include <limits>

#include <surfel/truth/disc_hierarchy.h>

namespace surfel {
namespace {

using Box = Eigen::AlignedBox3d;
using Bound = DiscHierarchy::Bound;

/// Whether the beam meets the box, rounded towards yes. Along each axis, the beam's ball at t is
/// within reach of a side of the box where a t <= b, with a = +-direction - spread: six half lines
/// of t that must have a point in common. (At the box's edges balls are taken for cubes.)
bool meets(const Beam& beam, double slack, const Eigen::AlignedBox3d& box) {
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
  for (int axis = 0; axis < 3; ++axis) {
    const double radius = beam.radius + slack;
    const double o = beam.origin[axis];
    const double d = beam.direction[axis];
    restrict_to(d - beam.spread, box.max()[axis] - o + radius);
    restrict_to(-d - beam.spread, o - box.min()[axis] + radius);
  }
  return from <= to;
}

Box bound_of(const RenderCloud& cloud, std::size_t i, double reach, Bound bound) {
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
  const Vec3d center(cloud.x[i], cloud.y[i], cloud.z[i]);
  return {Vec3d(center - half), Vec3d(center + half)};
}

}  // namespace

DiscHierarchy::DiscHierarchy(const RenderCloud& cloud, double reach, Bound bound)
    : tree_(cloud.size(), [&](std::size_t i) {
        Node node;
        node.add(bound_of(cloud, i, reach, bound));
        return node;
      }) {
  if (tree_.node_count() == 0) return;
  const Node& root = tree_.leaf(tree_.node_count() - 1);
  largest_coordinate_ = root.min().cwiseAbs().maxCoeff() + root.max().cwiseAbs().maxCoeff();
}

void DiscHierarchy::for_each(const Beam& beam,
                             FunctionRef<void(std::uint32_t surfel)> visit) const {
  // A beam from afar is rounded in units of its own coordinates.
  const double slack = 1e-14 * (beam.origin.cwiseAbs().maxCoeff() + largest_coordinate_);
  tree_.for_each_leaf([&](const Node& node) { return meets(beam, slack, node); },
                      [&](std::size_t leaf) {
                        tree_.for_each_item(leaf, [&](std::size_t item) {
                          visit(static_cast<std::uint32_t>(item));
                        });
                      });
}

}  // namespace surfel
