#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/base/types.h>

namespace surfel {

/// Bounding volume hierarchy over items in the order of a space-filling curve: every kLeafSize
/// items that follow each other are a leaf, every kChildren nodes that follow each other have a
/// parent, up to the root. The shape depends on the number of items alone, so that no links are
/// stored. The items stay with the caller.
///
/// \tparam Node  what bounds items, a box and whatever else a search asks for; a Node() bounds
///               nothing, add(const Node&) extends it.
template <class Node, std::size_t kLeafSize, std::size_t kChildren>
class BoxTree {
 public:
  BoxTree() = default;
  /// \param items    Number of items, which node_of() knows by 0 to items - 1.
  /// \param node_of  node_of(item) is the Node that bounds the item alone; called by several
  ///                 threads.
  template <class NodeOf>
  BoxTree(std::size_t items, const NodeOf& node_of) : items_(items) {
    for (std::size_t count = leaf_count(); count > 0;
         count = count > 1 ? (count + kChildren - 1) / kChildren : 0) {
      level_begin_.push_back(level_begin_.back() + count);
    }
    nodes_.resize(level_begin_.back());
    for (std::size_t level = 0; level < levels(); ++level) {
      parallel_for(level_size(level), kGrain, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t place = begin; place < end; ++place) {
          Node node;
          if (level == 0) {
            for_each_item(place, [&](std::size_t item) { node.add(node_of(item)); });
          } else {
            for_each_child(level, place, [&](std::size_t child) {
              node.add(nodes_[level_begin_[level - 1] + child]);
            });
          }
          nodes_[level_begin_[level] + place] = node;
        }
      });
    }
  }

  /// Nodes are numbered level by level, leaves first.
  std::size_t node_count() const { return nodes_.size(); }
  std::size_t leaf_count() const { return (items_ + kLeafSize - 1) / kLeafSize; }
  const Node& leaf(std::size_t number) const { return nodes_[number]; }
  static std::size_t leaf_of(std::size_t item) { return item / kLeafSize; }
  std::size_t leaf_size(std::size_t leaf) const {
    return std::min(kLeafSize, items_ - leaf * kLeafSize);
  }
  /// Calls body(item) for the items of a leaf, ascending.
  template <class Body>
  void for_each_item(std::size_t leaf, const Body& body) const {
    const std::size_t end = std::min(items_, (leaf + 1) * kLeafSize);
    for (std::size_t item = leaf * kLeafSize; item < end; ++item) body(item);
  }

  /// Calls visit(leaf), ascending, for every leaf for which, and for all nodes above which,
  /// enter(node) holds.
  template <class Enter, class Visit>
  void for_each_leaf(const Enter& enter, const Visit& visit) const {
    if (levels() > 0) descend(levels() - 1, 0, enter, visit);
  }

  /// Calls body(number) for the node of the leaf that holds the item, its parent, and so on up to
  /// the root.
  template <class Body>
  void for_each_node_above(std::size_t item, const Body& body) const {
    std::size_t place = leaf_of(item);
    for (std::size_t level = 0; level < levels(); ++level, place /= kChildren) {
      body(level_begin_[level] + place);
    }
  }

  /// Calls visit(item) for the items of the leaves for which, and for all nodes above which,
  /// enter(node, number, distance) holds, where distance = distance_of(node). Of the children of a
  /// node the one of the least distance comes first, so that enter() can refuse more and more
  /// nodes as the search goes on.
  template <class DistanceOf, class Enter, class Visit>
  void search(const DistanceOf& distance_of, const Enter& enter, const Visit& visit) const {
    if (levels() > 0) search_below(levels() - 1, 0, distance_of, enter, visit);
  }

  /// Does what search() does, but starts with the items of the leaf that holds `item`, without
  /// asking enter(), and goes on with the leaf's siblings, its parent's siblings, and so on.
  template <class DistanceOf, class Enter, class Visit>
  void search_around(std::size_t item, const DistanceOf& distance_of, const Enter& enter,
                     const Visit& visit) const {
    std::size_t place = leaf_of(item);
    for_each_item(place, visit);
    for (std::size_t level = 0; level + 1 < levels(); ++level, place /= kChildren) {
      for_each_child(level + 1, place / kChildren, [&](std::size_t sibling) {
        if (sibling != place) search_below(level, sibling, distance_of, enter, visit);
      });
    }
  }

 private:
  /// Nodes of a level that one thread makes at a time: a few microseconds' work.
  static constexpr std::size_t kGrain = 1 << 12;
  /// Levels of a tree over as many items as std::size_t can count.
  static constexpr std::size_t kMostLevels = 64 / (std::bit_width(kChildren) - 1);

  std::size_t levels() const { return level_begin_.size() - 1; }
  std::size_t level_size(std::size_t level) const {
    return level_begin_[level + 1] - level_begin_[level];
  }
  /// Calls body(place) for the children of a node, which are nodes of the level below.
  template <class Body>
  void for_each_child(std::size_t level, std::size_t place, const Body& body) const {
    const std::size_t end = std::min(level_size(level - 1), (place + 1) * kChildren);
    for (std::size_t child = place * kChildren; child < end; ++child) body(child);
  }

  template <class Enter, class Visit>
  void descend(std::size_t level, std::size_t place, const Enter& enter, const Visit& visit) const {
    if (!enter(nodes_[level_begin_[level] + place])) return;
    if (level == 0) {
      visit(place);
    } else {
      for_each_child(level, place,
                     [&](std::size_t child) { descend(level - 1, child, enter, visit); });
    }
  }

  template <class DistanceOf, class Enter, class Visit>
  void search_below(std::size_t level, std::size_t place, const DistanceOf& distance_of,
                    const Enter& enter, const Visit& visit) const {
    using Distance = decltype(distance_of(nodes_[0]));
    struct Open {
      std::size_t level, place;
      Distance distance;
    };
    // The path to a node leaves its siblings open on every level.
    std::array<Open, (kChildren - 1) * kMostLevels + 1> open;
    std::size_t count = 0;
    open[count++] = {level, place, distance_of(nodes_[level_begin_[level] + place])};
    while (count > 0) {
      const Open at = open[--count];
      const std::size_t number = level_begin_[at.level] + at.place;
      if (!enter(nodes_[number], number, at.distance)) continue;
      if (at.level == 0) {
        for_each_item(at.place, visit);
        continue;
      }
      const std::size_t below = at.level - 1;
      const std::size_t begin = at.place * kChildren;
      const std::size_t first_open = count;
      // Sorted by descending distance: the last is taken next, of equals the lower one.
      for (std::size_t i = std::min(level_size(below), begin + kChildren); i-- > begin;) {
        const Open child{below, i, distance_of(nodes_[level_begin_[below] + i])};
        std::size_t slot = count++;
        for (; slot > first_open && open[slot - 1].distance < child.distance; --slot) {
          open[slot] = open[slot - 1];
        }
        open[slot] = child;
      }
    }
  }

  std::size_t items_ = 0;
  Array<Node> nodes_;
  std::vector<std::size_t> level_begin_{0};  ///< First node of every level, leaves first; the end.
};

}  // namespace surfel
