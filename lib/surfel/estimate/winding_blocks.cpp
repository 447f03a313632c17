#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/progress.h>
#include <surfel/estimate/winding_blocks.h>

namespace surfel {
namespace {

void require_room_for_tiles(const BlockCloud& cloud) {
  const std::uint64_t needed =
      cloud.sizes.index_bytes +
      StoredSides::bytes(cloud.finite(), cloud.options.orientation.tile_points);
  if (cloud.sizes.bounded && cloud.sizes.all_memory < needed) {
    throw_usage(
        fmt::format("{} bytes of memory are too few to find the sides of {} points by winding: "
                    "give at least {} bytes, or orient by another method",
                    cloud.sizes.all_memory, cloud.finite(), needed));
  }
}

}  // namespace

std::unique_ptr<StoredSides> find_sides_by_winding(const BlockCloud& cloud) {
  if (cloud.peers) {
    throw_usage(
        "sides by winding are found by one process alone: orient by up, viewpoint, align or none, "
        "or start one process");
  }
  require_room_for_tiles(cloud);
  const RunIndex& index = cloud.index();
  RunSearch search(cloud.points, index);
  auto sides = std::make_unique<StoredSides>(
      index, cloud.options.orientation.tile_points, cloud.facts.sample,
      [&](const Vec3f& place, std::size_t k, std::vector<Vec3f>& out) {
        search.nearest(place, k, out);
      },
      cloud.beside);
  ProgressStage progress("finding sides", index.points(), "points");
  const BlockPass pass(cloud, BlockPass::normal_halo(cloud));
  cloud.for_each_block([&](std::size_t begin, std::size_t end) {
    BlockPoints block = pass.read(begin, end, false);
    Array<Vec3f> normal(block.cloud.size());
    pass.look_at(pass.along_curve(block), block, [&](const LoadedBlock& loaded) {
      const HaloNormals found(loaded, cloud);
      loaded.for_each_certain(found.search, [&](std::size_t i, std::size_t to) {
        normal[to] = found.normals.normal[i];
      });
      return pass.uncertain(loaded, found.search, block);
    });
    sides->add(block.cloud.position, normal);
    progress.add(index.begin(end) - index.begin(begin));
  });
  sides->finish();
  return sides;
}

}  // namespace surfel
