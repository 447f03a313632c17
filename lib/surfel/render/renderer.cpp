#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/exact_kernel.h>
#include <surfel/render/renderer.h>
#include <surfel/render/shading.h>
#include <surfel/render/splat.h>
#include <surfel/render/splat_setup.h>
#include <surfel/render/tile_raster.h>

namespace surfel {
namespace {

/// Entries of tile lists in flight that a batch may be expected to need.
constexpr double kBatchReferences = 1 << 24;
/// Where several batches are needed, the A-buffer of this many bytes is kept between them; larger
/// pictures are rendered in horizontal bands.
constexpr std::size_t kABufferBytes = std::size_t{1} << 30;
/// Tile histograms of all segments together, entries.
constexpr std::size_t kHistogramEntries = std::size_t{1} << 22;
/// Most tiles along a side that TileRange can name: pictures of 65,536 pixels have 4,096.
constexpr int kMostTiles = 1 << 16;

/// Cluster seen by the camera, nearest first, ties by index.
struct VisibleCluster {
  float nearest;  ///< Least z of its surfels' bounding sphere.
  std::uint32_t index;
  double references;  ///< Upper estimate of the tile list entries of its splats.
};

/// A tile list's entry.
struct Reference {
  std::uint32_t splat;
  float depth;
};

/// Standard deviation of the low-pass filter that stands for none, pixels: an edge-on disc keeps a
/// width.
constexpr double kNoLowpass = 1e-3;

/// Scratch memory of one worker.
struct Worker {
  SplatColumns columns;
  Array<float> a_buffer;
  std::vector<std::uint32_t> order;
  std::vector<std::uint32_t> other;
  std::vector<std::uint32_t> keys;
  MergeStatistics merges;
  std::size_t exact_splats = 0;
};

/// Indices of the splats of `list`, nearest first, splats of equal depth in the list's order. The
/// key is 16 bits of the depth's place in the list's range: two stable passes of counting.
void sort_front_to_back(const Reference* list, std::size_t count, Worker& worker) {
  worker.order.resize(count);
  worker.other.resize(count);
  worker.keys.resize(count);
  float lo = std::numeric_limits<float>::infinity();
  float hi = -lo;
  for (std::size_t i = 0; i < count; ++i) {
    lo = std::min(lo, list[i].depth);
    hi = std::max(hi, list[i].depth);
  }
  const float scale = hi > lo ? 65535.0F / (hi - lo) : 0.0F;
  std::array<std::uint32_t, 256> low{};
  std::array<std::uint32_t, 256> high{};
  for (std::size_t i = 0; i < count; ++i) {
    const auto key = static_cast<std::uint32_t>(std::min(65535.0F, (hi - list[i].depth) * scale));
    worker.keys[i] = key;
    ++low[key & 255];
    ++high[key >> 8];
  }
  const auto to_starts = [](std::array<std::uint32_t, 256>& histogram) {
    std::uint32_t sum = 0;
    for (std::uint32_t& entry : histogram) {
      const std::uint32_t n = entry;
      entry = sum;
      sum += n;
    }
  };
  to_starts(low);
  to_starts(high);
  for (std::size_t i = 0; i < count; ++i) {
    worker.other[low[worker.keys[i] & 255]++] = static_cast<std::uint32_t>(i);
  }
  for (const std::uint32_t i : worker.other) {
    worker.order[high[worker.keys[i] >> 8]++] = list[i].splat;
  }
}

double lowpass_of(const RenderOptions& options) {
  return options.filter == Filter::kNone ? kNoLowpass : options.lowpass;
}

SplatView make_view(const Camera& camera, const Vec3d& origin, const RenderOptions& options) {
  SplatView view{};
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      view.rotation[3 * row + column] = static_cast<float>(camera.camera_from_world(row, column));
    }
  }
  // In double: cloud and camera may both be far from the world's origin.
  const Vec3d translation = camera.camera_from_world * (origin - camera.eye);
  for (int i = 0; i < 3; ++i) view.translation[i] = static_cast<float>(translation[i]);
  view.focal_x = static_cast<float>(camera.focal_x);
  view.focal_y = static_cast<float>(camera.focal_y);
  view.center_x = static_cast<float>(camera.center_x);
  view.center_y = static_cast<float>(camera.center_y);
  view.near = static_cast<float>(camera.near);
  view.orthographic = camera.orthographic;
  view.cull_back = options.cull_back;
  view.cutoff = static_cast<float>(options.cutoff);
  view.lowpass2 = static_cast<float>(lowpass_of(options) * lowpass_of(options));
  view.circular = options.filter == Filter::kCircular;
  view.tolerance = std::numeric_limits<float>::infinity();
  if (!camera.orthographic && !view.circular && options.kernel != Kernel::kAffine) {
    view.tolerance =
        options.kernel == Kernel::kAuto ? static_cast<float>(options.kernel_tolerance) : -1.0F;
  }
  view.clip_x1 = static_cast<float>(camera.width);
  return view;
}

}  // namespace

