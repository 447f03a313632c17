#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/edge_coverage.h>
#include <surfel/render/edge_search.h>
#include <surfel/render/frame.h>
#include <surfel/render/pixel_probe.h>
#include <surfel/render/plain_pixels.h>
#include <surfel/render/relief.h>
#include <surfel/render/renderer.h>
#include <surfel/render/shading.h>
#include <surfel/render/splat_lists.h>
#include <surfel/render/tile_raster.h>
#include <surfel/surface/coverage_threshold.h>

namespace surfel {
namespace {

/// Memory of one thread.
struct Worker {
  std::unique_ptr<Compositor::Worker> compositor;
  Array<float> a_buffer;
  std::vector<TileJob> jobs;
  MergeStatistics merges;
  std::uint64_t fragments = 0;  ///< See FrameStatistics.
  OpenPixels open;
};

/// A batch of clusters drawn into a frame.
struct Pass {
  const Frame& frame;
  bool first;  ///< No clusters have been drawn into the frame before.
  bool last;   ///< No clusters will be drawn into the frame after.
  Image& image;
};

bool is_opaque(const RenderCloud& cloud, const Scene& scene) {
  if (cloud.transparent()) return false;
  if (cloud.material.empty()) return scene.materials.front().opacity >= 1;
  return std::all_of(scene.materials.begin(), scene.materials.end(),
                     [](const Material& m) { return m.opacity >= 1; });
}

Rgba premultiplied(const std::array<float, 4>& b) {
  return {b[0] * b[3], b[1] * b[3], b[2] * b[3], b[3]};
}

Image blank_image(const Camera& camera, bool aovs) {
  Image image;
  image.width = camera.width;
  image.height = camera.height;
  image.channels = {"R", "G", "B", "A"};
  if (aovs) {
    for (const char* name : {"Z", "Z.first", "N.X", "N.Y", "N.Z", "weight"}) {
      image.channels.emplace_back(name);
    }
  }
  image.data.resize(static_cast<std::size_t>(camera.width) * camera.height * image.channels.size());
  return image;
}

}  // namespace

struct Renderer::Impl {
  ClusterStore& store;
  const RenderCloud& cloud;
  const Scene& scene;
  const RenderOptions options;
  std::unique_ptr<Compositor> compositor;
  TileABuffer blank_tile;  ///< The members that all tiles have in common, without the shader.

  // Kept from frame to frame: nothing is allocated in a turntable's later frames.
  PerWorker<Worker> workers{[this] {
    auto worker = std::make_unique<Worker>();
    worker->compositor = compositor->make_worker();
    return worker;
  }};
  std::vector<SplatLists> lists;  ///< Parallel to Compositor::lists().
  /// A-buffers of all tiles of a band, where it takes several batches.
  Array<float> a_buffer;
  TileRims rims;             ///< Borders of all tiles of a band.
  NearnessPicture nearness;  ///< Of pictures with relief.
  EdgeFilter edge_filter;
  std::optional<EdgeCoverage> edges;  ///< Of opaque pictures.
  PixelProbe* probe = nullptr;        ///< Null: no pixel is explained.

  Impl(ClusterStore& st, const Scene& sc, const RenderOptions& o)
      : store(st),
        cloud(st.cloud()),
        scene(sc),
        options(o),
        edge_filter(o.cutoff, o.filter_deviation()) {
    require_usable(options);
    require_usable(scene);
    const CompositingMethod& method = options.compositing();
    if (!store.resident() && method.needs_whole_tiles()) {
      throw_usage(
          "the method needs all surfels of a tile at once, and the surfels are read from their "
          "file piece by piece; only the A-buffer draws them so");
    }
    const bool opaque = is_opaque(cloud, scene);
    compositor = method.make(cloud, options, opaque);
    blank_tile.layout = {.layers = compositor->layers(),
                         .normals = options.lit || options.aovs,
                         .opaque = opaque,
                         .clips = cloud.has_clips(),
                         .planes = opaque && !method.needs_whole_tiles()};
    set_weights();
    if (opaque && compositor->sums_are_whole() && options.filter == Filter::kEwa &&
        !options.coverage_threshold) {
      edges.emplace(edge_filter, options.lowpass, blank_tile.full_weight);
    }
    blank_tile.edges_later = edges.has_value();
    for (SplatListOptions list : compositor->lists()) {
      list.edges_filtered = edges.has_value();
      lists.emplace_back(cloud, scene, options, blank_tile.layout, list);
    }
  }

