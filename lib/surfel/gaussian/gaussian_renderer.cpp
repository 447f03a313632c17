#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/base/timing.h>
#include <surfel/gaussian/gaussian_projection.h>
#include <surfel/gaussian/gaussian_raster.h>
#include <surfel/gaussian/gaussian_renderer.h>

namespace surfel {
namespace {

constexpr std::size_t kProjectionGrain = 2048;
/// Ranges in which splats are counted by tiles, at most: each has a counter for every tile.
constexpr std::size_t kMostListRanges = 64;
constexpr std::size_t kLeastListRange = 4096;
/// A raster reads lists by whole vectors.
constexpr std::size_t kListSpare = 16;

/// The tiles of a picture.
struct TileGrid {
  int columns, rows;

  explicit TileGrid(const Camera& camera)
      : columns((camera.width + kGaussianTile - 1) / kGaussianTile),
        rows((camera.height + kGaussianTile - 1) / kGaussianTile) {}
  std::size_t size() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  /// Calls body(tile) for the tiles that a splat's box meets.
  template <class Body>
  void for_each(const GaussianSplat& s, const Body& body) const {
    const int left = s.x0 / kGaussianTile;
    const int right = s.x1 / kGaussianTile;
    for (int row = s.y0 / kGaussianTile; row <= s.y1 / kGaussianTile; ++row) {
      const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(columns);
      for (int column = left; column <= right; ++column) {
        body(first + static_cast<std::size_t>(column));
      }
    }
  }
};

}  // namespace

struct GaussianRenderer::Frame {
  Array<GaussianSplat> splats;  ///< In ranges of kProjectionGrain Gaussians, each with gaps after.
  Array<GaussianPerspective> perspective;
  Array<std::uint32_t> keys;
  std::vector<std::size_t> range_count;
  Array<std::uint32_t> slot;          ///< Of all splats, in the order of the Gaussians.
  Array<std::uint64_t> wide;          ///< Their keys.
  Array<std::uint32_t> order;         ///< Slots in the order of keys.
  std::vector<std::uint32_t> counts;  ///< By range of `order` and tile: where the tile's go.
  std::vector<std::size_t> tile_end;
  Array<std::uint32_t> lists;
  PerWorker<GaussianScratch> scratch;

  void project(const GaussianView& view, const GaussianCloud& cloud);
  void sort();
  void list(const TileGrid& grid);
};

/// Projects all Gaussians.
void GaussianRenderer::Frame::project(const GaussianView& view, const GaussianCloud& cloud) {
  const std::size_t size = cloud.size();
  const bool in_perspective =
      view.profile == GaussianProfile::k2dgs || view.profile == GaussianProfile::kExact;
  splats.resize(size);
  perspective.resize(in_perspective ? size : 0);
  keys.resize(size);
  range_count.assign((size + kProjectionGrain - 1) / kProjectionGrain, 0);
  parallel_for(size, kProjectionGrain, [&](std::size_t begin, std::size_t end, int) {
    range_count[begin / kProjectionGrain] = project_gaussians(
        view, cloud, begin, end, splats.data() + begin,
        in_perspective ? perspective.data() + begin : nullptr, keys.data() + begin);
  });
}

/// Orders the splats by their keys, and by the Gaussians' numbers where keys are equal.
void GaussianRenderer::Frame::sort() {
  std::vector<std::size_t> first(range_count.size() + 1, 0);
  std::partial_sum(range_count.begin(), range_count.end(), first.begin() + 1);
  const std::size_t seen = first.back();
  slot.resize(seen);
  wide.resize(seen);
  parallel_each(range_count.size(), 8, [&](std::size_t range) {
    const std::size_t from = range * kProjectionGrain;
    for (std::size_t i = 0; i < range_count[range]; ++i) {
      slot[first[range] + i] = static_cast<std::uint32_t>(from + i);
      wide[first[range] + i] = keys[from + i];
    }
  });
  order = sort_keys(wide);
  parallel_each(seen, 16384, [&](std::size_t i) { order[i] = slot[order[i]]; });
}

/// Lists the splats of every tile, in their order.
void GaussianRenderer::Frame::list(const TileGrid& grid) {
  const std::size_t seen = order.size();
  const std::size_t tiles = grid.size();
  const std::size_t grain =
      std::max(kLeastListRange, (seen + kMostListRanges - 1) / kMostListRanges);
  const std::size_t ranges = (seen + grain - 1) / grain;
  counts.assign(ranges * tiles, 0);
  parallel_for(seen, grain, [&](std::size_t begin, std::size_t end, int) {
    std::uint32_t* const count = counts.data() + begin / grain * tiles;
    for (std::size_t i = begin; i < end; ++i) {
      grid.for_each(splats[order[i]], [&](std::size_t tile) { ++count[tile]; });
    }
  });
  tile_end.resize(tiles);
  std::size_t total = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    for (std::size_t range = 0; range < ranges; ++range) {
      std::uint32_t& count = counts[range * tiles + tile];
      const std::uint32_t here = count;
      count = static_cast<std::uint32_t>(total);
      total += here;
    }
    tile_end[tile] = total;
  }
  if (total > UINT32_MAX) {
    throw Error(ErrorKind::kInput, "more than 2^32 Gaussians meet tiles of the picture");
  }
  lists.resize(total + kListSpare);
  std::fill_n(lists.data() + total, kListSpare, 0U);
  parallel_for(seen, grain, [&](std::size_t begin, std::size_t end, int) {
    std::uint32_t* const next = counts.data() + begin / grain * tiles;
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t splat = order[i];
      grid.for_each(splats[splat], [&](std::size_t tile) { lists[next[tile]++] = splat; });
    }
  });
}