double coverage_threshold(double cutoff) {
  struct Point {
    double cutoff, tau;
  };
  // The sum of rho that all but 1 in 100,000 pixels inside a magnified jittered grid (V = h^2 I,
  // jitter 0.35 h, 6 grids) reach.
  static constexpr Point kMeasured[] = {{0, 0},    {0.5, 0.1}, {1, 0.31},  {1.5, 0.51},
                                        {2, 0.61}, {3, 0.74},  {4, 0.775}, {16, 0.795}};
  for (std::size_t i = 1; i < std::size(kMeasured); ++i) {
    const Point& a = kMeasured[i - 1];
    const Point& b = kMeasured[i];
    if (cutoff <= b.cutoff) {
      return a.tau + (b.tau - a.tau) * (cutoff - a.cutoff) / (b.cutoff - a.cutoff);
    }
  }
  return std::end(kMeasured)[-1].tau;
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
  check(layers >= 1 && layers <= 64, fmt::format("layers is {}; it must be in 1..64", layers));
  check(depth_epsilon > 0 && depth_epsilon <= 1e6,
        fmt::format("depth-epsilon is {}; it must be in (0, 1e6]", depth_epsilon));
  check(!coverage_threshold || (*coverage_threshold > 0 && *coverage_threshold <= 1e6),
        fmt::format("coverage-threshold is {}; it must be in (0, 1e6]",
                    coverage_threshold.value_or(0)));
  check(batch >= RenderCloud::kClusterSize && batch <= (std::size_t{1} << 28),
        fmt::format("batch is {}; it must be in 256..2^28", batch));
  check(std::all_of(background.begin(), background.end(),
                    [](float v) { return std::isfinite(v) && v >= 0; }) &&
            background[3] <= 1,
        "background must be four numbers >= 0, alpha at most 1");
  return found;
}

struct Renderer::Impl {
  const RenderCloud& cloud;
  const Scene& scene;
  RenderOptions options;
  float full_weight, edge_weight;  ///< See TileABuffer.
  bool opaque;
  ABufferLayout layout;

  // Kept from frame to frame: nothing is allocated in a turntable's later frames.
  std::vector<Worker> workers;
  Array<Splat> splats;
  Array<SplatNormal> normals;
  Array<ExactSplat> exact;  ///< Parallel to `splats`; where k is kExactKernel.
  Array<TileRange> ranges;
  std::vector<std::vector<std::uint32_t>> kept;  ///< Per segment: splats that are seen.
  Array<std::uint32_t> histogram;                ///< Segments x tiles.
  Array<std::uint32_t> tile_begin;
  Array<Reference> references;
  Array<float> a_buffer;

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
    layout.layers = options.layers;
    layout.normals = options.lit || options.aovs;
    layout.opaque = opaque;
  }

  /// One horizontal band of a frame.
  struct Band {
    SplatView view;
    int y0, y1;  ///< Rows of pixels.
    int tiles_x, tiles_y;
    std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * tiles_y; }
  };

  std::vector<VisibleCluster> cull(const Camera& camera, const Band& band) const;
  std::size_t draw_batch(const Camera& camera, const Band& band, const VisibleCluster* clusters,
                         std::size_t count, const Shader& shader, bool first, bool last,
                         Image& image, FrameStatistics& statistics);
  std::size_t set_up(const Camera& camera, const Band& band, const VisibleCluster* clusters,
                     std::size_t count, std::size_t per_segment);
  SurfelInCamera in_camera(const Camera& camera, std::size_t surfel) const;
  void add_splat(const Band& band, std::size_t surfel, const Splat& splat, const TileRange& range,
                 std::size_t at, std::vector<std::uint32_t>& seen, std::uint32_t* tile_counts);
  void bin(const Band& band, std::size_t segments);
  void rasterize(const Camera& camera, const Band& band, const Shader& shader, bool first,
                 bool last, Image& image);
  void resolve(TileABuffer& tile, Image& image) const;
};

