#include <algorithm>
#include <cmath>

#include <surfel/surface/voronoi_cell.h>

namespace surfel {
namespace {

double cross(const Vec2d& a, const Vec2d& b) { return a.x() * b.y() - a.y() * b.x(); }

}  // namespace

void VoronoiCell::reset(double half_side) {
  const double h = half_side;
  corners_.resize(4);
  corners_[0] = {-h, -h};
  corners_[1] = {h, -h};
  corners_[2] = {h, h};
  corners_[3] = {-h, h};
  radius2_ = 2 * h * h;
}

bool VoronoiCell::cut(const Vec2d& neighbor) {
  const double half2 = neighbor.squaredNorm() / 2;
  if (half2 == 0) return false;
  const std::size_t n = corners_.size();
  // How far each corner is beyond the bisector.
  excess_.resize(n);
  double most = 0;
  for (std::size_t i = 0; i < n; ++i) {
    excess_[i] = corners_[i].dot(neighbor) - half2;
    most = std::max(most, excess_[i]);
  }
  if (most <= 0) return false;
  other_.resize(2 * n);  // A side gives two corners at most.
  std::size_t kept = 0;
  double radius2 = 0;
  const auto keep = [&](const Vec2d& corner) {
    other_[kept++] = corner;
    radius2 = std::max(radius2, corner.squaredNorm());
  };
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t next = i + 1 < n ? i + 1 : 0;
    const double ea = excess_[i];
    const double eb = excess_[next];
    if (ea <= 0) keep(corners_[i]);
    if ((ea < 0 && eb > 0) || (ea > 0 && eb < 0)) {
      keep(corners_[i] + (corners_[next] - corners_[i]) * (ea / (ea - eb)));
    }
  }
  other_.resize(kept);
  corners_.swap(other_);
  radius2_ = radius2;
  return true;
}

double VoronoiCell::area() const {
  double twice = 0;
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    twice += cross(corners_[i], corners_[i + 1 < corners_.size() ? i + 1 : 0]);
  }
  return twice / 2;
}

Mat2d VoronoiCell::moments() const {
  // A triangle (0, a, b) has the moments cross(a, b) / 24 (a a^T + b b^T + (a + b) (a + b)^T).
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
  // s picks a triangle of the fan by area; its remainder picks the place in the triangle.
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
