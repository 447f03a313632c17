// Zhang, Pajarola 2006, Single-Pass Point Rendering and Transparent Shading, section 4.2.2 (SP06).

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/base/parallel.h>
#include <surfel/sp06/disc_area.h>
#include <surfel/sp06/group_cells.h>

namespace surfel {
namespace {

/// Directions in which the surface's reach is measured. A round border is overestimated by
/// 1 / cos(pi / 16), 2 %.
constexpr std::size_t kDirections = 16;
/// The square in which a disc of the whole cloud looks for its neighbours, in radii: it must hold
/// the disc, and nothing outside of the disc matters.
constexpr double kOwnSquare = 1.01;
/// Discs along the curve that are looked at first, either way.
constexpr std::size_t kAlongCurve = 6;
/// Cells whose corner is so many times further away, squared, than a corner of a disc of their area
/// are looked at closely; a regular hexagon has 1.2.
constexpr double kSlender = 2.5;

const std::array<Vec2d, kDirections>& directions() {
  static const std::array<Vec2d, kDirections> kUnit = [] {
    std::array<Vec2d, kDirections> unit;
    for (std::size_t k = 0; k < kDirections; ++k) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(k) / kDirections;
      unit[k] = {portable::cos(angle), portable::sin(angle)};
    }
    return unit;
  }();
  return kUnit;
}

/// Discs, and the tree that finds them.
struct FoundDiscs {
  const Discs& discs;
  const DiscTree& tree;
};

/// Cuts the Voronoi cell of a disc out of a square in its plane. Ends early where the cell is
/// within `enough` of the disc's centre.
void cut_cell(const FoundDiscs& all, std::size_t disc, const TangentPlane& plane, double half_side,
              double enough, VoronoiCell& cell) {
  const Discs& discs = all.discs;
  cell.reset(half_side);
  const double enough2 = enough * enough;
  // Bisectors beyond the cell's furthest corner cut nothing.
  const Vec3f& center = plane.center();
  const auto limit2 = [&] { return static_cast<float>(4 * kBoxRounding * cell.radius2()); };
  float reach2 = limit2();
  const auto enter = [&](const DiscTree::Node&, std::size_t, float distance2) {
    return distance2 <= reach2 && cell.radius2() > enough2;
  };
  const auto cut_by = [&](std::size_t j) {
    if ((discs.center[j] - center).squaredNorm() > reach2) return;
    Vec2d place;
    if (plane.unfold(discs.center[j], discs.normal[j], place) && cell.cut(place)) reach2 = limit2();
  };
  // The next discs along the curve come first: they close most cells, so that few boxes are opened.
  const std::size_t first = disc - std::min(disc, kAlongCurve);
  const std::size_t last = std::min(discs.size() - 1, disc + kAlongCurve);
  for (std::size_t step = 1; step <= kAlongCurve; ++step) {
    if (disc >= first + step) cut_by(disc - step);
    if (disc + step <= last) cut_by(disc + step);
  }
  all.tree.search_around(disc, center, enter, [&](std::size_t j) {
    if (j < first || j > last) cut_by(j);
  });
}

/// May the disc meet the cell? True for some that only come near a corner.
bool touches(const VoronoiCell& cell, const Vec2d& center, double radius) {
  const auto corners = cell.corners();
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Vec2d side = corners[i + 1 < corners.size() ? i + 1 : 0] - corners[i];
    const Vec2d outward(side.y(), -side.x());
    if (outward.dot(center - corners[i]) > radius * side.norm()) return false;
  }
  return true;
}

/// Calls visit(disc, place) for the discs on a plane's sheet that touch the cell, until it
/// returns false.
template <class Visit>
void for_each_touching(const FoundDiscs& all, const TangentPlane& plane, const VoronoiCell& cell,
                       Visit visit) {
  const Discs& discs = all.discs;
  const double cell_radius = cell.radius();
  bool more = true;
  const auto enter = [&](const DiscTree::Node& node, std::size_t, float distance2) {
    const double reach = cell_radius + static_cast<double>(node.radius());
    return more && static_cast<double>(distance2) <= kBoxRounding * reach * reach;
  };
  const auto try_visit = [&](std::size_t j) {
    Vec2d place;
    const auto radius = static_cast<double>(discs.radius[j]);
    if (more && plane.unfold(discs.center[j], discs.normal[j], place) &&
        touches(cell, place, radius)) {
      more = visit(j, place);
    }
  };
  all.tree.search(plane.center(), enter, try_visit);
}

