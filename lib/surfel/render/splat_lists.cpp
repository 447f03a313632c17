#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/cut.h>
#include <surfel/render/clip_kernel.h>
#include <surfel/render/exact_kernel.h>
#include <surfel/render/splat_lists.h>

namespace surfel {
namespace {

/// A block's splats should fit a core's second-level cache and leave room for other data.
constexpr double kBlockSplats = 24000;
/// Blocks that a band has at least, for the threads to share. Each block sets up all splats that
/// reach into it: where each reaches over more than kWideShare of the band, fewer blocks do.
constexpr std::size_t kLeastBlocks = 64;
constexpr std::size_t kLeastBlocksOfWide = 16;
constexpr double kWideShare = 0.25;
/// Most splats of a block: places of their fields, in floats, fit 32 bits with a sign.
constexpr std::size_t kMostSplats = std::size_t{1} << 27;
/// Splats of a block for which there is room at once, if it may have as many.
constexpr std::size_t kFirstSplats = std::size_t{1} << 19;
/// A group that enlarges a disc by less than this factor leaves it as it was, within rounding.
constexpr float kLeastEnlargement = 1 + 1e-3F;
constexpr float kNoSplat = std::numeric_limits<float>::quiet_NaN();

/// Whether a splat covers a tile that it meets, or may.
bool is_large(const PixelBox& box) {
  return box.x1 - box.x0 >= kTileSize && box.y1 - box.y0 >= kTileSize;
}

}  // namespace

BlockGrid::BlockGrid(const Band& band, std::size_t surfels, double share) {
  const std::size_t least = share > kWideShare ? kLeastBlocksOfWide : kLeastBlocks;
  const auto make = [&](int s) {
    shift = s;
    blocks_x = (band.tiles_x + (1 << s) - 1) >> s;
    blocks_y = (band.tiles_y + (1 << s) - 1) >> s;
  };
  constexpr int kMostShift = std::bit_width(static_cast<unsigned>(kMostBlockSize / kTileSize)) - 1;
  for (int s = kMostShift; s >= 1; --s) {
    make(s);
    if (blocks() >= least &&
        static_cast<double>(surfels) <= kBlockSplats * static_cast<double>(blocks())) {
      return;
    }
  }
}

SplatLists::SplatLists(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
                       const ABufferLayout& layout, const SplatListOptions& lists)
    : cloud_(cloud), scene_(scene), options_(options), layout_(layout), lists_(lists) {
  lists_.enlarged = lists.enlarged && !cloud.group_radius.empty();
  rules_ = {.cutoff = static_cast<float>(options.cutoff),
            .lowpass2 = static_cast<float>(lists.lowpass * lists.lowpass),
            .depth_epsilon = static_cast<float>(options.epsilon_share()),
            .opaque = layout.opaque};
  if (!layout.opaque && !lists.groups && !lists.enlarged) {
    flatness_ = std::vector<std::atomic<Flatness>>(cloud.clusters().size());
  }
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
  view.cutoff = rules_.cutoff;
  view.lowpass2 = rules_.lowpass2;
  view.margin = static_cast<float>(lists_.margin);
  view.edges_filtered = lists_.edges_filtered;
  view.beyond_growth = beyond_growth(options_.cutoff);
  view.circular = options_.filter == Filter::kCircular;
  view.tolerance = std::numeric_limits<float>::infinity();
  if (!camera.orthographic && !view.circular && options_.kernel != Kernel::kAffine) {
    view.tolerance =
        options_.kernel == Kernel::kAuto ? static_cast<float>(options_.kernel_tolerance) : -1.0F;
  }
  view.clip_x0 = 0;
  view.clip_y0 = static_cast<float>(band.y0);
  view.clip_x1 = static_cast<float>(camera.width);
  view.clip_y1 = static_cast<float>(band.y1);
  return view;
}

std::vector<VisibleCluster> SplatLists::cull(const Camera& camera, const Band& band) {
  view_ = view(camera, band);
  const std::vector<Cluster>& clusters = cloud_.clusters();
  const Eigen::Matrix3f rotation = camera.camera_from_world.cast<float>();
  const auto width = static_cast<float>(camera.width);
  const float reach = std::sqrt(2 * view_.cutoff);
  const float filter = reach * static_cast<float>(lists_.lowpass) + view_.margin;
  // Side planes of the view through the band's edges, moved out by the filter's reach: a sphere at
  // camera-space centre p is outside where a . (p.x or p.y, p.z) > radius * |a|.
  struct Edge {
    float focal, offset, sign;
    int axis;
    float norm;
  };
  const auto edge = [&](int axis, float focal, float center, float pixel, float sign) {
    const float offset = sign * (pixel - center) + filter;
    return Edge{focal, offset, sign, axis,
                camera.orthographic ? focal : portable::hypot(focal, offset)};
  };
  const Edge edges[] = {edge(0, view_.focal_x, view_.center_x, 0, -1),
                        edge(0, view_.focal_x, view_.center_x, width, 1),
                        edge(1, view_.focal_y, view_.center_y, static_cast<float>(band.y0), -1),
                        edge(1, view_.focal_y, view_.center_y, static_cast<float>(band.y1), 1)};
  const auto visible = [&](const Cluster& cluster, const Vec3f& p) {
    if (!listed(cluster)) return false;
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
          portable::acos(std::min(1.0F, along)) + portable::asin(spread) +
                  portable::acos(cluster.cone_cosine) <
              1.5707F) {
        return false;
      }
    }
    return true;
  };
  const auto seen = [&](std::uint32_t i) {
    return visible(clusters[i], center_in_camera(clusters[i]));
  };
  const auto entry = [&](std::uint32_t i) {
    const float z = center_in_camera(clusters[i]).z();
    return VisibleCluster{.nearest = z - clusters[i].radius, .index = i};
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

double SplatLists::mean_share(const Band& band, std::span<const VisibleCluster> clusters) const {
  constexpr std::size_t kSample = 64;
  const std::size_t sample = std::min(kSample, clusters.size());
  double sum = 0;
  for (std::size_t i = 0; i < sample; ++i) {
    const Cluster& cluster = cloud_.clusters()[clusters[i * clusters.size() / sample].index];
    // The square around the sphere, as if it were as far away as its nearest point.
    const Vec3f p = center_in_camera(cluster);
    const float radius = cluster.radius + disc_radius(cluster);
    const float z = view_.orthographic ? 1.0F : p.z() - radius;
    if (!(z > 0)) {
      sum += 1;
      continue;
    }
    const auto length = [&](int axis, float focal, float center, float first, float last) {
      const float at = center + focal * p[axis] / (view_.orthographic ? 1.0F : p.z());
      const float reach = focal * radius / z;
      return std::max(0.0F, std::min(last, at + reach) - std::max(first, at - reach));
    };
    const auto y0 = static_cast<float>(band.y0);
    const auto y1 = static_cast<float>(band.y1);
    sum += length(0, view_.focal_x, view_.center_x, 0, view_.clip_x1) / view_.clip_x1 *
           length(1, view_.focal_y, view_.center_y, y0, y1) / (y1 - y0);
  }
  return sample == 0 ? 0 : sum / static_cast<double>(sample);
}

Vec3f SplatLists::center_in_camera(const Cluster& cluster) const {
  const Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>> rotation(view_.rotation);
  return rotation * cluster.center +
         Vec3f(view_.translation[0], view_.translation[1], view_.translation[2]);
}

/// The projected box of the cluster, extended by the reach of a disc and of the pixel filter.
SplatLists::TileRange SplatLists::tiles_of(const Cluster& cluster) const {
  const Vec3f center = center_in_camera(cluster);
  const Band& band = frame_->band;
  const TileRange all{0, 0, static_cast<std::uint16_t>(band.tiles_x - 1),
                      static_cast<std::uint16_t>(band.tiles_y - 1)};
  const Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>> rotation(view_.rotation);
  const Eigen::Matrix3f half = rotation * cluster.half_extent.asDiagonal();
  const float radius = disc_radius(cluster);
  const float least_z = center.z() - half.row(2).cwiseAbs().sum() - radius;
  // A cluster that reaches near the eye's plane may be seen anywhere.
  if (!view_.orthographic && !(least_z > 0.1F * radius)) return all;
  Eigen::Array2f lo = Eigen::Array2f::Constant(std::numeric_limits<float>::infinity());
  Eigen::Array2f hi = -lo;
  for (int corner = 0; corner < 8; ++corner) {
    Vec3f p = center;
    for (int axis = 0; axis < 3; ++axis) {
      if ((corner >> axis & 1) != 0) {
        p += half.col(axis);
      } else {
        p -= half.col(axis);
      }
    }
    const Eigen::Array2f slope = view_.orthographic ? p.head<2>() : Vec2f(p.head<2>() / p.z());
    lo = lo.min(slope);
    hi = hi.max(slope);
  }
  // An offset (a, b) of a point at slope X and depth z moves it by (a - X b) / (z + b) at most.
  const Eigen::Array2f reach =
      view_.orthographic
          ? Eigen::Array2f::Constant(radius)
          : Eigen::Array2f((lo.abs().max(hi.abs()).square() + 1).sqrt() * (radius / least_z));
  const Eigen::Array2f focal(view_.focal_x, view_.focal_y);
  const Eigen::Array2f middle(view_.center_x, view_.center_y - view_.clip_y0);
  constexpr float kRounding = 0.01F;  // Pixels: coordinates round by 2^-8 of one at most.
  const float filter = std::sqrt(2 * view_.cutoff * view_.lowpass2) + view_.margin + kRounding;
  const Eigen::Array2f size(view_.clip_x1, view_.clip_y1 - view_.clip_y0);
  const Eigen::Array2f first = (focal * (lo - reach) + middle - filter).max(0.0F).min(size - 1);
  const Eigen::Array2f last = (focal * (hi + reach) + middle + filter).max(0.0F).min(size - 1);
  return {static_cast<std::uint16_t>(first.x() / kTileSize),
          static_cast<std::uint16_t>(first.y() / kTileSize),
          static_cast<std::uint16_t>(last.x() / kTileSize),
          static_cast<std::uint16_t>(last.y() / kTileSize)};
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

/// Whether surfels of the cluster can be in the list.
bool SplatLists::listed(const Cluster& cluster) const {
  switch (lists_.surfels) {
    case ListedSurfels::kAll:
      break;
    case ListedSurfels::kOriginals:
      return !cluster.copies;
    case ListedSurfels::kAdditions:
      return cluster.copies || lists_.enlarged;
  }
  return true;
}

/// Whether a cluster's surfels are of transparent planes: most neighbours in its order, which are
/// near to each other in space, lie in one plane. Where several planes cross, most neighbours still
/// are of one plane.
bool SplatLists::is_flat(const Cluster& cluster) {
  if (flatness_.empty()) return false;
  // Squares of the angle from normal to normal, which is larger on spheres of a million surfels,
  // and of the slope of the line from place to place, radians^2.
  constexpr float kMostTurn2 = 0.002F * 0.002F;
  constexpr float kMostSlope2 = 0.05F * 0.05F;
  constexpr float kLeastShare = 0.75F;
  const auto index = static_cast<std::size_t>(&cluster - cloud_.clusters().data());
  std::atomic<Flatness>& known = flatness_[index];
  if (const Flatness f = known.load(std::memory_order_relaxed); f != Flatness::kUnknown) {
    return f == Flatness::kFlat;
  }
  const SurfelColumns c = surfel_columns(cluster);
  const std::size_t pairs = cluster.end - cluster.begin - 1;
  std::size_t in_plane = 0;
  for (std::size_t i = 0; i < pairs; ++i) {
    const Vec3f n(c.normal_x[i], c.normal_y[i], c.normal_z[i]);
    const Vec3f next(c.normal_x[i + 1], c.normal_y[i + 1], c.normal_z[i + 1]);
    const Vec3f offset(c.x[i + 1] - c.x[i], c.y[i + 1] - c.y[i], c.z[i + 1] - c.z[i]);
    const float off_plane = n.dot(offset);
    const bool agree = (next - n).squaredNorm() < kMostTurn2 &&
                       off_plane * off_plane <= kMostSlope2 * offset.squaredNorm();
    in_plane += agree ? 1 : 0;
  }
  const bool flat =
      pairs > 0 && static_cast<float>(in_plane) >= kLeastShare * static_cast<float>(pairs);
  known.store(flat ? Flatness::kFlat : Flatness::kNotFlat, std::memory_order_relaxed);
  return flat;
}

float SplatLists::disc_radius(const Cluster& cluster) const {
  return lists_.enlarged ? cluster.max_group_radius
                         : std::sqrt(2 * view_.cutoff) * cluster.max_deviation;
}

/// The factor on a surfel's standard deviations that gives its disc the radius that its group asks
/// for.
float SplatLists::enlargement(std::size_t surfel) const {
  return cloud_.group_radius[surfel] /
         (std::sqrt(2 * view_.cutoff) * cloud_.larger_deviation(surfel));
}

SurfelColumns SplatLists::surfel_columns(const Cluster& cluster) const {
  const auto from = [&](const Array<float>& column) {
    return column.empty() ? nullptr : column.data() + cluster.begin;
  };
  const auto half_planes = [&](const RenderCloud::ClipColumns& clip) -> HalfPlaneColumns {
    return {from(clip.x), from(clip.y), from(clip.z), from(clip.distance)};
  };
  return {from(cloud_.x),
          from(cloud_.y),
          from(cloud_.z),
          from(cloud_.normal_x),
          from(cloud_.normal_y),
          from(cloud_.normal_z),
          from(cloud_.deviation_u),
          from(cloud_.deviation_v),
          from(cloud_.tangent_x),
          from(cloud_.tangent_y),
          from(cloud_.tangent_z),
          from(cloud_.area),
          from(cloud_.red),
          from(cloud_.green),
          from(cloud_.blue),
          from(cloud_.alpha),
          {half_planes(cloud_.clip[0]), half_planes(cloud_.clip[1])}};
}

/// The surfels with the deviations that they are drawn with.
SurfelColumns SplatLists::columns_of(const Cluster& cluster, Worker& worker) const {
  SurfelColumns surfels = surfel_columns(cluster);
  const bool widened = covering_ > 0;
  if (!lists_.enlarged && !widened) return surfels;
  const auto change = [&](const Array<float>& deviation, Array<float>& out) {
    out.assign(RenderCloud::kClusterSize + RenderCloud::kPadding, 0.0F);
    if (widened) {
      for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
        out[i - cluster.begin] = std::max(deviation[i], covering_deviation(cluster, i));
      }
    } else {
      enlarge(cluster, deviation, out.data());
    }
    return out.data();
  };
  surfels.deviation_u = change(cloud_.deviation_u, worker.deviation_u);
  if (cloud_.anisotropic()) surfels.deviation_v = change(cloud_.deviation_v, worker.deviation_v);
  return surfels;
}

/// Standard deviations with which a cluster's discs have the radii that their groups ask for.
void SplatLists::enlarge(const Cluster& cluster, const Array<float>& deviation, float* out) const {
  // Splats are not set up of surfels whose deviation is no number.
  const bool added_alone = lists_.surfels == ListedSurfels::kAdditions && !cluster.copies;
  const float least = added_alone ? kLeastEnlargement : 0;
  const float inv_reach = 1 / std::sqrt(2 * view_.cutoff);
  const float* const radius = cloud_.group_radius.data();
  const float* const u = cloud_.deviation_u.data();
  const float* const v = (cloud_.anisotropic() ? cloud_.deviation_v : cloud_.deviation_u).data();
  const float* const from = deviation.data();
  for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
    const float factor = radius[i] * inv_reach / std::max(u[i], v[i]);
    out[i - cluster.begin] = factor > least ? from[i] * factor : kNoSplat;
  }
}