Renderer::Renderer(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options)
    : impl_(std::make_unique<Impl>(cloud, scene, options)) {}
Renderer::~Renderer() = default;

std::vector<VisibleCluster> Renderer::Impl::cull(const Camera& camera, const Band& band) const {
  const std::vector<Cluster>& clusters = cloud.clusters();
  const Eigen::Matrix3f rotation = camera.camera_from_world.cast<float>();
  const Vec3f translation(band.view.translation[0], band.view.translation[1],
                          band.view.translation[2]);
  const auto width = static_cast<float>(camera.width);
  const float reach = std::sqrt(2 * band.view.cutoff);
  const float filter = reach * static_cast<float>(options.lowpass);
  // Side planes of the view through the band's edges, moved out by the filter's reach: a sphere at
  // camera-space centre p is outside where a . (p.x or p.y, p.z) > radius * |a|.
  struct Edge {
    float focal, offset, sign;
    int axis;
    float norm;
  };
  const auto edge = [&](int axis, float focal, float center, float pixel, float sign) {
    const float offset = sign * (pixel - center) + filter;
    return Edge{focal, offset, sign, axis, camera.orthographic ? focal : std::hypot(focal, offset)};
  };
  const Edge edges[] = {
      edge(0, band.view.focal_x, band.view.center_x, 0, -1),
      edge(0, band.view.focal_x, band.view.center_x, width, 1),
      edge(1, band.view.focal_y, band.view.center_y, static_cast<float>(band.y0), -1),
      edge(1, band.view.focal_y, band.view.center_y, static_cast<float>(band.y1), 1)};
  const auto visible = [&](const Cluster& cluster, const Vec3f& p) {
    const float radius = cluster.radius + reach * cluster.max_deviation;
    if (p.z() + radius <= band.view.near) return false;
    for (const Edge& e : edges) {
      const float outside = camera.orthographic ? e.sign * e.focal * p[e.axis] - e.offset
                                                : e.sign * e.focal * p[e.axis] - e.offset * p.z();
      if (outside > radius * e.norm) return false;
    }
    if (options.cull_back && cluster.cone_cosine > 0) {
      // All normals look away where the view direction to every surfel is within the cone's
      // complement: angle(axis, p) + angular radius of the cluster + cone angle < 90 degrees.
      const Vec3f axis = rotation * cluster.cone_axis;
      const float distance = camera.orthographic ? 1.0F : p.norm();
      const float along = camera.orthographic ? axis.z() : axis.dot(p) / distance;
      const float spread = camera.orthographic ? 0.0F : cluster.radius / distance;
      if (spread < 1 && along > 0 &&
          std::acos(std::min(1.0F, along)) + std::asin(spread) + std::acos(cluster.cone_cosine) <
              1.5707F) {
        return false;
      }
    }
    return true;
  };
  constexpr std::size_t kGrain = 1024;
  std::vector<std::vector<VisibleCluster>> found((clusters.size() + kGrain - 1) / kGrain);
  parallel_for(clusters.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<VisibleCluster>& out = found[begin / kGrain];
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3f p = rotation * clusters[i].center + translation;
      if (!visible(clusters[i], p)) continue;
      const float nearest = p.z() - clusters[i].radius;
      // Estimate of a splat's side in tiles, for the size of batches only.
      const float z = camera.orthographic ? 1.0F : std::max(nearest, 1e-6F);
      const double side =
          std::min<double>(std::max(band.tiles_x, band.tiles_y),
                           1 + 2 *
                                   (reach * clusters[i].max_deviation *
                                        std::max(band.view.focal_x, band.view.focal_y) / z +
                                    filter) /
                                   kTileSize);
      out.push_back({nearest, static_cast<std::uint32_t>(i),
                     (clusters[i].end - clusters[i].begin) * side * side});
    }
  });
  std::vector<VisibleCluster> all;
  for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  std::sort(all.begin(), all.end(), [](const VisibleCluster& a, const VisibleCluster& b) {
    return a.nearest != b.nearest ? a.nearest < b.nearest : a.index < b.index;
  });
  return all;
}