  void set_weights();
  RowRange rows_seen(const Camera& camera) const;
  int band_rows(const Camera& camera, int y0) const;
  void begin(const Camera& camera);
  void apply_edges(const Shader& shader, const RowRange& rows, Image& image);
  void draw_band(const Camera& camera, const Band& band, const RowRange& rows, const Shader& shader,
                 Image& image, FrameStatistics& statistics);
  std::vector<VisibleCluster> drawn_clusters(const Frame& frame,
                                             std::span<const VisibleCluster> clusters) const;
  void draw(const Pass& pass);
  void draw_block(const Pass& pass, std::size_t block, int w);
  void draw_tile(TileABuffer& tile, int x, int y, int w);
  Rgba backdrop() const;
  void put(PixelResult result, const Shader& shader, int x, int y, Image& image);
  void resolve(TileABuffer& tile, const Compositor::Worker* background, OpenPixels& open,
               Image& image);
  void resolve_open(const Frame& frame, Image& image);
  void finish(FrameStatistics& statistics);
  Image draw_picture(const Camera& camera, const Shader& shader, FrameStatistics& statistics);
  PixelExplanation explain(Camera camera, int x, int y);
};

Renderer::Renderer(ClusterStore& store, const Scene& scene, const RenderOptions& options)
    : impl_(std::make_unique<Impl>(store, scene, options)) {}
Renderer::~Renderer() = default;

/// See TileABuffer.
void Renderer::Impl::set_weights() {
  const auto full =
      static_cast<float>(options.coverage_threshold.value_or(coverage_threshold(options.cutoff)));
  // Kernels have the volume a_k, of which the part within beta < c is 1 - exp(-c): the mean sum.
  // Where the pixel filter evens the sums out, all but few are above this.
  const auto mean = static_cast<float>(1 - portable::exp(-options.cutoff));
  blank_tile.full_weight = full;
  blank_tile.mean_weight = options.coverage_threshold ? full : mean;
  blank_tile.edge_weight = options.coverage_threshold ? full : mean - (mean - full) / 4;
  blank_tile.inside_weight =
      blank_tile.layout.opaque ? blank_tile.edge_weight : kOneSurface * blank_tile.mean_weight;
  // A threshold of one's own says by itself what is covered.
  if (!options.coverage_threshold) blank_tile.edge_filter = &edge_filter;
}

/// Rows to draw of which the camera's rows depend: pixels look at those around them to find edges
/// and to fill what no kernel reaches, and at many more for relief.
RowRange Renderer::Impl::rows_seen(const Camera& camera) const {
  const RowRange drawn = camera.drawn_rows();
  int around = 0;
  if (options.relief != Relief::kNone) around += relief_margin(options.relief, camera);
  around += kTileSize * (edges ? EdgeCoverage::kTilesAround + 1 : 1);
  // Tiles are drawn whole.
  return {std::max(0, drawn.begin - around) / kTileSize * kTileSize,
          std::min(camera.height, tiles_along(drawn.end + around) * kTileSize)};
}

/// Rows of the picture to draw together, from y0 on: all, unless their A-buffers are to be kept and
/// take too much memory.
int Renderer::Impl::band_rows(const Camera& camera, int y0) const {
  const int rows = camera.height - y0;
  const std::size_t tile_row = blank_tile.layout.size() * sizeof(float) * tiles_along(camera.width);
  const std::size_t most = std::max<std::size_t>(1, store.picture_bytes() / tile_row);
  return std::min(rows,
                  static_cast<int>(std::min<std::size_t>(tiles_along(rows), most)) * kTileSize);
}

/// Rasterises the splats of a tile of the loaded block.
void Renderer::Impl::draw_tile(TileABuffer& tile, int x, int y, int w) {
  Worker& worker = workers[w];
  worker.jobs.clear();
  for (SplatLists& list : lists) {
    worker.jobs.push_back(list.job(x, y, w));
    worker.jobs.back().fragments = &worker.fragments;
  }
  if (probe && probe->meets(tile.x0, tile.y0)) {
    probe->draw(tile, worker.jobs, lists, w, *worker.compositor);
  }
  worker.compositor->draw(worker.jobs, tile);
}

/// What pixels are composited over, premultiplied: the background, which relief puts behind the
/// surfaces at last. Pixels are explained over nothing.
Rgba Renderer::Impl::backdrop() const {
  if (options.relief != Relief::kNone || probe) return {};
  return premultiplied(options.background);
}

/// Writes a pixel's channels, and its nearness.
void Renderer::Impl::put(PixelResult result, const Shader& shader, int x, int y, Image& image) {
  float* const out = image.pixel(x, y);
  if (edges) edges->set_opacity(x, y, result.opacity);
  result.color.composite(backdrop());
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
  if (options.relief != Relief::kNone) {
    const float z = std::isfinite(result.depth) ? result.depth : result.depth_first;
    *nearness.at(x, y) = std::isfinite(z) ? shader.depth(z) : NearnessPicture::kNothing;
  }
}

/// Resolves the pixels of a tile that do not depend on other tiles. Adds all other pixels to
/// `open`, and stores the tile's border for the pixels of other tiles that look at it.
void Renderer::Impl::resolve(TileABuffer& tile, const Compositor::Worker* background,
                             OpenPixels& open, Image& image) {
  const bool takes_plain = !options.aovs && !background && !tile.shader->has_environment();
  if (probe && probe->meets(tile.x0, tile.y0)) probe->keep(tile, takes_plain);
  const Rgba behind = backdrop();
  std::optional<PlainPixels> plain;
  if (takes_plain) {
    plain = resolve_plain_pixels(tile, tile.shader->lighting(), behind);
  }
  rims.store(tile, plain ? plain->inside : TileInside::kNo);
  if (plain && !edges) open.add_lone(tile, plain->lone);
  const bool set_opacities = edges && !(plain && plain->inside != TileInside::kNo);
  if (edges && plain && plain->inside_fine && !tile.layout.clips) {
    edges->store_inside(tile);
  } else if (edges) {
    edges->store(tile, plain ? plain->inside : TileInside::kNo);
  }
  // The channels of a pixel without fragments, where all such pixels are alike.
  std::optional<std::vector<float>> nothing;
  if (!background && !tile.shader->has_environment()) {
    nothing = {behind.red, behind.green, behind.blue, behind.alpha};
    if (options.aovs) {
      constexpr float kInfinity = std::numeric_limits<float>::infinity();
      nothing->insert(nothing->end(), {kInfinity, kInfinity, 0, 0, 0, 0});
    }
  }
  const auto resolve_one = [&](int pixel, int x, int y) {
    if (nothing && tile.at(0, kWeight, pixel) == 0) {
      std::copy(nothing->begin(), nothing->end(), image.pixel(x, y));
      return;
    }
    // SP06: I = alpha C_F + (1 - alpha) C_O
    const Fragment others = background ? background->behind(pixel) : Fragment{};
    const bool waits = background && background->waits(tile, pixel);
    const std::optional<PixelResult> result = resolve_pixel(tile, pixel, others, waits, open);
    if (result) put(*result, *tile.shader, x, y, image);
  };
  const std::size_t channels = image.channels.size();
  const bool relief = options.relief != Relief::kNone;
  for (int y = 0; y < tile.height; ++y) {
    float* const row = image.pixel(tile.x0, tile.y0 + y);
    for (int x0 = 0; x0 < tile.width; x0 += kStripWidth) {
      // Pixels of a row of a strip follow one another in the tile as well.
      const int first = tile_pixel(x0, y);
      const int count = std::min(kStripWidth, tile.width - x0);
      if (plain && count == kStripWidth) {
        std::memcpy(row + channels * x0, &plain->color[first], sizeof(Rgba) * kStripWidth);
        if (set_opacities) {
          edges->set_opacities(tile.x0 + x0, tile.y0 + y, &plain->opacity[first]);
        }
        if (relief) {
          std::copy_n(&plain->nearness[first], kStripWidth, nearness.at(tile.x0 + x0, tile.y0 + y));
        }
        const float* left = &plain->left[first];
        if (left[0] + left[1] + left[2] + left[3] == 0) continue;
      }
      for (int i = 0; i < count; ++i) {
        float* out = row + channels * (x0 + i);
        if (plain && plain->left[first + i] == 0) {
          std::memcpy(out, &plain->color[first + i], sizeof(Rgba));
          if (set_opacities) {
            edges->set_opacity(tile.x0 + x0 + i, tile.y0 + y, plain->opacity[first + i]);
          }
          if (relief) *nearness.at(tile.x0 + x0 + i, tile.y0 + y) = plain->nearness[first + i];
        } else {
          resolve_one(first + i, tile.x0 + x0 + i, tile.y0 + y);
        }
      }
    }
  }
}

/// Resolves the open pixels, except pixels that depend on the next band.
void Renderer::Impl::resolve_open(const Frame& frame, Image& image) {
  TileABuffer tile = blank_tile;
  tile.shader = &frame.shader;
  const RowRange rows = frame.surrounded_rows(kEdgeReach);
  constexpr std::size_t kGrain = 256;  // Pixels: tens of microseconds' work.
  const auto for_each_surrounded = [&](const auto& pixels, const auto& body) {
    parallel_for(pixels.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        if (pixels[i].y >= rows.begin && pixels[i].y < rows.end) body(pixels[i]);
      }
    });
  };
  workers.for_each([&](Worker& worker) {
    OpenPixels& open = worker.open;
    for_each_surrounded(open.pixels, [&](const OpenPixels::Pixel& pixel) {
      compositor->complete(frame.shader, pixel.x, pixel.y, open.fragments_of(pixel));
      put(resolve_open_pixel(tile, open, pixel, rims), frame.shader, pixel.x, pixel.y, image);
    });
    for_each_surrounded(open.lone, [&](const LoneFragment& lone) {
      float* out = image.pixel(lone.x, lone.y);
      // The share of the pixel's only fragment is proportional to the coverage.
      const float change = rims.coverage_change(tile, lone);
      const Rgba behind = backdrop();
      for (const float back : {behind.red, behind.green, behind.blue, behind.alpha}) {
        *out = back + (*out - back) * change;
        ++out;
      }
    });
    open.keep_from_row(rows.end);
  });
  if (probe && probe->y() >= std::max(rows.begin, frame.band.y0 - kEdgeReach) &&
      probe->y() < rows.end) {
    probe->resolve(rims, frame.shader);
  }
}