float SplatLists::covering_deviation(const Cluster& cluster, std::size_t surfel) const {
  return cluster.merged ? std::sqrt(covering_ * cloud_.area[surfel]) : 0.0F;
}

/// Surfel in camera space, in double; an unknown normal looks at the eye.
SurfelInCamera SplatLists::in_camera(const Cluster& cluster, std::size_t surfel) const {
  SurfelInCamera s;
  const Camera& camera = frame_->camera;
  const Eigen::Matrix3d& rotation = camera.camera_from_world;
  s.position = rotation * (cloud_.origin() - camera.eye +
                           Vec3d(cloud_.x[surfel], cloud_.y[surfel], cloud_.z[surfel]));
  s.normal =
      rotation * Vec3d(cloud_.normal_x[surfel], cloud_.normal_y[surfel], cloud_.normal_z[surfel]);
  s.normal = s.normal.isZero(0) ? Vec3d(-s.position.normalized()) : Vec3d(s.normal.normalized());
  const double scale = lists_.enlarged ? enlargement(surfel) : 1;
  const double least = covering_deviation(cluster, surfel);
  s.variance_u = portable::squared(std::max<double>(scale * cloud_.deviation_u[surfel], least));
  s.variance_v = s.variance_u;
  s.tangent = s.normal.unitOrthogonal();
  if (cloud_.anisotropic()) {
    s.variance_v = portable::squared(std::max<double>(scale * cloud_.deviation_v[surfel], least));
    const Vec3d t = rotation * Vec3d(cloud_.tangent_x[surfel], cloud_.tangent_y[surfel],
                                     cloud_.tangent_z[surfel]);
    s.tangent = (t - s.normal * s.normal.dot(t)).normalized();
  }
  s.area = cloud_.area[surfel];
  for (std::size_t j = 0; j < cloud_.clip.size(); ++j) {
    const RenderCloud::ClipColumns& clip = cloud_.clip[j];
    if (!cloud_.clips(clip, surfel)) continue;
    const Vec3d direction = rotation * Vec3d(clip.x[surfel], clip.y[surfel], clip.z[surfel]);
    s.clip[j] = {(direction - s.normal * s.normal.dot(direction)).normalized(),
                 clip.distance[surfel]};
  }
  return s;
}