/// Surfel in camera space, in double; an unknown normal looks at the eye.
SurfelInCamera Renderer::Impl::in_camera(const Camera& camera, std::size_t surfel) const {
  SurfelInCamera s;
  const Eigen::Matrix3d& rotation = camera.camera_from_world;
  s.position = rotation * (cloud.origin() - camera.eye +
                           Vec3d(cloud.x[surfel], cloud.y[surfel], cloud.z[surfel]));
  s.normal =
      rotation * Vec3d(cloud.normal_x[surfel], cloud.normal_y[surfel], cloud.normal_z[surfel]);
  s.normal = s.normal.isZero(0) ? Vec3d(-s.position.normalized()) : Vec3d(s.normal.normalized());
  s.variance_u = static_cast<double>(cloud.deviation_u[surfel]) * cloud.deviation_u[surfel];
  s.variance_v = s.variance_u;
  s.tangent = s.normal.unitOrthogonal();
  if (cloud.anisotropic()) {
    s.variance_v = static_cast<double>(cloud.deviation_v[surfel]) * cloud.deviation_v[surfel];
    const Vec3d t =
        rotation * Vec3d(cloud.tangent_x[surfel], cloud.tangent_y[surfel], cloud.tangent_z[surfel]);
    s.tangent = (t - s.normal * s.normal.dot(t)).normalized();
  }
  s.area = cloud.area[surfel];
  return s;
}

/// Stores a splat, `splat` without its colour, and counts the tiles that it touches.
void Renderer::Impl::add_splat(const Band& band, std::size_t surfel, const Splat& splat,
                               const TileRange& range, std::size_t at,
                               std::vector<std::uint32_t>& seen, std::uint32_t* tile_counts) {
  const std::uint32_t material = cloud.material.empty() ? 0 : cloud.material[surfel];
  float alpha = cloud.alpha.empty() ? 1.0F : cloud.alpha[surfel];
  if (!opaque) {
    alpha *= scene.materials[std::min<std::size_t>(material, scene.materials.size() - 1)].opacity;
  }
  Splat& out = splats[at];
  out = splat;
  out.red = cloud.red[surfel] * alpha;
  out.green = cloud.green[surfel] * alpha;
  out.blue = cloud.blue[surfel] * alpha;
  out.alpha = alpha;
  out.tag = splat.tag | material << kMaterialShift;
  if (layout.normals) {
    normals[at] = {cloud.normal_x[surfel], cloud.normal_y[surfel], cloud.normal_z[surfel]};
  }
  ranges[at] = range;
  seen.push_back(static_cast<std::uint32_t>(at));
  for (int ty = range.y0; ty <= range.y1; ++ty) {
    for (int tx = range.x0; tx <= range.x1; ++tx) ++tile_counts[ty * band.tiles_x + tx];
  }
}

