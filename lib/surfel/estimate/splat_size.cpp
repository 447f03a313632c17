#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numbers>
#include <optional>

#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/neighborhood_plane.h>
#include <surfel/estimate/splat_size.h>
#include <surfel/surface/closed_cell.h>
#include <surfel/surface/sheet.h>
#include <surfel/surface/tangent_frame.h>
#include <surfel/surface/voronoi_cell.h>

namespace surfel {
namespace {

constexpr std::size_t kSizeGrain = 1024;
/// Points that surround one in a regular pattern: SS01's small neighbourhood.
constexpr std::size_t kSmallNeighborhood = 6;
/// The local spacing is the mean distance to this many points: a square grid has four neighbours.
constexpr std::size_t kSpacingNeighbors = 4;
/// A neighbourhood is doubled up to this many times where a cell stays open ...
constexpr std::size_t kMostDoublings = 3;
/// ... and up to this many times where it does not reach kJumpReach local spacings, as at a jump of
/// density, where the denser side holds all of the nearest points. (At a border of an even surface
/// the 128 nearest points reach 9 spacings.)
constexpr std::size_t kMostDoublingsAtJumps = 6;
constexpr double kJumpReach = 4;
/// Distance up to which the surface surely goes on, in local spacings.
constexpr double kSureReach = 1.15;
/// Least share of its disc that a cell at a border counts for: about the mean share of all cells of
/// random points, 0.44.
constexpr double kBorderFill = 0.5;
/// Voids whose middle is further away than this are holes of the surface, in local spacings. The
/// middle between scan lines 10 times as far apart as their points is 3.3 spacings away.
constexpr double kVoidReach = 4;
/// A point is alone if its spacing is this many times the median of its neighbours' spacings; the
/// median, as outliers come in pairs, too.
constexpr double kAloneFactor = 3;
/// A cell is elongated if it is longer than this many times its width: below, ellipses are worth
/// less than the columns that they need.
constexpr double kElongated = 2;
/// Ellipses are used for the whole cloud where this share of the cells is elongated.
constexpr double kElongatedShare = 0.1;
/// Discs and ellipses are larger than their cells by this factor, as neighbouring tangent planes
/// differ where the surface bends.
constexpr double kMargin = 1.05;
/// A point is on a scan line if this many nearest points are less than a third as wide as long: few
/// enough not to reach the next line.
constexpr std::size_t kLineNeighbors = 8;
constexpr double kLineWidth2 = 0.1;
/// A cloud consists of scan lines if this share of its points is on one: of a statue's scan 1 in 90
/// is, of a forest seen from the air 1 in 10.
constexpr double kLeastLineShare = 0.25;
/// Normals of one face differ by less than the angle of this cosine, 20 degrees, beside a crease.
constexpr float kSameFaceCosine = 0.94F;
/// A cell is at least this wide beside a line, in half sides of the square that it is cut from.
constexpr double kLeastWidth = 1e-3;
/// Distance up to which a surface surely goes on along a line, in local spacings.
constexpr double kLineReach = 2;
/// Gaps that noise leaves, in local spacings, are at most taken to be this.
constexpr double kMostGap = 0.5;

/// A point's nearest points, the point itself among them.
struct Neighborhood {
  std::span<const Neighbor> near;  ///< By ascending distance.
  std::size_t coincident = 0;      ///< The first ones, at the point's own place.
  double spacing = 0;              ///< Local spacing: mean distance to the nearest others, if any.

  explicit Neighborhood(std::span<const Neighbor> nearest) : near(nearest) {
    while (coincident < near.size() && near[coincident].distance2 == 0) ++coincident;
    const std::size_t end = std::min(near.size(), coincident + kSpacingNeighbors);
    if (end <= coincident) return;
    for (std::size_t k = coincident; k < end; ++k) {
      spacing += std::sqrt(static_cast<double>(near[k].distance2));
    }
    spacing /= static_cast<double>(end - coincident);
  }

