#include <algorithm>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <surfel/base/peers.h>
#include <surfel/base/progress.h>
#include <surfel/estimate/block_turns.h>
#include <surfel/estimate/forest_blocks.h>
#include <surfel/estimate/surface_edges.h>

namespace surfel {
namespace {

/// Makes the forests of blocks.
class ForestPass {
 public:
  explicit ForestPass(const BlockCloud& cloud)
      : cloud_(cloud), pass_(cloud, BlockPass::normal_halo(cloud)) {}

  BlockForest make(std::size_t begin_run, std::size_t end_run) const {
    BlockPoints block = pass_.read(begin_run, end_run, false);
    Array<Vec3f> normal(block.cloud.size());
    BlockEdges edges;
    edges.resize(block.cloud.size(), std::min(kOrientationNeighbors + 1, cloud_.finite()));
    pass_.look_at(pass_.along_curve(block), block, [&](const LoadedBlock& loaded) {
      HaloNormals found(loaded, cloud_);
      found.search.next_stage();
      note_edges(loaded, found, edges);
      loaded.for_each_certain(found.search, [&](std::size_t i, std::size_t to) {
        normal[to] = found.normals.normal[i];
      });
      return pass_.uncertain(loaded, found.search, block);
    });
    return BlockForest::of(block.cloud.position, normal, edges,
                           cloud_.index().finite_before(begin_run), cloud_.grid);
  }

 private:
  /// Notes the edges of the wanted points that are certain.
  static void note_edges(const LoadedBlock& loaded, const HaloNormals& found, BlockEdges& out) {
    const HaloPoints& points = loaded.points;
    const SurfaceEdges edges(points.position, found.normals.normal);
    const auto note = [&](std::size_t i, std::span<const Neighbor> near, int) {
      if (loaded.wanted[i] == 0 || !found.search.certain(i) || !edges.known(i)) return;
      for (std::size_t k = 0; k < near.size(); ++k) {
        const std::uint32_t j = near[k].index;
        if (j == i || !edges.known(j)) continue;
        out.set(points.point[i], k, points.number[j], edges.weight(i, j), edges.opposed(i, j));
      }
    };
    found.search.for_each_nearest(kOrientationNeighbors + 1, note);
  }

  const BlockCloud& cloud_;
  BlockPass pass_;
};

/// Leaves the points of a block around which parts may be joined.
void leave_coming(const ForestSides& sides, std::uint64_t first_number,
                  Array<std::uint32_t>& points) {
  Array<std::uint64_t> numbers(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) numbers[i] = first_number + points[i];
  const ForestSides::Parts parts = sides.parts_of(numbers);
  std::size_t left = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (sides.comes(parts, i)) points[left++] = points[i];
  }
  points.resize(left);
}

/// Joins the parts between which there are edges that no point's nearest ones have.
void join_parts(const BlockCloud& cloud, ForestSides& sides) {
  const RunIndex& index = cloud.index();
  const BlockPass pass(cloud,
                       {.neighbors = kJoinNeighbors, .most_points = cloud.sizes.most_loaded});
  PartJoins joins = sides.joins();
  ProgressStage progress("joining parts", index.points(), "points");
  cloud.for_each_block([&](std::size_t begin, std::size_t end) {
    BlockPoints block = pass.read(begin, end, false);
    Array<std::uint32_t> points = pass.along_curve(block);
    leave_coming(sides, index.finite_before(begin), points);
    pass.look_at(std::move(points), block, [&](const LoadedBlock& loaded) {
      const HaloPoints& near = loaded.points;
      const ExactSearch tree(near.position);
      const HaloSearch search(tree, near.position, near.known, cloud.finite(), loaded.wanted);
      const ForestSides::Parts parts = sides.parts_of(near.number);
      find_joins(
          {near.position, parts.normal, parts.part, parts.opposed, near.number}, search,
          [&](std::size_t i) { return loaded.wanted[i] != 0; },
          [&](std::size_t i) { return search.certain(i); }, joins);
      return pass.uncertain(loaded, search, block);
    });
    sides.require_room_for(
        joins, static_cast<double>(index.begin(end)) / static_cast<double>(index.points()));
    progress.add(index.begin(end) - index.begin(begin));
  });
  sides.join(joins);
}

/// Tells all processes what process 0 has found.
TurnedPoints told_to_all(Peers& peers, TurnedPoints found) {
  Bytes bytes;
  if (peers.rank() == 0) {
    const std::uint64_t parts = found.parts;
    append_values(&parts, 1, bytes);
    append_values(found.turned.data(), found.turned.size(), bytes);
  }
  const std::vector<Bytes> from =
      peers.exchange(std::vector<Bytes>(static_cast<std::size_t>(peers.count()), bytes));
  const std::vector<std::uint64_t> told = values_of<std::uint64_t>(from[0]);
  found.parts = told[0];
  found.turned.assign(told.begin() + 1, told.end());
  return found;
}

}  // namespace

TurnedPoints find_sides_along_surface(const BlockCloud& cloud) {
  std::optional<ForestSides> sides;
  if (!cloud.peers || cloud.peers->rank() == 0) {
    sides.emplace(cloud.finite(), cloud.grid,
                  ForestSides::Options{.method = cloud.options.orientation.method,
                                       .memory = cloud.sizes.forest_memory,
                                       .of_memory = cloud.sizes.all_memory,
                                       .beside = cloud.beside});
  }
  const ForestPass pass(cloud);
  make_in_turns<BlockForest>(
      cloud, "finding sides",
      [&](std::size_t begin, std::size_t end) { return pass.make(begin, end); },
      [&](const BlockForest& forest) { sides->add(forest); });
  TurnedPoints found;
  if (sides) {
    sides->unite();
    if (sides->looks_for_joins()) join_parts(cloud, *sides);
    found = sides->turn();
    sides.reset();
  }
  return cloud.peers ? told_to_all(*cloud.peers, std::move(found)) : found;
}

}  // namespace surfel
