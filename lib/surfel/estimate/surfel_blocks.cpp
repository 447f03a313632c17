#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <surfel/estimate/surfel_blocks.h>

namespace surfel {

SurfelPass::SurfelPass(const BlockCloud& cloud, const StoredSides* sides)
    : cloud_(cloud), sides_(sides), pass_(cloud, halo()) {}

HaloOptions SurfelPass::halo() const {
  HaloOptions halo = BlockPass::normal_halo(cloud_);
  const bool aligned = cloud_.options.orientation.method == Orientation::kAlign;
  if (aligned || cloud_.rules.to_sensors || sides_) {
    halo.directions = [this](const SurfelCloud& piece, std::size_t run) {
      return directions(piece, run);
    };
  }
  return halo;
}

/// The directions that orient_normals(), or turn_to_sides(), needs of the points from a run on.
Array<Vec3f> SurfelPass::directions(const SurfelCloud& piece, std::size_t run) const {
  if (sides_) return sides_->of(piece.position, run);
  if (!cloud_.rules.to_sensors) return piece.normal;
  Array<Vec3d> sensors;
  if (cloud_.facts.sensors) sensors = piece.sensors();
  Array<Vec3f> out(piece.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Vec3d& sensor = cloud_.facts.sensors ? sensors[i] : piece.viewpoint->position;
    out[i] = direction_to_sensor(sensor, piece.origin, piece.position[i]);
  }
  return out;
}

/// Makes room for the estimates of a block's points.
void SurfelPass::make_room(SurfelBlock& block) const {
  const std::size_t count = block.points.cloud.size();
  PointEstimates& estimates = block.estimates;
  estimates.normals.normal.resize(count);
  estimates.normals.quality.resize(count);
  estimates.sizes.of.resize(count);
  estimates.sizes.kind.resize(count);
  estimates.sizes.ellipses = ellipses_;
  if (cloud_.options.orientation.method != Orientation::kNone) {
    estimates.side_confidence.resize(count);
  }
  block.turned.resize(count);
}

SurfelBlock SurfelPass::make(std::size_t begin_run, std::size_t end_run) const {
  SurfelBlock block;
  block.points = pass_.read(begin_run, end_run, true);
  make_room(block);
  pass_.look_at(pass_.along_curve(block.points), block.points,
                [&](const LoadedBlock& loaded) { return estimate(loaded, block); });
  return block;
}

/// Turns the normals of points that are loaded to their sides.
void SurfelPass::turn(const LoadedBlock& loaded, HaloNormals& found, Array<float>& confidence,
                      SurfelBlock& block) const {
  const HaloPoints& points = loaded.points;
  Array<Vec3f>& normal = found.normals.normal;
  if (sides_) {
    turn_to_sides(points.position, found.search, points.previous, normal, &confidence);
    block.method = Orientation::kWinding;
    block.components = sides_->parts();
  } else {
    const OrientationReport sides =
        orient_normals(points.position, block.points.cloud.origin, found.search, points.previous,
                       cloud_.options.orientation, normal, &confidence);
    block.method = sides.method;
    block.components = std::max(block.components, sides.components);
  }
}

/// Estimates the points that are loaded, and notes the block's points that are certain. Returns
/// the others, with the regions that they need.
HaloTask SurfelPass::estimate(const LoadedBlock& loaded, SurfelBlock& block) const {
  const HaloPoints& points = loaded.points;
  HaloNormals found(loaded, cloud_);
  found.search.next_stage();
  const Array<Vec3f>& normal = found.normals.normal;
  Array<std::uint8_t> negative(points.size());
  parallel_each(points.size(), kBlockGrain,
                [&](std::size_t i) { negative[i] = std::signbit(normal[i].x()) ? 1 : 0; });
  Array<float> confidence;
  turn(loaded, found, confidence, block);
  const bool oriented = cloud_.options.orientation.method != Orientation::kNone;
  const auto sized = [&] { found.search.next_stage(); };
  const SplatSizes sizes =
      estimate_splat_sizes(points.position, normal, oriented, found.search, cloud_.options.size,
                           {loaded.wanted, cloud_.rules.scan_lines, sized});

  PointEstimates& out = block.estimates;
  loaded.for_each_certain(found.search, [&](std::size_t i, std::size_t to) {
    out.normals.normal[to] = normal[i];
    out.normals.quality[to] = found.normals.quality[i];
    if (!confidence.empty()) out.side_confidence[to] = confidence[i];
    out.sizes.of[to] = sizes.of[i];
    out.sizes.kind[to] = sizes.kind[i];
    const bool known = !normal[i].isZero(0);
    block.turned[to] = known && (std::signbit(normal[i].x()) ? 1 : 0) != negative[i] ? 1 : 0;
  });
  return pass_.uncertain(loaded, found.search, block.points);
}

SurfelCloud SurfelPass::surfels(SurfelBlock&& block) {
  SurfelCloud out = std::move(block.points.cloud);
  Array<std::uint32_t> place(out.size());
  std::iota(place.begin(), place.end(), 0U);
  set_estimates(block.estimates, place, out);
  return out;
}

SurfelCloud SurfelPass::first_surfel() const {
  SurfelBlock block;
  block.points.cloud = cloud_.points.read(0, 1);
  block.points.cloud.tree = {};
  make_room(block);
  return surfels(std::move(block));
}

}  // namespace surfel
