#include <algorithm>
#include <cstring>
#include <numeric>

#include <surfel/store/gathered_clusters.h>

namespace surfel {
namespace {

/// What comes before the columns of a cluster in a message.
struct PackedCluster {
  std::uint32_t number, surfels, merged;
  float center[3], radius, max_deviation, cone_axis[3], cone_cosine, half_extent[3];
};

}  // namespace

GatheredClusters::GatheredClusters(const RenderCloud& part) {
  const auto wanted = RenderCloud::float_columns(part);
  const auto own = RenderCloud::float_columns(cloud_);
  for (std::size_t k = 0; k < own.size(); ++k) {
    if (!wanted[k]->empty()) own[k]->resize(RenderCloud::kPadding);
  }
  // One row, of no cluster, so that the column is there.
  if (!part.material.empty()) cloud_.material.resize(1);
  cloud_.origin_ = part.origin();
  cloud_.merged_ = true;
}

void GatheredClusters::pack(const RenderCloud& part, std::uint32_t cluster, std::uint32_t number,
                            Bytes& to) {
  const Cluster& c = part.clusters()[cluster];
  PackedCluster packed{number, c.end - c.begin, c.merged ? 1U : 0U,
                       {},     c.radius,        c.max_deviation,
                       {},     c.cone_cosine,   {}};
  std::copy_n(c.center.data(), 3, packed.center);
  std::copy_n(c.cone_axis.data(), 3, packed.cone_axis);
  std::copy_n(c.half_extent.data(), 3, packed.half_extent);
  append_values(&packed, 1, to);
  const auto column = [&](const auto& values) {
    if (!values.empty()) append_values(values.data() + c.begin, packed.surfels, to);
  };
  for (const Array<float>* values : RenderCloud::float_columns(part)) column(*values);
  column(part.material);
}

void GatheredClusters::clear() {
  cloud_.clusters_.clear();
  cloud_.size_ = 0;
  number_.clear();
}

/// Makes room for so many surfels.
void GatheredClusters::make_rows(std::size_t rows) {
  for (Array<float>* column : RenderCloud::float_columns(cloud_)) {
    if (!column->empty()) column->resize(std::max(column->size(), rows + RenderCloud::kPadding));
  }
  if (!cloud_.material.empty()) {
    cloud_.material.resize(std::max(cloud_.material.size(), rows));
  }
}

void GatheredClusters::add(const Bytes& message) {
  for (std::size_t at = 0; at < message.size();) {
    const auto take = [&](auto* to, std::size_t count) {
      std::memcpy(to, message.data() + at, count * sizeof(*to));
      at += count * sizeof(*to);
    };
    PackedCluster packed;
    take(&packed, 1);
    Cluster& c = cloud_.clusters_.emplace_back();
    c.center = Vec3f(packed.center[0], packed.center[1], packed.center[2]);
    c.radius = packed.radius;
    c.max_deviation = packed.max_deviation;
    c.cone_axis = Vec3f(packed.cone_axis[0], packed.cone_axis[1], packed.cone_axis[2]);
    c.cone_cosine = packed.cone_cosine;
    c.half_extent = Vec3f(packed.half_extent[0], packed.half_extent[1], packed.half_extent[2]);
    c.merged = packed.merged != 0;
    c.begin = static_cast<std::uint32_t>(cloud_.size_);
    c.end = c.begin + packed.surfels;
    number_.push_back(packed.number);
    cloud_.size_ = c.end;
    make_rows(cloud_.size_);
    for (Array<float>* column : RenderCloud::float_columns(cloud_)) {
      if (!column->empty()) take(column->data() + c.begin, packed.surfels);
    }
    if (!cloud_.material.empty()) take(cloud_.material.data() + c.begin, packed.surfels);
  }
}

void GatheredClusters::finish(const PictureLoad& load) {
  load_ = load;
  std::vector<std::uint32_t> order(number_.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return number_[a] < number_[b]; });
  std::vector<Cluster> sorted;
  sorted.reserve(order.size());
  for (const std::uint32_t i : order) sorted.push_back(cloud_.clusters_[i]);
  cloud_.clusters_ = std::move(sorted);
  for (Array<float>* column : RenderCloud::float_columns(cloud_)) {
    if (column->empty()) continue;
    std::fill_n(column->begin() + static_cast<std::ptrdiff_t>(cloud_.size_), RenderCloud::kPadding,
                0.0F);
  }
  ++cloud_.revision_;
}

}  // namespace surfel