void SplatLists::reserve(Worker& worker, std::size_t more, std::size_t most) const {
  const auto grow = [&](auto& array, std::size_t count, std::size_t least) {
    const std::size_t needed = count + more;
    if (array.size() < needed) array.resize(std::max({needed, 2 * array.size(), least}));
  };
  // Only the touched pages of a block of memory of its own count, so that reserving it from the
  // start costs less than moving the splats as their number grows.
  const std::size_t all = std::min(most, kFirstSplats);
  grow(worker.splats, worker.count, all);
  if (layout_.normals) grow(worker.normals, worker.count, all);
  if (lists_.groups) grow(worker.groups, worker.count, all);
  if (std::isfinite(view_.tolerance)) grow(worker.exact, worker.count, all);
  if (cloud_.has_clips()) grow(worker.clips, worker.count, all);
  for (TileList& list : worker.tiles) {
    grow(list.splats, list.count, 0);
    grow(list.depths, list.count + kTileSize, 0);
  }
}

/// Completes the splats from `begin` on, which lack only the values of their materials, and lists
/// them in the tiles that they touch. `surfels` has their surfels.
void SplatLists::add_splats(const Cluster& cluster, std::size_t begin, const std::uint32_t* surfels,
                            Worker& worker) {
  const std::size_t count = worker.count - begin;
  Splat* const splats = worker.splats.data() + begin;
  const std::uint32_t flags = is_flat(cluster) ? kFlatTag : 0;
  for (std::size_t i = 0; i < count && flags != 0; ++i) splats[i].tag |= flags;
  for (std::size_t i = 0; i < count && !cloud_.material.empty(); ++i) {
    splats[i].tag |= std::uint32_t{cloud_.material[surfels[i]]} << kMaterialShift;
  }
  for (std::size_t i = 0; i < count && !layout_.opaque; ++i) {
    const std::size_t material = splats[i].tag >> kMaterialShift;
    const float opacity = scene_.materials[std::min(material, scene_.materials.size() - 1)].opacity;
    for (float* channel : {&splats[i].red, &splats[i].green, &splats[i].blue, &splats[i].alpha}) {
      *channel *= opacity;
    }
  }
  if (layout_.normals) {
    SplatNormal* const normals = worker.normals.data() + begin;
    const bool mapped = cloud_.has_shading();
    const float* const x = (mapped ? cloud_.shading_x : cloud_.normal_x).data();
    const float* const y = (mapped ? cloud_.shading_y : cloud_.normal_y).data();
    const float* const z = (mapped ? cloud_.shading_z : cloud_.normal_z).data();
    for (std::size_t i = 0; i < count; ++i) {
      normals[i] = {x[surfels[i]], y[surfels[i]], z[surfels[i]]};
    }
  }
  for (std::size_t i = 0; i < count && lists_.groups; ++i) {
    worker.groups[begin + i] = cloud_.group[surfels[i]];
  }
  TileList* const tiles = worker.tiles.data();
  for (std::size_t i = 0; i < count; ++i) {
    bool large = false;
    const auto put = [&](int x, int y) {
      TileList& list = tiles[(y << frame_->grid.shift) + x];
      list.splats[list.count] = static_cast<std::uint32_t>(begin + i);
      list.depths[list.count++] = splats[i].depth;
      list.large += large ? 1 : 0;
      list.clipped += (splats[i].tag & kClippedTag) != 0 ? 1 : 0;
    };
    const PixelBox box = splats[i].box;
    large = is_large(box);
    if (large && box == worker.block) {
      worker.covering.push_back(static_cast<std::uint32_t>(begin + i));
      worker.clipped_covering += (splats[i].tag & kClippedTag) != 0 ? 1 : 0;
      continue;
    }
    const int x0 = box.x0 / kTileSize;
    const int y0 = box.y0 / kTileSize;
    const int x1 = box.x1 / kTileSize;
    const int y1 = box.y1 / kTileSize;
    if (x0 == x1 && y0 == y1) {  // Most, where splats are small.
      put(x0, y0);
      continue;
    }
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) put(x, y);
    }
  }
}

