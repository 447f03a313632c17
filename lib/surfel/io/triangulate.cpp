// Meisters, "Polygons have ears", 1975.

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <numeric>
#include <tuple>

#include <surfel/base/box_tree.h>
#include <surfel/base/morton.h>
#include <surfel/io/triangulate.h>

namespace surfel {
namespace {

double cross(const Vec2d& a, const Vec2d& b, const Vec2d& c) {
  return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
}

/// The polygon in the coordinate plane that it faces most, counter-clockwise.
std::vector<Vec2d> project(std::span<const Vec3d> corners) {
  Vec3d normal = Vec3d::Zero();
  const Vec3d& base = corners[0];
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    normal += (corners[i] - base).cross(corners[i + 1] - base);
  }
  Eigen::Index axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  Eigen::Index u = (axis + 1) % 3;
  Eigen::Index v = (axis + 2) % 3;
  if (normal[axis] < 0) std::swap(u, v);
  std::vector<Vec2d> flat;
  flat.reserve(corners.size());
  for (const Vec3d& p : corners) flat.emplace_back(p[u] - base[u], p[v] - base[v]);
  return flat;
}

/// Convex at every corner, and once around: a pentagram turns twice.
bool is_convex(const std::vector<Vec2d>& p) {
  const std::size_t n = p.size();
  int descents = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const Vec2d& a = p[i];
    const Vec2d& b = p[(i + 1) % n];
    const Vec2d& c = p[(i + 2) % n];
    if (cross(a, b, c) <= 0) return false;
    descents += b.y() < a.y() && c.y() >= b.y();
  }
  return descents == 1;
}

/// Bounds of points.
struct FlatBox {
  Vec2d low = Vec2d::Constant(std::numeric_limits<double>::infinity());
  Vec2d high = Vec2d::Constant(-std::numeric_limits<double>::infinity());

  void add(const FlatBox& other) {
    low = low.cwiseMin(other.low);
    high = high.cwiseMax(other.high);
  }
  double squared_distance(const Vec2d& p) const {
    return (low - p).cwiseMax(p - high).cwiseMax(0).squaredNorm();
  }
};

/// A triangle that is asked for points in it or on it.
struct FlatTriangle {
  Vec2d a, b, c;

  bool holds(const Vec2d& q) const {
    return cross(a, b, q) >= 0 && cross(b, c, q) >= 0 && cross(c, a, q) >= 0;
  }
  bool has_corner(const Vec2d& q) const { return q == a || q == b || q == c; }
  /// False only if no point of the box is in the triangle: all of the box lies beyond a side of
  /// the triangle, or the triangle beyond one of the box. Products and differences are rounded
  /// monotonically, so that no point of the box has a larger cross() than its outermost corner.
  bool meets(const FlatBox& box) const {
    const auto beyond = [&](const Vec2d& from, const Vec2d& to) {
      return cross(from, to,
                   {to.y() > from.y() ? box.low.x() : box.high.x(),
                    to.x() > from.x() ? box.high.y() : box.low.y()}) < 0;
    };
    const Vec2d low = a.cwiseMin(b).cwiseMin(c);
    const Vec2d high = a.cwiseMax(b).cwiseMax(c);
    return (low.array() <= box.high.array()).all() && (high.array() >= box.low.array()).all() &&
           !beyond(a, b) && !beyond(b, c) && !beyond(c, a);
  }
};

/// The places of corners that may lie in an ear, from which corners are removed one by one. Corners
/// at one place count as one: thousands of bridges may start there.
class CornerPlaces {
 public:
  CornerPlaces(const std::vector<Vec2d>& points, std::vector<std::uint32_t> corners)
      : corner_(std::move(corners)), place_of_(points.size(), kNoPlace) {
    if (corner_.size() > kScanned) sort(points);
    place_.reserve(corner_.size());
    for (const std::uint32_t i : corner_) {
      if (place_.empty() || place_.back().point != points[i]) place_.push_back({points[i], 0});
      place_of_[i] = static_cast<std::uint32_t>(place_.size() - 1);
      ++place_.back().corners;
    }
    if (corner_.size() > kScanned) {
      tree_ = Tree(place_.size(), [&](std::size_t k) {
        return FlatBox{place_[k].point, place_[k].point};
      });
      live_below_.assign(tree_.node_count(), 0);
      for (std::size_t k = 0; k < place_.size(); ++k) {
        tree_.for_each_node_above(k, [&](std::size_t node) { ++live_below_[node]; });
      }
    }
  }

