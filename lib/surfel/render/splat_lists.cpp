#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/cut.h>
#include <surfel/render/exact_kernel.h>
#include <surfel/render/splat_lists.h>

namespace surfel {
namespace {

/// Entries of tile lists in flight that a batch may be expected to need.
constexpr double kBatchReferences = 1 << 24;
/// Tile histograms of all segments together, entries.
constexpr std::size_t kHistogramEntries = std::size_t{1} << 22;
/// Splats in flight with groups: places of their fields, in floats, fit 32 bits with a sign.
constexpr std::size_t kMostSplats = std::size_t{1} << 27;

}  // namespace

SplatLists::SplatLists(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
                       const SplatListOptions& lists)
    : cloud_(cloud), scene_(scene), options_(options), lists_(lists) {
  if (!cloud.tree().empty()) covering_ = covering_variance(options.lod_pixels(), lists.lowpass);
}

SplatView SplatLists::view(const Camera& camera, const Band& band) const {
  SplatView view{};
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      view.rotation[3 * row + column] = static_cast<float>(camera.camera_from_world(row, column));
    }
  }
  // In double: cloud and camera may both be far from the world's origin.
  const Vec3d translation = camera.camera_from_world * (cloud_.origin() - camera.eye);
  for (int i = 0; i < 3; ++i) view.translation[i] = static_cast<float>(translation[i]);
  view.focal_x = static_cast<float>(camera.focal_x);
  view.focal_y = static_cast<float>(camera.focal_y);
  view.center_x = static_cast<float>(camera.center_x);
  view.center_y = static_cast<float>(camera.center_y);
  view.near = static_cast<float>(camera.near);
  view.orthographic = camera.orthographic;
  view.cull_back = options_.cull_back;
  view.cutoff = static_cast<float>(options_.cutoff);
  view.lowpass2 = static_cast<float>(lists_.lowpass * lists_.lowpass);
  view.circular = options_.filter == Filter::kCircular;
  view.tolerance = std::numeric_limits<float>::infinity();
  if (!camera.orthographic && !view.circular && options_.kernel != Kernel::kAffine) {
    view.tolerance =
        options_.kernel == Kernel::kAuto ? static_cast<float>(options_.kernel_tolerance) : -1.0F;
  }
  view.clip_x1 = static_cast<float>(camera.width);
  view.clip_y0 = static_cast<float>(band.y0);
  view.clip_y1 = static_cast<float>(band.y1);
  return view;
}

std::vector<VisibleCluster> SplatLists::cull(const Camera& camera, const Band& band) {
  view_ = view(camera, band);
  const std::vector<Cluster>& clusters = cloud_.clusters();
  const Eigen::Matrix3f rotation = camera.camera_from_world.cast<float>();
  const Vec3f translation(view_.translation[0], view_.translation[1], view_.translation[2]);
  const auto width = static_cast<float>(camera.width);
  const float reach = std::sqrt(2 * view_.cutoff);
  const float filter = reach * static_cast<float>(lists_.lowpass);
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
  const Edge edges[] = {edge(0, view_.focal_x, view_.center_x, 0, -1),
                        edge(0, view_.focal_x, view_.center_x, width, 1),
                        edge(1, view_.focal_y, view_.center_y, static_cast<float>(band.y0), -1),
                        edge(1, view_.focal_y, view_.center_y, static_cast<float>(band.y1), 1)};
  const auto visible = [&](const Cluster& cluster, const Vec3f& p) {
    const float radius = cluster.radius + disc_radius(cluster);
    if (p.z() + radius <= view_.near) return false;
    for (const Edge& e : edges) {
      const float outside = camera.orthographic ? e.sign * e.focal * p[e.axis] - e.offset
                                                : e.sign * e.focal * p[e.axis] - e.offset * p.z();
      if (outside > radius * e.norm) return false;
    }
    if (options_.cull_back && cluster.cone_cosine > 0) {
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
  const auto in_camera = [&](std::size_t i) -> Vec3f {
    return rotation * clusters[i].center + translation;
  };
  const auto seen = [&](std::uint32_t i) { return visible(clusters[i], in_camera(i)); };
  const auto entry = [&](std::uint32_t i) {
    const float nearest = in_camera(i).z() - clusters[i].radius;
    // Estimate of a splat's side in tiles, for the size of batches only.
    const float z = camera.orthographic ? 1.0F : std::max(nearest, 1e-6F);
    const double side = std::min<double>(
        std::max(band.tiles_x, band.tiles_y),
        1 + 2 * (disc_radius(clusters[i]) * std::max(view_.focal_x, view_.focal_y) / z + filter) /
                kTileSize);
    return VisibleCluster{nearest, i, (clusters[i].end - clusters[i].begin) * side * side};
  };
  std::vector<VisibleCluster> all;
  if (!cloud_.tree().empty()) {
    for (const std::uint32_t i : level_of_detail(camera, seen)) all.push_back(entry(i));
  } else {
    constexpr std::size_t kGrain = 1024;
    std::vector<std::vector<VisibleCluster>> found((clusters.size() + kGrain - 1) / kGrain);
    parallel_for(clusters.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        const auto index = static_cast<std::uint32_t>(i);
        if (seen(index)) found[begin / kGrain].push_back(entry(index));
      }
    });
    for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  }
  std::sort(all.begin(), all.end(), [](const VisibleCluster& a, const VisibleCluster& b) {
    return a.nearest != b.nearest ? a.nearest < b.nearest : a.index < b.index;
  });
  return all;
}