  /// Are there enough other points to tell the spacing, and to bound a cell?
  bool bounds_cell() const { return near.size() >= coincident + 2; }
  /// The nearest points, as many as a cell is first made from.
  std::span<const Neighbor> nearest() const {
    return near.first(std::min(near.size(), coincident + kSplatNeighbors));
  }
  /// Side of the square that each of them would have to itself on a plane.
  double plane_spacing() const {
    const auto count = static_cast<double>(nearest().size() - coincident);
    return std::sqrt(std::numbers::pi * static_cast<double>(nearest().back().distance2) / count);
  }
  /// All points up to this distance are known.
  double reach() const { return std::sqrt(static_cast<double>(near.back().distance2)); }
};

/// Disc and ellipse that hold a point's cell.
struct Shape {
  double radius2 = 0;                ///< Square of the disc's radius.
  Vec2d axis{1, 0};                  ///< Long axis of the ellipse, unit.
  Vec2d half_axes2 = Vec2d::Zero();  ///< Squares of its half axes, the long one first.
};

/// Do points with these moments lie along a line?
bool along_line(const Moments& moments) {
  if (!(moments.variance() > 0)) return false;
  const Plane plane = plane_of(moments);
  return plane.lambda[1] < kLineWidth2 * plane.lambda[2];
}

class Sizer {
 public:
  Sizer(const Array<Vec3f>& position, const Array<Vec3f>& normal, bool oriented,
        const NeighborSearch& search, const SplatSizeOptions& options, std::span<const float> noise,
        std::span<const EdgeLines> lines, const PartOfCloud* part)
      : position_(position),
        normal_(normal),
        oriented_(oriented),
        search_(search),
        options_(options),
        noise_(noise),
        lines_(lines),
        part_(part) {
    const std::size_t count = position.size();
    kind_.resize(count);
    out_.of.resize(count);
    out_.ellipses = options.rule == VarianceRule::kCover && options.anisotropy != Anisotropy::kOff;
  }

  SplatSizes run() {
    if (part_) {
      size_part();
      limit_lonely();
      out_.kind = std::move(kind_);
      return std::move(out_);
    }
    if (options_.max_radius > 0) {
      scan_lines_ = consists_of_scan_lines(sample_places(position_, kScanLineSample),
                                           nearest_places(position_, search_));
    }
    search_.for_each_nearest(kSplatNeighbors,
                             [&](std::size_t i, std::span<const Neighbor> near, int worker) {
                               size_point(i, near, workers_[worker]);
                             });
    limit_lonely();
    out_.border =
        count_where(kind_.size(), [&](std::size_t i) { return kind_[i] != CellKind::kClosed; });
    out_.capped =
        count_where(kind_.size(), [&](std::size_t i) { return kind_[i] == CellKind::kAlone; });
    out_.ellipses = out_.ellipses && worth_ellipses();
    out_.kind = std::move(kind_);
    return std::move(out_);
  }

 private:
  /// Sizes the points of a part that are wanted, and the points whose spacings limit_lonely() looks
  /// at.
  void size_part() {
    scan_lines_ = part_->scan_lines;
    search_.for_each_nearest(kSplatNeighbors,
                             [&](std::size_t i, std::span<const Neighbor> near, int worker) {
                               if (wanted(i)) size_point(i, near, workers_[worker]);
                             });
    Array<std::uint8_t> needed;
    needed.assign(position_.size(), 0);
    parallel_for(position_.size(), kSizeGrain, [&](std::size_t begin, std::size_t end, int w) {
      std::vector<Neighbor>& near = workers_[w].more;
      for (std::size_t i = begin; i < end; ++i) {
        if (!wanted(i) || kind_[i] == CellKind::kClosed) continue;
        search_.nearest(position_[i], kSplatNeighbors, near);
        for (const Neighbor& n : near) {
          if (wanted(n.index)) continue;
          std::atomic_ref<std::uint8_t>(needed[n.index]).store(1, std::memory_order_relaxed);
        }
      }
    });
    parallel_for(position_.size(), kSizeGrain, [&](std::size_t begin, std::size_t end, int w) {
      std::vector<Neighbor> near;
      for (std::size_t i = begin; i < end; ++i) {
        if (needed[i] == 0) continue;
        search_.nearest(position_[i], kSplatNeighbors, near);
        size_point(i, near, workers_[w]);
      }
    });
    part_->sized();
  }

