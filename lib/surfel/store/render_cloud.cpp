#include <algorithm>
#include <cmath>
#include <compare>
#include <iterator>
#include <limits>
#include <numeric>
#include <span>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/framing.h>
#include <surfel/store/render_cloud.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 15;

}  // namespace

RenderCloud::RenderCloud(SurfelSource& source, const RenderColumns& needed,
                         const std::string& name) {
  size_ = source.size();
  allocate(size_, source.attributes(), needed, name);
  const std::size_t count = (size_ + kClusterSize - 1) / kClusterSize;
  clusters_.resize(count);
  std::vector<SurfelTotals> totals(count);
  Bounds box;
  const auto fill = [&] {
    parallel_for(size_, kBlock, [&](std::size_t begin, std::size_t end, int) {
      source.fill(begin, end, *this, begin);
      for (std::size_t i = begin; i < end; i += kClusterSize) {
        totals[i / kClusterSize] = make_cluster(i, std::min<std::size_t>(end, i + kClusterSize),
                                                clusters_[i / kClusterSize]);
      }
    });
    const SurfelTotals all = added_up(totals);
    box.min = all.min.cast<double>();
    box.max = all.max.cast<double>();
  };
  fill();
  require_float_extent(box, name);
  if (source.recenter(box)) fill();
  number_rows(0, size_, 0);
  origin_ = source.origin();
  // Files written by this library are in order already, and hold no surfels that cannot be drawn.
  const bool copies = source.attributes().source;
  const bool all_drawn = std::all_of(
      totals.begin(), totals.end(), [](const SurfelTotals& t) { return t.usable && !t.invisible; });
  if (copies || !all_drawn ||
      !MortonGrid(box.min.cast<float>(), box.max.cast<float>())
           .in_order({x.data(), y.data(), z.data(), size_})) {
    Array<std::uint32_t> order = drawing_order();
    if (copies) move_copies(source, needed.copies, order);
    gather(order);
    totals = make_clusters();
  }
  const bool crowded = std::any_of(totals.begin(), totals.end(), [](const SurfelTotals& t) {
    return t.min == t.max;  // Of one surfel, too, for which there is nothing to merge.
  });
  if (crowded && !has_copies()) {
    const std::size_t all_surfels = size_;
    gather(merge_coincident());
    coincident_ = all_surfels - size_;
    totals = make_clusters();
  }
  if (!group.empty()) number_groups(name);
  const SurfelTotals all = added_up(totals);
  if (!all.transparent) alpha = {};
  if (size_ > 0) mean_deviation_ = all.deviations / static_cast<double>(size_);
  make_box(all.reach_min, all.reach_max);
}

RenderCloud::RenderCloud(const SurfelCloud& cloud, const RenderColumns& needed,
                         const std::string& name) {
  CloudSource source(cloud, name);
  *this = cloud.tree.empty() ? RenderCloud(source, needed, name)
                             : RenderCloud(source, cloud.tree, needed, name);
}

RenderCloud::RenderCloud(const SurfelSource& source, const ClusterTree& tree,
                         const RenderColumns& needed, const std::string& name)
    : origin_(source.origin()) {
  take_clusters(tree, needed.levels);
  allocate(size_, source.attributes(), needed, name);
  const std::size_t skipped = source.size() - size_;
  parallel_for(size_, kBlock, [&](std::size_t begin, std::size_t end, int) {
    source.fill(skipped + begin, skipped + end, *this, begin);
  });
  number_rows(0, size_, skipped);
  std::vector<SurfelTotals> totals(clusters_.size());
  parallel_for(clusters_.size(), kBlock / kClusterSize,
               [&](std::size_t begin, std::size_t end, int) {
                 for (std::size_t c = begin; c < end; ++c) {
                   totals[c] = check_levels(clusters_[c], name);
                   measure(clusters_[c], totals[c]);
                 }
               });
  if (!group.empty()) number_groups(name);
  const auto finest = static_cast<std::size_t>(std::count_if(
      clusters_.begin(), clusters_.end(), [](const Cluster& cluster) { return cluster.merged; }));
  const SurfelTotals all = added_up(std::span(totals).subspan(finest));
  if (!all.transparent) alpha = {};
  mean_deviation_ = all.deviations / static_cast<double>(size_ - first_finest_);
}

