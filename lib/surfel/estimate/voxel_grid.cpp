#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/plugin.h>
#include <surfel/estimate/filters_plugin.h>
#include <surfel/estimate/voxel_grid.h>
#include <surfel/surface/point_spacing.h>

namespace surfel {
namespace {

constexpr std::size_t kVoxelGrain = 1 << 14;
constexpr double kAutoSpacings = 2;

/// Columns that are averaged, a row of floats a point: the position above the box's lower corner,
/// then the others that the cloud has.
struct AveragedColumns {
  std::size_t count = 3;
  std::vector<Array<Vec3f> SurfelCloud::*> vectors;
  bool alpha = false;

  explicit AveragedColumns(const SurfelCloud& cloud) {
    for (const auto column :
         {&SurfelCloud::normal, &SurfelCloud::color, &SurfelCloud::coefficient}) {
      if ((cloud.*column).empty()) continue;
      vectors.push_back(column);
      count += 3;
    }
    alpha = !cloud.alpha.empty();
    if (alpha) ++count;
  }

  void read(const SurfelCloud& cloud, const Vec3d& low, std::size_t i, float* row) const {
    const Vec3f above = (cloud.position[i].cast<double>() - low).cast<float>();
    row = std::copy_n(above.data(), 3, row);
    for (const auto column : vectors) row = std::copy_n((cloud.*column)[i].data(), 3, row);
    if (alpha) *row = cloud.alpha[i];
  }

  void write(const float* row, const Vec3d& low, std::size_t i, SurfelCloud& cloud) const {
    const auto next = [&] {
      const Vec3f v(row[0], row[1], row[2]);
      row += 3;
      return v;
    };
    cloud.position[i] = (next().cast<double>() + low).cast<float>();
    for (const auto column : vectors) (cloud.*column)[i] = next();
    if (alpha) cloud.alpha[i] = *row;
    if (cloud.normal.empty()) return;
    Vec3f& normal = cloud.normal[i];
    const float length = normal.norm();
    // Sides that cancel leave no direction.
    constexpr float kLeast = 1e-3F;
    normal = length > kLeast ? Vec3f(normal / length) : Vec3f(0, 0, 0);
  }
};

struct Box {
  Vec3d low{Vec3d::Constant(std::numeric_limits<double>::infinity())};
  Vec3d high{-low};
};

Box box_of(const Array<Vec3f>& position) {
  Box box;
  for (const Vec3f& p : position) {
    box.low = box.low.cwiseMin(p.cast<double>());
    box.high = box.high.cwiseMax(p.cast<double>());
  }
  return box;
}

/// Cells of the grid, which PCL counts by 31 bits.
double cell_count(const Box& box, double edge) {
  // One more on each axis, as rounding may put the last point beyond the end.
  return ((box.high - box.low) / edge)
      .array()
      .floor()
      .unaryExpr([](double n) { return n + 2; })
      .prod();
}

void require_countable(const Box& box, double edge, const std::string& name) {
  constexpr double kMostCells = std::numeric_limits<std::int32_t>::max();
  if (cell_count(box, edge) < kMostCells) return;
  double least = edge;
  while (cell_count(box, least) >= kMostCells) least *= 1.01;
  throw_input(name,
              fmt::format("cells of {:.4g} make a grid of {:.3g}, more than the 2^31 that can "
                          "be counted; take an `edge` of {:.4g} or more",
                          edge, cell_count(box, edge), least));
}

double edge_for(const SurfelCloud& cloud, const VoxelOptions& options, const std::string& name) {
  if (options.edge > 0) return options.edge;
  if (cloud.size() < 2) {
    throw_input(name, "one point has no spacing; give the `edge` of the cells");
  }
  const auto search = make_neighbor_search(cloud.position);
  const double edge = kAutoSpacings * point_spacing(cloud.position, *search);
  if (edge > 0) return edge;
  throw_input(name,
              "half of the points lie on others, so that their spacing cannot be told; give "
              "the `edge` of the cells");
}

/// Of each cell the point nearest to its mean, the first of several.
Array<std::uint32_t> nearest_to_means(const Array<float>& values, const Array<float>& means,
                                      const Array<std::uint32_t>& cell_of, std::size_t columns,
                                      std::size_t cells) {
  constexpr std::uint32_t kNoPoint = std::numeric_limits<std::uint32_t>::max();
  Array<std::uint32_t> nearest;
  nearest.assign(cells, kNoPoint);
  Array<float> least(cells);
  for (std::size_t i = 0; i < cell_of.size(); ++i) {
    const std::uint32_t cell = cell_of[i];
    const float* mean = means.data() + cell * columns;
    const float* p = values.data() + i * columns;
    const float distance2 = Vec3f(p[0] - mean[0], p[1] - mean[1], p[2] - mean[2]).squaredNorm();
    if (nearest[cell] != kNoPoint && least[cell] <= distance2) continue;
    nearest[cell] = static_cast<std::uint32_t>(i);
    least[cell] = distance2;
  }
  return nearest;
}

}  // namespace

std::vector<std::string> VoxelOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, edge == 0 || (edge >= 1e-9 && edge <= 1e9), "edge", edge, "in 1e-9..1e9");
  return found;
}

SurfelCloud average_voxels(const SurfelCloud& cloud, const VoxelOptions& options,
                           const std::string& name, double& edge) {
  require_usable(options);
  if (cloud.empty()) throw_input(name, "there are no points");
  edge = edge_for(cloud, options, name);
  const Box box = box_of(cloud.position);
  require_countable(box, edge, name);
  const AveragedColumns columns(cloud);
  Array<float> values(cloud.size() * columns.count);
  parallel_each(cloud.size(), kVoxelGrain, [&](std::size_t i) {
    columns.read(cloud, box.low, i, values.data() + i * columns.count);
  });
  Array<float> means(values.size());
  Array<std::uint32_t> cell_of(cloud.size());
  VoxelWork work;
  work.values = values.data();
  work.count = cloud.size();
  work.columns = columns.count;
  work.edge = static_cast<float>(edge);
  work.means = means.data();
  work.cell_of = cell_of.data();
  static const auto average =
      reinterpret_cast<AverageVoxels*>(plugin_symbol("filters", kAverageVoxelsSymbol));
  if (!average(work)) throw Error(ErrorKind::kNumeric, "PCL failed to average the voxels");

  Array<std::uint32_t> nearest =
      nearest_to_means(values, means, cell_of, columns.count, work.cells);
  std::sort(nearest.begin(), nearest.end());
  SurfelCloud out = cloud.gathered(nearest);
  parallel_each(out.size(), kVoxelGrain, [&](std::size_t i) {
    columns.write(means.data() + cell_of[nearest[i]] * columns.count, box.low, i, out);
  });
  return out;
}

}  // namespace surfel