  bool wanted(std::size_t i) const { return !part_ || part_->wanted[i] != 0; }

  struct Worker {
    ClosedCell closed;
    VoronoiCell cell;
    double half_side = 0;      ///< Half the side of the square that the cell started as.
    std::vector<Vec2d> flat;   ///< Neighbours on the surface, in the tangent plane.
    std::vector<Vec2d> lines;  ///< Feet of the lines at which the surface ends, there.
    std::vector<Neighbor> more, within;
  };

  void size_point(std::size_t i, std::span<const Neighbor> near, Worker& worker) {
    Neighborhood around(near);
    const bool whole = lines_.empty() || lines_[i].count == 0;
    if (whole && size_closed(i, around, worker)) return;
    const bool known = !normal_[i].isZero(0);
    if (!known && near.size() >= around.coincident + kSpacingNeighbors) {
      // Without a tangent plane the spacing is all that can be told; more points do not change it.
      kind_[i] = CellKind::kBorder;
      store_unknown(i, around.spacing);
      return;
    }
    std::size_t doublings = 0;
    if (near.size() < search_.whole()) {
      // Of random points 3 in 100 need this many to see that the surface goes on around them.
      find_more(i, 2 * near.size(), std::sqrt(near.back().distance2), worker.more);
      around = Neighborhood(worker.more);
      if (whole && size_closed(i, around, worker)) return;
      doublings = 1;
    }
    const TangentFrame frame =
        tangent_frame(known ? Vec3d(normal_[i].cast<double>()) : Vec3d(Vec3d::UnitZ()));
    bool settled = false;  // Do the neighbours suffice to know the cell?
    std::size_t cut = 0;   // Neighbours that the cell is cut by.
    for (std::size_t k = around.near.size();; ++doublings) {
      const bool usable = known && around.bounds_cell();
      if (usable) cut = cut_cell(i, around.near, cut, frame, worker);
      settled = usable && !open_corner(around, worker);
      const bool jump = around.reach() < kJumpReach * around.spacing;
      if (settled || k >= search_.whole() ||
          doublings >= (jump ? kMostDoublingsAtJumps : kMostDoublings)) {
        break;
      }
      k *= 2;
      if (worker.more.size() < std::min(k, search_.whole())) {
        // Where 32 points do not suffice 64 hardly ever do: twice as many take one search less.
        const bool ahead = doublings == 1;
        constexpr double kRoot2 = std::numbers::sqrt2;
        find_more(i, ahead ? 2 * k : k,
                  static_cast<float>(ahead ? kRoot2 * around.reach() : around.reach()),
                  worker.more);
      }
      around = Neighborhood(
          std::span<const Neighbor>(worker.more).first(std::min(k, worker.more.size())));
    }
    if (!known || !around.bounds_cell()) {
      kind_[i] = CellKind::kBorder;
      store_unknown(i, around.spacing);
      return;
    }
    const bool open = !settled && close_at_border(around, worker);
    kind_[i] = open ? CellKind::kBorder : CellKind::kClosed;
    double area = worker.cell.area();
    if (open) {
      // A disc has its point in the middle; a cell at a border need not. Without this the sum of
      // kernels would fall off before the border.
      const double radius = worker.cell.radius();
      area = std::max(area, kBorderFill * std::numbers::pi * radius * radius);
    }
    store(i, around, area, shape_of(worker.cell), frame);
  }

