#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <fmt/format.h>
#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/base/timing.h>
#include <surfel/gaussian/gaussian_projection.h>
#include <surfel/gaussian/gaussian_raster.h>
#include <surfel/gaussian/gaussian_renderer.h>
#include <surfel/gaussian/sample_filter.h>

namespace surfel {
namespace {

constexpr std::size_t kProjectionGrain = 2048;
/// Ranges in which splats are counted by tiles, at most: each has a counter for every tile.
constexpr std::size_t kMostListRanges = 64;
constexpr std::size_t kLeastListRange = 4096;
constexpr std::size_t kSortRanges = 16;
/// A raster reads lists by whole vectors.
constexpr std::size_t kListSpare = 16;

/// The first and the last tiles that a splat meets.
struct TileBox {
  std::uint16_t x0, y0, x1, y1;

  explicit TileBox(const GaussianSplat& s)
      : x0(s.x0 / kGaussianTile),
        y0(s.y0 / kGaussianTile),
        x1(s.x1 / kGaussianTile),
        y1(s.y1 / kGaussianTile) {}
  TileBox() = default;
};

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
  void for_each(const TileBox& box, const Body& body) const {
    for (std::size_t row = box.y0; row <= box.y1; ++row) {
      const std::size_t first = row * static_cast<std::size_t>(columns);
      for (std::size_t column = box.x0; column <= box.x1; ++column) body(first + column);
    }
  }
};

/// Standard deviation of the filter of each sample of a pixel, samples: kernels that are smaller
/// would hardly ever be met. Less than the least GaussianOptions::lowpass where a pixel has two.
constexpr double kSampleLowpass = 0.15;

int samples_of(const GaussianCloud& cloud, const GaussianOptions& options) {
  if (options.profile != GaussianProfile::kExact) return 1;
  if (options.samples > 0) return options.samples;
  return cloud.rule == AmplitudeRule::kDensity ? 2 : 1;
}

/// The camera of a picture that is `times` as large.
Camera magnified(Camera camera, int times) {
  const int most = Camera::kMostSide / times;
  if (camera.width > most || camera.height > most) {
    throw_usage(
        fmt::format("pictures of {} samples a pixel along each axis have at most {} pixels "
                    "along a side; set a smaller size, or fewer samples",
                    times, most));
  }
  camera.width *= times;
  camera.height *= times;
  camera.rows = {camera.rows.begin * times, std::min(Camera::kMostSide, camera.rows.end * times)};
  for (double* length : {&camera.focal_x, &camera.focal_y, &camera.center_x, &camera.center_y}) {
    *length *= times;
  }
  return camera;
}

void set_background(const GaussianOptions& options, GaussianOutput& out) {
  const std::array<float, 4>& background = options.background;
  for (std::size_t c = 0; c < 3; ++c) {
    out.background[c] = linear_to_srgb(background[c]) * background[3];
  }
  out.background[3] = background[3];
}

/// Place of a tile's pixel in GaussianTile.
int gaussian_tile_pixel(int x, int y) {
  constexpr int kPatch = 4;
  const int patch = y / kPatch * (kGaussianTile / kPatch) + x / kPatch;
  return patch * kPatch * kPatch + y % kPatch * kPatch + x % kPatch;
}

}  // namespace

struct GaussianRenderer::Frame {
  Array<GaussianSplat> splats;  ///< In ranges of kProjectionGrain Gaussians, each with gaps after.
  Array<GaussianPerspective> perspective;
  Array<std::uint32_t> keys;
  std::vector<std::size_t> range_count;
  /// A splat and what it is ordered by.
  struct Ordered {
    std::uint32_t key, splat;
  };
  Array<Ordered> order, spare;
  Array<TileBox> boxes;               ///< Of the splats in their order.
  std::vector<std::uint32_t> counts;  ///< By range of `order` and bucket.
  std::vector<std::size_t> tile_end;
  Array<std::uint32_t> lists;
  PerWorker<GaussianScratch> scratch;

