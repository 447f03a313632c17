#include <algorithm>
#include <cmath>

#include <surfel/estimate/voronoi_cell.h>

namespace surfel {
namespace {

double cross(const Vec2d& a, const Vec2d& b) { return a.x() * b.y() - a.y() * b.x(); }

}  // namespace

void VoronoiCell::reset(double half_side) {
  const double h = half_side;
  corners_ = {{-h, -h}, {h, -h}, {h, h}, {-h, h}};
}

void VoronoiCell::cut(const Vec2d& neighbor) {
  const double half2 = neighbor.squaredNorm() / 2;
  if (half2 == 0) return;
  const auto excess = [&](const Vec2d& p) { return p.dot(neighbor) - half2; };
  if (std::all_of(corners_.begin(), corners_.end(), [&](const Vec2d& p) { return excess(p) <= 0; }))
    return;
  other_.clear();
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const Vec2d& a = corners_[i];
    const Vec2d& b = corners_[i + 1 < corners_.size() ? i + 1 : 0];
    const double ea = excess(a);
    const double eb = excess(b);
    if (ea <= 0) other_.push_back(a);
    if ((ea < 0 && eb > 0) || (ea > 0 && eb < 0))
      other_.emplace_back(a + (b - a) * (ea / (ea - eb)));
  }
  corners_.swap(other_);
}

double VoronoiCell::radius() const {
  double most2 = 0;
  for (const Vec2d& corner : corners_) most2 = std::max(most2, corner.squaredNorm());
  return std::sqrt(most2);
}

double VoronoiCell::area() const {
  double twice = 0;
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    twice += cross(corners_[i], corners_[i + 1 < corners_.size() ? i + 1 : 0]);
  }
  return twice / 2;
}

Eigen::Matrix2d VoronoiCell::moments() const {
  // Of a triangle (0, a, b): cross(a, b) / 24 times the sum over its corners' products.
  Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const Vec2d& a = corners_[i];
    const Vec2d& b = corners_[i + 1 < corners_.size() ? i + 1 : 0];
    const Vec2d c = a + b;
    sum += cross(a, b) / 24 * (a * a.transpose() + b * b.transpose() + c * c.transpose());
  }
  return sum;
}

Vec2d VoronoiCell::point(double s, double t) const {
  // s picks a triangle of the fan by area, and what is left of it the place in the triangle.
  double rest = s * area();
  std::size_t i = 1;
  double triangle = 0;
  for (; i + 1 < corners_.size(); ++i) {
    triangle = cross(corners_[i] - corners_[0], corners_[i + 1] - corners_[0]) / 2;
    if (rest < triangle || i + 2 == corners_.size()) break;
    rest -= triangle;
  }
  const double u = std::sqrt(triangle > 0 ? std::min(1.0, rest / triangle) : 0);
  return corners_[0] +
         u * ((1 - t) * (corners_[i] - corners_[0]) + t * (corners_[i + 1] - corners_[0]));
}

}  // namespace surfel