void SplatLists::bin(const Frame& frame, std::span<const VisibleCluster> clusters) {
  frame_ = &frame;
  const BlockGrid& grid = frame.grid;
  clusters_ = clusters.data();
  tiles_.resize(clusters.size());
  constexpr std::size_t kGrain = 256;
  parallel_each(clusters.size(), kGrain,
                [&](std::size_t i) { tiles_[i] = tiles_of(cloud_.clusters()[clusters[i].index]); });
  block_begin_.resize(grid.blocks() + 1);
  std::fill(block_begin_.begin(), block_begin_.end(), 0U);
  const auto for_each_block = [&](const TileRange& c, const auto& body) {
    for (int y = c.y0 >> grid.shift; y <= c.y1 >> grid.shift; ++y) {
      for (int x = c.x0 >> grid.shift; x <= c.x1 >> grid.shift; ++x) body(y * grid.blocks_x + x);
    }
  };
  std::size_t sum = 0;
  for (const TileRange& tiles : tiles_) {
    for_each_block(tiles, [&](int block) {
      ++block_begin_[block];
      ++sum;
    });
  }
  if (sum > std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorKind::kNumeric, "the splats are too large on screen; move the camera back");
  }
  std::uint32_t begin = 0;
  for (std::uint32_t& entry : block_begin_) begin += std::exchange(entry, begin);
  block_clusters_.resize(sum);
  // Entries become ends, which are the beginnings one block further.
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    for_each_block(tiles_[i], [&](int block) {
      block_clusters_[block_begin_[block]++] = static_cast<std::uint32_t>(i);
    });
  }
  std::copy_backward(block_begin_.begin(), block_begin_.end() - 1, block_begin_.end());
  block_begin_[0] = 0;
}

