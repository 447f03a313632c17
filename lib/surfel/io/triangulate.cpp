#include <Eigen/Geometry>

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

class EarClipper {
 public:
  explicit EarClipper(const std::vector<Vec2d>& points)
      : p_(points), previous_(points.size()), next_(points.size()) {
    const auto n = static_cast<std::uint32_t>(p_.size());
    for (std::uint32_t i = 0; i < n; ++i) {
      previous_[i] = (i + n - 1) % n;
      next_[i] = (i + 1) % n;
    }
    for (std::uint32_t i = 0; i < n; ++i) {
      if (turn(i) <= 0) reflex_.push_back(i);
    }
  }

  void clip(std::vector<std::array<std::uint32_t, 3>>& triangles) {
    std::uint32_t at = 1;
    std::size_t since_last_ear = 0;
    for (std::size_t left = p_.size(); left > 2;) {
      // A whole round without an ear: the polygon crosses itself or what is left has no area.
      if (!is_ear(at) && ++since_last_ear <= left) {
        at = next_[at];
        continue;
      }
      triangles.push_back({previous_[at], at, next_[at]});
      next_[previous_[at]] = next_[at];
      previous_[next_[at]] = previous_[at];
      const std::uint32_t removed = at;
      at = next_[at];
      --left;
      since_last_ear = 0;
      // Cutting an ear never makes another corner reflex; those that it made convex leave the list.
      std::erase_if(reflex_, [&](std::uint32_t i) { return i == removed || turn(i) > 0; });
    }
  }

 private:
  double turn(std::uint32_t i) const { return cross(p_[previous_[i]], p_[i], p_[next_[i]]); }

  /// Convex, and no other corner lies in or on its triangle. Reflex ones suffice to look at; those
  /// at the place of one of the three are the other side of a bridge.
  bool is_ear(std::uint32_t i) const {
    const Vec2d& a = p_[previous_[i]];
    const Vec2d& b = p_[i];
    const Vec2d& c = p_[next_[i]];
    if (cross(a, b, c) <= 0) return false;
    for (const std::uint32_t k : reflex_) {
      const Vec2d& q = p_[k];
      if (q == a || q == b || q == c) continue;
      if (cross(a, b, q) >= 0 && cross(b, c, q) >= 0 && cross(c, a, q) >= 0) return false;
    }
    return true;
  }

  const std::vector<Vec2d>& p_;
  std::vector<std::uint32_t> previous_;
  std::vector<std::uint32_t> next_;
  std::vector<std::uint32_t> reflex_;
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