/// Is disc j of the cloud not wholly nearer to another one of a group's discs, on its sheet, than
/// to disc i?
bool owns(const FoundDiscs& members, std::size_t i, const Discs& all, std::size_t j) {
  const Discs& group = members.discs;
  const Vec3f& center = all.center[j];
  const float closer = (group.center[i] - center).norm() - 2 * all.radius[j];
  if (closer <= 0) return true;
  const TangentPlane plane(all, j);
  bool found = false;
  const auto enter = [&](const DiscTree::Node&, std::size_t, float distance2) {
    return !found && distance2 < closer * closer;
  };
  members.tree.search(center, enter, [&](std::size_t m) {
    Vec2d place;
    found = found || (m != i && (group.center[m] - center).squaredNorm() < closer * closer &&
                      plane.unfold(group.center[m], group.normal[m], place));
  });
  return !found;
}

/// At a crease cells have spikes: the plane goes on where the surface turns away, and the
/// neighbours behind the crease bound it badly.
bool slender(const VoronoiCell& cell) {
  return std::numbers::pi * cell.radius2() > kSlender * cell.area();
}

/// Distance of the nearest side; 0 for a cell without area.
double inner_radius(const VoronoiCell& cell) {
  const auto corners = cell.corners();
  if (corners.size() < 3) return 0;
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Vec2d& a = corners[i];
    const Vec2d side = corners[i + 1 < corners.size() ? i + 1 : 0] - a;
    const double length = side.norm();
    if (length > 0) nearest = std::min(nearest, (a.x() * side.y() - a.y() * side.x()) / length);
  }
  return std::max(0.0, nearest);
}

}  // namespace

DiscSurface::DiscSurface(const Discs& discs, bool with_area)
    : discs_(discs.gathered(distinct_discs(discs))), tree_(discs_) {
  find_border(with_area);
}

void DiscSurface::find_border(bool with_area) {
  constexpr std::size_t kGrain = 256;
  struct Part {
    double area = 0;
    std::vector<std::uint32_t> border;
  };
  std::vector<Part> parts((discs_.size() + kGrain - 1) / kGrain);
  PerWorker<VoronoiCell> cells;
  parallel_for(discs_.size(), kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    VoronoiCell& cell = cells[worker];
    Part& part = parts[begin / kGrain];
    for (std::size_t i = begin; i < end; ++i) {
      const TangentPlane plane(discs_, i);
      const auto radius = static_cast<double>(discs_.radius[i]);
      // A disc that covers its cell is not at a border, whatever else would be cut.
      cut_cell({discs_, tree_}, i, plane, kOwnSquare * radius, with_area ? 0 : radius, cell);
      if (with_area) part.area += disc_area_in_polygon(radius, cell.corners());
      if (cell.radius() > radius) part.border.push_back(static_cast<std::uint32_t>(i));
    }
  });
  Array<std::uint32_t> border;
  for (const Part& part : parts) {
    area_ += part.area;
    border.insert(border.end(), part.border.begin(), part.border.end());
  }
  border_ = discs_.gathered(border);
  border_tree_.emplace(border_);
}

bool DiscSurface::may_end_in(const TangentPlane& plane, const VoronoiCell& cell) const {
  bool found = false;
  for_each_touching({border_, *border_tree_}, plane, cell, [&](std::size_t, const Vec2d&) {
    found = true;
    return false;
  });
  return found;
}