  bool holds(std::uint32_t corner) const { return place_of_[corner] != kNoPlace; }

  void remove(std::uint32_t corner) {
    const std::uint32_t k = std::exchange(place_of_[corner], kNoPlace);
    if (--place_[k].corners == 0 && !live_below_.empty()) {
      tree_.for_each_node_above(k, [&](std::size_t node) { --live_below_[node]; });
    }
  }

  /// Is any place in the triangle or on its sides, other than at its corners? Adds the number of
  /// places and nodes looked at to `steps`.
  bool any_in(const FlatTriangle& triangle, std::uint64_t& steps) const {
    bool found = false;
    const auto visit = [&](std::size_t k) {
      ++steps;
      const Place& place = place_[k];
      found = found || (place.corners > 0 && !triangle.has_corner(place.point) &&
                        triangle.holds(place.point));
    };
    if (live_below_.empty()) {
      for (std::size_t k = 0; k < place_.size() && !found; ++k) visit(k);
      return found;
    }
    tree_.search([&](const FlatBox& box) { return box.squared_distance(triangle.b); },
                 [&](const FlatBox& box, std::size_t node, double) {
                   ++steps;
                   return !found && live_below_[node] > 0 && triangle.meets(box);
                 },
                 visit);
    return found;
  }

 private:
  struct Place {
    Vec2d point;
    std::uint32_t corners;  ///< Corners left there.
  };
  using Tree = BoxTree<FlatBox, 8, 4>;
  static constexpr std::size_t kScanned = 40;  ///< So many are looked at sooner than sorted.
  static constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();

  /// Along a Morton curve, corners at one place side by side.
  void sort(const std::vector<Vec2d>& points) {
    FlatBox box;
    for (const std::uint32_t i : corner_) box.add({points[i], points[i]});
    constexpr double kCells = (1 << 21) - 1;
    const Vec2d cells = (box.high - box.low).unaryExpr([](double extent) {
      return extent > 0 ? kCells / extent : 0;
    });
    std::vector<std::tuple<std::uint64_t, double, double, std::uint32_t>> keys;
    keys.reserve(corner_.size());
    for (const std::uint32_t i : corner_) {
      const Vec2d cell = (points[i] - box.low).cwiseProduct(cells);
      const std::uint64_t key = morton_code(static_cast<std::uint32_t>(cell.x()),
                                            static_cast<std::uint32_t>(cell.y()), 0);
      keys.emplace_back(key, points[i].x(), points[i].y(), i);
    }
    std::sort(keys.begin(), keys.end());
    std::transform(keys.begin(), keys.end(), corner_.begin(),
                   [](const auto& key) { return std::get<3>(key); });
  }

  std::vector<std::uint32_t> corner_;
  std::vector<std::uint32_t> place_of_;  ///< Per corner of the polygon.
  std::vector<Place> place_;
  Tree tree_;                              ///< Over the places, unless they are few.
  std::vector<std::uint32_t> live_below_;  ///< Places with corners left below each node.
};

class EarClipper {
 public:
  explicit EarClipper(const std::vector<Vec2d>& points)
      : p_(points),
        count_(static_cast<std::uint32_t>(points.size())),
        previous_(count_),
        next_(count_),
        state_(count_, kQueued),
        reflex_(points, linked_reflex_corners()),
        queue_(next_) {}

  void clip(std::vector<std::array<std::uint32_t, 3>>& triangles) {
    for (std::uint32_t left = count_; left > 2; --left) {
      const std::uint32_t i = next_to_cut();
      const std::uint32_t before = previous_[i];
      const std::uint32_t after = next_[i];
      triangles.push_back({before, i, after});
      next_[before] = after;
      previous_[after] = before;
      state_[i] = kCut;
      any_ = after;
      if (reflex_.holds(i)) reflex_.remove(i);
      // Cutting an ear never makes another corner reflex, but may make its neighbours convex.
      for (const std::uint32_t k : {before, after}) {
        if (reflex_.holds(k) && turn(k) > 0) reflex_.remove(k);
        if (state_[k] != kQueued) queue_.push_back(k);
        state_[k] = kQueued;
      }
    }
  }