/// Sets up the splats that a block has in the batch and draws its tiles, in several parts where
/// they are very many.
void Renderer::Impl::draw_block(const Pass& pass, std::size_t block, int w) {
  const auto& [frame, first, last, image] = pass;
  const Band& band = frame.band;
  Worker& worker = workers[w];
  const std::size_t clusters = lists.front().clusters(block);
  if (clusters == 0 && !first && !last) return;
  const std::size_t part = options.compositing().needs_whole_tiles()
                               ? std::max<std::size_t>(1, clusters)
                               : options.batch / RenderCloud::kClusterSize;
  const int first_x = frame.grid.first_tile_x(block);
  const int first_y = frame.grid.first_tile_y(block);
  const int tiles_x = std::min(1 << frame.grid.shift, band.tiles_x - first_x);
  const int tiles_y = std::min(1 << frame.grid.shift, band.tiles_y - first_y);
  TileABuffer tile = blank_tile;
  tile.shader = &frame.shader;
  tile.picture_width = image.width;
  tile.picture_height = image.height;
  // A-buffers stay from batch to batch, or from part to part; else one serves all tiles.
  const std::size_t size = tile.layout.size();
  const bool batches = !(first && last);
  const bool parts = clusters > part;
  if (!batches) worker.a_buffer.resize(size * (parts ? tiles_x * tiles_y : 1));
  const auto buffer = [&](int x, int y) {
    if (batches) return a_buffer.data() + size * band.tile(first_x + x, first_y + y);
    return worker.a_buffer.data() + size * (parts ? y * tiles_x + x : 0);
  };
  for (std::size_t begin = 0; begin == 0 || begin < clusters; begin += part) {
    const std::size_t end = std::min(begin + part, clusters);
    lists.front().load(block, begin, end, w);
    for (SplatLists& other : std::span(lists).subspan(1)) {
      other.load(block, 0, other.clusters(block), w);
    }
    for (int y = 0; y < tiles_y; ++y) {
      for (int x = 0; x < tiles_x; ++x) {
        tile.y0 = band.y0 + (first_y + y) * kTileSize;
        if (!frame.draws_tile(tile.y0)) continue;
        tile.data = buffer(x, y);
        if (first && begin == 0) worker.compositor->clear(tile);
        tile.x0 = (first_x + x) * kTileSize;
        tile.width = std::min(kTileSize, image.width - tile.x0);
        tile.height = std::min(kTileSize, band.y1 - tile.y0);
        tile.merges = {};
        draw_tile(tile, x, y, w);
        if (last && end == clusters) {
          worker.compositor->finish(tile);
          resolve(tile, compositor->has_background() ? worker.compositor.get() : nullptr,
                  worker.open, image);
        }
        worker.merges.add(tile.merges);
      }
    }
  }
}

