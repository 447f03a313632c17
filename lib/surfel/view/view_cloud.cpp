#include <algorithm>
#include <cmath>
#include <mutex>
#include <utility>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/shell_quote.h>
#include <surfel/store/attribute_values.h>
#include <surfel/store/cloud_stream.h>
#include <surfel/store/colored_source.h>
#include <surfel/view/packed_cluster.h>
#include <surfel/view/view_cloud.h>

namespace surfel {
namespace {

/// A source whose surfels have the share of an attribute's range instead of colours; no value is 0.
class AttributeSource final : public ForwardingSource {
 public:
  AttributeSource(SurfelSource& inner, AttributeValues values, std::pair<double, double> range)
      : ForwardingSource(inner), values_(std::move(values)), range_(std::move(range)) {}

  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud,
            std::size_t row) const override {
    ForwardingSource::fill(begin, end, cloud, row);
    std::vector<double> values(end - begin);
    values_.values(begin, end, cloud, row, values.data());
    const double size = range_.second - range_.first;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double share = size > 0 ? (values[i] - range_.first) / size : 0.5;
      const float value = std::isfinite(values[i]) ? static_cast<float>(share) : 0.0F;
      const float shown = std::clamp(value, 0.0F, 1.0F);
      cloud.red[row + i] = cloud.green[row + i] = cloud.blue[row + i] = shown;
    }
  }

 private:
  AttributeValues values_;
  std::pair<double, double> range_;
};

/// The file's surfels, or with an attribute instead of colours.
CloudLoadOptions load_options(const ViewCloudOptions& options) {
  CloudLoadOptions load{.memory = options.memory, .sample = true};
  load.columns.levels = true;
  return load;
}

bool any_normal(const RenderCloud& cloud, std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; ++i) {
    if (cloud.normal_x[i] != 0 || cloud.normal_y[i] != 0 || cloud.normal_z[i] != 0) return true;
  }
  return false;
}

[[noreturn]] void refuse_bare(const std::string& path) {
  throw_input(path, "has no normals, which discs need; surfel-estimate " + shell_file(path) +
                        " -o surfels.ply makes surfels of it, to be looked at instead");
}

}  // namespace

struct ViewCloud::Impl {
  std::string path;
  std::unique_ptr<LoadedCloud> surfels;
  std::unique_ptr<LoadedCloud> values;  ///< The same with the attribute; null: there is none.
  std::string attribute;
  bool colored = false;
  bool materials = false;  ///< Surfels have numbers of materials.
  bool black = false;      ///< All colours are black, and left out.
  std::pair<double, double> range{0, 1};
  mutable std::mutex mutex;

  /// Brings clusters into memory.
  static void fetch(const LoadedCloud& cloud, std::span<const std::uint32_t> clusters) {
    if (cloud.store().resident()) return;
    std::vector<VisibleCluster> wanted;
    for (const std::uint32_t cluster : clusters) wanted.push_back({0, cluster});
    cloud.store().fetch(wanted);
  }
};

ViewCloud::ViewCloud(const std::string& path, const ViewCloudOptions& options)
    : impl_(std::make_unique<Impl>()) {
  Impl& i = *impl_;
  i.path = path;
  CloudLoadOptions load = load_options(options);
  load.wrap = [&](const CloudFacts& facts) {
    if (!facts.source.attributes().normal) refuse_bare(path);
    i.black = CloudStream::all_black(facts.source);
    i.colored = facts.source.attributes().color && !i.black;
    i.materials = facts.source.attributes().material;
    const bool known = AttributeValues::find(facts.source, options.attribute).has_value();
    if (!options.attribute.empty() && known) {
      const AttributeValues values(facts.source, options.attribute, Vec3d(0, 0, 1), path);
      if (values.kind() == AttributeKind::kNumber) {
        i.attribute = values.name();
        const AttributeSummary found = values.summary(facts.first_finest, facts.source.size());
        i.range = found.robust_range();
        // Shares are shown as such, so that files can be compared.
        if (found.min >= 0 && found.max <= 1) i.range = {0, 1};
      }
    }
    return i.black ? std::make_unique<UncoloredSource>(facts.source)
                   : std::unique_ptr<SurfelSource>();
  };
  i.surfels = std::make_unique<LoadedCloud>(path, load);
  const RenderCloud& cloud = i.surfels->surfels();
  if (cloud.clusters().empty()) throw_input(path, "has no surfels");
  if (!i.attribute.empty()) {
    load.sample = false;
    load.wrap = [&](const CloudFacts& facts) {
      const AttributeValues values(facts.source, i.attribute, Vec3d(0, 0, 1), path);
      return std::make_unique<AttributeSource>(facts.source, values, i.range);
    };
    i.values = std::make_unique<LoadedCloud>(path, load);
  }
  const std::uint32_t first[] = {0};
  Impl::fetch(*i.surfels, first);
  const Cluster& coarsest = cloud.clusters().front();
  const bool some = i.surfels->store().resident() ? any_normal(cloud, 0, cloud.size())
                                                  : any_normal(cloud, coarsest.begin, coarsest.end);
  if (!some) refuse_bare(path);
}

