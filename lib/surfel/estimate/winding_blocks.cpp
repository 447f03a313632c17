#include <cstring>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/peers.h>
#include <surfel/estimate/block_turns.h>
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
  const BlockPass pass(cloud, BlockPass::normal_halo(cloud));
  make_in_turns<BlockNormals>(
      cloud, "finding sides",
      [&](std::size_t begin, std::size_t end) { return normals_of(pass, cloud, begin, end); },
      [&](const BlockNormals& block) { sides->add(block.position, block.normal); });
  if (!cloud.peers || cloud.peers->rank() == 0) sides->finish();
  if (cloud.peers) sides->share(*cloud.peers);
  return sides;
}

}  // namespace surfel