void Renderer::Impl::draw(const Pass& pass) {
  const Frame& frame = pass.frame;
  if (pass.first && !pass.last) a_buffer.resize(blank_tile.layout.size() * frame.band.tiles());
  // The blocks with most splats come first, so that none is left to one thread at the end.
  std::vector<std::size_t> blocks(frame.grid.blocks());
  std::iota(blocks.begin(), blocks.end(), std::size_t{0});
  std::erase_if(blocks, [&](std::size_t block) { return !frame.draws_block(block); });
  std::stable_sort(blocks.begin(), blocks.end(), [&](std::size_t a, std::size_t b) {
    return lists.front().clusters(a) > lists.front().clusters(b);
  });
  parallel_for(blocks.size(), 1,
               [&](std::size_t i, std::size_t, int w) { draw_block(pass, blocks[i], w); });
}

/// The clusters that reach into blocks to be drawn, in their order.
std::vector<VisibleCluster> Renderer::Impl::drawn_clusters(
    const Frame& frame, std::span<const VisibleCluster> clusters) const {
  const RowRange blocks = frame.block_rows();
  std::vector<VisibleCluster> drawn;
  drawn.reserve(clusters.size());
  for (const VisibleCluster& cluster : clusters) {
    const TileRange tiles = lists.front().culling().tiles_of(cloud.clusters()[cluster.index]);
    if (tiles.y0 >> frame.grid.shift < blocks.end && tiles.y1 >> frame.grid.shift >= blocks.begin) {
      drawn.push_back(cluster);
    }
  }
  return drawn;
}