/// Allocates the columns whose attributes the source has and the picture needs.
void RenderCloud::allocate(std::size_t rows, const SurfelAttributes& attributes,
                           const RenderColumns& needed, const std::string& name) {
  if (needed.groups && rows > 0 && !attributes.group) {
    throw_input(name, "the surfels have no groups; run surfel-group on them");
  }
  const bool has_radius = needed.group_radius && attributes.group_radius;
  for (Array<float>* column : float_columns(*this)) {
    const bool of_frame = column == &deviation_v || column == &tangent_x || column == &tangent_y ||
                          column == &tangent_z;
    const auto of_clip = [&](const ClipColumns& c) {
      return column == &c.x || column == &c.y || column == &c.z || column == &c.distance;
    };
    const bool of_shading = column == &shading_x || column == &shading_y || column == &shading_z;
    if ((of_frame && !attributes.anisotropic) || (of_shading && !attributes.shading_normal) ||
        (of_clip(clip[0]) && !attributes.clip1) || (of_clip(clip[1]) && !attributes.clip2) ||
        (column == &alpha && !attributes.alpha) || (column == &group_radius && !has_radius)) {
      continue;
    }
    column->resize(rows + kPadding);
    std::fill_n(column->begin() + static_cast<std::ptrdiff_t>(rows), kPadding, 0.0F);
  }
  if (attributes.material) material.resize(rows);
  if (needed.groups && attributes.group) group.resize(rows);
  if (needed.places) place.resize(rows);
}

/// Numbers rows [begin, end) from `first` on, where their numbers are asked for.
void RenderCloud::number_rows(std::size_t begin, std::size_t end, std::uint64_t first) {
  if (place.empty()) return;
  std::iota(place.begin() + static_cast<std::ptrdiff_t>(begin),
            place.begin() + static_cast<std::ptrdiff_t>(end), first);
}

/// Is a surfel to be drawn? Counts it if it cannot be; what is invisible need not be.
bool RenderCloud::usable(std::size_t i, UnusableSurfels& dropped) const {
  SurfelValues values{.position = {x[i], y[i], z[i]},
                      .deviation_u = deviation_u[i],
                      .deviation_v = anisotropic() ? deviation_v[i] : deviation_u[i],
                      .color = {red[i], green[i], blue[i]},
                      .area = area[i]};
  if (!group_radius.empty()) values.group_radius = group_radius[i];
  if (!alpha.empty()) values.alpha = alpha[i];
  const Usability found = usability(values);
  dropped.add(found);
  return found == Usability::kUsable && (alpha.empty() || alpha[i] > 0);
}

/// The surfels that are drawn, in the order of the Morton curve.
Array<std::uint32_t> RenderCloud::drawing_order() {
  Array<std::uint32_t> order = column_morton_order({x.data(), y.data(), z.data(), size_});
  std::size_t kept = 0;
  for (const std::uint32_t i : order) {
    if (usable(i, dropped_)) order[kept++] = i;
  }
  order.resize(kept);
  return order;
}

/// Moves copies to the end of an order, or leaves them out of it.
void RenderCloud::move_copies(const SurfelSource& source, bool keep, Array<std::uint32_t>& order) {
  Array<std::uint32_t> origin(size_);
  source.fill_sources(0, size_, origin.data());
  // By the place as well, since other programs' files may mean something else by `source`.
  const auto key = [&](std::uint32_t i) { return std::tuple(origin[i], x[i], y[i], z[i]); };
  Array<std::uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::tuple_cat(key(a), std::tuple(a)) < std::tuple_cat(key(b), std::tuple(b));
  });
  std::vector<bool> is_copy(size_);
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    is_copy[sorted[i]] = key(sorted[i]) == key(sorted[i - 1]);
  }
  const auto copies = std::stable_partition(order.begin(), order.end(),
                                            [&](std::uint32_t i) { return !is_copy[i]; });
  first_copy_ = static_cast<std::size_t>(copies - order.begin());
  if (keep) return;
  copies_ = order.size() - first_copy_;
  order.resize(first_copy_);
}

/// Makes the clusters anew, copies apart from the others. Returns their totals.
std::vector<SurfelTotals> RenderCloud::make_clusters() {
  std::vector<std::pair<std::size_t, std::size_t>> ranges;
  const auto cut = [&](std::size_t begin, std::size_t end) {
    for (; begin < end; begin += kClusterSize) {
      ranges.emplace_back(begin, std::min<std::size_t>(end, begin + kClusterSize));
    }
  };
  const std::size_t first_copy = std::min(size_, first_copy_);
  cut(0, first_copy);
  cut(first_copy, size_);
  clusters_.resize(ranges.size());
  std::vector<SurfelTotals> totals(ranges.size());
  parallel_for(ranges.size(), kBlock / kClusterSize, [&](std::size_t first, std::size_t last, int) {
    for (std::size_t c = first; c < last; ++c) {
      totals[c] = make_cluster(ranges[c].first, ranges[c].second, clusters_[c]);
    }
  });
  return totals;
}