/// Sets up a batch's clusters, `per_segment` of them at a time, and counts the tiles that each
/// segment's splats touch. Returns how many splats are seen.
std::size_t Renderer::Impl::set_up(const Camera& camera, const Band& band,
                                   const VisibleCluster* clusters, std::size_t count,
                                   std::size_t per_segment) {
  const std::size_t tiles = band.tiles();
  // Of half the box of a kernel with twice the pixel filter's variance: half of it is the filter's.
  const float filtered_diagonal2 = 2 * band.view.cutoff * 4 * band.view.lowpass2;
  const ExactKernelView exact_view{.cutoff = options.cutoff,
                                   .lowpass = lowpass_of(options),
                                   .x1 = static_cast<double>(camera.width),
                                   .y0 = static_cast<double>(band.y0),
                                   .y1 = static_cast<double>(band.y1)};
  parallel_for(count, per_segment, [&](std::size_t begin, std::size_t end, int worker) {
    const std::size_t segment = begin / per_segment;
    std::uint32_t* tile_counts = histogram.data() + segment * tiles;
    std::fill_n(tile_counts, tiles, 0U);
    std::vector<std::uint32_t>& seen = kept[segment];
    seen.clear();
    SplatColumns& columns = workers[worker].columns;
    for (std::size_t c = begin; c < end; ++c) {
      const Cluster& cluster = cloud.clusters()[clusters[c].index];
      const std::uint32_t i = cluster.begin;
      const auto from = [&](const Array<float>& column) {
        return column.empty() ? nullptr : column.data() + i;
      };
      const SurfelColumns surfels{
          from(cloud.x),           from(cloud.y),           from(cloud.z),
          from(cloud.normal_x),    from(cloud.normal_y),    from(cloud.normal_z),
          from(cloud.deviation_u), from(cloud.deviation_v), from(cloud.tangent_x),
          from(cloud.tangent_y),   from(cloud.tangent_z),   from(cloud.area)};
      set_up_splats(band.view, surfels, static_cast<int>(cluster.end - i), columns);
      std::size_t at = c * RenderCloud::kClusterSize;
      for (int v = 0; v < columns.visible_count; ++v) {
        const int k = columns.visible[v];
        const float diagonal2 =
            columns.half_x[k] * columns.half_x[k] + columns.half_y[k] * columns.half_y[k];
        const std::uint32_t tag = (columns.front[k] != 0 ? kFrontTag : 0U) |
                                  (diagonal2 < filtered_diagonal2 ? kFilteredTag : 0U);
        const Splat splat{columns.x[k],
                          columns.y[k],
                          columns.m[k],
                          columns.k[k],
                          columns.amplitude[k],
                          columns.depth[k],
                          columns.depth_dx[k],
                          columns.depth_dy[k],
                          columns.depth_range[k],
                          columns.half_x[k],
                          columns.half_y[k],
                          0,
                          0,
                          0,
                          0,
                          tag};
        const TileRange range{static_cast<std::uint16_t>(columns.tile_x0[k]),
                              static_cast<std::uint16_t>(columns.tile_y0[k]),
                              static_cast<std::uint16_t>(columns.tile_x1[k]),
                              static_cast<std::uint16_t>(columns.tile_y1[k])};
        add_splat(band, i + static_cast<std::size_t>(k), splat, range, at++, seen, tile_counts);
      }
      for (int v = 0; v < columns.exact_count; ++v) {
        const std::size_t surfel = i + static_cast<std::size_t>(columns.exact[v]);
        const std::optional<ExactKernel> kernel =
            make_exact_kernel(in_camera(camera, surfel), camera, exact_view);
        if (!kernel) continue;
        exact[at] = kernel->exact;
        add_splat(band, surfel, kernel->splat, kernel->tiles, at++, seen, tile_counts);
        ++workers[worker].exact_splats;
      }
    }
  });
  std::size_t seen = 0;
  for (std::size_t s = 0; s < (count + per_segment - 1) / per_segment; ++s) seen += kept[s].size();
  return seen;
}

