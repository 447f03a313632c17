#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/sp06/disc_tree.h>
#include <surfel/surface/voronoi_cell.h>

namespace surfel {

/// The surface that a cloud's discs stand for: their union, sheet by sheet.
class SURFEL_API DiscSurface {
 public:
  /// `discs` may hold several at one place; O(n log n) in practice, twice as long with the area.
  DiscSurface(const Discs& discs, bool with_area);

  /// Area of the union of the discs, unit^2: SP06 (7) over all points. 0 if it was not asked for.
  double area() const { return area_; }
  /// Discs that do not cover their own Voronoi cell: the surface ends at them, or has a hole.
  std::size_t border_count() const { return border_.size(); }

  /// What restrict_cell() has done to a cell.
  struct Restriction {
    bool cut = false;  ///< Whether the surface ends within the cell.
    double reach = 0;  ///< Largest distance of the surface from the disc's centre, scene units.
  };
  /// Whether a disc of this surface is to be covered by the cell.
  using Owns = FunctionRef<bool(const Discs& discs, std::size_t disc)>;
  /// Cuts from a cell, given in the tangent plane of a disc, the part beyond the surface: the reach
  /// in 16 directions is taken of the discs on the same sheet that touch the cell and that it owns,
  /// and the cell ends there.
  Restriction restrict_cell(const TangentPlane& plane, Owns owns, VoronoiCell& cell) const;
  /// May the surface end within the cell?
  bool may_end_in(const TangentPlane& plane, const VoronoiCell& cell) const;

 private:
  void find_border(bool with_area);

  Discs discs_;
  DiscTree tree_;
  Discs border_;
  std::optional<DiscTree> border_tree_;
  double area_ = 0;
};

/// Voronoi cells of a group's discs in their tangent planes, restricted to the surface. Cells whose
/// neighbours lie on other sheets are not cut by them; where the group has no neighbour left, at a
/// border, a cell ends where the discs of the whole cloud end (DiscSurface). Discs that are wholly
/// nearer to another splat of the group on their own sheet do not count there: a splat that is
/// askew to the surface would see far parts of the surface in its plane. So a cell is bounded by
/// the surface's size. A disc covers its part of the surface if it covers its cell: the part of
/// disc i outside of its cell is what SP06 (7) has to subtract (`Clipped` as worded there would
/// subtract the lens of two discs twice), and for discs of one size the parts inside add up to the
/// area of the union. Where sizes differ the sum is a lower bound.
class SURFEL_API GroupCells {
 public:
  /// `discs`: of one group, no two at one place on one sheet (distinct_discs()).
  GroupCells(const Discs& discs, const DiscSurface& surface);

  std::size_t size() const { return count_; }
  /// Corners of the cell of a disc, counter-clockwise about it.
  std::span<const Vec2d> corners(std::size_t disc) const;
  /// Distance of the furthest corner: the radius with which the disc covers its cell.
  double reach(std::size_t disc) const { return reach_[disc]; }
  /// Sum of the cells' areas, unit^2.
  double area() const { return area_; }
  /// Cells that end at the surface's border.
  std::size_t restricted() const { return restricted_; }
  /// The discs' area within their own cells, unit^2; disc i has the radius factor * radius[i].
  double covered_area(std::span<const float> radius, double factor) const;

 private:
  static constexpr std::size_t kGrain = 256;
  /// Cells of kGrain discs.
  struct Chunk {
    std::vector<std::uint32_t> begin{0};
    Array<Vec2d> corners;
    double area = 0;
    std::size_t restricted = 0;
  };

  std::size_t count_;
  std::vector<Chunk> chunks_;
  Array<double> reach_;
  Array<double> inner_;  ///< Radius of the largest disc about the point within its cell.
  double area_ = 0;
  std::size_t restricted_ = 0;
};

}  // namespace surfel
