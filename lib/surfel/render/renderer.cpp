#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <span>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/plain_pixels.h>
#include <surfel/render/renderer.h>
#include <surfel/render/shading.h>
#include <surfel/render/splat.h>
#include <surfel/render/splat_lists.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/depth_peel.h>
#include <surfel/sp06/group_raster.h>
#include <surfel/sp06/layer_blend.h>
#include <surfel/store/cloud_stream.h>

namespace surfel {
namespace {

/// Standard deviation of the low-pass filter that stands for none, pixels: an edge-on disc keeps a
/// width.
constexpr double kNoLowpass = 1e-3;
/// How far the discs of layers that are not interpolated reach beyond their rim, pixels: as little
/// as lets every disc meet a pixel's centre.
constexpr double kLayerReach = 0.5;
/// Most steps of (6): they and a fraction fit a float.
constexpr double kMostSteps = 1 << 20;

/// Scratch memory of one worker.
struct Worker {
  Array<float> a_buffer;
  GroupImages images;
  LayerScratch layers;
  PeelScratch peel;
  std::vector<NearestLayer> nearest;
  MergeStatistics merges;
  PeelStatistics peeled;
  std::uint64_t culled = 0;
};

/// Of the clusters that a band shows, some that are drawn together: are they the first, the last?
struct Batch {
  bool first = true;
  bool last = true;
};

double lowpass_of(const RenderOptions& options) {
  return options.filter == Filter::kNone ? kNoLowpass : options.lowpass;
}

bool needs_groups(Method method) {
  return method == Method::kDeferred || method == Method::kTransparent ||
         method == Method::kTransparentHigh;
}

bool blends_layers(Method method) {
  return method == Method::kTransparent || method == Method::kTransparentHigh;
}

}  // namespace

RenderColumns columns_of(Method method) {
  return {.groups = needs_groups(method),
          .group_radius = blends_layers(method),
          .copies = blends_layers(method)};
}

std::vector<std::string> RenderOptions::problems() const {
  std::vector<std::string> found;
  const auto check = [&](bool ok, const std::string& message) {
    if (!ok) found.push_back(message);
  };
  check(cutoff >= 0.1 && cutoff <= 16, fmt::format("cutoff is {}; it must be in 0.1..16", cutoff));
  check(lowpass >= 0.1 && lowpass <= 16,
        fmt::format("lowpass is {}; it must be in 0.1..16 pixels", lowpass));
  check(kernel_tolerance > 0 && kernel_tolerance <= 1e6,
        fmt::format("kernel-tolerance is {}; it must be in (0, 1e6] pixels", kernel_tolerance));
  check(kernel != Kernel::kPerspective || filter != Filter::kCircular,
        "the circular filter has an affine kernel only; leave out --kernel perspective");
  check(peel >= 1 && peel <= kMostLayers,
        fmt::format("peel is {}; it must be in 1..{}", peel, kMostLayers));
  check(!aovs || !blends_layers(method),
        "depth and normals are not made by the transparent methods; leave them out");
  check(layers >= 1 && layers <= kMostLayers,
        fmt::format("layers is {}; it must be in 1..{}", layers, kMostLayers));
  check(depth_epsilon > 0 && depth_epsilon <= 1e6,
        fmt::format("depth-epsilon is {}; it must be in (0, 1e6]", depth_epsilon));
  check(!coverage_threshold || (*coverage_threshold > 0 && *coverage_threshold <= 1e6),
        fmt::format("coverage-threshold is {}; it must be in (0, 1e6]",
                    coverage_threshold.value_or(0)));
  check(!lod_error || (*lod_error >= 0 && *lod_error <= 1000),
        fmt::format("lod-error is {}; it must be in 0..1000 pixels", lod_error.value_or(0)));
  check(batch >= RenderCloud::kClusterSize && batch <= (std::size_t{1} << 27),
        fmt::format("batch is {}; it must be in 256..2^27", batch));
  check(std::all_of(background.begin(), background.end(),
                    [](float v) { return std::isfinite(v) && v >= 0; }) &&
            background[3] <= 1,
        "background must be four numbers >= 0, alpha at most 1");
  return found;
}

struct Renderer::Impl {
  const RenderCloud& cloud;
  CloudStream* stream = nullptr;  ///< Where the cloud's columns come from, or null.
  const Scene& scene;
  RenderOptions options;
  float full_weight, edge_weight;  ///< See TileABuffer.
  bool opaque;
  ABufferLayout layout;