  void project(const GaussianView& view, const GaussianCloud& cloud);
  void sort();
  void list(const TileGrid& grid);
  void draw(const GaussianView& view, const TileGrid& grid, int begin, int end,
            const GaussianOutput& out);
  void draw_filtered(const GaussianView& view, const TileGrid& grid, const RowRange& rows,
                     int per_pixel, const SampleFilter& filter, const GaussianOutput& out);
  std::size_t gaussian_of(const GaussianView& view, const GaussianCloud& cloud,
                          std::uint32_t splat) const;
  template <class Tell>
  std::size_t start_of_each(std::size_t ranges, std::size_t buckets, const Tell& tell);
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

/// The Gaussian that a splat is of.
std::size_t GaussianRenderer::Frame::gaussian_of(const GaussianView& view,
                                                 const GaussianCloud& cloud,
                                                 std::uint32_t splat) const {
  // Each Gaussian of a range that is seen has one splat there, in the order of the Gaussians.
  std::size_t before = splat % kProjectionGrain;
  for (std::size_t i = splat - before;; ++i) {
    GaussianSplat one;
    GaussianPerspective in_perspective;
    std::uint32_t key = 0;
    const std::size_t seen = project_gaussians(
        view, cloud, i, i + 1, &one, perspective.empty() ? nullptr : &in_perspective, &key);
    if (seen > 0 && before-- == 0) return i;
  }
}

/// Orders the splats by their keys, and by the Gaussians' numbers where keys are equal: a radix
/// sort whose passes each thread makes over ranges of its own, so that it stays stable.
void GaussianRenderer::Frame::sort() {
  constexpr int kBits = 11;
  constexpr std::size_t kBuckets = std::size_t{1} << kBits;
  std::vector<std::size_t> first(range_count.size() + 1, 0);
  std::partial_sum(range_count.begin(), range_count.end(), first.begin() + 1);
  const std::size_t seen = first.back();
  order.resize(seen);
  spare.resize(seen);
  parallel_each(range_count.size(), 8, [&](std::size_t range) {
    const std::size_t from = range * kProjectionGrain;
    for (std::size_t i = 0; i < range_count[range]; ++i) {
      order[first[range] + i] = {keys[from + i], static_cast<std::uint32_t>(from + i)};
    }
  });
  const std::size_t grain = std::max(kLeastListRange, (seen + kSortRanges - 1) / kSortRanges);
  const std::size_t ranges = (seen + grain - 1) / grain;
  for (int shift = 0; shift < 32; shift += kBits) {
    counts.assign(ranges * kBuckets, 0);
    const auto bucket_of = [shift](const Ordered& o) { return o.key >> shift & (kBuckets - 1); };
    parallel_for(seen, grain, [&](std::size_t begin, std::size_t end, int) {
      std::uint32_t* const count = counts.data() + begin / grain * kBuckets;
      for (std::size_t i = begin; i < end; ++i) ++count[bucket_of(order[i])];
    });
    start_of_each(ranges, kBuckets, [](std::size_t, std::size_t) {});
    parallel_for(seen, grain, [&](std::size_t begin, std::size_t end, int) {
      std::uint32_t* const next = counts.data() + begin / grain * kBuckets;
      for (std::size_t i = begin; i < end; ++i) spare[next[bucket_of(order[i])]++] = order[i];
    });
    order.swap(spare);
  }
}

/// Makes of `counts`, by range and bucket, where each begins when buckets follow one another.
/// \param tell  gets the end of each bucket.
template <class Tell>
std::size_t GaussianRenderer::Frame::start_of_each(std::size_t ranges, std::size_t buckets,
                                                   const Tell& tell) {
  std::size_t total = 0;
  for (std::size_t bucket = 0; bucket < buckets; ++bucket) {
    for (std::size_t range = 0; range < ranges; ++range) {
      std::uint32_t& count = counts[range * buckets + bucket];
      const std::uint32_t here = count;
      count = static_cast<std::uint32_t>(total);
      total += here;
    }
    tell(bucket, total);
  }
  return total;
}

/// Lists the splats of every tile, in their order.
void GaussianRenderer::Frame::list(const TileGrid& grid) {
  const std::size_t seen = order.size();
  const std::size_t tiles = grid.size();
  const std::size_t grain =
      std::max(kLeastListRange, (seen + kMostListRanges - 1) / kMostListRanges);
  const std::size_t ranges = (seen + grain - 1) / grain;
  counts.assign(ranges * tiles, 0);
  boxes.resize(seen);
  parallel_for(seen, grain, [&](std::size_t begin, std::size_t end, int) {
    constexpr std::size_t kAhead = 16;
    std::uint32_t* const count = counts.data() + begin / grain * tiles;
    for (std::size_t i = begin; i < end; ++i) {
      if (i + kAhead < end) __builtin_prefetch(&splats[order[i + kAhead].splat].x0);
      boxes[i] = TileBox(splats[order[i].splat]);
      grid.for_each(boxes[i], [&](std::size_t tile) { ++count[tile]; });
    }
  });
  tile_end.resize(tiles);
  const std::size_t total = start_of_each(
      ranges, tiles, [&](std::size_t tile, std::size_t end) { tile_end[tile] = end; });
  if (total > UINT32_MAX) {
    throw Error(ErrorKind::kInput, "more than 2^32 Gaussians meet tiles of the picture");
  }
  lists.resize(total + kListSpare);
  std::fill_n(lists.data() + total, kListSpare, 0U);
  parallel_for(seen, grain, [&](std::size_t begin, std::size_t end, int) {
    std::uint32_t* const next = counts.data() + begin / grain * tiles;
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t splat = order[i].splat;
      grid.for_each(boxes[i], [&](std::size_t tile) { lists[next[tile]++] = splat; });
    }
  });
}

