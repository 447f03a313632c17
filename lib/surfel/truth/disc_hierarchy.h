#pragma once

#include <Eigen/Geometry>
#include <cstdint>

#include <surfel/base/box_tree.h>
#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// A thick half line: the balls around origin + t direction with the radius `radius` + t `spread`,
/// for all t >= 0. A ray is a beam without thickness, a pixel seen from the eye one that spreads.
struct Beam {
  Vec3d origin{0, 0, 0};  ///< Scene units, relative to the cloud's origin.
  Vec3d direction{0, 0, 1};
  double radius = 0;  ///< Scene units, >= 0.
  double spread = 0;  ///< Scene units per t, >= 0.
};

/// Boxes around a cloud's discs, in double, in a tree along the space-filling curve that orders the
/// cloud. Made once, asked by any number of threads. Memory: some 24 bytes for each surfel.
class SURFEL_API DiscHierarchy {
 public:
  enum class Bound {
    kDisc,  ///< The disc itself; a ball where the normal is unknown, as it turns with the eye.
    kBall,  ///< The ball around the disc.
  };

  /// Discs are ellipses of `reach` standard deviations. Keeps no reference to the cloud.
  DiscHierarchy(const RenderCloud& cloud, double reach, Bound bound);

  /// Calls visit(surfel) once for every surfel whose bound meets the beam, and for some others
  /// whose bounds are near, in an order that depends on the cloud alone.
  void for_each(const Beam& beam, FunctionRef<void(std::uint32_t surfel)> visit) const;

 private:
  struct Node : Eigen::AlignedBox3d {
    void add(const Eigen::AlignedBox3d& other) { extend(other); }
  };
  BoxTree<Node, 4, 2> tree_;
  double largest_coordinate_ = 0;  ///< Of the boxes' corners, their absolute value.
};

}  // namespace surfel
