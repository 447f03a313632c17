#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/cloud/morton.h>
#include <surfel/render/render_cloud.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 15;

/// Cosine below which a cone of normals is of no use for culling.
constexpr float kWidestCone = 0.05F;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Values taken side by side, so that the compiler makes vector instructions of a minimum, maximum
/// or logical sum whose order it must not change.
constexpr std::size_t kLanes = 8;

/// Calls visit(i, lane) for i in [begin, end).
template <class Visit>
void visit_lanes(std::size_t begin, std::size_t end, Visit&& visit) {
  std::size_t i = begin;
  for (; i + kLanes <= end; i += kLanes) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) visit(i + lane, lane);
  }
  for (; i < end; ++i) visit(i, 0);
}

struct Range {
  float min, max;
};

/// Least and largest of the values, passing over those that are NaN.
template <class Value>
Range range_of(std::size_t begin, std::size_t end, const Value& value) {
  float lo[kLanes];
  float hi[kLanes];
  std::fill_n(lo, kLanes, kInfinity);
  std::fill_n(hi, kLanes, -kInfinity);
  visit_lanes(begin, end, [&](std::size_t i, std::size_t lane) {
    const float v = value(i);
    lo[lane] = v < lo[lane] ? v : lo[lane];
    hi[lane] = v > hi[lane] ? v : hi[lane];
  });
  return {*std::min_element(lo, lo + kLanes), *std::max_element(hi, hi + kLanes)};
}

bool usable_size(float v) { return std::isfinite(v) && v > 0; }

}  // namespace

RenderCloud::RenderCloud(const SurfelCloud& cloud, const RenderColumns& needed) {
  CloudSource source(cloud);
  *this = RenderCloud(source, needed, "");
}

RenderCloud::RenderCloud(SurfelSource& source, const RenderColumns& needed,
                         const std::string& name) {
  size_ = source.size();
  const SurfelAttributes attributes = source.attributes();
  if (needed.groups && size_ > 0 && !attributes.group) throw_no_groups(name);
  allocate(size_, attributes, needed);
  const std::size_t count = (size_ + kClusterSize - 1) / kClusterSize;
  clusters_.resize(count);
  std::vector<ClusterTotals> totals(count);
  Bounds box;
  const auto fill = [&] {
    parallel_for(size_, kBlock, [&](std::size_t begin, std::size_t end, int) {
      source.fill(begin, end, *this, begin);
      for (std::size_t i = begin; i < end; i += kClusterSize) {
        totals[i / kClusterSize] = make_cluster(i, std::min<std::size_t>(end, i + kClusterSize),
                                                clusters_[i / kClusterSize]);
      }
    });
    box = {};
    for (const ClusterTotals& t : totals) {
      box.min = box.min.cwiseMin(t.min.cast<double>());
      box.max = box.max.cwiseMax(t.max.cast<double>());
    }
  };
  fill();
  if (source.recenter(box)) fill();
  origin_ = source.origin();
  // What this library has written is in order already, and has nothing that cannot be drawn.
  const bool usable =
      std::all_of(totals.begin(), totals.end(), [](const ClusterTotals& t) { return t.usable; });
  if (size_ > 0 && !(usable && MortonGrid(box.min.cast<float>(), box.max.cast<float>())
                                   .in_order({x.data(), y.data(), z.data(), size_}))) {
    gather(usable_order());
    clusters_.resize((size_ + kClusterSize - 1) / kClusterSize);
    totals.resize(clusters_.size());
    parallel_for(
        clusters_.size(), kBlock / kClusterSize, [&](std::size_t first, std::size_t last, int) {
          for (std::size_t c = first; c < last; ++c) {
            totals[c] =
                make_cluster(c * kClusterSize, std::min<std::size_t>(size_, (c + 1) * kClusterSize),
                             clusters_[c]);
          }
        });
  }
  if (!group.empty()) number_groups(name);
  if (!make_extent(totals)) alpha = {};
}

std::vector<Array<float>*> RenderCloud::float_columns() {
  return {&x,         &y,         &z,         &normal_x,    &normal_y,    &normal_z,
          &tangent_x, &tangent_y, &tangent_z, &deviation_u, &deviation_v, &area,
          &red,       &green,     &blue,      &alpha,       &group_radius};
}