void SplatLists::load(std::size_t block, std::size_t begin, std::size_t end, int worker) {
  Worker& w = workers_[worker];
  if ((end - begin) * RenderCloud::kClusterSize > kMostSplats) {
    throw Error(
        ErrorKind::kNumeric,
        "more than 134 million surfels are seen in a few pixels, more than this method draws; "
        "use `method` abuffer");
  }
  SplatView view = view_;
  const int tile_x = frame_->grid.first_tile_x(block);
  const int tile_y = frame_->grid.first_tile_y(block);
  view.first_column = tile_x == 0;
  view.first_row = tile_y == 0;
  view.clip_x0 = static_cast<float>(tile_x * kTileSize);
  view.clip_y0 = view_.clip_y0 + static_cast<float>(tile_y * kTileSize);
  view.clip_x1 = std::min(view_.clip_x1, view.clip_x0 + static_cast<float>(frame_->grid.size()));
  view.clip_y1 = std::min(view_.clip_y1, view.clip_y0 + static_cast<float>(frame_->grid.size()));
  const ExactKernelView exact_view{.cutoff = options_.cutoff,
                                   .lowpass = lists_.lowpass,
                                   .margin = lists_.margin,
                                   .x0 = view.clip_x0,
                                   .y0 = view.clip_y0,
                                   .x1 = view.clip_x1,
                                   .y1 = view.clip_y1,
                                   .first_column = view.first_column,
                                   .first_row = view.first_row};
  w.count = 0;
  ++w.loads;
  w.tiles.resize(std::size_t{1} << 2 * frame_->grid.shift);
  for (TileList& list : w.tiles) list.count = list.large = list.clipped = 0;
  w.covering.clear();
  w.clipped_covering = 0;
  w.block = {0, 0, static_cast<std::uint8_t>(view.clip_x1 - view.clip_x0 - 1),
             static_cast<std::uint8_t>(view.clip_y1 - view.clip_y0 - 1)};
  const auto cluster_at = [&](std::size_t c) -> const Cluster& {
    return cloud_.clusters()[clusters_[block_clusters_[block_begin_[block] + c]].index];
  };
  // Clusters follow one another in depth, not in memory.
  constexpr std::size_t kAhead = 4;
  for (std::size_t c = begin; c < end; ++c) {
    const Cluster& cluster = cluster_at(c);
    const std::uint32_t i = cluster.begin;
    if (c + kAhead < end) __builtin_prefetch(&cluster_at(c + kAhead).begin);
    std::optional<SurfelColumns> ahead;
    if (c + 1 < end) ahead = surfel_columns(cluster_at(c + 1));
    reserve(w, RenderCloud::kClusterSize, (end - begin) * RenderCloud::kClusterSize);
    SetUpSplats& set_up = w.set_up;
    set_up_splats(view, columns_of(cluster, w), static_cast<int>(cluster.end - i),
                  ahead ? &*ahead : nullptr, w.splats.data() + w.count,
                  cloud_.has_clips() ? w.clips.data() + w.count : nullptr, set_up);
    w.splats_seen += static_cast<std::size_t>(set_up.first_count);
    const std::size_t first = w.count;
    std::array<std::uint32_t, RenderCloud::kClusterSize> surfels;
    for (int v = 0; v < set_up.visible_count; ++v) {
      surfels[v] = i + static_cast<std::uint32_t>(set_up.visible[v]);
    }
    w.count += static_cast<std::size_t>(set_up.visible_count);
    for (int v = 0; v < set_up.exact_count; ++v) {
      const std::size_t surfel = i + static_cast<std::size_t>(set_up.exact[v]);
      const std::optional<ExactKernel> kernel =
          make_exact_kernel(in_camera(cluster, surfel), frame_->camera, exact_view);
      if (!kernel) continue;
      w.exact[w.count] = kernel->exact;
      surfels[w.count - first] = static_cast<std::uint32_t>(surfel);
      Splat& splat = w.splats[w.count++];
      splat = kernel->splat;
      splat.alpha = cloud_.alpha.empty() ? 1.0F : cloud_.alpha[surfel];
      splat.red = cloud_.red[surfel] * splat.alpha;
      splat.green = cloud_.green[surfel] * splat.alpha;
      splat.blue = cloud_.blue[surfel] * splat.alpha;
      if (cloud_.is_clipped(surfel)) {
        splat.tag |= kClippedTag;
        w.clips[w.count - 1] = make_exact_clip(in_camera(cluster, surfel), frame_->camera);
      }
      w.splats_seen += kernel->first ? 1 : 0;
      w.exact_seen += kernel->first ? 1 : 0;
    }
    add_splats(cluster, first, surfels.data(), w);
  }
  w.loaded = w.count;
}