DiscSurface::Restriction DiscSurface::restrict_cell(const TangentPlane& plane, Owns owns,
                                                    VoronoiCell& cell) const {
  struct Touching {
    double furthest;
    std::size_t disc;
    Vec2d place;
  };
  std::vector<Touching> touching;
  for_each_touching({discs_, tree_}, plane, cell, [&](std::size_t j, const Vec2d& place) {
    touching.push_back({place.norm() + static_cast<double>(discs_.radius[j]), j, place});
    return true;
  });
  // The furthest corners come first: few other discs reach further in any direction and have to be
  // asked about.
  std::sort(touching.begin(), touching.end(), [](const Touching& a, const Touching& b) {
    return a.furthest != b.furthest ? a.furthest > b.furthest : a.disc < b.disc;
  });
  std::array<double, kDirections> reach{};
  for (const Touching& disc : touching) {
    std::array<double, kDirections> extended{};
    bool extends = false;
    for (std::size_t k = 0; k < kDirections; ++k) {
      extended[k] = std::max(reach[k], disc.place.dot(directions()[k]) +
                                           static_cast<double>(discs_.radius[disc.disc]));
      extends = extends || extended[k] > reach[k];
    }
    if (extends && owns(discs_, disc.disc)) reach = extended;
  }
  Restriction out;
  for (std::size_t k = 0; k < kDirections; ++k) {
    if (cell.cut(2 * reach[k] * directions()[k])) out.cut = true;
    out.reach = std::max(out.reach, reach[k]);
  }
  return out;
}

GroupCells::GroupCells(const Discs& discs, const DiscSurface& surface)
    : count_(discs.size()), chunks_((discs.size() + kGrain - 1) / kGrain) {
  reach_.resize(count_);
  inner_.resize(count_);
  const DiscTree tree(discs);
  const FoundDiscs group{discs, tree};
  PerWorker<VoronoiCell> cells;
  parallel_for(count_, kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    VoronoiCell& cell = cells[worker];
    Chunk& chunk = chunks_[begin / kGrain];
    // A square that most cells fit into: eight neighbours along the curve are spread over nearly
    // three spacings. Cells that do not fit are made anew in a larger one.
    const auto first_guess = [&](std::size_t i) {
      double furthest2 = 0;
      const std::size_t first = i - i % 8;
      for (std::size_t j = first; j < std::min(count_, first + 8); ++j) {
        const Vec3d offset = (discs.center[j] - discs.center[i]).cast<double>();
        furthest2 = std::max(furthest2, offset.squaredNorm());
      }
      return static_cast<double>(discs.radius[i]) + std::sqrt(furthest2);
    };
    for (std::size_t i = begin; i < end; ++i) {
      const TangentPlane plane(discs, i);
      bool restricted = false;
      for (double half_side = first_guess(i);;) {
        cut_cell(group, i, plane, half_side, 0, cell);
        // Neighbours further away than twice the square could only cut the part of a cell beyond
        // it.
        const bool open = cell.radius() > half_side;
        if (!open && !slender(cell) && !surface.may_end_in(plane, cell)) break;
        const auto restriction = surface.restrict_cell(
            plane, [&](const Discs& all, std::size_t j) { return owns(group, i, all, j); }, cell);
        restricted = restriction.cut;
        if (!open || restriction.reach <= half_side) break;
        half_side = std::max(2 * half_side, kBoxRounding * restriction.reach);
      }
      reach_[i] = cell.radius();
      inner_[i] = inner_radius(cell);
      chunk.area += cell.area();
      chunk.restricted += restricted ? 1 : 0;
      const auto corners = cell.corners();
      chunk.corners.insert(chunk.corners.end(), corners.begin(), corners.end());
      chunk.begin.push_back(static_cast<std::uint32_t>(chunk.corners.size()));
    }
  });
  for (const Chunk& chunk : chunks_) {
    area_ += chunk.area;
    restricted_ += chunk.restricted;
  }
}

std::span<const Vec2d> GroupCells::corners(std::size_t disc) const {
  const Chunk& chunk = chunks_[disc / kGrain];
  const std::size_t at = disc % kGrain;
  return {chunk.corners.data() + chunk.begin[at], chunk.begin[at + 1] - chunk.begin[at]};
}

double GroupCells::covered_area(std::span<const float> radius, double factor) const {
  std::vector<double> partial(chunks_.size());
  parallel_for(count_, kGrain, [&](std::size_t begin, std::size_t end, int) {
    double sum = 0;
    for (std::size_t i = begin; i < end; ++i) {
      const double r = factor * static_cast<double>(radius[i]);
      // Discs within their cells and over them are many and need no sides.
      sum += r <= inner_[i] ? std::numbers::pi * r * r
                            : disc_area_in_polygon(std::min(r, reach_[i]), corners(i));
    }
    partial[begin / kGrain] = sum;
  });
  double sum = 0;
  for (const double p : partial) sum += p;
  return sum;
}

}  // namespace surfel