void RenderCloud::allocate(std::size_t rows, const SurfelAttributes& attributes,
                           const RenderColumns& needed) {
  const bool has_radius = needed.group_radius && attributes.group_radius;
  for (Array<float>* column : float_columns()) {
    const bool of_frame = column == &deviation_v || column == &tangent_x || column == &tangent_y ||
                          column == &tangent_z;
    if ((of_frame && !attributes.anisotropic) || (column == &alpha && !attributes.alpha) ||
        (column == &group_radius && !has_radius)) {
      continue;
    }
    column->resize(rows + kPadding);
    prefer_huge_pages(column->data(), rows * sizeof(float));
    std::fill_n(column->begin() + static_cast<std::ptrdiff_t>(rows), kPadding, 0.0F);
  }
  if (attributes.material) material.resize(rows);
  if (needed.groups && attributes.group) group.resize(rows);
}

/// Can a surfel be drawn? Counts it if not.
bool RenderCloud::usable(std::size_t i, Dropped& dropped) const {
  if (!Vec3f(x[i], y[i], z[i]).allFinite()) {
    ++dropped.position;
  } else if (!usable_size(deviation_u[i]) || (anisotropic() && !usable_size(deviation_v[i])) ||
             (!group_radius.empty() && !usable_size(group_radius[i]))) {
    ++dropped.variance;
  } else if (!Vec3f(red[i], green[i], blue[i]).allFinite() ||
             (!alpha.empty() && !std::isfinite(alpha[i])) || !std::isfinite(area[i])) {
    ++dropped.color;
  } else {
    return true;
  }
  return false;
}

/// The order of the surfels that can be drawn along the Morton curve.
Array<std::uint32_t> RenderCloud::usable_order() {
  Array<std::uint32_t> order = column_morton_order({x.data(), y.data(), z.data(), size_});
  std::size_t kept = 0;
  for (const std::uint32_t i : order) {
    if (usable(i, dropped_)) order[kept++] = i;
  }
  order.resize(kept);
  return order;
}

/// Puts the columns in an order, one after the other.
void RenderCloud::gather(const Array<std::uint32_t>& order) {
  size_ = order.size();
  const auto gather_column = [&](auto& column, std::size_t padding) {
    if (column.empty()) return;
    std::remove_reference_t<decltype(column)> gathered(size_ + padding);
    prefer_huge_pages(gathered.data(), size_ * sizeof(gathered[0]));
    parallel_for(size_, kGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) gathered[i] = column[order[i]];
    });
    std::fill_n(gathered.end() - static_cast<std::ptrdiff_t>(padding), padding, 0);
    column.swap(gathered);
  };
  for (Array<float>* column : float_columns()) gather_column(*column, kPadding);
  gather_column(material, 0);
  gather_column(group, 0);
}

/// Numbers the groups in use from 0 on: a file may leave out any.
void RenderCloud::number_groups(const std::string& name) {
  std::vector<int> number(std::size_t{1} << 16, -1);
  for (const std::uint16_t g : group) number[g] = 0;
  for (int& n : number) {
    if (n == 0) n = groups_++;
  }
  if (groups_ > kMostGroups) {
    throw_input(name, fmt::format("the surfels are in {} groups, at most {} can be drawn; run "
                                  "surfel-group on them with a smaller --overlap",
                                  groups_, kMostGroups));
  }
  for (std::uint16_t& g : group) g = static_cast<std::uint16_t>(number[g]);
}

