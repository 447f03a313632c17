#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// A thick half line: the balls around origin + t direction with the radius `radius` + t `spread`,
/// for all t >= 0. A ray is a beam without thickness, a pixel seen from the eye is a beam that
/// spreads.
struct Beam {
  Vec3d origin{0, 0, 0};  ///< Scene units, relative to the cloud's origin.
  Vec3d direction{0, 0, 1};
  double radius = 0;  ///< Scene units, >= 0.
  double spread = 0;  ///< Scene units per t, >= 0.
};

/// Bounding volume hierarchy over a cloud's discs: a binary tree of boxes parallel to the axes,
/// each split at the median of its discs' centres along the longest side. In double. Made once,
/// asked by any number of threads. Memory: some 40 bytes for each surfel. A BoxTree
/// (base/box_tree.h) takes longer: see lib/README.md.
class SURFEL_API DiscHierarchy {
 public:
  enum class Bound {
    kDisc,  ///< The disc itself; a ball where the normal is unknown, as it turns with the eye.
    kBall,  ///< The ball around the disc.
  };

  /// Discs are ellipses of `reach` standard deviations. Keeps no reference to the cloud.
  DiscHierarchy(const RenderCloud& cloud, double reach, Bound bound);

  /// Calls visit(surfel) once for every surfel whose bound meets the beam, and for some surfels
  /// whose bounds pass the beam closely, in an order that depends on the cloud alone.
  void for_each(const Beam& beam, FunctionRef<void(std::uint32_t surfel)> visit) const;

 private:
  using Box = Eigen::AlignedBox3d;
  /// A range of order_. Its first child is the next node.
  struct Node {
    Box box;
    std::uint32_t begin, end;
    std::uint32_t second_child;  ///< 0: a leaf.
  };
  static Box bound_of(const RenderCloud& cloud, std::uint32_t surfel, double reach, Bound bound);
  void build(const RenderCloud& cloud, double reach, Bound bound, std::uint32_t begin,
             std::uint32_t end);

  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;  ///< Depth first; the root comes first.
};

}  // namespace surfel