/// \param rows  of pixels to be drawn, see Frame.
void Renderer::Impl::draw_band(const Camera& camera, const Band& band, const RowRange& rows,
                               const Shader& shader, Image& image, FrameStatistics& statistics) {
  StageTimes& stages = statistics.stages;
  Timer timer;
  Frame being_made{camera, shader, band, {}, {}, rows};
  std::size_t most = 0;
  for (SplatLists& list : lists) {
    being_made.clusters.push_back(list.cull(camera, band));
    most = std::max(most, being_made.clusters.back().size());
  }
  being_made.grid = BlockGrid(band, most * RenderCloud::kClusterSize,
                              lists.front().culling().mean_share(being_made.clusters.front()));
  statistics.clusters += most;
  const Frame& frame = being_made;
  stages.add("cull", timer.milliseconds());
  const std::span<const VisibleCluster> clusters = frame.clusters.front();
  const std::size_t size =
      std::min(store.batch_clusters(), std::max<std::size_t>(1, clusters.size()));
  const auto batch_from = [&](std::size_t begin) {
    return drawn_clusters(frame,
                          clusters.subspan(begin).first(std::min(size, clusters.size() - begin)));
  };
  std::vector<VisibleCluster> batch;
  std::vector<VisibleCluster> next = batch_from(0);
  for (std::size_t begin = 0; begin == 0 || begin < clusters.size(); begin += size) {
    const std::size_t end = std::min(begin + size, clusters.size());
    batch = std::move(next);
    next = batch_from(end);
    timer.restart();
    store.fetch(batch);
    store.expect(next);
    if (!store.resident()) stages.add("read", timer.milliseconds());
    timer.restart();
    lists.front().bin(frame, batch);
    for (std::size_t i = 1; i < lists.size(); ++i) lists[i].bin(frame, frame.clusters[i]);
    stages.add("cull", timer.milliseconds());
    timer.restart();
    const bool last = end == clusters.size();
    draw({frame, begin == 0, last, image});
    if (last) resolve_open(frame, image);
    stages.add("raster", timer.milliseconds());
  }
}

/// Makes workers ready for a picture.
void Renderer::Impl::begin(const Camera& camera) {
  compositor->begin(camera);
  if (edges) edges->begin(camera.width, camera.height);
  workers.for_each([](Worker& worker) {
    worker.merges = {};
    worker.open.clear();
  });
}