GaussianRenderer::GaussianRenderer(const GaussianCloud& cloud, const GaussianOptions& options)
    : cloud_(cloud), options_(options), frame_(std::make_unique<Frame>()) {
  require_usable(options);
  const GaussianProfile profile = options.profile;
  if (cloud.rule == AmplitudeRule::kSurfel && profile != GaussianProfile::kSurfel) {
    throw_usage("samples of a surface are drawn by the profile surfel alone");
  }
  if (!cloud.tree.empty()) {
    throw_usage(
        "the Gaussians are levels of detail, all of them together; draw a cut (gaussian_cut.h)");
  }
  if (cloud.rule == AmplitudeRule::kDensity && profile != GaussianProfile::kExact) {
    throw_usage("densities are drawn by the profile exact alone");
  }
  // Splats are addressed by 32 bits that count floats.
  constexpr std::size_t kMostGaussians = (std::size_t{1} << 31) / (sizeof(GaussianSplat) / 4) - 1;
  if (cloud.size() > kMostGaussians) {
    throw Error(ErrorKind::kInput, "more than 2^27 Gaussians; leave some out");
  }
}

GaussianRenderer::~GaussianRenderer() = default;

/// Draws rows [begin, end) of the grid's tiles, whose first pixel row is row 0 of `out`.
void GaussianRenderer::Frame::draw(const GaussianView& view, const TileGrid& grid, int begin,
                                   int end, const GaussianOutput& out) {
  const auto columns = static_cast<std::size_t>(grid.columns);
  const std::size_t first_tile = static_cast<std::size_t>(begin) * columns;
  const std::size_t count = static_cast<std::size_t>(end - begin) * columns;
  parallel_for(count, 4, [&](std::size_t from, std::size_t to, int worker) {
    GaussianTile tile;
    for (std::size_t i = from; i < to; ++i) {
      const std::size_t number = first_tile + i;
      const std::size_t first = number == 0 ? 0 : tile_end[number - 1];
      const int x0 = static_cast<int>(number % columns) * kGaussianTile;
      const int y0 = static_cast<int>(number / columns) * kGaussianTile;
      const GaussianTileJob job{.view = &view,
                                .splats = splats.data(),
                                .perspective = perspective.empty() ? nullptr : perspective.data(),
                                .order = lists.data() + first,
                                .count = tile_end[number] - first,
                                .x0 = x0,
                                .y0 = y0,
                                .depth = out.channels > 4};
      draw_gaussian_tile(job, scratch[worker], tile);
      write_gaussian_tile(tile, x0, y0 - begin * kGaussianTile, out);
    }
  });
}