 private:
  enum State : std::uint8_t { kQueued, kTested, kCut };
  /// Steps of searching that a polygon may take for each of its corners: eight times what stars of
  /// 100,000 corners with random radii take, whose ears are long and thin.
  static constexpr std::uint64_t kStepsPerCorner = 1 << 12;
  /// Blocked corners that are asked again for each ear that was cut since they were asked.
  static constexpr std::size_t kAgain = 8;

  double turn(std::uint32_t i) const { return cross(p_[previous_[i]], p_[i], p_[next_[i]]); }

  /// Links the corners to a ring, and returns those that are not convex.
  std::vector<std::uint32_t> linked_reflex_corners() {
    std::iota(next_.begin(), next_.end() - 1, 1U);
    std::iota(previous_.begin() + 1, previous_.end(), 0U);
    previous_[0] = count_ - 1;
    std::vector<std::uint32_t> reflex;
    for (std::uint32_t i = 0; i < count_; ++i) {
      if (turn(i) <= 0) reflex.push_back(i);
    }
    return reflex;
  }

  /// No other corner lies in or on the triangle of a convex corner. Reflex ones suffice to look at;
  /// one at the place of one of the three is the other side of a bridge.
  bool is_free(std::uint32_t i) {
    return !reflex_.any_in({p_[previous_[i]], p_[i], p_[next_[i]]}, steps_);
  }

  /// Neighbours at one place, or a corner at the place of a neighbour: what is cut off has no area,
  /// and the rest has the same outline.
  bool is_spike(std::uint32_t i) const {
    const Vec2d& a = p_[previous_[i]];
    const Vec2d& c = p_[next_[i]];
    return a == c || p_[i] == a || p_[i] == c;
  }

  /// An ear, as long as there is one. A corner is asked once, and again after its neighbours
  /// changed: in a simple polygon that is the only thing that makes it an ear. In one that touches
  /// or crosses itself those that were blocked are asked again, as long as the steps last. Of a
  /// polygon without ears a convex corner is cut, or else any.
  std::uint32_t next_to_cut() {
    const bool may_search = steps_ < kStepsPerCorner * count_;
    for (;;) {
      while (asked_ < queue_.size()) {
        const std::uint32_t i = queue_[asked_++];
        if (state_[i] == kCut) continue;
        state_[i] = kTested;
        const double area = turn(i);
        if (area < 0 || (area == 0 && !is_spike(i))) continue;
        if (area == 0 || (may_search && is_free(i))) {
          ++new_ears_;
          return i;
        }
        blocked_.push_back(i);
      }
      queue_.clear();
      asked_ = 0;
      if (!may_search || new_ears_ == 0 || kAgain * new_ears_ < blocked_.size()) break;
      new_ears_ = 0;
      for (const std::uint32_t i : blocked_) {
        if (state_[i] == kTested) queue_.push_back(i);
        if (state_[i] == kTested) state_[i] = kQueued;
      }
      blocked_.clear();
    }
    while (!blocked_.empty()) {
      const std::uint32_t i = blocked_.back();
      blocked_.pop_back();
      if (state_[i] != kCut && turn(i) > 0) return i;
    }
    return any_;
  }

  const std::vector<Vec2d>& p_;
  std::uint32_t count_;
  std::vector<std::uint32_t> previous_;
  std::vector<std::uint32_t> next_;
  std::vector<State> state_;
  CornerPlaces reflex_;
  std::vector<std::uint32_t> queue_;    ///< Corners to ask, in this order.
  std::size_t asked_ = 0;               ///< Corners of the queue that were asked.
  std::vector<std::uint32_t> blocked_;  ///< Convex corners that were asked and are no ears.
  std::size_t new_ears_ = 0;            ///< Ears cut since all blocked corners were asked.
  std::uint32_t any_ = 0;               ///< A corner that is left.
  std::uint64_t steps_ = 0;
};

}  // namespace

void triangulate_polygon(std::span<const Vec3d> corners,
                         std::vector<std::array<std::uint32_t, 3>>& triangles) {
  const auto n = static_cast<std::uint32_t>(corners.size());
  const std::vector<Vec2d> flat = project(corners);
  if (is_convex(flat)) {
    for (std::uint32_t i = 1; i + 1 < n; ++i) triangles.push_back({0, i, i + 1});
  } else {
    EarClipper(flat).clip(triangles);
  }
}

}  // namespace surfel
