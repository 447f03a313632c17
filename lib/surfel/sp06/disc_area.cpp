#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/sp06/disc_area.h>

namespace surfel {
namespace {

double cross(const Vec2d& a, const Vec2d& b) { return a.x() * b.y() - a.y() * b.x(); }

double sector(const Vec2d& a, const Vec2d& b, double radius2) {
  return radius2 / 2 * portable::atan2(cross(a, b), a.dot(b));
}

/// Signed area of the disc within the triangle (0, a, b).
double disc_area_in_triangle(const Vec2d& a, const Vec2d& b, double radius2) {
  const Vec2d d = b - a;
  const double length2 = d.squaredNorm();
  if (!(length2 > 0)) return 0;
  // The side leaves and enters the circle where |a + t d| = radius.
  const double middle = -a.dot(d) / length2;
  const double height2 = (a + middle * d).squaredNorm();
  if (height2 >= radius2) return sector(a, b, radius2);
  const double half = std::sqrt((radius2 - height2) / length2);
  const double enter = middle - half;
  const double leave = middle + half;
  if (leave <= 0 || enter >= 1) return sector(a, b, radius2);
  const Vec2d p = enter > 0 ? Vec2d(a + enter * d) : a;
  const Vec2d q = leave < 1 ? Vec2d(a + leave * d) : b;
  double area = cross(p, q) / 2;
  if (enter > 0) area += sector(a, p, radius2);
  if (leave < 1) area += sector(q, b, radius2);
  return area;
}

}  // namespace

double disc_area_in_polygon(double radius, std::span<const Vec2d> polygon) {
  double area = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec2d& next = polygon[i + 1 < polygon.size() ? i + 1 : 0];
    area += disc_area_in_triangle(polygon[i], next, radius * radius);
  }
  return area;
}

double UncoveredDiscArea::operator()(const Circle& disc, std::span<const Circle> others) {
  // Relative to the disc, whose centre may be far from the origin.
  const Circle self{Vec2d(0, 0), disc.radius};
  near_.clear();
  hidden_.clear();
  for (const Circle& other : others) {
    const Circle circle{other.center - disc.center, other.radius};
    if (circle.center.norm() >= self.radius + circle.radius) continue;
    if (hide_inside(self, circle, true)) return 0;
    near_.push_back(circle);
  }
  double area = shown_arcs(self);
  // Discs are sorted from left to right, so that of many discs few are compared.
  std::stable_sort(near_.begin(), near_.end(),
                   [](const Circle& a, const Circle& b) { return a.center.x() < b.center.x(); });
  double largest = 0;
  for (const Circle& circle : near_) largest = std::max(largest, circle.radius);
  for (std::size_t i = 0; i < near_.size(); ++i) {
    hidden_.clear();
    bool shown = true;
    const double reach = near_[i].radius + largest;
    const double x = near_[i].center.x();
    // Of discs that coincide the first one bounds the open area.
    for (std::size_t k = i; k-- > 0 && shown && x - near_[k].center.x() < reach;) {
      shown = !hide_inside(near_[i], near_[k], true);
    }
    for (std::size_t k = i + 1; k < near_.size() && shown && near_[k].center.x() - x < reach; ++k) {
      shown = !hide_inside(near_[i], near_[k], false);
    }
    if (!shown) continue;
    // Only arcs within the disc bound its area: the rest of a circle is hidden.
    const double distance = near_[i].center.norm();
    if (distance + near_[i].radius > self.radius) {
      const double r = near_[i].radius;
      const double cosine =
          (distance * distance + r * r - self.radius * self.radius) / (2 * distance * r);
      const double half = portable::acos(std::clamp(cosine, -1.0, 1.0));
      const double inwards = portable::atan2(-near_[i].center.y(), -near_[i].center.x());
      hide(inwards + half, inwards + 2 * std::numbers::pi - half);
    }
    area -= shown_arcs(near_[i]);
  }
  return std::clamp(area, 0.0, std::numbers::pi * self.radius * self.radius);
}

void UncoveredDiscArea::hide(double begin, double end) {
  const double turn = std::floor(begin / (2 * std::numbers::pi)) * 2 * std::numbers::pi;
  begin -= turn;
  end -= turn;
  hidden_.push_back({begin, std::min(end, 2 * std::numbers::pi)});
  if (end > 2 * std::numbers::pi) hidden_.push_back({0, end - 2 * std::numbers::pi});
}

/// Hides the part of a circle that lies in another disc. Is that all of it?
bool UncoveredDiscArea::hide_inside(const Circle& circle, const Circle& other,
                                    bool other_wins_ties) {
  const Vec2d to_other = other.center - circle.center;
  const double distance = to_other.norm();
  if (distance == 0 && circle.radius == other.radius) return other_wins_ties;
  if (distance + circle.radius <= other.radius) return true;
  if (distance >= circle.radius + other.radius || distance + other.radius <= circle.radius) {
    return false;
  }
  const double cosine =
      (distance * distance + circle.radius * circle.radius - other.radius * other.radius) /
      (2 * distance * circle.radius);
  const double half = portable::acos(std::clamp(cosine, -1.0, 1.0));
  const double middle = portable::atan2(to_other.y(), to_other.x());
  hide(middle - half, middle + half);
  return false;
}

/// 1/2 of the integral of x dy - y dx along the arcs of a circle that are not hidden.
double UncoveredDiscArea::shown_arcs(const Circle& circle) {
  const auto arc = [&](double begin, double end) {
    const double r = circle.radius;
    return r / 2 *
           (r * (end - begin) + circle.center.x() * (portable::sin(end) - portable::sin(begin)) -
            circle.center.y() * (portable::cos(end) - portable::cos(begin)));
  };
  std::sort(hidden_.begin(), hidden_.end(),
            [](const Interval& a, const Interval& b) { return a.begin < b.begin; });
  double sum = 0;
  double at = 0;
  for (const Interval& interval : hidden_) {
    if (interval.begin > at) sum += arc(at, interval.begin);
    at = std::max(at, interval.end);
  }
  if (at < 2 * std::numbers::pi) sum += arc(at, 2 * std::numbers::pi);
  return sum;
}

}  // namespace surfel