ViewCloud::~ViewCloud() = default;

const LoadedCloud& ViewCloud::loaded() const { return *impl_->surfels; }
const std::string& ViewCloud::path() const { return impl_->path; }
std::size_t ViewCloud::clusters() const { return impl_->surfels->surfels().clusters().size(); }
bool ViewCloud::has_levels() const { return !impl_->surfels->surfels().tree().empty(); }
bool ViewCloud::colored() const { return impl_->colored; }
const std::string& ViewCloud::attribute() const { return impl_->attribute; }
std::pair<double, double> ViewCloud::attribute_range() const { return impl_->range; }

std::string ViewCloud::not_shown() const {
  std::string what = impl_->materials ? "materials" : "";
  if (impl_->black) what += what.empty() ? "colours, all black," : " and colours, all black,";
  return what.empty() ? what : what + " are not shown";
}

std::uint64_t ViewCloud::most_bytes() const {
  const RenderCloud& cloud = impl_->surfels->surfels();
  std::size_t of_surfel = kMostPackedSurfel;
  if (!cloud.anisotropic()) of_surfel -= 8;
  if (!cloud.has_clips()) of_surfel -= 8;
  std::uint64_t surfels = 0;
  for (std::size_t c = 0; c < clusters(); ++c) {
    surfels += has_levels() ? cloud.tree()[c].end - cloud.tree()[c].begin
                            : cloud.clusters()[c].end - cloud.clusters()[c].begin;
  }
  const std::uint64_t clusters_bytes = sizeof(PackedCluster) + sizeof(ClusterRecord);
  return (surfels * of_surfel + clusters() * clusters_bytes) * 4 / 3;
}

void ViewCloud::append_records(std::size_t first, std::size_t end, std::string& to) const {
  const RenderCloud& cloud = impl_->surfels->surfels();
  const ClusterTree& tree = cloud.tree();
  for (std::size_t c = first; c < end; ++c) {
    const Cluster& cluster = cloud.clusters()[c];
    ClusterRecord record{};
    for (int axis = 0; axis < 3; ++axis) record.center[axis] = cluster.center[axis];
    record.radius = cluster.radius;
    record.max_deviation = cluster.max_deviation;
    record.merged = cluster.merged ? 1 : 0;
    record.count = static_cast<std::uint16_t>(cluster.end - cluster.begin);
    if (!tree.empty()) {
      record.spacing = tree[c].spacing;
      record.first_child = tree[c].first_child;
      record.child_count = static_cast<std::uint16_t>(tree[c].child_count);
      record.count = static_cast<std::uint16_t>(tree[c].end - tree[c].begin);
    }
    to.append(reinterpret_cast<const char*>(&record), sizeof(record));
  }
}

void ViewCloud::append_clusters(std::span<const std::uint32_t> clusters, std::string& to) const {
  const std::lock_guard lock(impl_->mutex);
  const LoadedCloud& loaded = *impl_->surfels;
  const LoadedCloud* values = impl_->values.get();
  const std::size_t most = std::min(kMostAtOnce, loaded.store().batch_clusters());
  while (!clusters.empty()) {
    const auto part = clusters.first(std::min(most, clusters.size()));
    clusters = clusters.subspan(part.size());
    Impl::fetch(loaded, part);
    if (values) Impl::fetch(*values, part);
    for (const std::uint32_t cluster : part) {
      pack_cluster(loaded.store().cloud(), cluster, values ? &values->store().cloud() : nullptr,
                   to);
    }
  }
}

}  // namespace surfel