  /// Sizes a point whose cell is closed, as nearly all are, the fast way: the result is equal
  /// within rounding. False if the cell may be open; nothing is done then.
  bool size_closed(std::size_t i, const Neighborhood& around, Worker& worker) {
    if (normal_[i].isZero(0) || !around.bounds_cell()) return false;
    const std::span<const Neighbor> near = around.near;
    const CellSurface surface{position_, normal_, oriented_};
    CellLimits limits{std::sqrt(near.back().distance2),
                      static_cast<float>(kSureReach * around.spacing),
                      static_cast<float>(kVoidReach * around.spacing)};
    ClosedCell& cell = worker.closed;
    CellState state = measure_cell(surface, i, near, limits, cell);
    if (state == CellState::kBeyondReach) {
      // All points that may cut the cell lie within twice the distance of its furthest corner.
      constexpr double kRounding = 1 + 1e-5;
      const float reach2 = near.back().distance2;
      const double radius = cell.unit * std::sqrt(static_cast<double>(cell.radius2));
      limits.reach = static_cast<float>(2 * kRounding * radius);
      search_.within(position_[i], limits.reach, ClosedCell::kMostNeighbors, worker.within);
      if (worker.within.size() == ClosedCell::kMostNeighbors) return false;
      const auto further =
          std::partition_point(worker.within.begin(), worker.within.end(),
                               [&](const Neighbor& n) { return n.distance2 < reach2; });
      state = extend_cell(surface, i, std::span(further, worker.within.end()), limits, cell);
    }
    if (state != CellState::kClosed) return false;
    kind_[i] = CellKind::kClosed;
    const double unit2 = cell.unit * cell.unit;
    store(i, around, unit2 * static_cast<double>(cell.area), shape_of(cell),
          {cell.a.cast<double>(), cell.b.cast<double>(), normal_[i].cast<double>()});
    return true;
  }

  /// Notes the size of a point whose cell has this area and shape in this frame.
  void store(std::size_t i, const Neighborhood& around, double area, Shape shape,
             const TangentFrame& frame) {
    const double two_c = 2 * options_.cutoff;
    if (!noise_.empty()) {
      const double gap = std::min(static_cast<double>(noise_[i]), kMostGap * around.spacing);
      shape.radius2 += gap * gap;
      shape.half_axes2 += Vec2d::Constant(gap * gap);
    }
    const auto shared = static_cast<double>(std::max<std::size_t>(around.coincident, 1));
    limit(i, around, shape);
    SplatSize& size = out_.of[i];
    size.area = static_cast<float>(area / shared);
    size.spacing = static_cast<float>(around.spacing);
    if (options_.rule == VarianceRule::kMaxDistance) {
      const std::size_t last =
          std::min(around.near.size(), around.coincident + kSmallNeighborhood) - 1;
      size.variance = around.near[last].distance2;
    } else {
      size.variance = static_cast<float>(shape.radius2 / two_c);
    }
    size.tangent = frame.a.cast<float>();
    size.variance_u = size.variance;
    size.variance_v = size.variance;
    if (!out_.ellipses) return;
    Vec3d tangent = frame.lifted(shape.axis);
    // An axis has two directions; which one the solver took must not matter.
    int largest = 0;
    tangent.cwiseAbs().maxCoeff(&largest);
    if (tangent[largest] < 0) tangent = -tangent;
    size.tangent = tangent.cast<float>();
    size.variance_u = static_cast<float>(shape.half_axes2[0] / two_c);
    size.variance_v = static_cast<float>(shape.half_axes2[1] / two_c);
  }

  /// Cuts a shape to the longest reach that splats have.
  void limit(std::size_t i, const Neighborhood& around, Shape& shape) const {
    if (options_.max_radius == 0) return;
    double most = options_.max_radius * around.spacing;
    const double longest2 = std::max(shape.radius2, shape.half_axes2[0]);
    if (longest2 <= most * most) return;
    // On a scan line the nearest points tell nothing of the distance to the next line.
    if (scan_lines_ && on_line(i, around)) most = options_.max_radius * around.plane_spacing();
    shape.radius2 = std::min(shape.radius2, most * most);
    shape.half_axes2 = shape.half_axes2.cwiseMin(most * most);
  }

  /// Do the nearest points lie along a line?
  bool on_line(std::size_t i, const Neighborhood& around) const {
    Moments moments;
    const std::span<const Neighbor> near = around.nearest();
    for (const Neighbor& n : near.first(std::min(near.size(), kLineNeighbors))) {
      moments.add((position_[n.index] - position_[i]).cast<double>());
    }
    return along_line(moments);
  }

  /// Finds the k nearest of point i, half of which lie within `reach`. It is faster to look first
  /// as far as k points should reach on an even surface.
  void find_more(std::size_t i, std::size_t k, float reach, std::vector<Neighbor>& out) const {
    constexpr float kGrowth = 1.7F;  ///< sqrt(2) on an even surface, and some more for uneven ones.
    search_.within(position_[i], kGrowth * reach, k, out);
    if (out.size() < std::min(k, search_.whole())) search_.nearest(position_[i], k, out);
  }

