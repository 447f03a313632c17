#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

/// Points in Morton order, cut into the largest dyadic boxes (whatever their size and shape: a
/// cell, a half or a quarter of one) that hold no more than 16 distinct positions, and these boxes
/// into nodes by the same rule: a tree with 16 branches whose leaves are SIMD vectors. It follows
/// the density by itself; where more than 16 positions share a cell of the Morton grid (a cluster
/// in a huge extent) a finer grid divides that cell. About 40 bytes a point.
///
/// However many points coincide, they are one entry, a place, so that equal distances at which a
/// search would have to visit all of them do not arise.
class PointTree {
 public:
  static constexpr std::size_t kWidth = 16;

  /// Unused entries are NaN, whose distance compares below nothing.
  struct alignas(64) Leaf {
    float x[kWidth], y[kWidth], z[kWidth];
    std::uint32_t index[kWidth];  ///< Least index of the points at the place.
  };

  /// Tight boxes of the children: leaves at the lowest level, else nodes of the level below.
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
  /// 0 without points; the last level is the root alone.
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
  /// Of the first point of a place, that place. Only where some points coincide.
  std::size_t place_of(std::uint32_t index) const { return place_of_[index]; }

 private:
  void cut_leaves(std::span<const Vec3f> place, std::size_t begin,
                  std::span<const std::uint64_t> code);
  void fill_leaves(std::span<const Vec3f> place);
  void add_levels(std::vector<std::uint64_t> code);

  Array<std::uint32_t> member_;            ///< Points by place, ascending within each.
  Array<std::uint32_t> first_;             ///< Place to its first entry of `member_`; one more.
  Array<std::uint32_t> place_of_;          ///< By point; empty if no two coincide.
  std::vector<std::uint32_t> leaf_place_;  ///< Leaf to its first place; one more.
  Array<Leaf> leaf_;
  std::vector<Array<Node>> level_;
};

}  // namespace surfel