/// Adds the splats that cover the block to a tile's others, in the order of the worker's splats.
void SplatLists::add_covering(TileList& list, const Worker& worker) {
  std::size_t own = list.count;
  std::size_t covering = worker.covering.size();
  list.count += covering;
  list.clipped += worker.clipped_covering;
  if (list.splats.size() < list.count) list.splats.resize(list.count);
  if (list.depths.size() < list.count + kTileSize) list.depths.resize(list.count + kTileSize);
  for (std::size_t to = list.count; covering > 0;) {
    --to;
    if (own > 0 && list.splats[own - 1] > worker.covering[covering - 1]) {
      --own;
      list.splats[to] = list.splats[own];
      list.depths[to] = list.depths[own];
    } else {
      list.splats[to] = worker.covering[--covering];
      list.depths[to] = worker.splats[list.splats[to]].depth;
    }
  }
}

/// Leaves large_splats of the large splats of a tile, with so much more amplitude: their sum stays
/// nearly as it is, whatever their number, at a bounded cost. One is taken from each of equal
/// stretches of the splats that cover the block, and of the tile's others. Neighbours in space
/// follow each other there, so that the splats that stay are spread evenly in space, and tiles that
/// show the same splats leave the same. (docs/reliability.md tells how pictures change.)
void SplatLists::thin_out(TileList& list, Worker& worker) const {
  const std::size_t most = lists_.large_splats;
  const std::size_t large = worker.covering.size() + list.large;
  const float factor = static_cast<float>(large) / static_cast<float>(most);
  // The copies of the tile before are no longer needed.
  worker.count = worker.loaded;
  ++worker.loads;
  reserve(worker, most, 0);
  std::size_t kept = 0;
  const auto next = [&] { return (2 * kept + 1) * large / (2 * most); };
  // A splat of its own, as other tiles draw the splat with another amplitude.
  const auto keep = [&](std::uint32_t at) {
    ++kept;
    const std::size_t copy = worker.count++;
    worker.splats[copy] = worker.splats[at];
    worker.splats[copy].amplitude *= factor;
    if (worker.splats[at].k < 0) {
      worker.exact[copy] = worker.exact[at];
      worker.exact[copy].amplitude *= factor;
    }
    if ((worker.splats[at].tag & kClippedTag) != 0) worker.clips[copy] = worker.clips[at];
    if (layout_.normals) worker.normals[copy] = worker.normals[at];
    if (lists_.groups) worker.groups[copy] = worker.groups[at];
    return static_cast<std::uint32_t>(copy);
  };
  std::size_t left = 0;
  std::size_t seen = worker.covering.size();
  std::vector<std::uint32_t>& copies = worker.copies;
  copies.clear();
  while (next() < seen) copies.push_back(keep(worker.covering[next()]));
  for (std::size_t i = 0; i < list.count; ++i) {
    const std::uint32_t at = list.splats[i];
    if (!is_large(worker.splats[at].box)) {
      list.splats[left] = at;
      list.depths[left++] = list.depths[i];
    } else if (seen++ == next()) {
      copies.push_back(keep(at));
    }
  }
  for (const std::uint32_t copy : copies) {
    list.splats[left] = copy;
    list.depths[left++] = worker.splats[copy].depth;
  }
  worker.thinned += large - kept;
  list.count = left;
  list.clipped += worker.clipped_covering;
}

