#pragma once

#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

struct Circle {
  Vec2d center{0, 0};
  double radius = 0;  ///< >= 0.
};

/// Area of the disc of that radius about the origin within a convex polygon, counter-clockwise;
/// closed form, triangle by triangle.
SURFEL_API double disc_area_in_polygon(double radius, std::span<const Vec2d> polygon);

/// Area of a disc that no other disc covers; closed form, by Green's theorem along the arcs that
/// bound it. Keeps its memory: use one object a thread for many discs. O(n m log m) for n discs
/// that overlap the disc, m of which are not left or right of one another.
class SURFEL_API UncoveredDiscArea {
 public:
  double operator()(const Circle& disc, std::span<const Circle> others);

 private:
  struct Interval {
    double begin, end;  ///< Angles, 0 <= begin < end <= 2 pi.
  };
  void hide(double begin, double end);
  bool hide_inside(const Circle& circle, const Circle& other, bool other_wins_ties);
  double shown_arcs(const Circle& circle);

  std::vector<Circle> near_;
  std::vector<Interval> hidden_;
};

}  // namespace surfel