/// Writes every tile's list: splats in the order of the segments, which is that of the clusters.
void Renderer::Impl::bin(const Band& band, std::size_t segments) {
  const std::size_t tiles = band.tiles();
  // Entries become places: first within the tile's list, then in `references`.
  tile_begin.resize(tiles + 1);
  std::fill_n(tile_begin.data(), tiles, 0U);
  for (std::size_t i = 0; i < segments * tiles; i += tiles) {
    for (std::size_t t = 0; t < tiles; ++t) {
      const std::uint32_t n = histogram[i + t];
      histogram[i + t] = tile_begin[t];
      tile_begin[t] += n;
    }
  }
  std::size_t sum = 0;
  for (std::size_t t = 0; t < tiles; ++t) {
    const std::uint32_t n = tile_begin[t];
    tile_begin[t] = static_cast<std::uint32_t>(sum);
    sum += n;
  }
  if (sum > std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorKind::kNumeric, "the splats are too large on screen; move the camera back");
  }
  tile_begin[tiles] = static_cast<std::uint32_t>(sum);
  references.resize(sum);
  parallel_for(segments, 1, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t s = begin; s < end; ++s) {
      std::uint32_t* cursor = histogram.data() + s * tiles;
      for (std::size_t t = 0; t < tiles; ++t) cursor[t] += tile_begin[t];
      for (const std::uint32_t splat : kept[s]) {
        const TileRange& range = ranges[splat];
        const Reference reference{splat, splats[splat].depth};
        for (int ty = range.y0; ty <= range.y1; ++ty) {
          for (int tx = range.x0; tx <= range.x1; ++tx) {
            references[cursor[ty * band.tiles_x + tx]++] = reference;
          }
        }
      }
    }
  });
}

void Renderer::Impl::resolve(TileABuffer& tile, Image& image) const {
  const std::array<float, 4>& b = options.background;
  const Rgba background{b[0] * b[3], b[1] * b[3], b[2] * b[3], b[3]};
  for (int y = 0; y < tile.height; ++y) {
    for (int x = 0; x < tile.width; ++x) {
      PixelResult result = resolve_pixel(tile, tile_pixel(x, y));
      result.color.composite(background);
      float* out = image.pixel(tile.x0 + x, tile.y0 + y);
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
    }
  }
}

void Renderer::Impl::rasterize(const Camera& camera, const Band& band, const Shader& shader,
                               bool first, bool last, Image& image) {
  const bool keep = !(first && last);
  if (first && keep) a_buffer.resize(layout.size() * band.tiles());
  parallel_for(band.tiles(), 1, [&](std::size_t t, std::size_t, int w) {
    Worker& worker = workers[w];
    const std::size_t begin = tile_begin[t];
    const std::size_t count = tile_begin[t + 1] - begin;
    if (keep && !first && !last && count == 0) return;
    TileABuffer tile;
    tile.layout = layout;
    if (keep) {
      tile.data = a_buffer.data() + layout.size() * t;
    } else {
      worker.a_buffer.resize(layout.size());
      tile.data = worker.a_buffer.data();
    }
    if (first) std::fill_n(tile.data, layout.size(), 0.0F);
    tile.x0 = static_cast<int>(t % band.tiles_x) * kTileSize;
    tile.y0 = band.y0 + static_cast<int>(t / band.tiles_x) * kTileSize;
    tile.width = std::min(kTileSize, camera.width - tile.x0);
    tile.height = std::min(kTileSize, band.y1 - tile.y0);
    tile.full_weight = full_weight;
    tile.edge_weight = edge_weight;
    tile.shader = &shader;
    if (count > 0) {
      sort_front_to_back(references.data() + begin, count, worker);
      rasterize_tile({splats.data(), layout.normals ? normals.data() : nullptr, exact.data(),
                      worker.order.data(), count, band.view.cutoff, band.view.lowpass2,
                      static_cast<float>(options.depth_epsilon), opaque},
                     tile);
    }
    if (last) resolve(tile, image);
    worker.merges.add(tile.merges);
  });
}