/// Puts the columns in an order, one column after the other.
void RenderCloud::gather(const Array<std::uint32_t>& order) {
  size_ = order.size();
  const auto gather_column = [&](auto& column, std::size_t padding) {
    if (column.empty()) return;
    std::remove_reference_t<decltype(column)> gathered(size_ + padding);
    parallel_for(size_, kGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) gathered[i] = column[order[i]];
    });
    std::fill_n(gathered.end() - static_cast<std::ptrdiff_t>(padding), padding, 0);
    column.swap(gathered);
  };
  for (Array<float>* column : float_columns(*this)) gather_column(*column, kPadding);
  gather_column(material, 0);
  gather_column(group, 0);
  gather_column(place, 0);
}

/// Merges surfels at one place that differ in colour, alpha, area and normal for shading alone,
/// where a cluster's worth of surfels or more are there: their sum is one Gaussian of all their
/// area, with their mean colour, so that pictures are the same to rounding. Returns the order of
/// the surfels that are left.
Array<std::uint32_t> RenderCloud::merge_coincident() {
  const Array<float>* const columns[] = {
      &normal_x,         &normal_y,  &normal_z,     &deviation_u, &deviation_v,     &tangent_x,
      &tangent_y,        &tangent_z, &group_radius, &clip[0].x,   &clip[0].y,       &clip[0].z,
      &clip[0].distance, &clip[1].x, &clip[1].y,    &clip[1].z,   &clip[1].distance};
  const auto compared = [&](std::uint32_t a, std::uint32_t b) {
    std::partial_ordering result = std::partial_ordering::equivalent;
    for (const Array<float>* column : columns) {
      if (column->empty() || result != 0) continue;
      result = (*column)[a] <=> (*column)[b];
    }
    if (result == 0 && !material.empty()) result = material[a] <=> material[b];
    if (result == 0 && !group.empty()) result = group[a] <=> group[b];
    return result;
  };
  const auto merge_into_first = [&](std::span<const std::uint32_t> alike) {
    const std::uint32_t first = alike.front();
    double whole = 0;
    double opaque = 0;
    Vec3d color = Vec3d::Zero();
    Vec3d shaded = Vec3d::Zero();
    for (const std::uint32_t i : alike) {
      const double a = area[i];
      const double weight = alpha.empty() ? a : a * static_cast<double>(alpha[i]);
      whole += a;
      opaque += weight;
      color += weight * Vec3d(red[i], green[i], blue[i]);
      shaded += a * shading(i).cast<double>();
    }
    area[first] = static_cast<float>(whole);
    if (opaque > 0) {
      const Vec3f mean = (color / opaque).cast<float>();
      red[first] = mean.x();
      green[first] = mean.y();
      blue[first] = mean.z();
    }
    if (!(whole > 0)) return;
    if (!alpha.empty()) alpha[first] = static_cast<float>(opaque / whole);
    if (has_shading() && !shaded.isZero(0)) {
      const Vec3f mean = (shaded / whole).cast<float>();
      shading_x[first] = mean.x();
      shading_y[first] = mean.y();
      shading_z[first] = mean.z();
    }
  };
  const auto at_one_place = [&](std::size_t a, std::size_t b) {
    return x[a] == x[b] && y[a] == y[b] && z[a] == z[b];
  };
  Array<std::uint32_t> order;
  std::vector<std::uint32_t> here;
  for (std::size_t begin = 0; begin < size_;) {
    here.clear();
    std::size_t end = begin;
    for (; end < size_ && at_one_place(begin, end); ++end) {
      here.push_back(static_cast<std::uint32_t>(end));
    }
    begin = end;
    if (here.size() < kClusterSize) {
      order.insert(order.end(), here.begin(), here.end());
      continue;
    }
    std::stable_sort(here.begin(), here.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return compared(a, b) < 0; });
    for (std::size_t first = 0; first < here.size();) {
      std::size_t last = first + 1;
      while (last < here.size() && compared(here[first], here[last]) == 0) ++last;
      if (last - first > 1) merge_into_first(std::span(here).subspan(first, last - first));
      order.push_back(here[first]);
      first = last;
    }
  }
  return order;
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
                                  "surfel-group on them with a smaller overlap",
                                  groups_, kMostGroups));
  }
  for (std::uint16_t& g : group) g = static_cast<std::uint16_t>(number[g]);
}

