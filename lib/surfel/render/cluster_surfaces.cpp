#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>

#include <surfel/base/parallel.h>
#include <surfel/render/cluster_surfaces.h>
#include <surfel/render/splat.h>

namespace surfel {
namespace {

bool lie_in_planes(const SurfelColumns& c, std::size_t count) {
  // Squares of the angle from normal to normal, which is larger on spheres of a million surfels,
  // and of the slope of the line from place to place, radians^2.
  constexpr float kMostTurn2 = 0.002F * 0.002F;
  constexpr float kMostSlope2 = 0.05F * 0.05F;
  constexpr float kLeastShare = 0.75F;
  const std::size_t pairs = count - 1;
  std::size_t in_plane = 0;
  for (std::size_t i = 0; i < pairs; ++i) {
    const Vec3f n(c.normal_x[i], c.normal_y[i], c.normal_z[i]);
    const Vec3f next(c.normal_x[i + 1], c.normal_y[i + 1], c.normal_z[i + 1]);
    const Vec3f offset(c.x[i + 1] - c.x[i], c.y[i + 1] - c.y[i], c.z[i + 1] - c.z[i]);
    const float off_plane = n.dot(offset);
    const bool agree = (next - n).squaredNorm() < kMostTurn2 &&
                       off_plane * off_plane <= kMostSlope2 * offset.squaredNorm();
    in_plane += agree ? 1 : 0;
  }
  return pairs > 0 && static_cast<float>(in_plane) >= kLeastShare * static_cast<float>(pairs);
}

/// Pairs of surfels that follow one another.
struct Bends {
  float turned = 0;         ///< Sum of the angles between their normals, radians ...
  float along = 0;          ///< ... and of their distances.
  std::size_t count = 0;    ///< How many there are.
  std::size_t crossed = 0;  ///< How many lie on different sides of each other's planes.
};

/// How even the surface is that most of a cluster's surfels are of. Surfels that follow one another
/// are near to each other in space, and most such pairs are of one surface, also where several
/// surfaces cross or lie close.
Unevenness measure_unevenness(const SurfelColumns& c, std::size_t count) {
  constexpr std::size_t kMostSamples = 64;
  // The curvature of a place may be so many times the mean one.
  constexpr float kMostBend = 8;
  // The quarter of the samples that are least off are off by less than 0.45 deviations of noise.
  constexpr float kRoughByQuarter = 8;
  // Where a surface bends between two surfels, the line between them has about their mean slope. A
  // slope that differs by more than this tells that they are of different surfaces, or of a rough
  // one.
  constexpr float kMostSlope = 1e-3F;
  // By so much samples turn from one to the next at folds, and where surfaces cross, radians.
  constexpr float kMostTurn = 0.25F;
  std::array<float, kMostSamples> off;
  std::size_t samples = 0;
  Bends smooth;
  Bends sharp;
  const std::size_t step = (count + kMostSamples - 1) / kMostSamples;
  for (std::size_t i = 0; i + 1 < count; i += step) {
    // A scan that is there twice has its points in pairs, which tell nothing.
    std::size_t k = i + 1;
    while (k + 1 < count && c.x[k] == c.x[i] && c.y[k] == c.y[i] && c.z[k] == c.z[i]) ++k;
    const Vec3f n(c.normal_x[i], c.normal_y[i], c.normal_z[i]);
    const Vec3f next(c.normal_x[k], c.normal_y[k], c.normal_z[k]);
    if (n.isZero(0) || next.isZero(0)) return {};
    const Vec3f offset(c.x[k] - c.x[i], c.y[k] - c.y[i], c.z[k] - c.z[i]);
    const float distance = offset.norm();
    const float turn = (next - n).norm();
    off[samples] = std::abs((n + next).dot(offset)) / 2;
    const bool is_one = off[samples] <= (turn / 2 + kMostSlope) * distance;
    Bends& bends = turn < kMostTurn ? smooth : sharp;
    bends.turned += is_one ? turn : 0;
    bends.along += is_one ? distance : 0;
    bends.count += is_one || turn >= kMostTurn ? 1 : 0;
    // At a fold the two surfels are on the same side of each other's planes.
    bends.crossed += n.dot(offset) * next.dot(offset) > 0 ? 1 : 0;
    ++samples;
  }
  if (samples == 0) return {};
  // Where surfaces cross, many a surfel lies before the plane of another surface's that lies behind
  // its own.
  const bool crossing = 5 * sharp.crossed > sharp.count && 4 * smooth.count > samples;
  const float turned = smooth.turned + (crossing ? 0 : sharp.turned);
  const float along = smooth.along + (crossing ? 0 : sharp.along);
  const auto quarter = off.begin() + static_cast<std::ptrdiff_t>(samples / 4);
  std::nth_element(off.begin(), quarter, off.begin() + static_cast<std::ptrdiff_t>(samples));
  return {along > 0 ? kMostBend * turned / along : 0.0F, kRoughByQuarter * *quarter};
}

}  // namespace

SurfelColumns surfel_columns(const RenderCloud& cloud, const Cluster& cluster) {
  const auto from = [&](const Array<float>& column) {
    return column.empty() ? nullptr : column.data() + cluster.begin;
  };
  const auto half_planes = [&](const RenderCloud::ClipColumns& clip) -> HalfPlaneColumns {
    return {from(clip.x), from(clip.y), from(clip.z), from(clip.distance)};
  };
  return {from(cloud.x),
          from(cloud.y),
          from(cloud.z),
          from(cloud.normal_x),
          from(cloud.normal_y),
          from(cloud.normal_z),
          from(cloud.deviation_u),
          from(cloud.deviation_v),
          from(cloud.tangent_x),
          from(cloud.tangent_y),
          from(cloud.tangent_z),
          from(cloud.area),
          from(cloud.red),
          from(cloud.green),
          from(cloud.blue),
          from(cloud.alpha),
          {half_planes(cloud.clip[0]), half_planes(cloud.clip[1])},
          {}};
}

void ClusterSurfaces::search(const Cluster& cluster, Known& known) const {
  known.searched = true;
  const SurfelColumns columns = surfel_columns(cloud_, cluster);
  const std::size_t count = cluster.end - cluster.begin;
  if (opaque_) {
    known.uneven = measure_unevenness(columns, count);
    return;
  }
  known.flat = lie_in_planes(columns, count);
  if (!sheets_) return;
  const auto* material = cloud_.material.empty() ? nullptr : cloud_.material.data() + cluster.begin;
  known.sheets = find_sheets(columns, material, static_cast<int>(count));
}

void ClusterSurfaces::begin(std::span<const VisibleCluster> clusters, const SplatView& view,
                            float epsilon) {
  clusters_ = clusters;
  in_use_.resize(clusters.size());
  first_in_view_.resize(clusters.size() + 1);
  constexpr std::size_t kGrain = 64;
  parallel_each(clusters.size(), kGrain, [&](std::size_t place) {
    const std::uint32_t index = clusters[place].index;
    Known& known = known_[index];
    if (!known.searched) search(cloud_.clusters()[index], known);
    const float own_epsilon = known.flat ? kFlatEpsilon * epsilon : epsilon;
    std::uint32_t in_use = 0;
    for (std::size_t i = 0; i < known.sheets.size(); ++i) {
      if (may_sum_up(known.sheets[i], view, own_epsilon)) in_use |= 1U << i;
    }
    static_assert(kMostSheets <= 8);
    in_use_[place] = static_cast<std::uint8_t>(in_use);
  });
  std::uint32_t count = 0;
  for (std::size_t place = 0; place < clusters.size(); ++place) {
    first_in_view_[place] = count;
    count += static_cast<std::uint32_t>(std::popcount(in_use_[place]));
  }
  first_in_view_[clusters.size()] = count;
  in_view_.resize(count);
  parallel_each(clusters.size(), kGrain, [&](std::size_t place) {
    SheetInView* to = in_view_.data() + first_in_view_[place];
    for (unsigned left = in_use_[place]; left != 0; left &= left - 1) {
      const SurfaceSheet& sheet = known_[clusters[place].index].sheets[std::countr_zero(left)];
      const float* const r = view.rotation + 6;
      const float* const c = sheet.center;
      const float z = r[0] * c[0] + r[1] * c[1] + r[2] * c[2] + view.translation[2];
      *to++ = {sheet.surfels, view.orthographic ? -z : 1 / z};
    }
  });
}

}  // namespace surfel