/// The clusters to draw of a cloud with levels of detail: as coarse as lod_error allows.
std::vector<std::uint32_t> SplatLists::level_of_detail(
    const Camera& camera, FunctionRef<bool(std::uint32_t)> seen) const {
  const auto error = static_cast<float>(options_.lod_pixels());
  const float pixels_per_unit = std::max(view_.focal_x, view_.focal_y);
  const Vec3f forward = camera.camera_from_world.row(2).cast<float>();
  return cut_tree(cloud_.tree(), [&](std::uint32_t i) {
    if (!seen(i)) return CutStep::kSkip;
    const TreeCluster& cluster = cloud_.tree()[i];
    const float z =
        forward.dot(cluster.bounds.center) + view_.translation[2] - cluster.bounds.radius;
    return fine_enough(cluster, z, pixels_per_unit, camera.orthographic, error) ? CutStep::kDraw
                                                                                : CutStep::kRefine;
  });
}

float SplatLists::disc_radius(const Cluster& cluster) const {
  return lists_.enlarged ? cluster.max_group_radius
                         : std::sqrt(2 * view_.cutoff) * cluster.max_deviation;
}

/// What a surfel's standard deviations are multiplied with for its disc to have the radius that its
/// group asks for.
double SplatLists::enlargement(std::size_t surfel) const {
  const float deviation = cloud_.anisotropic()
                              ? std::max(cloud_.deviation_u[surfel], cloud_.deviation_v[surfel])
                              : cloud_.deviation_u[surfel];
  return cloud_.group_radius[surfel] / (std::sqrt(2 * options_.cutoff) * deviation);
}

SurfelColumns SplatLists::columns_of(const Cluster& cluster, Worker& worker) const {
  const auto from = [&](const Array<float>& column) {
    return column.empty() ? nullptr : column.data() + cluster.begin;
  };
  SurfelColumns surfels{from(cloud_.x),           from(cloud_.y),           from(cloud_.z),
                        from(cloud_.normal_x),    from(cloud_.normal_y),    from(cloud_.normal_z),
                        from(cloud_.deviation_u), from(cloud_.deviation_v), from(cloud_.tangent_x),
                        from(cloud_.tangent_y),   from(cloud_.tangent_z),   from(cloud_.area)};
  const bool widened = covering_ > 0;
  if (!lists_.enlarged && !widened) return surfels;
  const auto change = [&](const Array<float>& deviation, Array<float>& out) {
    out.assign(RenderCloud::kClusterSize + RenderCloud::kPadding, 0.0F);
    for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
      out[i - cluster.begin] = widened ? std::max(deviation[i], covering_deviation(i))
                                       : static_cast<float>(deviation[i] * enlargement(i));
    }
    return out.data();
  };
  surfels.deviation_u = change(cloud_.deviation_u, worker.deviation_u);
  if (cloud_.anisotropic()) surfels.deviation_v = change(cloud_.deviation_v, worker.deviation_v);
  return surfels;
}

float SplatLists::covering_deviation(std::size_t surfel) const {
  return surfel < cloud_.first_finest() ? std::sqrt(covering_ * cloud_.area[surfel]) : 0.0F;
}