  /// Cuts the cell of point i out of its tangent plane; the first `cut` neighbours have cut it
  /// before. Returns how many neighbours have cut it now.
  std::size_t cut_cell(std::size_t i, std::span<const Neighbor> near, std::size_t cut,
                       const TangentFrame& frame, Worker& worker) const {
    // A cell that is bounded by the square that it started as starts anew, as the square grows.
    const double half_side = std::sqrt(static_cast<double>(near.back().distance2));
    if (cut == 0 || worker.cell.radius2() > worker.half_side * worker.half_side) {
      worker.cell.reset(half_side);
      worker.half_side = half_side;
      worker.flat.clear();
      worker.lines.clear();
      cut = 0;
      if (!lines_.empty()) cut_at_lines(lines_[i], frame, worker);
    }
    for (const Neighbor& neighbor : near.subspan(cut)) {
      const Vec3d offset = (position_[neighbor.index] - position_[i]).cast<double>();
      const Vec2d flat = frame.flat(offset);
      const double height = frame.height(offset);
      if (oriented_ && !same_side(normal_[i].dot(normal_[neighbor.index]))) continue;
      if (!along_sheet(height * height, flat.squaredNorm())) continue;
      // Beside a crease the line ends the cell, and not points of the other face.
      if (!worker.lines.empty() &&
          std::abs(normal_[i].dot(normal_[neighbor.index])) < kSameFaceCosine) {
        continue;
      }
      worker.flat.push_back(flat);
      // Bisectors beyond the cell's furthest corner cut nothing.
      if (flat.squaredNorm() <= 4 * worker.cell.radius2()) worker.cell.cut(flat);
    }
    return near.size();
  }

  /// Ends the cell at the lines at which the surface ends.
  static void cut_at_lines(const EdgeLines& lines, const TangentFrame& frame, Worker& worker) {
    for (const EdgeLine& line : lines) {
      // A cell has to have a width for a bisector to cut it.
      const double distance =
          std::max(static_cast<double>(line.distance), kLeastWidth * worker.half_side);
      const Vec2d foot = distance * frame.flat(line.outward.cast<double>());
      worker.lines.push_back(foot);
      worker.cell.cut(2 * foot);
    }
  }

  /// Is a corner of the cell on one of the lines, and not too far along it?
  static bool on_line(const Vec2d& corner, const Neighborhood& around,
                      const std::vector<Vec2d>& lines) {
    constexpr double kRounding = 1e-6;
    const double most = kLineReach * around.spacing;
    if (corner.squaredNorm() > most * most) return false;
    return std::any_of(lines.begin(), lines.end(), [&](const Vec2d& foot) {
      return corner.dot(foot) >= (1 - kRounding) * foot.squaredNorm();
    });
  }

  /// Does the surface go on at a corner of the cell? It does if the void around the corner is not
  /// too large and the corner lies within the convex hull of the neighbours `flat`, looked at from
  /// five sides, 30 degrees apart.
  static bool on_surface(const Vec2d& corner, const Neighborhood& around,
                         const std::vector<Vec2d>& flat) {
    const double distance2 = corner.squaredNorm();
    const auto square = [](double x) { return x * x; };
    if (distance2 <= square(kSureReach * around.spacing)) return true;
    if (distance2 > square(std::min(around.reach() / 2, kVoidReach * around.spacing))) return false;
    // A neighbour p is beyond the corner c in the direction of c turned by t if
    // cos t (p.c - c.c) + sin t (c x p) >= 0. The furthest neighbours, which decide, come first.
    constexpr double kRoot3 = std::numbers::sqrt3;
    constexpr unsigned kAllSides = 0b11111;  // A bit for each of the five sides.
    unsigned sides = 0;
    for (auto p = flat.rbegin(); p != flat.rend() && sides != kAllSides; ++p) {
      const double along = p->dot(corner) - distance2;
      const double across = corner.x() * p->y() - corner.y() * p->x();
      sides |= (along >= 0 ? 1U : 0U) | (kRoot3 * along + across >= 0 ? 2U : 0U) |
               (kRoot3 * along - across >= 0 ? 4U : 0U) | (along + kRoot3 * across >= 0 ? 8U : 0U) |
               (along - kRoot3 * across >= 0 ? 16U : 0U);
    }
    return sides == kAllSides;
  }

