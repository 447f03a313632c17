#include <algorithm>
#include <cmath>
#include <span>

#include <fmt/format.h>
#include <surfel/align/scan.h>
#include <surfel/base/coordinate_spread.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/normals.h>
#include <surfel/surface/neighbor_lists.h>
#include <surfel/surface/point_spacing.h>

namespace surfel {
namespace {

constexpr std::size_t kScanNeighbors = 16;
constexpr std::size_t kScanGrain = 1024;

/// Points at whose one side the surface ends. The mean of the neighbours of a point inside is near
/// the point: of n random ones its distance is some R / sqrt(2 n), 0.18 R here. At a straight
/// border it is 4 R / (3 pi) = 0.42 R.
Array<std::uint8_t> find_border(const Array<Vec3f>& position, const NeighborSearch& search) {
  constexpr float kOneSided = 0.32F;
  Array<std::uint8_t> border(position.size());
  search.for_each_nearest(
      kScanNeighbors, [&](std::size_t i, std::span<const Neighbor> neighbors, int) {
        Vec3f sum(0, 0, 0);
        for (const Neighbor& n : neighbors) sum += position[n.index] - position[i];
        const float mean = sum.norm() / static_cast<float>(neighbors.size());
        border[i] = mean > kOneSided * std::sqrt(neighbors.back().distance2) ? 1 : 0;
      });
  return border;
}

/// Turns normals to the side of the file's, of which all have to be known.
bool turn_to_given(const SurfelCloud& cloud, const Array<std::uint32_t>& order,
                   Array<Vec3f>& normal) {
  if (cloud.normal.empty()) return false;
  for (const std::uint32_t i : order) {
    if (!(cloud.normal[i].squaredNorm() > 0)) return false;
  }
  parallel_each(order.size(), kScanGrain, [&](std::size_t i) {
    if (normal[i].dot(cloud.normal[order[i]]) < 0) normal[i] = -normal[i];
  });
  return true;
}

}  // namespace

RigidPose RigidPose::inverse() const {
  const Quaternion back = rotation.conjugate();
  return {back, -(back * translation)};
}

RigidPose RigidPose::operator*(const RigidPose& first) const {
  return {(rotation * first.rotation).normalized(), (*this)(first.translation)};
}

Scan make_scan(const SurfelCloud& cloud, const std::string& name) {
  constexpr std::size_t kLeastPoints = 100;
  Array<std::uint32_t> order = morton_order(cloud.position);
  // Stray points match nothing, and would take the precision of the others.
  CoordinateSpread spread;
  spread.add(Vec3d::Zero(), cloud.position);
  const Bounds core = spread.core(spread.box());
  std::erase_if(order,
                [&](std::uint32_t i) { return !core.contains(cloud.position[i].cast<double>()); });
  if (order.size() < kLeastPoints) {
    throw_input(name, fmt::format("{} finite points are too few to be aligned; at least {} are "
                                  "needed",
                                  order.size(), kLeastPoints));
  }
  Scan scan;
  Vec3d sum(0, 0, 0);
  for (const std::uint32_t i : order) sum += cloud.position[i].cast<double>();
  const Vec3d mean = sum / static_cast<double>(order.size());
  scan.center = cloud.origin + mean;
  scan.position.resize(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Vec3d offset = cloud.position[order[i]].cast<double>() - mean;
    scan.radius = std::max(scan.radius, offset.norm());
    scan.position[i] = offset.cast<float>();
  }
  scan.search = make_neighbor_search(scan.position);
  scan.spacing = point_spacing(scan.position, *scan.search);
  if (!(scan.spacing > 0)) {
    throw_input(name,
                "half of the points lie on others; average them in the cells of a grid "
                "first");
  }
  const NeighborLists lists(*scan.search, scan.position, kScanNeighbors);
  NormalOptions normals;
  normals.k = static_cast<int>(kScanNeighbors);
  scan.normal = estimate_normals(scan.position, lists, normals).normal;
  scan.oriented = turn_to_given(cloud, order, scan.normal);
  scan.border = find_border(scan.position, lists);
  return scan;
}

}  // namespace surfel
