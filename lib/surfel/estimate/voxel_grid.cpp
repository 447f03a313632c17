#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/estimate/voxel_grid.h>
#include <surfel/surface/point_spacing.h>

namespace surfel {
namespace {

constexpr std::size_t kVoxelGrain = 1 << 14;
constexpr double kAutoSpacings = 2;
constexpr double kMostCells = 1 << 21;  ///< Along an axis, as Morton codes count them.

/// Cells along the longest side of the grid. One more than fit, as the last point may lie on the
/// end.
double cells_along(const Bounds& box, double edge) {
  return std::floor((box.max - box.min).maxCoeff() / edge) + 1;
}

void require_countable(const Bounds& box, double edge, const std::string& name) {
  if (voxels_are_countable(box, edge)) return;
  const double least = (box.max - box.min).maxCoeff() / (kMostCells - 1) * 1.001;
  throw_input(name, fmt::format("cells of {:.4g} make a grid of {:.3g} along a side, more than the "
                                "2^21 that can be counted; take an `edge` of {:.4g} or more",
                                edge, cells_along(box, edge), least));
}

double edge_for(const SurfelCloud& cloud, const Array<std::uint32_t>& points,
                const VoxelOptions& options, const std::string& name) {
  if (options.edge > 0) return options.edge;
  if (points.size() < 2) {
    throw_input(name, "one point has no spacing; give the `edge` of the cells");
  }
  Array<Vec3f> position(points.size());
  parallel_each(points.size(), kVoxelGrain,
                [&](std::size_t i) { position[i] = cloud.position[points[i]]; });
  const auto search = make_neighbor_search(position);
  const double edge = kAutoSpacings * point_spacing(position, *search);
  if (edge > 0) return edge;
  throw_input(name,
              "half of the points lie on others, so that their spacing cannot be told; give "
              "the `edge` of the cells");
}

/// Points by the cell that they lie in.
struct Cells {
  Array<std::uint32_t> begin;  ///< The first place in `point` of every cell, then their number.
  Array<std::uint32_t> point;