/// Surfel in camera space, in double; an unknown normal looks at the eye.
SurfelInCamera SplatLists::in_camera(const Camera& camera, std::size_t surfel) const {
  SurfelInCamera s;
  const Eigen::Matrix3d& rotation = camera.camera_from_world;
  s.position = rotation * (cloud_.origin() - camera.eye +
                           Vec3d(cloud_.x[surfel], cloud_.y[surfel], cloud_.z[surfel]));
  s.normal =
      rotation * Vec3d(cloud_.normal_x[surfel], cloud_.normal_y[surfel], cloud_.normal_z[surfel]);
  s.normal = s.normal.isZero(0) ? Vec3d(-s.position.normalized()) : Vec3d(s.normal.normalized());
  const double scale = lists_.enlarged ? enlargement(surfel) : 1;
  const double least = covering_deviation(surfel);
  s.variance_u = std::pow(std::max<double>(scale * cloud_.deviation_u[surfel], least), 2);
  s.variance_v = s.variance_u;
  s.tangent = s.normal.unitOrthogonal();
  if (cloud_.anisotropic()) {
    s.variance_v = std::pow(std::max<double>(scale * cloud_.deviation_v[surfel], least), 2);
    const Vec3d t = rotation * Vec3d(cloud_.tangent_x[surfel], cloud_.tangent_y[surfel],
                                     cloud_.tangent_z[surfel]);
    s.tangent = (t - s.normal * s.normal.dot(t)).normalized();
  }
  s.area = cloud_.area[surfel];
  return s;
}

/// Stores a splat, `splat` without its colour, and counts the tiles that it touches.
void SplatLists::add_splat(const Band& band, std::size_t surfel, const Splat& splat,
                           const TileRange& range, std::size_t at, std::vector<std::uint32_t>& seen,
                           std::uint32_t* tile_counts) {
  const std::uint32_t material = cloud_.material.empty() ? 0 : cloud_.material[surfel];
  float alpha = cloud_.alpha.empty() ? 1.0F : cloud_.alpha[surfel];
  if (!lists_.opaque) {
    alpha *= scene_.materials[std::min<std::size_t>(material, scene_.materials.size() - 1)].opacity;
  }
  Splat& out = splats_[at];
  out = splat;
  out.red = cloud_.red[surfel] * alpha;
  out.green = cloud_.green[surfel] * alpha;
  out.blue = cloud_.blue[surfel] * alpha;
  out.alpha = alpha;
  out.tag = splat.tag | material << kMaterialShift;
  if (lists_.normals) {
    normals_[at] = {cloud_.normal_x[surfel], cloud_.normal_y[surfel], cloud_.normal_z[surfel]};
  }
  if (lists_.groups) groups_[at] = cloud_.group[surfel];
  ranges_[at] = range;
  seen.push_back(static_cast<std::uint32_t>(at));
  for (int ty = range.y0; ty <= range.y1; ++ty) {
    for (int tx = range.x0; tx <= range.x1; ++tx) ++tile_counts[ty * band.tiles_x + tx];
  }
}

/// Sets up a batch's clusters, `per_segment` of them at a time, and counts the tiles that each
/// segment's splats touch. Returns how many splats are seen.
std::size_t SplatLists::set_up(const Camera& camera, const Band& band,
                               const VisibleCluster* clusters, std::size_t count,
                               std::size_t per_segment) {
  const std::size_t tiles = band.tiles();
  // Of half the box of a kernel with twice the pixel filter's variance: half of it is the filter's.
  const float filtered_diagonal2 = 2 * view_.cutoff * 4 * view_.lowpass2;
  const ExactKernelView exact_view{.cutoff = options_.cutoff,
                                   .lowpass = lists_.lowpass,
                                   .x1 = static_cast<double>(camera.width),
                                   .y0 = static_cast<double>(band.y0),
                                   .y1 = static_cast<double>(band.y1)};
  parallel_for(count, per_segment, [&](std::size_t begin, std::size_t end, int worker) {
    const std::size_t segment = begin / per_segment;
    std::uint32_t* tile_counts = histogram_.data() + segment * tiles;
    std::fill_n(tile_counts, tiles, 0U);
    std::vector<std::uint32_t>& seen = kept_[segment];
    seen.clear();
    SplatColumns& columns = workers_[worker].columns;
    for (std::size_t c = begin; c < end; ++c) {
      const Cluster& cluster = cloud_.clusters()[clusters[c].index];
      const std::uint32_t i = cluster.begin;
      set_up_splats(view_, columns_of(cluster, workers_[worker]), static_cast<int>(cluster.end - i),
                    columns);
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
        exact_[at] = kernel->exact;
        add_splat(band, surfel, kernel->splat, kernel->tiles, at++, seen, tile_counts);
        ++workers_[worker].exact_splats;
      }
    }
  });
  std::size_t seen = 0;
  for (std::size_t s = 0; s < (count + per_segment - 1) / per_segment; ++s) seen += kept_[s].size();
  return seen;
}

