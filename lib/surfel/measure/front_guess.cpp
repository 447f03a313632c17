#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/measure/front_guess.h>

namespace surfel {
namespace {

using Point = SurfaceSample::Point;

/// Places in a picture of the scene, and the points seen there.
class Silhouette {
 public:
  Silhouette(const JudgedSurface& s, const Vec3d& front, const Vec3d& up)
      : side_(std::clamp(
            static_cast<int>(std::sqrt(kPerCell * static_cast<double>(s.points.size()))), 8, 64)),
        cells_(static_cast<std::size_t>(side_ * side_)) {
    const Vec3d right = up.cross(front);
    Vec3d middle(0, 0, 0);
    for (std::size_t k = 0; k < 3; ++k) {
      middle += s.frame.axis[k] * ((s.frame.range[k].min + s.frame.range[k].max) / 2);
    }
    const double cell = 1.5 * s.frame.size() / side_;  // The diagonal of a picture fits.
    const auto place = [&](const Point& p) {
      const Vec3d at = p.position.cast<double>() - middle;
      const double column = std::floor(at.dot(right) / cell + side_ / 2.0);
      const double row = std::floor(at.dot(up) / cell + side_ / 2.0);
      const bool in = column >= 0 && column < side_ && row >= 0 && row < side_;
      return in ? static_cast<int>(row) * side_ + static_cast<int>(column) : -1;
    };
    for (const Point& p : s.points) {
      const int at = place(p);
      if (at < 0) continue;
      Cell& c = cells_[static_cast<std::size_t>(at)];
      c.nearest = std::max(c.nearest, p.position.cast<double>().dot(front));
    }
    for (const Point& p : s.points) {
      const int at = place(p);
      if (at < 0) continue;
      Cell& c = cells_[static_cast<std::size_t>(at)];
      if (p.position.cast<double>().dot(front) < c.nearest - 1.5 * cell) continue;
      if (p.normal.cast<double>().dot(front) < 0) continue;
      c.normal += p.normal.cast<double>() * static_cast<double>(p.area);
    }
  }

  int covered() const {
    return static_cast<int>(std::count_if(cells_.begin(), cells_.end(), &Silhouette::seen));
  }

  /// Sum of the changes of normals from cell to cell.
  double detail() const {
    double sum = 0;
    for (int row = 0; row + 1 < side_; ++row) {
      for (int column = 0; column + 1 < side_; ++column) {
        const Cell& here = cell(row, column);
        sum += change(here, cell(row, column + 1)) + change(here, cell(row + 1, column));
      }
    }
    return sum;
  }

 private:
  struct Cell {
    double nearest = -std::numeric_limits<double>::infinity();
    Vec3d normal{0, 0, 0};
  };
  static bool seen(const Cell& c) { return c.nearest > -std::numeric_limits<double>::infinity(); }
  const Cell& cell(int row, int column) const {
    return cells_[static_cast<std::size_t>(row * side_ + column)];
  }
  static double change(const Cell& a, const Cell& b) {
    if (!(a.normal.squaredNorm() > 0) || !(b.normal.squaredNorm() > 0)) return 0;
    return (a.normal.normalized() - b.normal.normalized()).norm();
  }

  /// Cells for each point, so few that most cells of the scene hold some points.
  static constexpr double kPerCell = 0.3;

  int side_;
  std::vector<Cell> cells_;
};

/// 1 or -1 where the upper part of the scene leans towards the front or back and hangs over what
/// the scene stands on there, as heads do; else 0.
double head(const JudgedSurface& s, const Vec3d& front, const Vec3d& up) {
  std::vector<double> heights;
  std::vector<double> depths;
  for (const Point& p : s.points) {
    heights.push_back(JudgedSurface::along(p, up));
    depths.push_back(JudgedSurface::along(p, front));
  }
  const Range height = range_of(heights);
  const Range depth = range_of(depths);
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Range feet{kInfinity, -kInfinity};
  double top = 0;
  double lean = 0;
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    const double at = (heights[i] - height.min) / height.size();
    if (at < kSlab) feet = {std::min(feet.min, depths[i]), std::max(feet.max, depths[i])};
    if (at < 0.7) continue;
    top += JudgedSurface::weight_of(s.points[i]);
    lean += JudgedSurface::weight_of(s.points[i]) * (depths[i] - (depth.min + depth.max) / 2);
  }
  constexpr double kClear = 0.1;  // Of the depth.
  lean /= top * depth.size();
  const double over = (depth.max - feet.max) / depth.size();
  const double behind = (feet.min - depth.min) / depth.size();
  if (lean > kClear && over > behind) return 1;
  return lean < -kClear && behind > over ? -1 : 0;
}

}  // namespace

Vec3d conventional_front(const Vec3d& up) {
  Vec3d front(0, 0, 1);
  if (std::abs(up.z()) > 0.7) front = Vec3d(0, up.z() > 0 ? -1 : 1, 0);
  if (up.y() < -0.7) front = Vec3d(0, 0, -1);
  return (front - front.dot(up) * up).normalized();
}

FrontGuess guess_front(const JudgedSurface& s, const Vec3d& up,
                       const std::array<double, 3>& symmetry) {
  const Vec3d usual = conventional_front(up);
  const Vec3d facing = s.normal - s.normal.dot(up) * up;
  const double thinness = [&] {
    Eigen::Index k = 0;
    up.cwiseAbs().maxCoeff(&k);
    return s.frame.thinness(static_cast<std::size_t>(k));
  }();
  FrontGuess guess{usual, radians(30), radians(thinness < kThin ? 50 : 20)};
  if (facing.norm() > kOneSided) {
    // The side that was scanned, along an axis where that is nearly so.
    guess.front = facing.normalized();
    for (const Vec3d& axis :
         {usual, Vec3d(-usual), Vec3d(up.cross(usual)), Vec3d(usual.cross(up))}) {
      if (axis.dot(guess.front) > portable::cos(radians(30))) guess.front = axis;
    }
    guess.azimuth = 0;
    guess.elevation = radians(10);
    return guess;
  }
  if (std::abs(s.normal.dot(up)) > kOneSided) return guess;  // Ground: no side is the front.
  // The plane of symmetry holds the front; else the wider silhouette is looked at.
  const Vec3d side = up.cross(usual);
  const auto mirrored_across = [&](const Vec3d& axis) {
    Eigen::Index k = 0;
    return axis.cwiseAbs().maxCoeff(&k) > 0.99 ? symmetry[static_cast<std::size_t>(k)] : 0;
  };
  const double across_side = mirrored_across(side);
  const double across_usual = mirrored_across(usual);
  const bool symmetric = std::max(across_side, across_usual) > kSymmetric &&
                         std::abs(across_side - across_usual) > 0.05;
  const bool from_side =
      symmetric ? across_usual > across_side
                : Silhouette(s, side, up).covered() > 1.1 * Silhouette(s, usual, up).covered();
  guess.front = from_side ? side : usual;
  // Chance makes one side of a rounded body a little more detailed than the other.
  constexpr double kClear = 1.1;
  const double here = Silhouette(s, guess.front, up).detail();
  const double there = Silhouette(s, -guess.front, up).detail();
  const bool alike = std::max(here, there) < kClear * std::min(here, there);
  if (alike ? head(s, guess.front, up) < 0 : there > here) guess.front = -guess.front;
  return guess;
}

}  // namespace surfel
