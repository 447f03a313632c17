#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/cloud/morton.h>
#include <surfel/render/render_cloud.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 15;

Vec3f normalized_or_zero(const Vec3f& v) {
  const float length = v.norm();
  return std::isfinite(length) && length > 0 ? Vec3f(v / length) : Vec3f(0, 0, 0);
}

/// Removes from `order` all but the first surfel of each source and place; returns how many. By the
/// place as well, since other programs' files may mean something else by `source`.
std::size_t remove_copies(const SurfelCloud& cloud, Array<std::uint32_t>& order) {
  const auto key = [&](std::uint32_t i) {
    const Vec3f& p = cloud.position[i];
    return std::tuple(cloud.source[i], p.x(), p.y(), p.z());
  };
  Array<std::uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::tuple_cat(key(a), std::tuple(a)) < std::tuple_cat(key(b), std::tuple(b));
  });
  std::vector<bool> is_copy(cloud.size());
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    is_copy[sorted[i]] = key(sorted[i]) == key(sorted[i - 1]);
  }
  return std::erase_if(order, [&](std::uint32_t i) { return is_copy[i]; });
}

}  // namespace

RenderCloud::RenderCloud(const SurfelCloud& cloud, const RenderColumns& needed)
    : origin_(cloud.origin) {
  cloud.check_columns("");
  if (!cloud.empty() && cloud.variance.empty() && !cloud.anisotropic()) {
    throw_input("",
                "the surfels have no variance (nor radius); make it with surfel-from-mesh or "
                "surfel-estimate");
  }
  if (needed.groups && !cloud.empty() && cloud.group.empty()) {
    throw_input("", "the surfels have no groups; run surfel-group on them");
  }
  const bool has_radius = needed.group_radius && !cloud.group_radius.empty();
  const Array<Vec3f>* color = cloud.render_color();
  const Array<std::uint32_t> order = drawing_order(cloud, needed);
  const std::size_t kept = order.size();
  size_ = kept;

  const bool has_alpha =
      std::any_of(cloud.alpha.begin(), cloud.alpha.end(), [](float a) { return a < 1; });
  const auto allocate = [&](std::initializer_list<Array<float>*> columns) {
    for (Array<float>* column : columns) {
      column->resize(kept + kPadding);
      std::fill_n(column->begin() + static_cast<std::ptrdiff_t>(kept), kPadding, 0.0F);
    }
  };
  allocate({&x, &y, &z, &normal_x, &normal_y, &normal_z, &deviation_u, &area, &red, &green, &blue});
  if (cloud.anisotropic()) allocate({&deviation_v, &tangent_x, &tangent_y, &tangent_z});
  if (has_alpha) allocate({&alpha});
  if (!cloud.material.empty()) material.resize(kept);
  if (has_radius) allocate({&group_radius});

  parallel_for(kept, kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t k = order[i];
      x[i] = cloud.position[k].x();
      y[i] = cloud.position[k].y();
      z[i] = cloud.position[k].z();
      const Vec3f n = cloud.normal.empty() ? Vec3f(0, 0, 0) : normalized_or_zero(cloud.normal[k]);
      normal_x[i] = n.x();
      normal_y[i] = n.y();
      normal_z[i] = n.z();
      float root_of_V = 0;  // sqrt |V|, the amplitude where the file has no area
      if (cloud.anisotropic()) {
        deviation_u[i] = std::sqrt(cloud.variance_u[k]);
        deviation_v[i] = std::sqrt(cloud.variance_v[k]);
        root_of_V = deviation_u[i] * deviation_v[i];
        // Made perpendicular to the normal, as the set-up relies on it.
        const Vec3f t = normalized_or_zero(cloud.tangent[k] - n * n.dot(cloud.tangent[k]));
        const Vec3f tangent =
            t.isZero() ? Vec3f(n.isZero() ? Vec3f::UnitX() : n.unitOrthogonal()) : t;
        tangent_x[i] = tangent.x();
        tangent_y[i] = tangent.y();
        tangent_z[i] = tangent.z();
      } else {
        deviation_u[i] = std::sqrt(cloud.variance[k]);
        root_of_V = cloud.variance[k];
      }
      area[i] = cloud.area.empty() ? root_of_V : std::max(0.0F, cloud.area[k]);
      const Vec3f c = color ? (*color)[k] : SurfelCloud::colorless();
      red[i] = c.x();
      green[i] = c.y();
      blue[i] = c.z();
      if (has_alpha) alpha[i] = std::clamp(cloud.alpha[k], 0.0F, 1.0F);
      if (!material.empty()) material[i] = cloud.material[k];
      if (has_radius) group_radius[i] = cloud.group_radius[k];
    }
  });
  if (needed.groups && !cloud.empty()) number_groups(cloud, order);
  if (cloud.tree.empty()) {
    make_clusters();
  } else {
    take_clusters(cloud.tree, needed.levels);
  }
  make_boxes();
  make_extent();
}

/// Surfels that can be drawn: along a Morton curve, or in the order of the levels of detail.
Array<std::uint32_t> RenderCloud::drawing_order(const SurfelCloud& cloud,
                                                const RenderColumns& needed) {
  const bool has_radius = needed.group_radius && !cloud.group_radius.empty();
  if (cloud.tree.empty()) {
    Array<std::uint32_t> order = morton_order(cloud.position);
    dropped_ = remove_unusable(cloud, has_radius, order);
    if (!needed.copies && !cloud.source.empty()) copies_ = remove_copies(cloud, order);
    return order;
  }
  const std::uint32_t first = needed.levels ? 0 : cloud.tree[first_leaf(cloud.tree)].begin;
  Array<std::uint32_t> order(cloud.size() - first);
  std::iota(order.begin(), order.end(), first);
  if (remove_unusable(cloud, has_radius, order).total() > 0) {
    throw_input("",
                "surfels in its levels of detail have positions, variances or colours that are "
                "not usable numbers; run surfel-lod on the original again");
  }
  return order;
}