/// Bounds the surfels [begin, end).
ClusterTotals RenderCloud::make_cluster(std::size_t begin, std::size_t end,
                                        Cluster& cluster) const {
  const auto column_range = [&](const Array<float>& column) {
    return range_of(begin, end, [&](std::size_t i) { return column[i]; });
  };
  const Range position[] = {column_range(x), column_range(y), column_range(z)};
  const Array<float>* const columns[] = {&x, &y, &z};
  ClusterTotals totals;
  for (int axis = 0; axis < 3; ++axis) {
    totals.min[axis] = position[axis].min;
    totals.max[axis] = position[axis].max;
    const float* p = columns[axis]->data();
    const float* reach = deviation_u.data();
    totals.reach_min[axis] =
        range_of(begin, end, [=](std::size_t i) { return p[i] - reach[i]; }).min;
    totals.reach_max[axis] =
        range_of(begin, end, [=](std::size_t i) { return p[i] + reach[i]; }).max;
  }
  cluster = {};
  cluster.begin = static_cast<std::uint32_t>(begin);
  cluster.end = static_cast<std::uint32_t>(end);
  cluster.center = totals.min + (totals.max - totals.min) / 2;
  Range deviation = column_range(deviation_u);
  if (anisotropic()) {
    const Range v = column_range(deviation_v);
    deviation = {std::min(deviation.min, v.min), std::max(deviation.max, v.max)};
  }
  cluster.max_deviation = deviation.max;
  float least_size = deviation.min;
  if (!group_radius.empty()) {
    const Range radius = column_range(group_radius);
    cluster.max_group_radius = radius.max;
    least_size = std::min(least_size, radius.min);
  }
  for (std::size_t i = begin; i < end; ++i) {
    totals.deviations += anisotropic() ? std::max(deviation_u[i], deviation_v[i]) : deviation_u[i];
  }
  if (!alpha.empty()) totals.transparent = column_range(alpha).min < 1;
  // A sum of products with zero is zero unless a value is infinite or NaN.
  float zero[kLanes] = {};
  for (const Array<float>* column : {&x, &y, &z, &deviation_u, &deviation_v, &area, &red, &green,
                                     &blue, &alpha, &group_radius}) {
    if (column->empty()) continue;
    const float* v = column->data();
    visit_lanes(begin, end, [&](std::size_t i, std::size_t lane) { zero[lane] += v[i] * 0.0F; });
  }
  totals.usable =
      least_size > 0 && std::all_of(zero, zero + kLanes, [](float v) { return v == 0; });

  Vec3f sum(0, 0, 0);
  bool all_oriented = true;
  for (std::size_t i = begin; i < end; ++i) {
    const Vec3f n(normal_x[i], normal_y[i], normal_z[i]);
    sum += n;
    all_oriented = all_oriented && !n.isZero();
  }
  const float* px = x.data();
  const float* py = y.data();
  const float* pz = z.data();
  const Vec3f center = cluster.center;
  const Range squared = range_of(begin, end, [=](std::size_t i) {
    const float dx = px[i] - center.x();
    const float dy = py[i] - center.y();
    const float dz = pz[i] - center.z();
    return dx * dx + (dy * dy + dz * dz);
  });
  // Rounding must not shrink a bound.
  cluster.radius = std::max(0.0F, std::sqrt(squared.max)) * (1.0F + 1e-6F);
  const Vec3f axis = unit_normal(sum);
  if (!all_oriented || axis.isZero()) return totals;
  const float* nx = normal_x.data();
  const float* ny = normal_y.data();
  const float* nz = normal_z.data();
  const float cosine =
      std::min(1.0F, range_of(begin, end, [=](std::size_t i) {
                       return axis.x() * nx[i] + (axis.y() * ny[i] + axis.z() * nz[i]);
                     }).min);
  if (cosine > kWidestCone) {
    cluster.cone_axis = axis;
    cluster.cone_cosine = cosine - 1e-6F;
  }
  return totals;
}

/// Sums the clusters up. Returns whether some surfel is transparent.
bool RenderCloud::make_extent(const std::vector<ClusterTotals>& totals) {
  for (const Cluster& cluster : clusters_) {
    const Vec3d center = origin_ + cluster.center.cast<double>();
    const double radius = static_cast<double>(cluster.radius) + cluster.max_deviation;
    extent_.spheres.push_back({center, radius});
  }
  // The box from the surfels themselves: around the spheres it would be far too large.
  double deviations = 0;
  bool transparent = false;
  for (const ClusterTotals& t : totals) {
    deviations += t.deviations;
    transparent = transparent || t.transparent;
    extent_.box.add(origin_ + t.reach_min.cast<double>());
    extent_.box.add(origin_ + t.reach_max.cast<double>());
  }
  if (size_ > 0) mean_deviation_ = deviations / static_cast<double>(size_);
  return transparent;
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