GaussianRenderer::GaussianRenderer(const GaussianCloud& cloud, const GaussianOptions& options)
    : cloud_(cloud), options_(options), frame_(std::make_unique<Frame>()) {
  require_usable(options);
  const bool opacities =
      cloud.rule == AmplitudeRule::kOpacity || cloud.rule == AmplitudeRule::kCompensated;
  if (!opacities && options.profile != GaussianProfile::kExact) {
    throw_usage("densities are drawn by the profile exact alone");
  }
  if (cloud.size() > UINT32_MAX) {
    throw Error(ErrorKind::kInput, "more than 2^32 Gaussians");
  }
}

GaussianRenderer::~GaussianRenderer() = default;

Image GaussianRenderer::render(const Camera& camera, GaussianStatistics* statistics) {
  const Timer timer;
  GaussianStatistics stats;
  auto lap = [&, before = 0.0]() mutable {
    const double now = timer.milliseconds();
    const double taken = now - before;
    before = now;
    return taken;
  };
  const GaussianView view = gaussian_view(cloud_, camera, options_);
  const TileGrid grid(camera);
  Frame& frame = *frame_;
  frame.project(view, cloud_);
  stats.project_ms = lap();
  frame.sort();
  stats.sort_ms = lap();
  frame.list(grid);
  stats.list_ms = lap();

  Image image = rgba_image(camera.width, camera.height);
  if (options_.depth) {
    image.channels.insert(image.channels.end(), {"Z", "Z.mean"});
    image.data.resize(image.channels.size() * static_cast<std::size_t>(camera.width) *
                      static_cast<std::size_t>(camera.height));
  }
  GaussianOutput out{.pixels = image.data.data(),
                     .width = camera.width,
                     .height = camera.height,
                     .channels = image.channel_count(),
                     .background = {},
                     .display = options_.display};
  const std::array<float, 4>& background = options_.background;
  for (std::size_t c = 0; c < 3; ++c) {
    out.background[c] = linear_to_srgb(background[c]) * background[3];
  }
  out.background[3] = background[3];
  parallel_for(grid.size(), 4, [&](std::size_t begin, std::size_t end, int worker) {
    GaussianTile tile;
    for (std::size_t number = begin; number < end; ++number) {
      const std::size_t first = number == 0 ? 0 : frame.tile_end[number - 1];
      const int x0 = static_cast<int>(number) % grid.columns * kGaussianTile;
      const int y0 = static_cast<int>(number) / grid.columns * kGaussianTile;
      const GaussianTileJob job{
          .view = &view,
          .splats = frame.splats.data(),
          .perspective = frame.perspective.empty() ? nullptr : frame.perspective.data(),
          .order = frame.lists.data() + first,
          .count = frame.tile_end[number] - first,
          .x0 = x0,
          .y0 = y0,
          .depth = options_.depth};
      draw_gaussian_tile(job, frame.scratch[worker], tile);
      write_gaussian_tile(tile, x0, y0, out);
    }
  });
  stats.raster_ms = lap();
  stats.splats = frame.order.size();
  stats.pairs = frame.tile_end.empty() ? 0 : frame.tile_end.back();
  stats.milliseconds = timer.milliseconds();
  if (statistics) *statistics = stats;
  return image;
}

}  // namespace surfel