/// Gives pixels near edges their opacities, when all else is drawn.
void Renderer::Impl::apply_edges(const Shader& shader, const RowRange& rows, Image& image) {
  const Rgba back = backdrop();
  if (!shader.has_environment()) {
    edges->apply(image, rows, [&](int /*x*/, int /*y*/) { return back; });
    return;
  }
  edges->apply(image, rows, [&](int x, int y) {
    Rgba behind = shader.open_view(static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F);
    behind.composite(back);
    return behind;
  });
}

/// Sums up what the workers counted.
void Renderer::Impl::finish(FrameStatistics& statistics) {
  MergeStatistics merges;
  statistics.geometry_passes = static_cast<int>(lists.size());
  workers.for_each([&](Worker& worker) {
    merges.add(worker.merges);
    statistics.fragments += std::exchange(worker.fragments, 0);
    worker.compositor->take_statistics(statistics);
  });
  for (SplatLists& list : lists) {
    statistics.splats += list.take_splat_count();
    statistics.exact_splats += list.take_exact_count();
    statistics.thinned_splats += list.take_thinned_count();
    statistics.fragments += list.take_fragment_count();
  }
  statistics.merged = merges.merged;
  const double all = merges.total_weight + merges.late_weight;
  statistics.late_weight_share = all > 0 ? merges.late_weight / all : 0;
  statistics.groups = cloud.groups();
}

Image Renderer::Impl::draw_picture(const Camera& camera, const Shader& shader,
                                   FrameStatistics& statistics) {
  begin(camera);
  Image image = blank_image(camera, options.aovs);
  const Relief relief = options.relief;
  const RowRange seen = rows_seen(camera);
  if (relief != Relief::kNone) nearness.reset(camera.width, seen, relief_margin(relief, camera));
  for (int y0 = 0; y0 < camera.height;) {
    const Band band(camera, y0, y0 + band_rows(camera, y0));
    y0 = band.y1;
    rims.begin(camera, band, blank_tile.layout.layers);
    if (band.y1 <= seen.begin || band.y0 >= seen.end) continue;
    draw_band(camera, band, seen, shader, image, statistics);
  }
  if (probe) probe->note(image, 0);
  if (edges) {
    const Timer timer;
    apply_edges(shader, camera.drawn_rows(), image);
    statistics.stages.add("edges", timer.milliseconds());
  }
  if (probe) probe->note(image, 1);
  if (relief != Relief::kNone) {
    const Timer timer;
    add_relief(image, nearness, camera, relief, probe ? Rgba{} : premultiplied(options.background));
    statistics.stages.add("relief", timer.milliseconds());
  }
  if (probe) probe->note(image, 2);
  finish(statistics);
  return image;
}

Image Renderer::render(const Camera& camera, FrameStatistics* statistics) {
  require_usable(camera);
  FrameStatistics stats;
  const Timer whole;
  const Shader shader(impl_->options.lit ? &impl_->scene : nullptr, camera,
                      impl_->options.filter_deviation(), impl_->cloud.has_shading());
  Image image = impl_->draw_picture(camera, shader, stats);
  stats.milliseconds = whole.milliseconds();
  if (statistics) *statistics = stats;
  return image;
}

PixelExplanation Renderer::Impl::explain(Camera camera, int x, int y) {
  camera.rows = {y, y + 1};
  const Shader shader(options.lit ? &scene : nullptr, camera, options.filter_deviation(),
                      cloud.has_shading());
  PixelProbe one(camera, cloud, x, y, !options.compositing().needs_whole_tiles());
  const auto set = [&](PixelProbe* with) {
    probe = with;
    for (SplatLists& list : lists) list.note_surfels(with != nullptr);
  };
  set(&one);
  FrameStatistics ignored;
  try {
    draw_picture(camera, shader, ignored);
  } catch (...) {
    set(nullptr);
    throw;
  }
  set(nullptr);
  return one.finish(premultiplied(options.background), options.lit, shader.has_environment());
}

std::vector<PixelExplanation> Renderer::explain(const Camera& camera,
                                                std::span<const std::array<int, 2>> pixels) {
  require_usable(camera);
  std::vector<PixelExplanation> all;
  for (const auto& [x, y] : pixels) {
    require_in_picture(camera, x, y);
    all.push_back(impl_->explain(camera, x, y));
  }
  return all;
}

}  // namespace surfel