/// Numbers the groups in use from 0 on: a file may leave out any.
void RenderCloud::number_groups(const SurfelCloud& cloud, const Array<std::uint32_t>& order) {
  std::vector<int> number(std::size_t{1} << 16, -1);
  for (const std::uint32_t i : order) number[cloud.group[i]] = 0;
  for (int& n : number) {
    if (n == 0) n = groups_++;
  }
  if (groups_ > kMostGroups) {
    throw_input("", fmt::format("the surfels are in {} groups, at most {} can be drawn; run "
                                "surfel-group on them with a smaller --overlap",
                                groups_, kMostGroups));
  }
  group.resize(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    group[i] = static_cast<std::uint16_t>(number[cloud.group[order[i]]]);
  }
}

/// The clusters of the levels that are there, with the bounds that they bring.
void RenderCloud::take_clusters(const ClusterTree& tree, bool levels) {
  const std::size_t finest = first_leaf(tree);
  const std::size_t first = levels ? 0 : finest;
  const std::uint32_t skipped = tree[first].begin;
  first_finest_ = tree[finest].begin - skipped;
  for (std::size_t c = first; c < tree.size(); ++c) {
    Cluster& cluster = clusters_.emplace_back(Cluster{tree[c].bounds});
    cluster.begin = tree[c].begin - skipped;
    cluster.end = tree[c].end - skipped;
    if (group_radius.empty()) continue;
    cluster.max_group_radius =
        *std::max_element(group_radius.begin() + cluster.begin, group_radius.begin() + cluster.end);
  }
  if (levels) tree_ = tree;
}

void RenderCloud::make_clusters() {
  const std::size_t count = (size() + kClusterSize - 1) / kClusterSize;
  clusters_.resize(count);
  parallel_for(count, 64, [&](std::size_t first, std::size_t last, int) {
    for (std::size_t c = first; c < last; ++c) {
      const std::size_t begin = c * kClusterSize;
      const std::size_t end = std::min<std::size_t>(size(), begin + kClusterSize);
      Cluster& cluster = clusters_[c];
      cluster = {cluster_bounds(
          end - begin,
          [&](std::size_t i) { return Vec3f(x[begin + i], y[begin + i], z[begin + i]); },
          [&](std::size_t i) {
            return Vec3f(normal_x[begin + i], normal_y[begin + i], normal_z[begin + i]);
          },
          [&](std::size_t i) { return larger_deviation(begin + i); })};
      cluster.begin = static_cast<std::uint32_t>(begin);
      cluster.end = static_cast<std::uint32_t>(end);
      if (group_radius.empty()) continue;
      cluster.max_group_radius = *std::max_element(group_radius.begin() + cluster.begin,
                                                   group_radius.begin() + cluster.end);
    }
  });
}

float RenderCloud::larger_deviation(std::size_t i) const {
  return anisotropic() ? std::max(deviation_u[i], deviation_v[i]) : deviation_u[i];
}

/// Boxes of the clusters' own surfels; bounds of levels of detail hold all levels below.
void RenderCloud::make_boxes() {
  parallel_for(clusters_.size(), 64, [&](std::size_t first, std::size_t last, int) {
    for (std::size_t c = first; c < last; ++c) {
      Cluster& cluster = clusters_[c];
      for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
        cluster.half_extent =
            cluster.half_extent.cwiseMax((Vec3f(x[i], y[i], z[i]) - cluster.center).cwiseAbs());
      }
      cluster.half_extent *= 1.0F + 1e-6F;  // Rounding must not shrink a bound.
    }
  });
}

void RenderCloud::make_extent() {
  for (const Cluster& cluster : clusters_) {
    if (cluster.begin < first_finest_) continue;
    const Vec3d center = origin_ + cluster.center.cast<double>();
    const double radius = static_cast<double>(cluster.radius) + cluster.max_deviation;
    extent_.spheres.push_back({center, radius});
  }
  // The box from the surfels themselves: around the spheres it would be far too large.
  Vec3f lo = Vec3f::Constant(std::numeric_limits<float>::infinity());
  Vec3f hi = -lo;
  for (std::size_t i = first_finest_; i < size(); ++i) {
    mean_deviation_ += larger_deviation(i) / static_cast<double>(size() - first_finest_);
    const Vec3f reach = Vec3f::Constant(deviation_u[i]);
    lo = lo.cwiseMin(Vec3f(x[i], y[i], z[i]) - reach);
    hi = hi.cwiseMax(Vec3f(x[i], y[i], z[i]) + reach);
  }
  if (size() > 0) {
    extent_.box.add(origin_ + lo.cast<double>());
    extent_.box.add(origin_ + hi.cast<double>());
  }
}

std::uint64_t RenderCloud::memory_bytes() const {
  std::uint64_t floats = 0;
  for (const Array<float>* column :
       {&x, &y, &z, &normal_x, &normal_y, &normal_z, &deviation_u, &deviation_v, &tangent_x,
        &tangent_y, &tangent_z, &area, &red, &green, &blue, &alpha, &group_radius}) {
    floats += column->size();
  }
  return floats * sizeof(float) + (material.size() + group.size()) * sizeof(std::uint16_t) +
         clusters_.size() * sizeof(Cluster) + tree_.size() * sizeof(TreeCluster);
}

}  // namespace surfel