ClusterColumns RenderCloud::columns(std::size_t begin, std::size_t end) const {
  const auto from = [&](const Array<float>& column) { return column.data() + begin; };
  return {.position = {from(x), from(y), from(z)},
          .normal = {from(normal_x), from(normal_y), from(normal_z)},
          .deviation_u = from(deviation_u),
          .deviation_v = from(anisotropic() ? deviation_v : deviation_u),
          .count = end - begin};
}

SurfelTotals RenderCloud::totals(std::size_t begin, std::size_t end) const {
  const Array<float>* const bounded[] = {&x,   &y,     &z,    &deviation_u, &deviation_v,
                                         &red, &green, &blue, &alpha,       &group_radius};
  const Array<float>* const positive[] = {&deviation_u, &deviation_v, &group_radius};
  const float* pointers[std::size(bounded) + std::size(positive)];
  // Columns that the cloud has.
  const auto pick = [&](std::span<const Array<float>* const> columns, const float** to) {
    std::size_t count = 0;
    for (const Array<float>* column : columns) {
      if (!column->empty()) to[count++] = column->data() + begin;
    }
    return std::span<const float* const>(to, count);
  };
  return surfel_totals(columns(begin, end), area.data() + begin,
                       alpha.empty() ? nullptr : alpha.data() + begin,
                       pick(positive, pointers + std::size(bounded)), pick(bounded, pointers));
}

/// Sets the members of a cluster that ClusterBounds does not have.
void RenderCloud::measure(Cluster& cluster, const SurfelTotals& totals) const {
  // The box holds the cluster's own surfels, whereas ClusterBounds of levels of detail hold all
  // levels below as well. Rounding must not shrink a bound.
  cluster.half_extent =
      (totals.max - cluster.center).cwiseMax(cluster.center - totals.min) * (1.0F + 1e-6F);
  for (std::uint32_t i = cluster.begin; i < cluster.end && !group_radius.empty(); ++i) {
    cluster.max_group_radius = std::max(cluster.max_group_radius, group_radius[i]);
  }
}

/// Makes a cluster of the surfels [begin, end).
SurfelTotals RenderCloud::make_cluster(std::size_t begin, std::size_t end, Cluster& cluster) const {
  cluster = {cluster_bounds(columns(begin, end))};
  cluster.begin = static_cast<std::uint32_t>(begin);
  cluster.end = static_cast<std::uint32_t>(end);
  cluster.copies = begin >= first_copy_;
  const SurfelTotals sums = totals(begin, end);
  measure(cluster, sums);
  return sums;
}

/// Takes over the clusters of all levels, or of the finest, with their bounds, and the tree's box.
void RenderCloud::take_clusters(const ClusterTree& tree, bool levels) {
  const std::size_t finest = first_leaf(tree);
  const std::size_t first = levels ? 0 : finest;
  const std::uint32_t skipped = tree[first].begin;
  size_ = tree.back().end - skipped;
  first_finest_ = tree[finest].begin - skipped;
  for (std::size_t i = first; i < tree.size(); ++i) {
    Cluster& cluster = clusters_.emplace_back();
    static_cast<ClusterBounds&>(cluster) = tree[i].bounds;
    cluster.begin = tree[i].begin - skipped;
    cluster.end = tree[i].end - skipped;
    cluster.half_extent = Vec3f::Constant(cluster.radius);
    cluster.merged = i < finest;
  }
  if (levels) tree_ = tree;
  make_box(tree.front().reach_min, tree.front().reach_max);
}

/// Totals of a cluster of a tree; throws unless all its surfels can be drawn.
SurfelTotals RenderCloud::check_levels(const Cluster& cluster, const std::string& name) const {
  const SurfelTotals sums = totals(cluster.begin, cluster.end);
  if (!sums.usable) {
    throw_input(name,
                "surfels in its levels of detail have positions, variances or colours that are "
                "not usable numbers; run surfel-lod on the original again");
  }
  return sums;
}

float RenderCloud::larger_deviation(std::size_t i) const {
  return anisotropic() ? std::max(deviation_u[i], deviation_v[i]) : deviation_u[i];
}

