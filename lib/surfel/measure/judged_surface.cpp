#include <cmath>

#include <surfel/base/elementary.h>
#include <surfel/measure/judged_surface.h>

namespace surfel {
namespace {

/// Fewer points than these tell nothing.
constexpr std::size_t kLeastPoints = 8;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

Vec3d snapped(const Vec3d& direction, double degrees) {
  for (int k = 0; k < 3; ++k) {
    const double sign = direction[k] < 0 ? -1 : 1;
    if (std::abs(direction[k]) > portable::cos(radians(degrees))) return sign * Vec3d::Unit(k);
  }
  return direction;
}

Range range_of(std::vector<double> values, double strays) {
  const auto skip = static_cast<std::ptrdiff_t>(strays * static_cast<double>(values.size()));
  std::nth_element(values.begin(), values.begin() + skip, values.end());
  const double min = values[static_cast<std::size_t>(skip)];
  std::nth_element(values.begin(), values.end() - 1 - skip, values.end());
  return {min, *(values.end() - 1 - skip)};
}

JudgedSurface::JudgedSurface(const SurfaceSample& sample)
    : points(sample.points), origin(sample.origin) {
  Vec3d sum(0, 0, 0);
  for (const Point& p : points) {
    weight += weight_of(p);
    sum += weight_of(p) * p.position.cast<double>();
    normal += weight_of(p) * p.normal.cast<double>();
  }
  if (!(weight > 0)) return;
  center = sum / weight;
  normal /= weight;
  frame = make_frame({Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ()});
  if (turned_to_origin()) normal *= outward();
}

bool JudgedSurface::turned_to_origin() const {
  constexpr double kNearlyAll = 0.9;
  if ((origin + center).norm() > frame.size()) return false;
  double turned = 0;
  for (const Point& p : points) {
    const Vec3d to_origin = -(origin + p.position.cast<double>());
    if (p.normal.cast<double>().dot(to_origin) > 0) turned += weight_of(p);
  }
  return turned > kNearlyAll * weight;
}

double JudgedSurface::outward() const {
  constexpr double kClear = 0.1;  // Of the distance from the middle; flat scans have 0, balls 1.
  double along_normals = 0;
  double distances = 0;
  for (const Point& p : points) {
    const Vec3d from_center = p.position.cast<double>() - center;
    along_normals += weight_of(p) * p.normal.cast<double>().dot(from_center);
    distances += weight_of(p) * from_center.norm();
  }
  if (std::abs(along_normals) < kClear * distances) return 0;
  return along_normals > 0 ? 1 : -1;
}

bool JudgedSurface::usable() const {
  return points.size() >= kLeastPoints && weight > 0 && frame.size() > 0;
}

ReferenceFrame JudgedSurface::make_frame(const std::array<Vec3d, 3>& axes) const {
  ReferenceFrame made{axes, {}};
  std::vector<double> values(points.size());
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = along(points[i], axes[k]);
    made.range[k] = range_of(values);
  }
  return made;
}

double JudgedSurface::mirrored(std::size_t axis) const {
  // Cells lie symmetrically, so that a mirrored point falls into the mirrored cell.
  constexpr int kCells = 24;
  constexpr int kSide = kCells + 4;  // Two cells around for strays.
  std::vector<char> taken(std::size_t{kSide} * kSide * kSide, 0);
  const double cell = frame.size() / kCells;
  const auto place = [&](const Vec3d& p, std::array<int, 3>& index) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Range& range = frame.range[k];
      const double middle = (range.min + range.max) / 2;
      const double at = std::floor((p[static_cast<int>(k)] - middle) / cell + kSide / 2.0);
      if (!(at >= 1 && at < kSide - 1)) return false;
      index[k] = static_cast<int>(at);
    }
    return true;
  };
  const auto cell_of = [&](const std::array<int, 3>& i) {
    return (static_cast<std::size_t>(i[0]) * kSide + static_cast<std::size_t>(i[1])) * kSide +
           static_cast<std::size_t>(i[2]);
  };
  std::array<int, 3> index{};
  for (const Point& p : points) {
    if (place(p.position.cast<double>(), index)) taken[cell_of(index)] = 1;
  }
  const double twice_middle = frame.range[axis].min + frame.range[axis].max;
  double found = 0;
  for (const Point& p : points) {
    Vec3d image = p.position.cast<double>();
    image[static_cast<int>(axis)] = twice_middle - image[static_cast<int>(axis)];
    if (!place(image, index)) continue;
    if (taken[cell_of(index)] != 0) found += weight_of(p);
  }
  return found / weight;
}

bool JudgedSurface::of_map() const {
  const Vec3d middle = origin + center;
  const double extent = frame.size();
  const bool far = std::abs(middle.x()) > 20 * extent && std::abs(middle.y()) > 20 * extent;
  const double height = frame.range[2].size();
  return far && height <= frame.range[0].size() && height <= frame.range[1].size() &&
         (normal.isZero(0) || std::abs(normal.z()) > kOneSided);
}

bool JudgedSurface::of_camera() const {
  // Some points in a cell, so that those behind others are found.
  const int cells_a_side =
      std::clamp(static_cast<int>(std::sqrt(static_cast<double>(points.size()) / 4)), 8, 48);
  constexpr double kWidest = 0.9;  // Tangent of half the field of view of wide depth cameras.
  constexpr double kNear = 0.5;    // The surface does not reach up to the camera.
  std::vector<double> depth;
  std::vector<double> x;
  std::vector<double> y;
  for (const Point& p : points) {
    const Vec3d q = origin + p.position.cast<double>();
    if (!(q.z() > 0)) return false;
    depth.push_back(q.z());
    x.push_back(q.x() / q.z());
    y.push_back(q.y() / q.z());
  }
  const Range z = range_of(depth);
  const Range u = range_of(x);
  const Range v = range_of(y);
  const auto within = [&](const Range& r) { return r.min > -kWidest && r.max < kWidest; };
  // A camera that sees a thing has it near the middle of its picture.
  const auto middle = [&](const Range& r) { return std::abs(r.min + r.max) / 2 < kWidest / 2; };
  if (z.min < kNear * z.size() || !within(u) || !within(v) || !middle(u) || !middle(v))
    return false;
  if (!(u.size() > 0) || !(v.size() > 0)) return false;
  std::vector<Range> cells(static_cast<std::size_t>(cells_a_side * cells_a_side),
                           Range{kInfinity, -kInfinity});
  std::vector<int> count(cells.size());
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (!u.holds(x[i]) || !v.holds(y[i]) || !z.holds(depth[i])) continue;
    const auto index = [&](double value, const Range& range) {
      const double at = (value - range.min) / range.size() * cells_a_side;
      return std::min(cells_a_side - 1, static_cast<int>(at));
    };
    const auto at = static_cast<std::size_t>(index(y[i], v) * cells_a_side + index(x[i], u));
    cells[at].min = std::min(cells[at].min, depth[i]);
    cells[at].max = std::max(cells[at].max, depth[i]);
    ++count[at];
  }
  int single = 0;
  int several = 0;
  const double step = 0.15 * std::max(z.size(), u.size() * z.min);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (count[i] < 2) continue;
    ++several;
    if (cells[i].size() < step) ++single;
  }
  return several > 10 && single > 0.9 * several;
}

}  // namespace surfel