TileJob SplatLists::job(int x, int y, int worker) {
  Worker& w = workers_[worker];
  TileList& list = w.tiles[(y << frame_->grid.shift) + x];
  if (w.covering.size() + list.large > kMostLargeSplats) {
    thin_out(list, w);
  } else if (!w.covering.empty()) {
    add_covering(list, w);
  }
  if (w.order.size() < list.count + kTileSize) w.order.resize(2 * list.count + kTileSize);
  sort_front_to_back(list.depths.data(), list.splats.data(), list.count, lists_.order, w.sort,
                     w.order.data());
  return {.rules = &rules_,
          .splats = w.splats.data(),
          .normals = layout_.normals ? w.normals.data() : nullptr,
          .exact = w.exact.data(),
          .clips = list.clipped > 0 ? w.clips.data() : nullptr,
          .groups = lists_.groups ? w.groups.data() : nullptr,
          .order = w.order.data(),
          .count = list.count,
          .box_x = x * kTileSize,
          .box_y = y * kTileSize,
          .load = w.loads};
}

std::size_t SplatLists::take_splat_count() {
  std::size_t sum = 0;
  workers_.for_each([&](Worker& worker) { sum += std::exchange(worker.splats_seen, 0); });
  return sum;
}

std::size_t SplatLists::take_thinned_count() {
  std::size_t sum = 0;
  workers_.for_each([&](Worker& worker) { sum += std::exchange(worker.thinned, 0); });
  return sum;
}

std::size_t SplatLists::take_exact_count() {
  std::size_t sum = 0;
  workers_.for_each([&](Worker& worker) { sum += std::exchange(worker.exact_seen, 0); });
  return sum;
}

}  // namespace surfel
