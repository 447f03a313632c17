#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

/// Points in Morton order, cut into the largest dyadic boxes (cells of the Morton grid, or halves
/// or quarters of cells) that hold no more than 16 distinct positions. Boxes are gathered into
/// nodes by the same rule. So the tree follows the density by itself; where more than 16 positions
/// share a cell of the Morton grid (a cluster in a huge extent) a finer grid divides the cell.
/// About 40 bytes a point.
///
/// Points that coincide are one entry, a place: however many there are, a search visits them once.
///
/// Why this is no general tree over boxes, nor a library's: searches for k neighbours of all points
/// spend their time in leaves, which are SIMD vectors of 16 points here, and in telling which of 16
/// children are near, which is one comparison of vectors. A binary tree is four times as deep;
/// FLANN's takes 5.5 to 7 times as long (docs/speed.md).
class PointTree {
 public:
  static constexpr std::size_t kWidth = 16;  ///< Floats of the widest vectors.

  /// Places of a leaf, in columns. Unused entries are NaN: no comparison with their distance holds.
  struct alignas(64) Leaf {
    float x[kWidth], y[kWidth], z[kWidth];
    std::uint32_t index[kWidth];  ///< Least index of the points at the place.
  };

  /// Tight boxes of up to 16 children, in columns. Children of the lowest level are leaves,
  /// children of other levels are nodes of the level below.
  struct alignas(64) Node {
    float low[3][kWidth], high[3][kWidth];
    std::uint32_t first_child = 0;
    std::uint32_t children = 0;
  };

  /// `points` are finite.
  explicit PointTree(const Array<Vec3f>& points);

  std::size_t size() const { return member_.size(); }
  std::size_t places() const { return first_.size() - 1; }
  std::size_t leaves() const { return leaf_.size(); }
  /// Number of levels, 0 without points; the last level is the root alone.
  std::size_t levels() const { return level_.size(); }
  const Leaf& leaf(std::size_t i) const { return leaf_[i]; }
  const Node& node(std::size_t level, std::size_t i) const { return level_[level][i]; }

  /// Places of a leaf, in the order of its entries.
  std::size_t first_place(std::size_t leaf) const { return leaf_place_[leaf]; }
  std::size_t leaf_size(std::size_t leaf) const {
    return leaf_place_[leaf + 1] - leaf_place_[leaf];
  }
  /// The points at a place, ascending.
  std::span<const std::uint32_t> at(std::size_t place) const {
    return {member_.data() + first_[place], member_.data() + first_[place + 1]};
  }
  /// The place whose first point is `index`. Only to be called if some points coincide.
  std::size_t place_of(std::uint32_t index) const { return place_of_[index]; }

 private:
  void cut_leaves(std::span<const Vec3f> place, std::size_t begin,
                  std::span<const std::uint64_t> code);
  void fill_leaves(std::span<const Vec3f> place);
  void add_levels(std::vector<std::uint64_t> code);

  Array<std::uint32_t> member_;            ///< Points by place, ascending within each.
  Array<std::uint32_t> first_;             ///< Place to its first entry of `member_`; one more.
  Array<std::uint32_t> place_of_;          ///< Place of every point; empty if no two coincide.
  std::vector<std::uint32_t> leaf_place_;  ///< Leaf to its first place; one more.
  Array<Leaf> leaf_;
  std::vector<Array<Node>> level_;
};

}  // namespace surfel