  // Kept from frame to frame: nothing is allocated in a turntable's later frames.
  std::vector<Worker> workers;
  std::optional<SplatLists> surfaces;  ///< Splats that are interpolated.
  std::optional<SplatLists> blended;   ///< Splats of layers that are blended.
  Array<float> a_buffer;               ///< Of all tiles of a band, where it takes several batches.

  Impl(const RenderCloud& c, const Scene& s, const RenderOptions& o)
      : cloud(c), scene(s), options(o) {
    for (const std::string& problem : options.problems()) throw_usage(problem);
    full_weight =
        static_cast<float>(options.coverage_threshold.value_or(coverage_threshold(options.cutoff)));
    // Kernels have the volume a_k, of which the part within beta < c is 1 - exp(-c): the mean sum.
    // Where the pixel filter evens the sums out, all but few are above this.
    const auto mean = static_cast<float>(1 - std::exp(-options.cutoff));
    edge_weight = options.coverage_threshold ? full_weight : mean - (mean - full_weight) / 4;
    opaque = !cloud.transparent();
    if (!cloud.material.empty()) {
      for (const Material& m : scene.materials) opaque = opaque && m.opacity >= 1;
    } else {
      opaque = opaque && scene.materials.front().opacity >= 1;
    }
    layout.layers = layers_of(options);
    layout.normals = options.lit || options.aovs;
    layout.opaque = opaque;
    const bool groups = needs_groups(options.method);
    if (groups && cloud.size() > 0 && cloud.groups() == 0) {
      throw_input("", "the surfels have no groups; run surfel-group on them");
    }
    if (groups && !cloud.tree().empty()) {
      throw_usage("levels of detail have no groups; use --lod off with methods that need them");
    }
    if (options.method == Method::kDeferred && !opaque) {
      throw_usage(
          "--method deferred draws the nearest surface alone, and the surfels or their materials "
          "are transparent; use --method transparent-high");
    }
    if (options.method != Method::kTransparent) {
      surfaces.emplace(
          cloud, scene, options,
          SplatListOptions{
              .normals = layout.normals,
              .groups = groups,
              .opaque = opaque,
              .order = options.method == Method::kABuffer ? DepthOrder::kCoarse : DepthOrder::kFine,
              .lowpass = lowpass_of(options)});
    }
    if (blends_layers(options.method)) {
      blended.emplace(cloud, scene, options,
                      SplatListOptions{.normals = layout.normals,
                                       .groups = true,
                                       .opaque = opaque,
                                       .enlarged = !cloud.group_radius.empty(),
                                       .lowpass = kLayerReach / std::sqrt(2 * options.cutoff)});
    }
  }

  static int layers_of(const RenderOptions& options) {
    switch (options.method) {
      case Method::kABuffer:
        break;
      case Method::kDeferred:
        // The layers of different groups can be more surfaces than each has, at rims above all.
        return options.layers == 1 ? 1 : std::min(kMostLayers, 2 * options.layers);
      case Method::kDepthPeel:
        return options.peel;
      case Method::kTransparent:
      case Method::kTransparentHigh:
        return 1;
    }
    return options.layers;
  }

  /// The splats of a tile must all be there at once.
  bool whole_tiles() const { return options.method != Method::kABuffer; }
  /// Either list has the same blocks.
  SplatLists& any_lists() { return surfaces ? *surfaces : *blended; }

