#include <algorithm>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <surfel/estimate/block_pass.h>
#include <surfel/estimate/point_estimates.h>

namespace surfel {

BlockPass::BlockPass(const BlockCloud& cloud, HaloOptions halo)
    : cloud_(cloud),
      directions_(halo.directions),
      halos_(cloud.points, cloud.index(), std::move(halo), cloud.name) {}

HaloOptions BlockPass::normal_halo(const BlockCloud& cloud) {
  const NormalOptions& normals = cloud.options.normals;
  HaloOptions halo{.most_points = cloud.sizes.most_loaded};
  if (normals.radius > 0) {
    halo.neighbors = 0;
    halo.radius = normals.radius;
  } else {
    halo.neighbors = normals.adaptive ? normals.k_max : normals.k;
  }
  return halo;
}

BlockPoints BlockPass::read(std::size_t begin_run, std::size_t end_run, bool all_columns) const {
  const RunIndex& index = cloud_.index();
  BlockPoints block;
  block.begin_run = begin_run;
  block.end_run = end_run;
  block.run_points.push_back(0);
  for (std::size_t run = begin_run; run < end_run; ++run) {
    block.run_points.push_back(block.run_points.back() + index[run].finite);
  }
  SurfelCloud all;
  if (all_columns) {
    all = cloud_.points.read(index.begin(begin_run), index.begin(end_run));
  } else {
    all.position = cloud_.points.positions(index.begin(begin_run), index.begin(end_run));
  }
  Array<std::uint32_t> finite(all.size());
  std::size_t count = 0;
  for (std::uint32_t i = 0; i < all.size(); ++i) {
    if (all.position[i].allFinite()) finite[count++] = i;
  }
  finite.resize(count);
  if (directions_) {
    const Array<Vec3f> previous = directions_(all, begin_run);
    block.previous.resize(previous.empty() ? 0 : count);
    for (std::size_t i = 0; i < block.previous.size(); ++i) {
      block.previous[i] = previous[finite[i]];
    }
  }
  if (count == all.size()) {
    all.tree = {};  // As gathered() does.
    block.cloud = std::move(all);
  } else {
    block.cloud = all.gathered(finite);
  }
  block.reach.resize(count);
  return block;
}

Array<std::uint32_t> BlockPass::along_curve(BlockPoints& block) const {
  Array<std::uint32_t> points = morton_order(block.cloud.position, cloud_.grid);
  if (!points.empty()) halos_.measure_reach(points, block);
  return points;
}

void BlockPass::look_at(Array<std::uint32_t> points, const BlockPoints& block,
                        FunctionRef<HaloTask(const LoadedBlock&)> look) const {
  if (points.empty()) return;
  std::vector<HaloTask> tasks;
  tasks.push_back({std::move(points), {}});
  while (!tasks.empty()) {
    const HaloTask task = std::move(tasks.back());
    tasks.pop_back();
    const std::optional<HaloPoints> found = halos_.load(task, block);
    if (!found) {
      // Halves along the curve need fewer points each.
      const std::size_t half = task.points.size() / 2;
      const auto middle = task.points.begin() + static_cast<std::ptrdiff_t>(half);
      tasks.push_back({Array<std::uint32_t>(middle, task.points.end()), task.needed});
      tasks.push_back({Array<std::uint32_t>(task.points.begin(), middle), task.needed});
      continue;
    }
    LoadedBlock loaded{*found, Array<std::uint8_t>(found->size())};
    parallel_each(found->size(), kBlockGrain,
                  [&](std::size_t i) { loaded.wanted[i] = found->point[i] != kHalo ? 1 : 0; });
    HaloTask rest = look(loaded);
    if (rest.points.empty()) continue;
    rest.needed.insert(rest.needed.end(), task.needed.begin(), task.needed.end());
    tasks.push_back(std::move(rest));
  }
}

HaloTask BlockPass::uncertain(const LoadedBlock& loaded, const HaloSearch& search,
                              const BlockPoints& block) const {
  HaloTask rest;
  for (std::size_t i = 0; i < loaded.points.size(); ++i) {
    if (loaded.wanted[i] != 0 && !search.certain(i)) rest.points.push_back(loaded.points.point[i]);
  }
  if (!rest.points.empty()) rest.needed = needed_regions(loaded, search, rest, block);
  return rest;
}

/// What has to be loaded for the uncertain points to become certain.
std::vector<HaloRegion> BlockPass::needed_regions(const LoadedBlock& loaded,
                                                  const HaloSearch& search,
                                                  const HaloTask& uncertain,
                                                  const BlockPoints& block) const {
  constexpr float kRounding = 1 + 2e-5F;
  // A neighbourhood among the points that are known may hold far too much if it reaches further
  // than halos do: where it ends is then found in the whole cloud.
  float usual = 0;
  for (const std::uint32_t i : uncertain.points) usual = std::max(usual, block.reach[i]);
  RunSearch exact(cloud_.points, cloud_.index());
  std::vector<Vec3f> near;
  std::vector<HaloRegion> out;
  for (const HaloSearch::Missing& missing : search.missing()) {
    const Vec3f& p = loaded.points.position[missing.point];
    float reach = missing.reach;
    if (!(reach <= usual)) {
      exact.nearest(p, missing.most, near);
      reach = std::min(reach, (near.back() - p).norm());
    }
    out.push_back({{p, p}, kRounding * reach + std::numeric_limits<float>::min()});
  }
  return out;
}

HaloNormals::HaloNormals(const LoadedBlock& loaded, const BlockCloud& cloud)
    : tree(loaded.points.position),
      lists(tree, loaded.points.position, shared_neighbors(cloud.options.normals)),
      search(lists, loaded.points.position, loaded.points.known, cloud.finite(), loaded.wanted),
      normals(estimate_normals(loaded.points.position, search, cloud.options.normals)) {}

}  // namespace surfel