  /// The furthest corner where the surface does not go on.
  static std::optional<Vec2d> open_corner(const Neighborhood& around, const Worker& worker) {
    std::optional<Vec2d> furthest;
    for (const Vec2d& corner : worker.cell.corners()) {
      if (on_surface(corner, around, worker.flat)) continue;
      if (on_line(corner, around, worker.lines)) continue;
      if (!furthest || corner.squaredNorm() > furthest->squaredNorm()) furthest = corner;
    }
    return furthest;
  }

  /// Ends the cell in every direction in which it is open; returns whether there was one.
  static bool close_at_border(const Neighborhood& around, Worker& worker) {
    // A bound: cells have fewer open corners, unless rounding leaves slivers.
    constexpr int kMostCuts = 32;
    int cuts = 0;
    for (; cuts < kMostCuts; ++cuts) {
      const std::optional<Vec2d> corner = open_corner(around, worker);
      if (!corner) break;
      worker.cell.cut(2 * kBorderReach * around.spacing * corner->normalized());
    }
    return cuts > 0;
  }

  /// The smallest disc about the point, and the smallest ellipse of the cell's second moments xx,
  /// xy and yy (up to a factor), that hold its corners(0), ..., corners(count - 1).
  template <class Corners>
  Shape shape_of(double radius2, double xx, double xy, double yy, std::size_t count,
                 const Corners& corners) const {
    Shape shape;
    constexpr double margin2 = kMargin * kMargin;
    shape.radius2 = radius2 * margin2;
    if (!out_.ellipses) return shape;
    // The eigenvalues are mean -+ r; the form of the long axis is the one without cancellation.
    const double mean = (xx + yy) / 2;
    const double half = (xx - yy) / 2;
    const double r = std::sqrt(half * half + xy * xy);
    // A cell that has shrunk to a point is round.
    const double across =
        mean > 0 ? std::max((mean - r) / (mean + r), 1 / (kMostElongated * kMostElongated)) : 1;
    if (r > 0) shape.axis = (half > 0 ? Vec2d(half + r, xy) : Vec2d(xy, r - half)).normalized();
    const double stretch = 1 / across;
    double along2 = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const Vec2d corner = corners(k);
      const double u = corner.dot(shape.axis);
      along2 = std::max(along2, u * u + (corner.squaredNorm() - u * u) * stretch);
    }
    shape.half_axes2 = margin2 * along2 * Vec2d(1, across);
    return shape;
  }

  Shape shape_of(const VoronoiCell& cell) const {
    const Eigen::Matrix2d m = cell.moments();
    return shape_of(cell.radius2(), m(0, 0), m(0, 1), m(1, 1), cell.corners().size(),
                    [&](std::size_t k) { return cell.corners()[k]; });
  }

  Shape shape_of(const ClosedCell& cell) const {
    const double unit2 = cell.unit * cell.unit;
    Shape shape = shape_of(static_cast<double>(cell.radius2), static_cast<double>(cell.xx),
                           static_cast<double>(cell.xy), static_cast<double>(cell.yy), cell.corners,
                           [&](std::size_t k) {
                             return Vec2d(static_cast<double>(cell.corner_x[k]),
                                          static_cast<double>(cell.corner_y[k]));
                           });
    shape.radius2 *= unit2;
    shape.half_axes2 *= unit2;
    return shape;
  }

  /// Without a tangent plane there is no cell: a disc of the border's reach.
  void store_unknown(std::size_t i, double spacing) {
    const double radius = kBorderReach * spacing;
    const auto variance = static_cast<float>(radius * radius / (2 * options_.cutoff));
    const Vec3f n = normal_[i].isZero(0) ? Vec3f(0, 0, 1) : normal_[i];
    out_.of[i] = {.tangent = n.unitOrthogonal(),
                  .variance = variance,
                  .variance_u = variance,
                  .variance_v = variance,
                  .area = static_cast<float>(spacing * spacing),
                  .spacing = static_cast<float>(spacing)};
  }

