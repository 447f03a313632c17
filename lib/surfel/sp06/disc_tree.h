#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Splats as discs, in the order of a space-filling curve; of discs at one place the larger come
/// first.
struct SURFEL_API Discs {
  Array<Vec3f> center;          ///< Scene units, relative to the cloud's origin.
  Array<Vec3f> normal;          ///< Unit.
  Array<float> radius;          ///< sqrt(2 cutoff max variance), > 0, scene units.
  Array<std::uint32_t> surfel;  ///< Index into the cloud.

  std::size_t size() const { return center.size(); }
  /// The discs which[0], which[1], ...; ascending indices keep the order.
  Discs gathered(std::span<const std::uint32_t> which) const;
};

/// The splats that have a disc: finite position, known normal, finite variance above zero. Throws
/// Error(kInput) if the cloud, `name`, has no normals or no variances.
SURFEL_API Discs make_discs(const SurfelCloud& cloud, double cutoff,
                            const std::string& name = "surfels");

/// Indices of the discs that do not lie at the same place and on the same sheet as an earlier one,
/// which is as large at least and covers them.
SURFEL_API Array<std::uint32_t> distinct_discs(const Discs& discs);

/// Tangent plane of a disc, and what other discs are to it.
class SURFEL_API TangentPlane {
 public:
  TangentPlane(const Discs& discs, std::size_t disc);
  /// Place of a disc in the plane, at its true distance: the neighbour's direction is projected,
  /// its distance kept, so that on a sphere, where the plane foreshortens, half the distance is
  /// where discs of one size meet. False if it lies on another sheet: facing the other way or
  /// further from the plane than along it.
  bool unfold(const Vec3f& center, const Vec3f& normal, Vec2d& place) const {
    if (!(normal_.dot(normal) > 0)) return false;
    const Vec3d offset = (center - center_).cast<double>();
    const Vec2d flat(offset.dot(a_), offset.dot(b_));
    const double flat2 = flat.squaredNorm();
    const double distance2 = offset.squaredNorm();
    // Height^2 = distance^2 - flat^2.
    if (distance2 > 2 * flat2) return false;
    place = flat2 > 0 ? Vec2d(flat * std::sqrt(distance2 / flat2)) : flat;
    return true;
  }

 private:
  Vec3f center_, normal_;
  Vec3d a_, b_;  ///< Unit, with the normal a right-handed frame.
};

/// Hierarchy of boxes over discs that are in the order of a space-filling curve: four to a leaf,
/// two children to a node, whatever their density. Made in a pass, 16 bytes a disc.
class SURFEL_API DiscTree {
 public:
  static constexpr std::size_t kLeafSize = 4;

  struct Node {
    /// Box of the centres; the fourth components are 0 and the largest radius, so that distances
    /// are taken four values at a time.
    Eigen::Vector4f low, high;

    float radius() const { return high[3]; }
    /// Squared distance of a place (x, y, z, 0) from the box.
    float distance2(const Eigen::Vector4f& p) const {
      return (low - p).cwiseMax(p - high).cwiseMax(Eigen::Vector4f::Zero()).squaredNorm();
    }
  };

  explicit DiscTree(const Discs& discs);

  /// Nodes are numbered level by level, leaves first: leaf l holds the discs 4 l to 4 l + 3.
  std::size_t node_count() const { return nodes_.size(); }
  /// Calls body(node) for the leaf that holds a disc, its parent, and so on up to the root.
  template <class Body>
  void for_each_node_above(std::size_t disc, Body body) const {
    std::size_t place = disc / kLeafSize;
    for (std::size_t level = 0; level < levels(); ++level, place /= 2) {
      body(level_begin_[level] + place);
    }
  }

  /// Calls visit(disc) for all discs of the nodes for which enter(node, number, distance2) holds,
  /// all the way from the root, nearest boxes first; enter() may refuse more as the search goes on.
  /// `distance2` is that of the box from `from`, squared.
  template <class Enter, class Visit>
  void search(const Vec3f& from, Enter enter, Visit visit) const {
    if (!nodes_.empty()) descend(levels() - 1, 0, from, enter, visit);
  }
  /// The same from the leaf of a disc on upwards: what is near comes first.
  template <class Enter, class Visit>
  void search_around(std::size_t disc, const Vec3f& from, Enter enter, Visit visit) const {
    std::size_t place = disc / kLeafSize;
    visit_leaf(place, visit);
    for (std::size_t level = 0; level + 1 < levels(); ++level, place /= 2) {
      const std::size_t sibling = place ^ 1U;
      if (sibling < level_size(level)) descend(level, sibling, from, enter, visit);
    }
  }

 private:
  struct Entry {
    std::size_t level, place;
    float distance2;
  };
  std::size_t levels() const { return level_begin_.size() - 1; }
  std::size_t level_size(std::size_t level) const {
    return level_begin_[level + 1] - level_begin_[level];
  }
  template <class Visit>
  void visit_leaf(std::size_t leaf, Visit& visit) const {
    const std::size_t end = std::min(size_, (leaf + 1) * kLeafSize);
    for (std::size_t i = leaf * kLeafSize; i < end; ++i) visit(i);
  }
  template <class Enter, class Visit>
  void descend(std::size_t level, std::size_t place, const Vec3f& from, Enter& enter,
               Visit& visit) const {
    // A path leaves one sibling a level: 2^32 discs have 30 levels.
    std::array<Entry, 64> stack;
    std::size_t depth = 0;
    const Eigen::Vector4f place4(from.x(), from.y(), from.z(), 0);
    const auto entry = [&](std::size_t l, std::size_t p) {
      return Entry{l, p, nodes_[level_begin_[l] + p].distance2(place4)};
    };
    stack[depth++] = entry(level, place);
    while (depth > 0) {
      const Entry at = stack[--depth];
      const std::size_t number = level_begin_[at.level] + at.place;
      if (!enter(nodes_[number], number, at.distance2)) continue;
      if (at.level == 0) {
        visit_leaf(at.place, visit);
        continue;
      }
      Entry near = entry(at.level - 1, 2 * at.place);
      if (2 * at.place + 1 < level_size(at.level - 1)) {
        Entry far = entry(at.level - 1, 2 * at.place + 1);
        if (far.distance2 < near.distance2) std::swap(near, far);
        stack[depth++] = far;
      }
      stack[depth++] = near;
    }
  }

  std::size_t size_;
  Array<Node> nodes_;
  std::vector<std::size_t> level_begin_;  ///< Of every level, leaves first, and the end.
};

}  // namespace surfel