std::size_t Renderer::Impl::draw_batch(const Camera& camera, const Band& band,
                                       const VisibleCluster* clusters, std::size_t count,
                                       const Shader& shader, bool first, bool last, Image& image,
                                       FrameStatistics& statistics) {
  // Enough for the threads to share the work evenly; lists do not depend on their number.
  const std::size_t most_segments = std::clamp<std::size_t>(
      kHistogramEntries / band.tiles(), 4, 16 * static_cast<std::size_t>(thread_count()));
  const std::size_t per_segment =
      std::max<std::size_t>(1, (count + most_segments - 1) / most_segments);
  const std::size_t segments = (count + per_segment - 1) / per_segment;
  const std::size_t capacity = count * RenderCloud::kClusterSize;
  splats.resize(std::max(splats.size(), capacity));
  ranges.resize(std::max(ranges.size(), capacity));
  if (layout.normals) normals.resize(std::max(normals.size(), capacity));
  if (std::isfinite(band.view.tolerance)) exact.resize(std::max(exact.size(), capacity));
  histogram.resize(segments * band.tiles());
  kept.resize(std::max(kept.size(), segments));

  Timer timer;
  const std::size_t seen = set_up(camera, band, clusters, count, per_segment);
  statistics.stages.add("setup", timer.milliseconds());
  timer.restart();
  bin(band, segments);
  statistics.stages.add("bin", timer.milliseconds());
  timer.restart();
  rasterize(camera, band, shader, first, last, image);
  statistics.stages.add("raster", timer.milliseconds());
  return seen;
}

Image Renderer::render(const Camera& camera, FrameStatistics* statistics) {
  Impl& r = *impl_;
  FrameStatistics stats;
  const Timer whole;
  const Shader shader(r.options.lit ? &r.scene : nullptr, camera, lowpass_of(r.options));
  r.workers.resize(std::max<std::size_t>(r.workers.size(), thread_count()));
  for (Worker& worker : r.workers) {
    worker.merges = {};
    worker.exact_splats = 0;
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

  // Bands only matter to pictures so large that the A-buffer may not fit its limit.
  const int tiles_x = (camera.width + kTileSize - 1) / kTileSize;
  const std::size_t row_bytes = r.layout.size() * sizeof(float) * tiles_x;
  const int band_rows =
      static_cast<int>(std::clamp<std::size_t>(kABufferBytes / row_bytes, 1, kMostTiles)) *
      kTileSize;
  for (int y0 = 0; y0 < camera.height; y0 += band_rows) {
    Impl::Band band;
    band.y0 = y0;
    band.y1 = std::min(camera.height, y0 + band_rows);
    band.tiles_x = tiles_x;
    band.tiles_y = (band.y1 - band.y0 + kTileSize - 1) / kTileSize;
    band.view = make_view(camera, r.cloud.origin(), r.options);
    band.view.clip_y0 = static_cast<float>(band.y0);
    band.view.clip_y1 = static_cast<float>(band.y1);

    Timer timer;
    const std::vector<VisibleCluster> clusters = r.cull(camera, band);
    stats.clusters += clusters.size();
    stats.stages.add("cull", timer.milliseconds());
    std::size_t begin = 0;
    do {
      std::size_t end = begin;
      double expected = 0;
      while (end < clusters.size() &&
             (end - begin + 1) * RenderCloud::kClusterSize <= r.options.batch &&
             (end == begin || expected + clusters[end].references <= kBatchReferences)) {
        expected += clusters[end++].references;
      }
      stats.splats += r.draw_batch(camera, band, clusters.data() + begin, end - begin, shader,
                                   begin == 0, end == clusters.size(), image, stats);
      begin = end;
    } while (begin < clusters.size());
  }
  MergeStatistics merges;
  for (const Worker& worker : r.workers) {
    merges.add(worker.merges);
    stats.exact_splats += worker.exact_splats;
  }
  stats.merged = merges.merged;
  const double all = merges.total_weight + merges.dropped_weight;
  stats.dropped_weight_share = all > 0 ? merges.dropped_weight / all : 0;
  stats.milliseconds = whole.milliseconds();
  if (statistics) *statistics = stats;
  return image;
}

}  // namespace surfel