  /// Cuts the splats of points that are far from all others to their neighbours' spacing.
  void limit_lonely() {
    parallel_for(position_.size(), kSizeGrain, [&](std::size_t begin, std::size_t end, int w) {
      std::vector<Neighbor>& near = workers_[w].more;
      std::vector<float> others;
      for (std::size_t i = begin; i < end; ++i) {
        if (!wanted(i) || kind_[i] == CellKind::kClosed) continue;
        search_.nearest(position_[i], kSplatNeighbors, near);
        others.clear();
        for (const Neighbor& neighbor : near) {
          if (neighbor.index != i) others.push_back(out_.of[neighbor.index].spacing);
        }
        if (others.empty()) continue;
        const auto middle = others.begin() + static_cast<std::ptrdiff_t>(others.size() / 2);
        std::nth_element(others.begin(), middle, others.end());
        const double most = kAloneFactor * *middle;
        SplatSize& size = out_.of[i];
        if (!(most > 0) || size.spacing <= most) continue;
        const double scale = most / size.spacing;
        const auto scale2 = static_cast<float>(scale * scale);
        size.variance *= scale2;
        size.variance_u *= scale2;
        size.variance_v *= scale2;
        size.area *= scale2;
        kind_[i] = CellKind::kAlone;
      }
    });
  }

  bool worth_ellipses() const {
    if (options_.anisotropy == Anisotropy::kOn) return true;
    return surfel::worth_ellipses(count_where(position_.size(),
                                              [&](std::size_t i) {
                                                // A cell that ends at a line is narrow, however its
                                                // points lie.
                                                return (lines_.empty() || lines_[i].count == 0) &&
                                                       elongated(out_.of[i], kind_[i]);
                                              }),
                                  position_.size());
  }

  const Array<Vec3f>& position_;
  const Array<Vec3f>& normal_;
  bool oriented_;
  const NeighborSearch& search_;
  const SplatSizeOptions& options_;
  std::span<const float> noise_;
  std::span<const EdgeLines> lines_;
  const PartOfCloud* part_;
  bool scan_lines_ = false;
  PerWorker<Worker> workers_;
  Array<CellKind> kind_;
  SplatSizes out_;
};

}  // namespace

std::vector<std::string> SplatSizeOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, cutoff >= 0.1 && cutoff <= 16, "cutoff", cutoff, "in 0.1..16");
  check_option(found, max_radius == 0 || (max_radius >= 1 && std::isfinite(max_radius)),
               "max_radius", max_radius, "at least 1, or 0 for none");
  return found;
}

bool elongated(const SplatSize& size, CellKind kind) {
  constexpr auto ratio2 = static_cast<float>(kElongated * kElongated);
  return kind == CellKind::kClosed && size.variance_u > ratio2 * size.variance_v;
}

bool worth_ellipses(std::size_t elongated, std::size_t points) {
  return static_cast<double>(elongated) > kElongatedShare * static_cast<double>(points);
}

bool consists_of_scan_lines(std::span<const Vec3f> sample, NearestPlaces nearest) {
  std::vector<Vec3f> near;
  std::size_t lines = 0;
  for (const Vec3f& place : sample) {
    nearest(place, kLineNeighbors, near);
    Moments moments;
    for (const Vec3f& p : near) moments.add((p - place).cast<double>());
    lines += along_line(moments) ? 1 : 0;
  }
  return static_cast<double>(lines) >= kLeastLineShare * static_cast<double>(sample.size());
}

SplatSizes estimate_splat_sizes(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                                bool oriented, const NeighborSearch& search,
                                const SplatSizeOptions& options, std::span<const float> noise,
                                std::span<const EdgeLines> lines) {
  require_usable(options);
  return Sizer(position, normal, oriented, search, options, noise, lines, nullptr).run();
}

SplatSizes estimate_splat_sizes(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                                bool oriented, const NeighborSearch& search,
                                const SplatSizeOptions& options, const PartOfCloud& part) {
  require_usable(options);
  return Sizer(position, normal, oriented, search, options, {}, {}, &part).run();
}

}  // namespace surfel
