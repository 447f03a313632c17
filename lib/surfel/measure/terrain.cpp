#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <surfel/measure/judged_surface.h>
#include <surfel/measure/terrain.h>

namespace surfel {
namespace {

/// Mean side of the surface by the side that most of it shows: 1 where all normals look up, or all
/// down; 1 too where normals are unknown.
double one_sided(const JudgedSurface& s, const Vec3d& up) {
  double sum = 0;
  double size = 0;
  for (const JudgedSurface::Point& p : s.points) {
    const double facing = JudgedSurface::weight_of(p) * p.normal.cast<double>().dot(up);
    sum += facing;
    size += std::abs(facing);
  }
  return size > 0 ? std::abs(sum) / size : 1;
}

/// Share of the points in columns along the height (axis 1 of the frame) in which they are about as
/// high as they lie far from one another, of those in columns of some points.
double single_valued(const JudgedSurface& s, const ReferenceFrame& frame) {
  constexpr double kPointsEach = 8;  // In the mean, so that few columns tell nothing.
  constexpr int kFewest = 4;
  constexpr double kSteepest = 2.5;  // Height in a column by the column's width.
  const int side =
      std::max(4, static_cast<int>(std::sqrt(static_cast<double>(s.points.size()) / kPointsEach)));
  struct Column {
    int points = 0;
    double low = 0, high = 0;
  };
  std::vector<Column> columns(static_cast<std::size_t>(side * side));
  const auto place = [&](double v, const Range& r) {
    const double cell = r.size() > 0 ? (v - r.min) / r.size() * side : 0;
    return static_cast<std::size_t>(std::clamp(cell, 0.0, side - 1.0));
  };
  for (const JudgedSurface::Point& p : s.points) {
    const double height = JudgedSurface::along(p, frame.axis[1]);
    Column& column = columns[place(JudgedSurface::along(p, frame.axis[0]), frame.range[0]) *
                                 static_cast<std::size_t>(side) +
                             place(JudgedSurface::along(p, frame.axis[2]), frame.range[2])];
    column.low = column.points == 0 ? height : std::min(column.low, height);
    column.high = column.points == 0 ? height : std::max(column.high, height);
    ++column.points;
  }
  const double width = std::max(frame.range[0].size(), frame.range[2].size()) / side;
  double judged = 0;
  double single = 0;
  for (const Column& column : columns) {
    if (column.points < kFewest) continue;
    judged += column.points;
    if (column.high - column.low <= kSteepest * width) single += column.points;
  }
  return judged > 0 ? single / judged : 0;
}

}  // namespace

bool is_terrain(const SurfaceSample& sample, const ViewGuess& guess) {
  const JudgedSurface s(sample);
  if (!s.usable() || guess.sensor) return false;
  if (s.of_map() && guess.up.z() > 0.99) return true;
  if (s.of_camera()) return false;
  constexpr double kRelief = 0.01;  // Less height by the width is a plane.
  constexpr double kSingle = 0.95;
  constexpr double kOneSide = 0.98;
  const Vec3d across = guess.up.unitOrthogonal();
  const ReferenceFrame frame = s.make_frame({across, guess.up, guess.up.cross(across)});
  const double thinness = frame.thinness(1);
  return thinness > kRelief && thinness < kThin && one_sided(s, guess.up) > kOneSide &&
         single_valued(s, frame) > kSingle;
}

}  // namespace surfel
