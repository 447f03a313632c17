#pragma once

#include <cstddef>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// A box and the spacing that samples in it should not exceed.
struct SizingCell {
  Vec3f min;
  Vec3f max;
  float spacing;  ///< > 0, finite.
};

/// Spacing of samples as a function of the place: the largest function that exceeds no cell's
/// spacing inside the cell, nor changes by more than `gradient` over a distance of 1,
///   h(p) = min(largest, min_k h_k + gradient |p - cell k|),
/// so that neighbouring samples have similar sizes.
class SURFEL_API SizingField {
 public:
  /// One spacing everywhere.
  explicit SizingField(double spacing);
  /// \param cells     may overlap.
  /// \param gradient  >= 0.
  /// \param largest   > 0.
  SizingField(const std::vector<SizingCell>& cells, double gradient, double largest);

  double at(const Vec3f& p) const;
  double least() const { return least_; }
  double largest() const { return largest_; }
  double gradient() const { return gradient_; }

 private:
  /// Bounds of the cells [begin, end) of the tree's order; the halves of the range are its children
  /// 2 i + 1 and 2 i + 2. Cells overlap, and come from two octrees: a BoxTree (base/box_tree.h)
  /// over their Morton order makes adaptive sampling take twice as long.
  struct Node {
    Vec3f min;
    Vec3f max;
    float spacing;  ///< The least spacing of the cells.
  };

  void build(std::size_t node, std::size_t begin, std::size_t end);
  void lower(std::size_t node, std::size_t begin, std::size_t end, const Vec3f& p,
             double& spacing) const;
  double bound(const Node& cell, const Vec3f& p) const;

  double least_;
  double largest_;
  double gradient_ = 0;
  std::vector<Node> cell_;  ///< Cells in the tree's order.
  std::vector<Node> tree_;
};

}  // namespace surfel
