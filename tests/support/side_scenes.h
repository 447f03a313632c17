#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include <surfel/base/random.h>
#include <surfel/base/types.h>

namespace surfel::test {

/// Points of surfaces whose sides are known.
struct SidedPoints {
  Array<Vec3f> position;
  Array<Vec3f> truth;  ///< Unit normals on the right side.
  double spacing = 0;  ///< Root of the area per point, before points were taken away.

  void add(const Vec3d& p, const Vec3d& n) {
    position.push_back(p.cast<float>());
    truth.push_back(n.cast<float>());
  }
};

/// A box with axes of its own; `inward` boxes are rooms.
struct SidedBox {
  Vec3d low, high;
  bool inward = false;

  bool holds(const Vec3d& p) const {
    return (p.array() > low.array()).all() && (p.array() < high.array()).all();
  }
};

/// Uniformly random points of the boxes' faces, `spacing` apart, outside of all solid boxes, whose
/// union they bound, and inside of the room, if there is one.
inline SidedPoints box_points(const std::vector<SidedBox>& boxes, double spacing) {
  SidedPoints out;
  out.spacing = spacing;
  std::uint64_t key = 0;
  for (const SidedBox& box : boxes) {
    const Vec3d size = box.high - box.low;
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3;
      const int v = (axis + 2) % 3;
      const auto count = static_cast<std::size_t>(size[u] * size[v] / (spacing * spacing));
      for (const bool far : {false, true}) {
        Vec3d normal(0, 0, 0);
        normal[axis] = far != box.inward ? 1 : -1;
        for (std::size_t i = 0; i < count; ++i, ++key) {
          Vec3d p;
          p[axis] = far ? box.high[axis] : box.low[axis];
          p[u] = box.low[u] + size[u] * random_uniform(21, key, 0);
          p[v] = box.low[v] + size[v] * random_uniform(21, key, 1);
          bool hidden = false;
          for (const SidedBox& other : boxes) {
            hidden = hidden || (other.inward ? !box.inward && !other.holds(p) : other.holds(p));
          }
          if (!hidden) out.add(p, normal);
        }
      }
    }
  }
  return out;
}

/// A square plate of edge 2, as thick as `gap` spacings.
inline SidedPoints thin_plate(std::size_t count, double gap) {
  const double spacing = std::sqrt(8.0 / static_cast<double>(count));
  const double half = gap * spacing / 2;
  return box_points({{{-1, -1, -half}, {1, 1, half}}}, spacing);
}

/// A block with ten fins that are as thick as `gap` spacings, like a heat sink.
inline SidedPoints fins(std::size_t count, double gap) {
  const double spacing = std::sqrt(40.0 / static_cast<double>(count));
  const double half = gap * spacing / 2;
  std::vector<SidedBox> boxes{{{-1, -1, -0.5}, {1, 1, 0}}};
  for (int i = 0; i < 10; ++i) {
    const double x = -0.9 + 0.2 * i;
    boxes.push_back({{x - half, -0.95, -0.1}, {x + half, 0.95, 0.9}});
  }
  return box_points(boxes, spacing);
}

/// A hemispherical bowl with two walls `gap` spacings apart and a rim between them.
inline SidedPoints bowl(std::size_t count, double gap) {
  SidedPoints out;
  out.spacing = std::sqrt(4 * std::numbers::pi / static_cast<double>(count));
  const double inner = 1 - gap * out.spacing;
  const auto points_of = [&](double area) {
    return static_cast<std::uint64_t>(area / (out.spacing * out.spacing));
  };
  for (const double radius : {1.0, inner}) {
    const std::uint64_t points = points_of(2 * std::numbers::pi * radius * radius);
    for (std::uint64_t i = 0; i < points; ++i) {
      const double z = -random_uniform(radius == 1 ? 31 : 32, i, 0);
      const double around = 2 * std::numbers::pi * random_uniform(radius == 1 ? 31 : 32, i, 1);
      const double r = std::sqrt(1 - z * z);
      const Vec3d n(r * std::cos(around), r * std::sin(around), z);
      out.add(radius * n, radius == 1 ? n : Vec3d(-n));
    }
  }
  const std::uint64_t points = points_of(std::numbers::pi * (1 - inner * inner));
  for (std::uint64_t i = 0; i < points; ++i) {
    const double r = std::sqrt(inner * inner + (1 - inner * inner) * random_uniform(33, i, 0));
    const double around = 2 * std::numbers::pi * random_uniform(33, i, 1);
    out.add(Vec3d(r * std::cos(around), r * std::sin(around), 0), Vec3d(0, 0, 1));
  }
  return out;
}

/// A room seen from inside, with furniture on its floor that is as thin as `gap` spacings (a table
/// top, a shelf, a screen) and a block.
inline SidedPoints furnished_room(std::size_t count, double gap) {
  const double spacing = std::sqrt(75.0 / static_cast<double>(count));
  const double t = gap * spacing;
  return box_points({{{0, 0, 0}, {4, 3, 2.5}, true},
                     {{0.5, 0.5, -0.1}, {1.3, 1.2, 0.9}},
                     {{2, 0.6, 0.7}, {3.2, 1.6, 0.7 + t}},
                     {{2.5, 1, -0.1}, {2.7, 1.2, 0.7 + t / 2}},
                     {{1, 2, 0.3}, {1 + t, 2.8, 2}},
                     {{2.4, 2.2, 0.9}, {3.6, 2.2 + t, 1.7}}},
                    spacing);
}

/// How points are made harder.
struct SideDamage {
  double noise = 0;     ///< Gaussian noise in all directions, standard deviation in spacings.
  int gaps = 0;         ///< Balls without points ...
  double gap_size = 0;  ///< ... of this radius, in units of the half diagonal.
  double density = 1;   ///< Share of the points that is left where there are fewest, along x.
};

inline SidedPoints damaged(const SidedPoints& points, const SideDamage& damage) {
  Eigen::AlignedBox3f box;
  for (const Vec3f& p : points.position) box.extend(p);
  std::vector<Vec3f> hole;
  for (int i = 0; i < damage.gaps; ++i) {
    const double u = random_uniform(41, static_cast<std::uint64_t>(i));
    hole.push_back(
        points.position[static_cast<std::size_t>(u * static_cast<double>(points.position.size()))]);
  }
  const auto reach = static_cast<float>(damage.gap_size) * box.diagonal().norm() / 2;
  SidedPoints out;
  out.spacing = points.spacing;
  for (std::size_t i = 0; i < points.position.size(); ++i) {
    const Vec3f& p = points.position[i];
    bool lost = false;
    for (const Vec3f& h : hole) lost = lost || (p - h).norm() < reach;
    const float along = (p.x() - box.min().x()) / box.sizes().x();
    // The share falls exponentially from 1 to `density`.
    if (lost || random_uniform(42, i) > std::pow(damage.density, static_cast<double>(along))) {
      continue;
    }
    Vec3d moved = p.cast<double>();
    for (int d = 0; d < 3; ++d) {
      const double u = std::max(random_uniform(43, i, 2 * d), 1e-12);
      moved[d] += damage.noise * points.spacing * std::sqrt(-2 * std::log(u)) *
                  std::cos(2 * std::numbers::pi * random_uniform(43, i, 2 * d + 1));
    }
    out.add(moved, points.truth[i].cast<double>());
  }
  return out;
}

}  // namespace surfel::test