/// Draws a picture of samples, some rows of tiles at a time, and filters it.
/// \param rows  of pixels.
void GaussianRenderer::Frame::draw_filtered(const GaussianView& view, const TileGrid& grid,
                                            const RowRange& rows, int per_pixel,
                                            const SampleFilter& filter, const GaussianOutput& out) {
  constexpr int kBand = 4;  // Rows of tiles.
  constexpr int kBandRows = kBand * kGaussianTile;
  const int bands_kept = (2 * filter.reach() + per_pixel + kBandRows - 1) / kBandRows + 1;
  SampleRows kept{.samples = {},
                  .width = view.width,
                  .height = view.height,
                  .rows = bands_kept * kBandRows,
                  .channels = out.channels};
  const std::size_t row_size =
      static_cast<std::size_t>(kept.width) * static_cast<std::size_t>(kept.channels);
  kept.samples.resize(row_size * static_cast<std::size_t>(kept.rows));
  PerWorker<std::vector<float>> columns;
  int done = rows.begin;
  const int first_seen = std::max(0, rows.begin * per_pixel - filter.reach()) / kBandRows * kBand;
  for (int begin = first_seen; begin < grid.rows && done < rows.end; begin += kBand) {
    const int end = std::min(grid.rows, begin + kBand);
    const int first = begin * kGaussianTile % kept.rows;
    draw(view, grid, begin, end,
         {.pixels = kept.samples.data() + static_cast<std::size_t>(first) * row_size,
          .width = kept.width,
          .height = std::min(kBandRows, kept.height - begin * kGaussianTile),
          .channels = kept.channels,
          .background = {},
          .display = true});
    // Rows of pixels whose filter does not reach beyond what is drawn.
    const int ready =
        end == grid.rows
            ? rows.end
            : std::clamp((end * kGaussianTile - filter.reach()) / per_pixel, done, rows.end);
    parallel_for(static_cast<std::size_t>(ready - done), 1,
                 [&](std::size_t from, std::size_t to, int worker) {
                   for (std::size_t i = from; i < to; ++i) {
                     filter.write_row(kept, done + static_cast<int>(i), out, columns[worker]);
                   }
                 });
    done = ready;
  }
}

Image GaussianRenderer::render(const Camera& camera, GaussianFrameStatistics* statistics) {
  const Timer timer;
  GaussianFrameStatistics stats;
  StageTimer stage(stats.stages);
  const int per_pixel = samples_of(cloud_, options_);
  const Camera sampled = magnified(camera, per_pixel);
  GaussianOptions options = options_;
  if (per_pixel > 1) options.lowpass = kSampleLowpass;
  const GaussianView view = gaussian_view(cloud_, sampled, options);
  const TileGrid grid(sampled);
  Frame& frame = *frame_;
  frame.project(view, cloud_);
  stage.end("project");
  frame.sort();
  stage.end("sort");
  frame.list(grid);
  stage.end("list");

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
  set_background(options_, out);
  const RowRange rows = camera.drawn_rows();
  if (per_pixel == 1) {
    GaussianOutput drawn = out;
    const int begin = rows.begin / kGaussianTile;
    drawn.pixels = image.pixel(0, begin * kGaussianTile);
    drawn.height -= begin * kGaussianTile;
    frame.draw(view, grid, begin, (rows.end + kGaussianTile - 1) / kGaussianTile, drawn);
  } else {
    const double remaining =
        portable::squared(options_.lowpass) - portable::squared(options.lowpass / per_pixel);
    frame.draw_filtered(view, grid, rows, per_pixel, SampleFilter(per_pixel, std::sqrt(remaining)),
                        out);
  }
  stage.end("raster");
  stats.splats = frame.order.size();
  stats.pairs = frame.tile_end.empty() ? 0 : frame.tile_end.back();
  stats.milliseconds = timer.milliseconds();
  if (statistics) *statistics = stats;
  return image;
}

