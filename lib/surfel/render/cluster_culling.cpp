#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/base/elementary.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/cut.h>
#include <surfel/render/clip_kernel.h>
#include <surfel/render/cluster_culling.h>

namespace surfel {

SplatView ClusterCulling::make_view(const Camera& camera, const Band& band) const {
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
  view.lowpass2 = static_cast<float>(list_.lowpass * list_.lowpass);
  view.margin = static_cast<float>(list_.margin);
  view.edges_filtered = list_.edges_filtered;
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

std::vector<VisibleCluster> ClusterCulling::cull(const Camera& camera, const Band& band) {
  view_ = make_view(camera, band);
  tiles_x_ = band.tiles_x;
  tiles_y_ = band.tiles_y;
  const std::vector<Cluster>& clusters = cloud_.clusters();
  const Eigen::Matrix3f rotation = camera.camera_from_world.cast<float>();
  const auto width = static_cast<float>(camera.width);
  const float reach = std::sqrt(2 * view_.cutoff);
  const float filter = reach * static_cast<float>(list_.lowpass) + view_.margin;
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

/// Share of the band that a cluster's splats reach over, about.
double ClusterCulling::share(const VisibleCluster& visible) const {
  const Cluster& cluster = cloud_.clusters()[visible.index];
  // The square around the sphere, as if it were as far away as its nearest point.
  const Vec3f p = center_in_camera(cluster);
  const float radius = cluster.radius + disc_radius(cluster);
  const float z = view_.orthographic ? 1.0F : p.z() - radius;
  if (!(z > 0)) return 1;
  const auto length = [&](int axis, float focal, float center, float first, float last) {
    const float at = center + focal * p[axis] / (view_.orthographic ? 1.0F : p.z());
    const float reach = focal * radius / z;
    return std::max(0.0F, std::min(last, at + reach) - std::max(first, at - reach));
  };
  const float y0 = view_.clip_y0;
  const float y1 = view_.clip_y1;
  return length(0, view_.focal_x, view_.center_x, 0, view_.clip_x1) / view_.clip_x1 *
         length(1, view_.focal_y, view_.center_y, y0, y1) / (y1 - y0);
}

double ClusterCulling::mean_share(std::span<const VisibleCluster> clusters) const {
  constexpr std::size_t kSample = 64;
  const std::size_t sample = std::min(kSample, clusters.size());
  double sum = 0;
  for (std::size_t i = 0; i < sample; ++i) sum += share(clusters[i * clusters.size() / sample]);
  return sample == 0 ? 0 : sum / static_cast<double>(sample);
}

Vec3f ClusterCulling::center_in_camera(const Cluster& cluster) const {
  const Eigen::Map<const Eigen::Matrix<float, 3, 3, Eigen::RowMajor>> rotation(view_.rotation);
  return rotation * cluster.center +
         Vec3f(view_.translation[0], view_.translation[1], view_.translation[2]);
}

/// The projected box of the cluster, extended by the reach of a disc and of the pixel filter.
TileRange ClusterCulling::tiles_of(const Cluster& cluster) const {
  const Vec3f center = center_in_camera(cluster);
  const TileRange all{0, 0, static_cast<std::uint16_t>(tiles_x_ - 1),
                      static_cast<std::uint16_t>(tiles_y_ - 1)};
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
std::vector<std::uint32_t> ClusterCulling::level_of_detail(
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
bool ClusterCulling::listed(const Cluster& cluster) const {
  switch (list_.surfels) {
    case ListedSurfels::kAll:
      break;
    case ListedSurfels::kOriginals:
      return !cluster.copies;
    case ListedSurfels::kAdditions:
      return cluster.copies || list_.enlarged;
  }
  return true;
}

float ClusterCulling::disc_radius(const Cluster& cluster) const {
  return list_.enlarged ? cluster.max_group_radius
                        : std::sqrt(2 * view_.cutoff) * cluster.max_deviation;
}

}  // namespace surfel
