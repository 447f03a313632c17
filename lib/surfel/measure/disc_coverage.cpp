#include <Eigen/Geometry>
#include <numbers>

#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/measure/disc_coverage.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

constexpr std::size_t kFlawGrain = 1 << 14;

/// The exponent beta = d^T V^-1 d / 2 of a place at the offset d from surfel i: half the squared
/// distance within the disc's plane, in the disc's standard deviations. [SS01 (6), no screen]
double exponent(const SurfelCloud& cloud, std::size_t i, const Vec3d& offset) {
  const Vec3d n = cloud.normal[i].cast<double>();
  if (!cloud.anisotropic()) {
    return (offset - offset.dot(n) * n).squaredNorm() /
           (2 * static_cast<double>(cloud.variance[i]));
  }
  const Vec3d t = cloud.tangent[i].cast<double>();
  const double u = offset.dot(t);
  const double v = offset.dot(n.cross(t));
  return u * u / (2 * static_cast<double>(cloud.variance_u[i])) +
         v * v / (2 * static_cast<double>(cloud.variance_v[i]));
}

}  // namespace

void count_flaws(const SurfelCloud& cloud, CloudStatistics& out) {
  const std::size_t n = cloud.size();
  out.count += n;
  out.nonfinite_positions +=
      count_where(n, [&](std::size_t i) { return !finite(cloud.position[i]); });
  if (!cloud.normal.empty()) {
    const auto& normal = cloud.normal;
    out.nonfinite_normals += count_where(n, [&](std::size_t i) { return !finite(normal[i]); });
    out.zero_normals += count_where(n, [&](std::size_t i) { return normal[i].isZero(0); });
    out.non_unit_normals += count_where(n, [&](std::size_t i) {
      return finite(normal[i]) && !normal[i].isZero(0) && std::abs(normal[i].norm() - 1) > 1e-3F;
    });
  }
  Array<std::uint8_t> flawed;
  flawed.assign(n, 0);
  SurfelCloud::visit_columns(cloud, [&](const auto& column) {
    const void* address = &column;
    if (column.empty() || address == &cloud.position || address == &cloud.normal) return;
    parallel_each(n, kFlawGrain, [&](std::size_t i) {
      if (!finite(column[i])) flawed[i] = 1;
    });
  });
  out.nonfinite_values += count_where(n, [&](std::size_t i) { return flawed[i] != 0; });
  if (has_variance(cloud)) {
    out.negative_variances +=
        count_where(n, [&](std::size_t i) { return largest_variance(cloud, i) < 0; });
  }
}

MeasuredDiscs finite_discs(const SurfelCloud& cloud, double cutoff) {
  MeasuredDiscs discs;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!finite(cloud.position[i])) continue;
    discs.position.push_back(cloud.position[i]);
    discs.surfel.push_back(static_cast<std::uint32_t>(i));
    if (has_variance(cloud)) discs.radius.push_back(disc_radius(cloud, i, cutoff));
  }
  return discs;
}

DiscsAround::DiscsAround(const MeasuredDiscs& discs, float largest_radius)
    : discs_(discs), reach_(discs.radius), order_(morton_order(discs.position)) {
  // A place over a disc is no further from its plane and from its axis than the radius.
  for (float& r : reach_) r = std::min(r * std::numbers::sqrt2_v<float>, largest_radius);
  tree_ = BoxTree<Box, 4, 2>(order_.size(), [&](std::size_t place) {
    const std::uint32_t disc = order_[place];
    if (!(reach_[disc] > 0)) return Box();
    const Eigen::Array3f center = discs_.position[disc].array();
    return Box{center - reach_[disc], center + reach_[disc], reach_[disc]};
  });
}

bool DiscsAround::within(const Vec3f& center, double radius, std::vector<Neighbor>& out) const {
  out.clear();
  const float reach = static_cast<float>(radius) * kRounding;
  tree_.for_each_leaf(
      [&](const Box& box) {
        // No less than what the discs of the box are asked for: which discs there are does not
        // depend on the boxes.
        const float limit = kRounding * reach + (kRounding * kRounding - 1) * box.largest;
        return box.distance2(center.array()) <= limit * limit && out.size() <= kMostDiscs;
      },
      [&](std::size_t leaf) {
        tree_.for_each_item(leaf, [&](std::size_t place) {
          const std::uint32_t disc = order_[place];
          const float distance2 = (discs_.position[disc] - center).squaredNorm();
          const float limit = reach + reach_[disc] * kRounding;
          if (reach_[disc] > 0 && distance2 <= limit * limit) out.push_back({disc, distance2});
        });
      });
  return out.size() <= kMostDiscs;
}

std::optional<SurfelCell> surfel_cell(const Vec3f& position, const Vec3f& normal,
                                      std::uint64_t surfel, std::uint64_t seed,
                                      const std::vector<CellNeighbor>& near) {
  if (!finite(normal) || normal.isZero(0)) return std::nullopt;
  const TangentFrame frame = tangent_frame(normal.cast<double>().normalized());
  const double reach = (near.back().position - position).norm();
  if (!(reach > 0)) return std::nullopt;
  VoronoiCell cell;
  cell.reset(reach);
  for (const CellNeighbor& neighbor : near) {
    if (!neighbor.same_surface) continue;
    cell.cut(frame.flat((neighbor.position - position).cast<double>()));
  }
  if (!(cell.radius() <= reach / 2)) return std::nullopt;
  SurfelCell out{cell.area(), cell.radius(), {}};
  for (int point = 0; point < kPointsPerCell; ++point) {
    const double s = random_uniform(seed, surfel, 2 * point + 1);
    const double t = random_uniform(seed, surfel, 2 * point + 2);
    out.points[point] = position.cast<double>() + frame.lifted(cell.point(s, t));
  }
  return out;
}

bool covers(const SurfelCloud& cloud, std::size_t i, float radius, double cutoff,
            const Vec3f& normal, const Vec3d& place) {
  if (radius == 0 || !same_surface(cloud.normal[i], normal)) return false;
  const Vec3d offset = place - cloud.position[i].cast<double>();
  const double height = std::abs(offset.dot(cloud.normal[i].cast<double>()));
  return height <= radius && exponent(cloud, i, offset) < cutoff;
}

std::vector<std::size_t> sampled(std::size_t count, std::size_t samples, std::uint64_t seed) {
  std::vector<std::size_t> picked(std::min(count, samples));
  const double stretch = static_cast<double>(count) / static_cast<double>(picked.size());
  for (std::size_t i = 0; i < picked.size(); ++i) {
    const double jitter = picked.size() == count ? 0 : random_uniform(seed, i);
    const auto at = static_cast<std::size_t>((static_cast<double>(i) + jitter) * stretch);
    picked[i] = std::min(at, count - 1);
  }
  return picked;
}

std::optional<Coverage> coverage_of_cells(const std::vector<CellCoverage>& cells) {
  // Cells differ in area and have the same number of points: a point counts by its cell's area.
  Coverage coverage;
  double area = 0;
  for (const CellCoverage& cell : cells) {
    if (cell.area <= 0) continue;
    ++coverage.cells;
    area += cell.area;
    coverage.hole_share += cell.area * cell.holes / cell.points;
    coverage.overlap += cell.area * cell.overlap / cell.points;
  }
  if (coverage.cells == 0) return std::nullopt;
  coverage.hole_share /= area;
  coverage.overlap /= area;
  coverage.cell_area_mean = area / static_cast<double>(coverage.cells);
  return coverage;
}

}  // namespace surfel