PixelExplanation GaussianRenderer::explain(const Camera& camera, int x, int y) {
  require_in_picture(camera, x, y);
  if (samples_of(cloud_, options_) > 1) {
    throw_usage("a pixel of several samples is the mean of many sums; set `samples` to 1");
  }
  const GaussianView view = gaussian_view(cloud_, camera, options_);
  const TileGrid grid(camera);
  Frame& frame = *frame_;
  frame.project(view, cloud_);
  frame.sort();
  frame.list(grid);
  const std::size_t number = static_cast<std::size_t>(y / kGaussianTile * grid.columns) +
                             static_cast<std::size_t>(x / kGaussianTile);
  const std::size_t first = number == 0 ? 0 : frame.tile_end[number - 1];
  GaussianTileJob job{.view = &view,
                      .splats = frame.splats.data(),
                      .perspective = frame.perspective.empty() ? nullptr : frame.perspective.data(),
                      .order = frame.lists.data() + first,
                      .count = frame.tile_end[number] - first,
                      .x0 = x / kGaussianTile * kGaussianTile,
                      .y0 = y / kGaussianTile * kGaussianTile,
                      .depth = false};
  const auto pixel = static_cast<std::size_t>(gaussian_tile_pixel(x - job.x0, y - job.y0));
  GaussianScratch& scratch = frame.scratch[0];
  GaussianTile tile;
  PixelExplanation out;
  out.x = x;
  out.y = y;
  out.display = true;

  // The splats whose boxes hold the pixel, and what each is there alone.
  std::vector<GaussianSplat> splats;
  std::vector<GaussianPerspective> perspective;
  std::array<std::uint32_t, kListSpare> only{};
  for (std::size_t i = 0; i < job.count; ++i) {
    const std::uint32_t index = job.order[i];
    const GaussianSplat& splat = job.splats[index];
    if (x < splat.x0 || x > splat.x1 || y < splat.y0 || y > splat.y1) continue;
    splats.push_back(splat);
    if (job.perspective) perspective.push_back(job.perspective[index]);
    GaussianTileJob one = job;
    one.splats = &splats.back();
    one.perspective = job.perspective ? &perspective.back() : nullptr;
    one.order = only.data();
    one.count = 1;
    draw_gaussian_tile(one, scratch, tile);
    ExplainedSplat& said = out.splats.emplace_back();
    said.surfel = frame.gaussian_of(view, cloud_, index);
    said.exact = job.perspective != nullptr;
    said.depth = splat.z;
    said.coefficient = std::min(1.0, portable::pow(2.0, static_cast<double>(splat.log_opacity)));
    said.weight = 1 - static_cast<double>(tile.transmittance[pixel]);
    said.kernel = said.coefficient > 0 ? said.weight / said.coefficient : 0;
    said.alpha = said.weight;
    said.color = {splat.red, splat.green, splat.blue};
    said.fate = said.weight > 0 ? SplatFate::kHidden : SplatFate::kOutside;
  }

  draw_gaussian_tile(job, scratch, tile);
  const std::array<const float*, 3> sums{tile.red, tile.green, tile.blue};
  for (std::size_t c = 0; c < 3; ++c) out.surfaces[static_cast<Eigen::Index>(c)] = sums[c][pixel];
  out.alpha = 1 - static_cast<double>(tile.transmittance[pixel]);
  Image image = rgba_image(camera.width, kGaussianTile);
  GaussianOutput output{.pixels = image.data.data(),
                        .width = camera.width,
                        .height = kGaussianTile,
                        .channels = 4,
                        .background = {},
                        .display = options_.display};
  set_background(options_, output);
  write_gaussian_tile(tile, job.x0, 0, output);
  std::copy_n(image.pixel(x, y - job.y0), 4, out.pixel.begin());
  std::copy_n(output.background, 4, out.background.begin());

  // Units of colour in three splats at a time: the pixel has so much of each.
  std::vector<std::uint32_t> order(splats.size() + kListSpare);
  std::iota(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(splats.size()), 0U);
  job.splats = splats.data();
  job.perspective = job.perspective ? perspective.data() : nullptr;
  job.order = order.data();
  job.count = splats.size();
  constexpr std::array<float GaussianSplat::*, 3> kColors{
      &GaussianSplat::red, &GaussianSplat::green, &GaussianSplat::blue};
  for (GaussianSplat& splat : splats) splat.red = splat.green = splat.blue = 0;
  for (std::size_t begin = 0; begin < splats.size(); begin += kColors.size()) {
    const std::size_t count = std::min(kColors.size(), splats.size() - begin);
    for (std::size_t i = 0; i < count; ++i) splats[begin + i].*kColors[i] = 1;
    draw_gaussian_tile(job, scratch, tile);
    for (std::size_t i = 0; i < count; ++i) {
      ExplainedSplat& said = out.splats[begin + i];
      said.share = sums[i][pixel];
      if (said.share > 0) said.fate = SplatFate::kBlended;
      splats[begin + i].*kColors[i] = 0;
    }
  }
  return out;
}

}  // namespace surfel
