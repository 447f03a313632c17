#include <cmath>
#include <utility>

#include <surfel/measure/voronoi_cell.h>

namespace surfel {
namespace {

double cross(const Vec2d& a, const Vec2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// The part of a convex polygon that is no further from the origin than from `q`
/// (Sutherland and Hodgman 1974).
std::vector<Vec2d> clip_at_bisector(const std::vector<Vec2d>& polygon, const Vec2d& q) {
  const auto excess = [&](const Vec2d& p) { return p.dot(q) - q.squaredNorm() / 2; };
  std::vector<Vec2d> clipped;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec2d& a = polygon[i];
    const Vec2d& b = polygon[(i + 1) % polygon.size()];
    const double ea = excess(a);
    const double eb = excess(b);
    if (ea <= 0) clipped.push_back(a);
    if ((ea < 0 && eb > 0) || (ea > 0 && eb < 0))
      clipped.emplace_back(a + (b - a) * (ea / (ea - eb)));
  }
  return clipped;
}

}  // namespace

std::optional<std::vector<Vec2d>> voronoi_cell(const std::vector<Vec2d>& neighbors, double reach) {
  if (!(reach > 0)) return std::nullopt;
  std::vector<Vec2d> cell = {{-reach, -reach}, {reach, -reach}, {reach, reach}, {-reach, reach}};
  for (const Vec2d& q : neighbors) {
    if (q.squaredNorm() > 0) cell = clip_at_bisector(cell, q);
  }
  for (const Vec2d& corner : cell) {
    if (corner.norm() > reach / 2) return std::nullopt;
  }
  if (cell.size() < 3) return std::nullopt;
  return cell;
}

double polygon_area(const std::vector<Vec2d>& corners) {
  double twice = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    twice += cross(corners[i], corners[(i + 1) % corners.size()]);
  }
  return twice / 2;
}

Vec2d polygon_point(const std::vector<Vec2d>& corners, double s, double t) {
  // s picks a triangle of the fan by area, and what is left of it the place in the triangle.
  double rest = s * polygon_area(corners);
  std::size_t i = 1;
  double area = 0;
  for (; i + 1 < corners.size(); ++i) {
    area = cross(corners[i] - corners[0], corners[i + 1] - corners[0]) / 2;
    if (rest < area || i + 2 == corners.size()) break;
    rest -= area;
  }
  const double u = std::sqrt(area > 0 ? std::min(1.0, rest / area) : 0);
  return corners[0] + u * ((1 - t) * (corners[i] - corners[0]) + t * (corners[i + 1] - corners[0]));
}

}  // namespace surfel