/// Writes every tile's list: splats in the order of the segments, which is that of the clusters.
void SplatLists::bin(const Band& band, std::size_t segments) {
  const std::size_t tiles = band.tiles();
  // Entries become places: first within the tile's list, then in `references_`.
  tile_begin_.resize(tiles + 1);
  std::fill_n(tile_begin_.data(), tiles, 0U);
  for (std::size_t i = 0; i < segments * tiles; i += tiles) {
    for (std::size_t t = 0; t < tiles; ++t) {
      const std::uint32_t n = histogram_[i + t];
      histogram_[i + t] = tile_begin_[t];
      tile_begin_[t] += n;
    }
  }
  std::size_t sum = 0;
  for (std::size_t t = 0; t < tiles; ++t) {
    const std::uint32_t n = tile_begin_[t];
    tile_begin_[t] = static_cast<std::uint32_t>(sum);
    sum += n;
  }
  if (sum > std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorKind::kNumeric, "the splats are too large on screen; move the camera back");
  }
  tile_begin_[tiles] = static_cast<std::uint32_t>(sum);
  references_.resize(sum);
  parallel_for(segments, 1, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t s = begin; s < end; ++s) {
      std::uint32_t* cursor = histogram_.data() + s * tiles;
      for (std::size_t t = 0; t < tiles; ++t) cursor[t] += tile_begin_[t];
      for (const std::uint32_t splat : kept_[s]) {
        const TileRange& range = ranges_[splat];
        const Reference reference{splat, splats_[splat].depth};
        for (int ty = range.y0; ty <= range.y1; ++ty) {
          for (int tx = range.x0; tx <= range.x1; ++tx) {
            references_[cursor[ty * band.tiles_x + tx]++] = reference;
          }
        }
      }
    }
  });
}

/// Indices of the splats of `list`, nearest first, splats of equal depth in the list's order. The
/// key is 16 bits of the depth's place in the list's range: two stable passes of counting.
void SplatLists::sort_front_to_back(const Reference* list, std::size_t count, Worker& worker) {
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

std::size_t SplatLists::end_of_batch(const std::vector<VisibleCluster>& clusters,
                                     std::size_t begin) const {
  std::size_t end = begin;
  double expected = 0;
  while (end < clusters.size() && (end - begin + 1) * RenderCloud::kClusterSize <= options_.batch &&
         (end == begin || expected + clusters[end].references <= kBatchReferences)) {
    expected += clusters[end++].references;
  }
  return end;
}

std::size_t SplatLists::make(const Camera& camera, const Band& band, const VisibleCluster* clusters,
                             std::size_t count, StageTimes& stages) {
  // Enough for the threads to share the work evenly; lists do not depend on their number.
  const std::size_t most_segments = std::clamp<std::size_t>(
      kHistogramEntries / band.tiles(), 4, 16 * static_cast<std::size_t>(thread_count()));
  const std::size_t per_segment =
      std::max<std::size_t>(1, (count + most_segments - 1) / most_segments);
  const std::size_t segments = (count + per_segment - 1) / per_segment;
  const std::size_t capacity = count * RenderCloud::kClusterSize;
  if (lists_.groups && capacity > kMostSplats) {
    throw Error(
        ErrorKind::kNumeric,
        "more than 134 million surfels are seen at once, more than methods with groups take; "
        "use --method abuffer");
  }
  workers_.resize(std::max<std::size_t>(workers_.size(), thread_count()));
  splats_.resize(std::max(splats_.size(), capacity));
  ranges_.resize(std::max(ranges_.size(), capacity));
  if (lists_.normals) normals_.resize(std::max(normals_.size(), capacity));
  if (lists_.groups) groups_.resize(std::max(groups_.size(), capacity));
  if (std::isfinite(view_.tolerance)) exact_.resize(std::max(exact_.size(), capacity));
  histogram_.resize(segments * band.tiles());
  kept_.resize(std::max(kept_.size(), segments));

  Timer timer;
  const std::size_t seen = set_up(camera, band, clusters, count, per_segment);
  stages.add("setup", timer.milliseconds());
  timer.restart();
  bin(band, segments);
  stages.add("bin", timer.milliseconds());
  return seen;
}

TileJob SplatLists::job(std::size_t tile, int worker) {
  Worker& w = workers_[worker];
  sort_front_to_back(references_.data() + tile_begin_[tile], count(tile), w);
  return {.splats = splats_.data(),
          .normals = lists_.normals ? normals_.data() : nullptr,
          .exact = exact_.data(),
          .groups = lists_.groups ? groups_.data() : nullptr,
          .order = w.order.data(),
          .count = count(tile),
          .cutoff = view_.cutoff,
          .lowpass2 = view_.lowpass2,
          .depth_epsilon = static_cast<float>(options_.depth_epsilon),
          .opaque = lists_.opaque};
}

std::size_t SplatLists::take_exact_count() {
  std::size_t sum = 0;
  for (Worker& worker : workers_) sum += std::exchange(worker.exact_splats, 0);
  return sum;
}

}  // namespace surfel
