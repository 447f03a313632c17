#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <surfel/base/box_tree.h>
#include <surfel/texture/surfel_basis.h>

namespace surfel {

/// A function takes part at most this many times its reach, squared, from the points' disc: as far
/// from its own centre as along the line of sight.
inline constexpr double kPlanarReach2 = 2;

/// Distance from its centre at which a function ends, scene units.
inline double reach_of(const SurfelBasis::Function& f, double cutoff) {
  return std::sqrt(2 * cutoff * std::max(f.variance_u, f.variance_v));
}

/// Finds the functions that reach a place, at a cost that follows their number, however much the
/// functions' sizes differ.
class ReachTree {
 public:
  /// \param cutoff  of the kernels; 0: only the positions count.
  ReachTree(const SurfelBasis& basis, double cutoff)
      : basis_(basis), cutoff_(cutoff), tree_(basis.size(), [&](std::size_t k) {
          const SurfelBasis::Function& f = basis.function[k];
          return Node{f.position, f.position, reach_of(f, cutoff)};
        }) {}

  /// Calls body(k) in ascending order for every function whose reach meets the ball.
  template <class Body>
  void meeting(const Vec3d& center, double radius, const Body& body) const {
    tree_.for_each_leaf([&](const Node& node) { return node.meets(center, radius); },
                        [&](std::size_t leaf) {
                          tree_.for_each_item(leaf, [&](std::size_t k) {
                            const SurfelBasis::Function& f = basis_.function[k];
                            const double limit = radius + reach_of(f, cutoff_);
                            const double distance2 = (f.position - center).squaredNorm();
                            if (distance2 <= limit * limit) body(k);
                          });
                        });
  }

 private:
  /// Box around functions' centres.
  struct Node {
    Vec3d min = Vec3d::Constant(HUGE_VAL);
    Vec3d max = Vec3d::Constant(-HUGE_VAL);
    double reach = 0;  ///< Largest.

    void add(const Node& other) {
      min = min.cwiseMin(other.min);
      max = max.cwiseMax(other.max);
      reach = std::max(reach, other.reach);
    }
    bool meets(const Vec3d& center, double radius) const {
      const double limit = radius + reach;
      const Vec3d nearest = center.cwiseMax(min).cwiseMin(max);
      return (nearest - center).squaredNorm() <= limit * limit;
    }
  };

  const SurfelBasis& basis_;
  double cutoff_;
  BoxTree<Node, 4, 4> tree_;
};

}  // namespace surfel
