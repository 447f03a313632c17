#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include <surfel/base/box_tree.h>
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

/// Factor by which distances grow before boxes of discs are tested, in single precision.
inline constexpr double kBoxRounding = 1 + 1e-5;

/// The tangent plane of a disc, in which other discs are looked at.
class SURFEL_API TangentPlane {
 public:
  TangentPlane(const Discs& discs, std::size_t disc);
  const Vec3f& center() const { return center_; }
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

/// Box around discs' centres. The fourth components are 0 and the largest radius, so that distances
/// are taken four values at a time.
struct DiscBox {
  Eigen::Vector4f low = Eigen::Vector4f::Constant(std::numeric_limits<float>::max());
  Eigen::Vector4f high = Eigen::Vector4f::Constant(-std::numeric_limits<float>::max());

  float radius() const { return high[3]; }
  void add(const DiscBox& other) {
    low = low.cwiseMin(other.low);
    high = high.cwiseMax(other.high);
  }
  /// Squared distance of a place (x, y, z, 0) from the box.
  float distance2(const Eigen::Vector4f& p) const {
    return (low - p).cwiseMax(p - high).cwiseMax(Eigen::Vector4f::Zero()).squaredNorm();
  }
};

/// Finds discs near a place, whatever their density; takes 16 bytes a disc.
class SURFEL_API DiscTree {
 public:
  using Node = DiscBox;

  explicit DiscTree(const Discs& discs);

  std::size_t node_count() const { return tree_.node_count(); }
  /// BoxTree::for_each_node_above().
  template <class Body>
  void for_each_node_above(std::size_t disc, const Body& body) const {
    tree_.for_each_node_above(disc, body);
  }
  /// BoxTree::search() with the squared distances of the boxes from `from`:
  /// enter(node, number, distance2), visit(disc).
  template <class Enter, class Visit>
  void search(const Vec3f& from, const Enter& enter, const Visit& visit) const {
    tree_.search(Distance2(from), enter, visit);
  }
  /// BoxTree::search_around() with the squared distances of the boxes from `from`.
  template <class Enter, class Visit>
  void search_around(std::size_t disc, const Vec3f& from, const Enter& enter,
                     const Visit& visit) const {
    tree_.search_around(disc, Distance2(from), enter, visit);
  }

 private:
  /// Squared distance of boxes from a place.
  struct Distance2 {
    explicit Distance2(const Vec3f& from) : place(from.x(), from.y(), from.z(), 0) {}
    float operator()(const Node& node) const { return node.distance2(place); }
    Eigen::Vector4f place;
  };

  BoxTree<Node, 4, 2> tree_;
};

}  // namespace surfel