  std::size_t size() const { return begin.size() - 1; }
};

Cells cells_of(const SurfelCloud& cloud, const Array<std::uint32_t>& points, const Vec3d& low,
               double edge) {
  Array<std::uint64_t> keys(points.size());
  parallel_each(points.size(), kVoxelGrain, [&](std::size_t i) {
    const Vec3d cell = (cloud.position[points[i]].cast<double>() - low) / edge;
    keys[i] =
        morton_code(static_cast<std::uint32_t>(cell.x()), static_cast<std::uint32_t>(cell.y()),
                    static_cast<std::uint32_t>(cell.z()));
  });
  Cells cells;
  cells.point = sort_keys(keys);
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (i == 0 || keys[i] != keys[i - 1]) cells.begin.push_back(static_cast<std::uint32_t>(i));
  }
  cells.begin.push_back(static_cast<std::uint32_t>(keys.size()));
  parallel_each(points.size(), kVoxelGrain,
                [&](std::size_t i) { cells.point[i] = points[cells.point[i]]; });
  return cells;
}

/// A value of a column as a vector to sum up, and back.
Vec3d summand(const Vec3f& value) { return value.cast<double>(); }
double summand(float value) { return static_cast<double>(value); }
void assign(const Vec3d& mean, Vec3f& value) { value = mean.cast<float>(); }
void assign(double mean, float& value) { value = static_cast<float>(mean); }

/// Calls assign(i, mean of value(point)) for the points of each cell; order[i] is the i-th cell.
template <class Value, class Assign>
void average(const Cells& cells, const Array<std::uint32_t>& order, const Value& value,
             const Assign& assign) {
  parallel_each(order.size(), kVoxelGrain, [&](std::size_t i) {
    const std::uint32_t begin = cells.begin[order[i]];
    const std::uint32_t end = cells.begin[order[i] + 1];
    auto sum = value(cells.point[begin]);
    for (std::uint32_t at = begin + 1; at < end; ++at) sum += value(cells.point[at]);
    assign(i, sum / static_cast<double>(end - begin));
  });
}

/// The means of a column over cells.
template <class T>
void average(const Array<T>& values, const Cells& cells, const Array<std::uint32_t>& order,
             Array<T>& means) {
  if (values.empty()) return;
  average(
      cells, order, [&](std::uint32_t point) { return summand(values[point]); },
      [&](std::size_t i, const auto& mean) { assign(mean, means[i]); });
}

/// Of each cell the point nearest to the mean of its positions, the first one of several.
Array<std::uint32_t> nearest_to_means(const SurfelCloud& cloud, const Cells& cells) {
  Array<std::uint32_t> nearest(cells.size());
  parallel_each(cells.size(), kVoxelGrain, [&](std::size_t c) {
    Vec3d mean(0, 0, 0);
    for (std::uint32_t at = cells.begin[c]; at < cells.begin[c + 1]; ++at) {
      mean += cloud.position[cells.point[at]].cast<double>();
    }
    mean /= static_cast<double>(cells.begin[c + 1] - cells.begin[c]);
    auto least = std::make_pair(0.0, cells.point[cells.begin[c]]);
    for (std::uint32_t at = cells.begin[c]; at < cells.begin[c + 1]; ++at) {
      const std::uint32_t point = cells.point[at];
      const auto candidate =
          std::make_pair((cloud.position[point].cast<double>() - mean).squaredNorm(), point);
      if (at == cells.begin[c] || candidate < least) least = candidate;
    }
    nearest[c] = least.second;
  });
  return nearest;
}

/// Gives a mean of unit vectors unit length again; sides that cancel leave no direction.
void normalize(Vec3f& normal) {
  constexpr float kLeast = 1e-3F;
  const float length = normal.norm();
  normal = length > kLeast ? Vec3f(normal / length) : Vec3f(0, 0, 0);
}

}  // namespace

std::vector<std::string> VoxelOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, edge == 0 || (edge >= 1e-9 && edge <= 1e9), "edge", edge, "in 1e-9..1e9");
  return found;
}

bool voxels_are_countable(const Bounds& box, double edge) {
  return cells_along(box, edge) <= kMostCells;
}

SurfelCloud average_voxels(const SurfelCloud& cloud, const Array<std::uint32_t>& points,
                           const VoxelOptions& options, const std::string& name, double& edge) {
  require_usable(options);
  if (points.empty()) throw_input(name, "there are no points");
  edge = edge_for(cloud, points, options, name);
  Bounds box;
  for (const std::uint32_t point : points) box.add(cloud.position[point].cast<double>());
  require_countable(box, edge, name);
  const Cells cells = cells_of(cloud, points, box.min, edge);
  const Array<std::uint32_t> nearest = nearest_to_means(cloud, cells);

  Array<std::uint64_t> by_point(nearest.begin(), nearest.end());
  const Array<std::uint32_t> order = sort_keys(by_point);
  Array<std::uint32_t> kept(order.size());
  for (std::size_t i = 0; i < kept.size(); ++i) kept[i] = nearest[order[i]];
  SurfelCloud out = cloud.gathered(kept);
  if (cloud.exact.empty()) {
    average(cloud.position, cells, order, out.position);
  } else {
    average(
        cells, order, [&](std::uint32_t point) { return cloud.world(point); },
        [&](std::size_t i, const Vec3d& mean) { out.place(i, mean); });
  }
  average(cloud.normal, cells, order, out.normal);
  average(cloud.color, cells, order, out.color);
  average(cloud.coefficient, cells, order, out.coefficient);
  average(cloud.alpha, cells, order, out.alpha);
  parallel_each(out.normal.size(), kVoxelGrain, [&](std::size_t i) { normalize(out.normal[i]); });
  return out;
}

}  // namespace surfel