SceneExtent RenderCloud::extent() const& {
  SceneExtent extent{.box = box_};
  if (clusters_.empty()) return extent;
  const auto support_within = [this](const std::optional<Bounds>& box) {
    return [this, box](const Vec3d& along, double outward) {
      const double greatest = support(along, outward, box, false);
      return std::isfinite(greatest) ? greatest : support(along, outward, box, true);
    };
  };
  extent.support = support_within(std::nullopt);
  const auto supported_box = [](const SceneExtent& of) {
    Bounds box;
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3d along = Vec3d::Unit(axis);
      box.min[axis] = -of.support(-along, 1);
      box.max[axis] = of.support(along, 1);
    }
    return box;
  };
  if (has_clips()) extent.box = supported_box(extent);
  if (const std::optional<CloudCore> found = core()) {
    SceneExtent core;
    core.support = support_within(found->box);
    core.box = supported_box(core);
    extent.core = std::make_shared<const SceneExtent>(std::move(core));
    extent.stray = found->stray;
  }
  return extent;
}

/// Hands on the surfels of a cluster, from the columns or from their file.
void RenderCloud::visit_rows(std::uint32_t cluster, RenderCloud& scratch, RowVisitor visit) const {
  if (read_rows_) {
    read_rows_(cluster, scratch, visit);
  } else {
    visit(*this, clusters_[cluster].begin, clusters_[cluster].end);
  }
}

/// The core of the finest level, relative to the origin.
std::optional<CloudCore> RenderCloud::core() const {
  std::vector<PointGroup> groups;
  std::vector<std::uint32_t> finest;
  for (std::uint32_t c = 0; c < clusters_.size(); ++c) {
    const Cluster& cluster = clusters_[c];
    if (cluster.merged) continue;
    groups.push_back({cluster.center.cast<double>(), cluster.radius, cluster.end - cluster.begin});
    finest.push_back(c);
  }
  RenderCloud scratch;
  return find_core(groups, [&](std::size_t g, FunctionRef<void(const Vec3d&)> add) {
    visit_rows(finest[g], scratch, [&](const RenderCloud& r, std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) add(Vec3d(r.x[i], r.y[i], r.z[i]));
    });
  });
}

/// SceneExtent::support of the finest level, or of its surfels whose centres lie within a box
/// relative to the origin; with surfels whose centres are cut off, or without. Takes its clusters
/// in the order of what their bounds allow, until none allows more than what has been found.
double RenderCloud::support(const Vec3d& a, double b, const std::optional<Bounds>& within,
                            bool cut_off) const {
  std::vector<std::pair<double, std::uint32_t>> bounds;
  for (std::uint32_t c = 0; c < clusters_.size(); ++c) {
    const Cluster& cluster = clusters_[c];
    if (cluster.merged) continue;
    bounds.emplace_back(a.dot(cluster.center.cast<double>()) + a.norm() * cluster.radius +
                            b * cluster.max_deviation,
                        c);
  }
  std::make_heap(bounds.begin(), bounds.end());
  double greatest = -std::numeric_limits<double>::infinity();
  const auto take = [&](const RenderCloud& rows, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (within && !within->contains(Vec3d(rows.x[i], rows.y[i], rows.z[i]))) continue;
      if (!cut_off && rows.is_cut_off(i)) continue;
      const double reach = rows.reach(i, a, b);
      if (reach > greatest) greatest = reach;  // Not where NaN.
    }
  };
  RenderCloud scratch;
  for (auto end = bounds.end(); end != bounds.begin() && bounds.front().first > greatest; --end) {
    visit_rows(bounds.front().second, scratch, take);
    std::pop_heap(bounds.begin(), end);
  }
  return greatest + a.dot(origin_);
}

/// SceneExtent::support of one surfel, relative to the origin.
double RenderCloud::reach(std::size_t row, const Vec3d& a, double b) const {
  return a.dot(Vec3d(x[row], y[row], z[row])) + b * larger_deviation(row);
}

/// Sets the box around the discs; a box around the clusters' spheres would be far too large.
void RenderCloud::make_box(const Vec3f& reach_min, const Vec3f& reach_max) {
  if (clusters_.empty()) return;
  box_.add(origin_ + reach_min.cast<double>());
  box_.add(origin_ + reach_max.cast<double>());
}

std::uint64_t RenderCloud::memory_bytes() const {
  std::uint64_t floats = 0;
  for (const Array<float>* column : float_columns(*this)) floats += column->size();
  return floats * sizeof(float) + (material.size() + group.size()) * sizeof(std::uint16_t) +
         clusters_.size() * sizeof(Cluster) + tree_.size() * sizeof(TreeCluster);
}

}  // namespace surfel
