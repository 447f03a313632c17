#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <tuple>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/cloud/morton.h>
#include <surfel/render/render_cloud.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 15;

/// Cosine below which a cone of normals is of no use for culling.
constexpr float kWidestCone = 0.05F;

enum class Verdict : std::uint8_t { kUsable, kPosition, kVariance, kColor };

bool usable_variance(float v) { return std::isfinite(v) && v > 0; }

Verdict judge(const SurfelCloud& cloud, const Array<Vec3f>* color, bool group_radius,
              std::size_t i) {
  if (!cloud.position[i].allFinite()) return Verdict::kPosition;
  const bool variance_ok = cloud.anisotropic() ? usable_variance(cloud.variance_u[i]) &&
                                                     usable_variance(cloud.variance_v[i])
                                               : usable_variance(cloud.variance[i]);
  if (!variance_ok || (group_radius && !usable_variance(cloud.group_radius[i]))) {
    return Verdict::kVariance;
  }
  if (color && !(*color)[i].allFinite()) return Verdict::kColor;
  if (!cloud.alpha.empty() && !std::isfinite(cloud.alpha[i])) return Verdict::kColor;
  if (!cloud.area.empty() && !std::isfinite(cloud.area[i])) return Verdict::kColor;
  return Verdict::kUsable;
}

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
  Array<std::uint32_t> order = morton_order(cloud.position);

  // Keep the usable ones, in order.
  std::size_t kept = 0;
  for (const std::uint32_t i : order) {
    switch (judge(cloud, color, has_radius, i)) {
      case Verdict::kUsable:
        order[kept++] = i;
        break;
      case Verdict::kPosition:
        ++dropped_.position;
        break;
      case Verdict::kVariance:
        ++dropped_.variance;
        break;
      case Verdict::kColor:
        ++dropped_.color;
        break;
    }
  }
  order.resize(kept);
  if (!needed.copies && !cloud.source.empty()) {
    copies_ = remove_copies(cloud, order);
    kept -= copies_;
  }
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
  make_clusters();
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

void RenderCloud::make_clusters() {
  const std::size_t count = (size() + kClusterSize - 1) / kClusterSize;
  clusters_.resize(count);
  parallel_for(count, 64, [&](std::size_t first, std::size_t last, int) {
    for (std::size_t c = first; c < last; ++c) {
      Cluster& cluster = clusters_[c];
      cluster.begin = static_cast<std::uint32_t>(c * kClusterSize);
      cluster.end =
          static_cast<std::uint32_t>(std::min<std::size_t>(size(), (c + 1) * kClusterSize));
      Vec3f lo(x[cluster.begin], y[cluster.begin], z[cluster.begin]);
      Vec3f hi = lo;
      Vec3f sum(0, 0, 0);
      bool all_oriented = true;
      for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
        const Vec3f p(x[i], y[i], z[i]);
        const Vec3f n(normal_x[i], normal_y[i], normal_z[i]);
        lo = lo.cwiseMin(p);
        hi = hi.cwiseMax(p);
        sum += n;
        all_oriented = all_oriented && !n.isZero();
        cluster.max_deviation = std::max(
            {cluster.max_deviation, deviation_u[i], anisotropic() ? deviation_v[i] : 0.0F});
        if (!group_radius.empty()) {
          cluster.max_group_radius = std::max(cluster.max_group_radius, group_radius[i]);
        }
      }
      cluster.center = lo + (hi - lo) / 2;
      // Rounding must not shrink a bound.
      cluster.half_extent = (cluster.center - lo).cwiseMax(hi - cluster.center) * (1.0F + 1e-6F);
      const Vec3f axis = normalized_or_zero(sum);
      float cosine = all_oriented && !axis.isZero() ? 1.0F : -1.0F;
      for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
        cluster.radius =
            std::max(cluster.radius, (Vec3f(x[i], y[i], z[i]) - cluster.center).norm());
        cosine = std::min(cosine, axis.dot(Vec3f(normal_x[i], normal_y[i], normal_z[i])));
      }
      cluster.radius *= 1.0F + 1e-6F;  // Rounding must not shrink a bound.
      if (cosine > kWidestCone) {
        cluster.cone_axis = axis;
        cluster.cone_cosine = cosine - 1e-6F;
      }
    }
  });
  for (const Cluster& cluster : clusters_) {
    const Vec3d center = origin_ + cluster.center.cast<double>();
    const double radius = static_cast<double>(cluster.radius) + cluster.max_deviation;
    extent_.spheres.push_back({center, radius});
  }
  // The box from the surfels themselves: around the spheres it would be far too large.
  Vec3f lo = Vec3f::Constant(std::numeric_limits<float>::infinity());
  Vec3f hi = -lo;
  for (std::size_t i = 0; i < size(); ++i) {
    mean_deviation_ += std::max(deviation_u[i], anisotropic() ? deviation_v[i] : 0.0F) /
                       static_cast<double>(size());
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
         clusters_.size() * sizeof(Cluster);
}

}  // namespace surfel
