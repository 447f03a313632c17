#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/peers.h>
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

/// The finite points of a block with their normals.
struct BlockNormals {
  Array<Vec3f> position, normal;

  Bytes bytes() const {
    Bytes out(2 * position.size() * sizeof(Vec3f));
    const std::size_t half = out.size() / 2;
    std::memcpy(out.data(), static_cast<const void*>(position.data()), half);
    std::memcpy(out.data() + half, static_cast<const void*>(normal.data()), half);
    return out;
  }
  static BlockNormals of(const Bytes& bytes) {
    const std::size_t count = bytes.size() / 2 / sizeof(Vec3f);
    BlockNormals out{Array<Vec3f>(count), Array<Vec3f>(count)};
    const auto half = static_cast<std::ptrdiff_t>(bytes.size() / 2);
    std::memcpy(static_cast<void*>(out.position.data()), bytes.data(), bytes.size() / 2);
    std::memcpy(static_cast<void*>(out.normal.data()), bytes.data() + half, bytes.size() / 2);
    return out;
  }
};

BlockNormals normals_of(const BlockPass& pass, const BlockCloud& cloud, std::size_t begin_run,
                        std::size_t end_run) {
  BlockPoints block = pass.read(begin_run, end_run, false);
  BlockNormals out;
  out.normal.resize(block.cloud.size());
  pass.look_at(pass.along_curve(block), block, [&](const LoadedBlock& loaded) {
    const HaloNormals found(loaded, cloud);
    loaded.for_each_certain(found.search, [&](std::size_t i, std::size_t to) {
      out.normal[to] = found.normals.normal[i];
    });
    return pass.uncertain(loaded, found.search, block);
  });
  out.position = std::move(block.cloud.position);
  return out;
}

/// Finds the normals of all blocks, every process of one block at a time. Process 0 gets all of
/// them in the order of the blocks, and adds them to its sides.
void add_normals(const BlockCloud& cloud, StoredSides& sides) {
  const BlockPass pass(cloud, BlockPass::normal_halo(cloud));
  const RunIndex& index = cloud.index();
  const std::size_t block_runs = cloud.sizes.block_runs;
  const int processes = cloud.peers ? cloud.peers->count() : 1;
  const int rank = cloud.peers ? cloud.peers->rank() : 0;
  ProgressStage progress("finding sides", index.points(), "points");
  const std::size_t together = block_runs * static_cast<std::size_t>(processes);
  for (std::size_t first = 0; first < index.size(); first += together) {
    const std::size_t begin =
        std::min(first + static_cast<std::size_t>(rank) * block_runs, index.size());
    BlockNormals mine;
    if (begin < index.size()) {
      mine = normals_of(pass, cloud, begin, std::min(begin + block_runs, index.size()));
    }
    if (rank == 0) sides.add(mine.position, mine.normal);
    // Process 0 has room for one block at a time.
    for (int sender = 1; sender < processes; ++sender) {
      std::vector<Bytes> to(static_cast<std::size_t>(processes));
      if (rank == sender && begin < index.size()) to[0] = mine.bytes();
      const std::vector<Bytes> from = cloud.peers->exchange(std::move(to));
      const Bytes& sent = from[static_cast<std::size_t>(sender)];
      if (rank != 0 || sent.empty()) continue;
      const BlockNormals block = BlockNormals::of(sent);
      sides.add(block.position, block.normal);
    }
    progress.add(index.begin(std::min(first + together, index.size())) - index.begin(first));
  }
}

}  // namespace

std::unique_ptr<StoredSides> find_sides_by_winding(const BlockCloud& cloud) {
  require_room_for_tiles(cloud);
  const RunIndex& index = cloud.index();
  RunSearch search(cloud.points, index);
  auto sides = std::make_unique<StoredSides>(
      index, cloud.options.orientation.tile_points, cloud.facts.sample,
      [&](const Vec3f& place, std::size_t k, std::vector<Vec3f>& out) {
        search.nearest(place, k, out);
      },
      cloud.beside);
  add_normals(cloud, *sides);
  if (!cloud.peers || cloud.peers->rank() == 0) sides->finish();
  if (cloud.peers) sides->share(*cloud.peers);
  return sides;
}

}  // namespace surfel