  LayerRule layer_rule(const Camera& camera) const;
  int band_rows(const Camera& camera, int y0) const;
  void rasterize(const Camera& camera, const Band& band, const BlockGrid& grid, const Batch& batch,
                 const Shader& shader, Image& image);
  void draw_block(const Band& band, const BlockGrid& grid, std::size_t block, const Batch& batch,
                  const LayerRule& rule, TileABuffer& tile, Image& image, int w);
  void draw(TileABuffer& tile, int x, int y, const LayerRule& rule, Worker& worker, int w);
  void resolve(TileABuffer& tile, const std::vector<BlendedPixel>* behind, Image& image) const;
};

Renderer::Renderer(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options)
    : impl_(std::make_unique<Impl>(cloud, scene, options)) {}
Renderer::Renderer(CloudStream& stream, const Scene& scene, const RenderOptions& options)
    : impl_(std::make_unique<Impl>(stream.cloud(), scene, options)) {
  if (impl_->whole_tiles()) {
    throw_usage(
        "only --method abuffer draws surfels that do not fit into --memory; the other methods need "
        "all of a tile at once");
  }
  impl_->stream = &stream;
}
Renderer::~Renderer() = default;

/// Rows of the picture to draw together, from y0 on: all, unless their A-buffers are to be kept and
/// take too much memory.
int Renderer::Impl::band_rows(const Camera& camera, int y0) const {
  const int rows = camera.height - y0;
  if (!stream) return rows;
  const std::size_t tile_row = layout.size() * sizeof(float) * tiles_along(camera.width);
  const std::size_t most = std::max<std::size_t>(1, stream->picture_bytes() / tile_row);
  return static_cast<int>(std::min<std::size_t>(rows, most * kTileSize));
}

/// SP06 (6): n is the least that its text allows, (d_max - d_min) / epsilon, with the footprint of
/// the mean surfel at the scene's centre for the epsilon that the paper takes as given.
LayerRule Renderer::Impl::layer_rule(const Camera& camera) const {
  double nearest = std::numeric_limits<double>::infinity();
  double farthest = -nearest;
  for (const Cluster& cluster : cloud.clusters()) {
    const Vec3d p =
        camera.camera_from_world * (cloud.origin() - camera.eye + cluster.center.cast<double>());
    nearest = std::min(nearest, p.z() - cluster.radius - cluster.max_deviation);
    farthest = std::max(farthest, p.z() + cluster.radius + cluster.max_deviation);
  }
  LayerRule rule{.voronoi = options.voronoi, .orthographic = camera.orthographic};
  if (!camera.orthographic) nearest = std::max(nearest, camera.near);
  if (!(farthest > nearest)) return rule;
  const double z = camera.orthographic ? 1 : (nearest + farthest) / 2;
  const double epsilon = options.epsilon_share() * std::sqrt(2 * options.cutoff) *
                         (cloud.mean_deviation() + lowpass_of(options) * z / camera.focal_y);
  const double n = std::clamp(std::ceil((farthest - nearest) / epsilon), 1.0, kMostSteps);
  rule.nearest = static_cast<float>(nearest);
  rule.steps_per_unit = static_cast<float>(n / (farthest - nearest));
  return rule;
}

/// Rasterises the splats of a tile of the loaded block by the method, all of them but in the
/// A-buffer.
void Renderer::Impl::draw(TileABuffer& tile, int x, int y, const LayerRule& rule, Worker& worker,
                          int w) {
  const auto composite = [&](const TileJob& job) {
    worker.images.reset(cloud.groups(), options.method == Method::kDeferred ? options.layers : 1);
    rasterize_groups(job, rule, tile, worker.images);
    composite_groups(job, worker.images, tile);
  };
  const auto blend = [&](const NearestLayer* masked) {
    worker.culled +=
        blend_layers(blended->job(x, y, w), rule, cloud.groups(), masked, tile, worker.layers);
  };
  switch (options.method) {
    case Method::kABuffer:
      rasterize_tile(surfaces->job(x, y, w), tile);
      break;
    case Method::kDepthPeel:
      worker.peeled.add(peel_tile(surfaces->job(x, y, w), worker.peel, tile));
      break;
    case Method::kDeferred:
      composite(surfaces->job(x, y, w));
      break;
    case Method::kTransparent:
      blend(nullptr);
      break;
    case Method::kTransparentHigh:
      composite(surfaces->job(x, y, w));
      if (tile.shader->has_environment()) filter_normals(tile, worker.layers);
      worker.nearest.resize(kTilePixels);
      for (int pixel = 0; pixel < kTilePixels; ++pixel) {
        worker.nearest[pixel] = nearest_layer(tile, pixel);
      }
      blend(worker.nearest.data());
      break;
  }
}

void Renderer::Impl::resolve(TileABuffer& tile, const std::vector<BlendedPixel>* behind,
                             Image& image) const {
  const std::array<float, 4>& b = options.background;
  const Rgba background{b[0] * b[3], b[1] * b[3], b[2] * b[3], b[3]};
  std::optional<PlainPixels> plain;
  if (!options.aovs && !behind && !tile.shader->has_environment()) {
    plain = resolve_plain_pixels(tile, tile.shader->lighting(), background);
  }
  // What a pixel without fragments shows, where that is the same for all.
  std::optional<std::vector<float>> nothing;
  if (!behind && !tile.shader->has_environment()) {
    nothing = {background.red, background.green, background.blue, background.alpha};
    if (options.aovs) {
      constexpr float kInfinity = std::numeric_limits<float>::infinity();
      nothing->insert(nothing->end(), {kInfinity, kInfinity, 0, 0, 0, 0});
    }
  }
  const auto resolve_one = [&](int pixel, float* out) {
    if (nothing && tile.at(0, kWeight, pixel) == 0) {
      std::copy(nothing->begin(), nothing->end(), out);
      return;
    }
    // SP06: I = alpha C_F + (1 - alpha) C_O
    const Fragment others = behind ? (*behind)[pixel].merged() : Fragment{};
    PixelResult result = resolve_pixel(tile, pixel, &others);
    result.color.composite(background);
    out[0] = result.color.red;
    out[1] = result.color.green;
    out[2] = result.color.blue;
    out[3] = result.color.alpha;
    if (options.aovs) {
      out[4] = result.depth;
      out[5] = result.depth_first;
      std::copy_n(result.normal, 3, out + 6);
      out[9] = result.weight;
    }
  };
  const std::size_t channels = image.channels.size();
  for (int y = 0; y < tile.height; ++y) {
    float* const row = image.pixel(tile.x0, tile.y0 + y);
    for (int x0 = 0; x0 < tile.width; x0 += kStripWidth) {
      // Pixels of a row of a strip follow one another in the tile as well.
      const int first = tile_pixel(x0, y);
      const int count = std::min(kStripWidth, tile.width - x0);
      if (plain && count == kStripWidth) {
        std::memcpy(row + channels * x0, &plain->color[first], sizeof(Rgba) * kStripWidth);
        const float* left = &plain->left[first];
        if (left[0] + left[1] + left[2] + left[3] == 0) continue;
      }
      for (int i = 0; i < count; ++i) {
        float* out = row + channels * (x0 + i);
        if (plain && plain->left[first + i] == 0) {
          std::memcpy(out, &plain->color[first + i], sizeof(Rgba));
        } else {
          resolve_one(first + i, out);
        }
      }
    }
  }
}

/// Sets up the splats that a block has in the batch and draws its tiles, in several parts where
/// they are very many. `tile` says what is the same for all tiles.
void Renderer::Impl::draw_block(const Band& band, const BlockGrid& grid, std::size_t block,
                                const Batch& batch, const LayerRule& rule, TileABuffer& tile,
                                Image& image, int w) {
  Worker& worker = workers[w];
  const std::size_t clusters = any_lists().clusters(block);
  if (clusters == 0 && !batch.first && !batch.last) return;
  const std::size_t part = whole_tiles() ? std::max<std::size_t>(1, clusters)
                                         : options.batch / RenderCloud::kClusterSize;
  const int first_x = grid.first_tile_x(block);
  const int first_y = grid.first_tile_y(block);
  const int tiles_x = std::min(1 << grid.shift, band.tiles_x - first_x);
  const int tiles_y = std::min(1 << grid.shift, band.tiles_y - first_y);
  // A-buffers stay from batch to batch, or from part to part; else one serves all tiles.
  const bool batches = !(batch.first && batch.last);
  const bool parts = clusters > part;
  if (!batches) worker.a_buffer.resize(layout.size() * (parts ? tiles_x * tiles_y : 1));
  const auto buffer = [&](int x, int y) {
    if (batches) return a_buffer.data() + layout.size() * band.tile(first_x + x, first_y + y);
    return worker.a_buffer.data() + layout.size() * (parts ? y * tiles_x + x : 0);
  };
  for (std::size_t begin = 0; begin == 0 || begin < clusters; begin += part) {
    const std::size_t end = std::min(begin + part, clusters);
    if (surfaces) surfaces->load(block, begin, end, w);
    if (blended) blended->load(block, 0, blended->clusters(block), w);
    for (int y = 0; y < tiles_y; ++y) {
      for (int x = 0; x < tiles_x; ++x) {
        tile.data = buffer(x, y);
        if (batch.first && begin == 0) std::fill_n(tile.data, layout.size(), 0.0F);
        tile.x0 = (first_x + x) * kTileSize;
        tile.y0 = band.y0 + (first_y + y) * kTileSize;
        tile.width = std::min(kTileSize, image.width - tile.x0);
        tile.height = std::min(kTileSize, band.y1 - tile.y0);
        tile.merges = {};
        draw(tile, x, y, rule, worker, w);
        if (batch.last && end == clusters) {
          resolve(tile, blended ? &worker.layers.pixels : nullptr, image);
        }
        worker.merges.add(tile.merges);
      }
    }
  }
}

void Renderer::Impl::rasterize(const Camera& camera, const Band& band, const BlockGrid& grid,
                               const Batch& batch, const Shader& shader, Image& image) {
  if (batch.first && !batch.last) a_buffer.resize(layout.size() * band.tiles());
  const LayerRule rule = needs_groups(options.method) ? layer_rule(camera) : LayerRule{};
  // Those with most to do first, so that none is left to one thread at the end.
  std::vector<std::size_t> blocks(grid.blocks());
  std::iota(blocks.begin(), blocks.end(), std::size_t{0});
  std::stable_sort(blocks.begin(), blocks.end(), [&](std::size_t a, std::size_t b) {
    return any_lists().clusters(a) > any_lists().clusters(b);
  });
  parallel_for(blocks.size(), 1, [&](std::size_t i, std::size_t, int w) {
    const std::size_t block = blocks[i];
    TileABuffer tile;
    tile.layout = layout;
    tile.full_weight = full_weight;
    tile.edge_weight = edge_weight;
    tile.shader = &shader;
    draw_block(band, grid, block, batch, rule, tile, image, w);
  });
}

Image Renderer::render(const Camera& camera, FrameStatistics* statistics) {
  Impl& r = *impl_;
  FrameStatistics stats;
  const Timer whole;
  const Shader shader(r.options.lit ? &r.scene : nullptr, camera, lowpass_of(r.options));
  r.workers.resize(std::max<std::size_t>(r.workers.size(), thread_count()));
  for (Worker& worker : r.workers) {
    worker.merges = {};
    worker.peeled = {};
    worker.culled = 0;
  }

  Image image;
  image.width = camera.width;
  image.height = camera.height;
  image.channels = {"R", "G", "B", "A"};
  if (r.options.aovs) {
    for (const char* name : {"Z", "Z.first", "N.X", "N.Y", "N.Z", "weight"}) {
      image.channels.emplace_back(name);
    }
  }
  image.data.resize(static_cast<std::size_t>(camera.width) * camera.height * image.channels.size());

  for (int y0 = 0; y0 < camera.height;) {
    Timer timer;
    const Band band(camera, y0, y0 + r.band_rows(camera, y0));
    y0 = band.y1;
    std::vector<VisibleCluster> clusters;
    std::vector<VisibleCluster> blended;
    if (r.surfaces) clusters = r.surfaces->cull(camera, band);
    if (r.blended) blended = r.blended->cull(camera, band);
    const std::size_t seen = std::max(clusters.size(), blended.size());
    stats.clusters += seen;
    const BlockGrid grid(band, seen * RenderCloud::kClusterSize);
    stats.stages.add("cull", timer.milliseconds());
    // All clusters at once, unless they have to be fetched.
    const std::size_t size =
        r.stream ? r.stream->batch_clusters() : std::max<std::size_t>(1, clusters.size());
    for (std::size_t begin = 0; begin == 0 || begin < clusters.size(); begin += size) {
      const std::span<VisibleCluster> rest = std::span(clusters).subspan(begin);
      const auto batch = rest.first(std::min(size, rest.size()));
      if (r.stream) {
        timer.restart();
        const auto next = rest.subspan(batch.size());
        r.stream->fetch(batch);
        r.stream->expect(next.first(std::min(size, next.size())));
        stats.stages.add("read", timer.milliseconds());
      }
      timer.restart();
      if (r.surfaces) r.surfaces->bin(camera, band, grid, batch);
      if (r.blended) r.blended->bin(camera, band, grid, blended);
      stats.stages.add("cull", timer.milliseconds());
      timer.restart();
      r.rasterize(camera, band, grid,
                  {.first = begin == 0, .last = begin + batch.size() == clusters.size()}, shader,
                  image);
      stats.stages.add("raster", timer.milliseconds());
    }
  }
  MergeStatistics merges;
  PeelStatistics peeled;
  for (const Worker& worker : r.workers) {
    merges.add(worker.merges);
    peeled.add(worker.peeled);
    stats.culled += worker.culled;
  }
  for (std::optional<SplatLists>* lists : {&r.surfaces, &r.blended}) {
    if (!*lists) continue;
    stats.splats += (*lists)->take_splat_count();
    stats.exact_splats += (*lists)->take_exact_count();
  }
  stats.merged = merges.merged;
  const double all = merges.total_weight + merges.late_weight;
  stats.late_weight_share = all > 0 ? merges.late_weight / all : 0;
  stats.groups = r.cloud.groups();
  stats.peeled_layers = peeled.layers;
  stats.unpeeled_pixels = peeled.unpeeled_pixels;
  stats.milliseconds = whole.milliseconds();
  if (statistics) *statistics = stats;
  return image;
}

}  // namespace surfel
