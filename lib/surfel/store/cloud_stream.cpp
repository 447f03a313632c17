#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/store/cloud_stream.h>

namespace surfel {
namespace {

/// Clusters read at once; each worker keeps as many.
constexpr std::size_t kRunLength = RenderCloud::kBlock / RenderCloud::kClusterSize;
/// Largest mean radius of clusters that can still be culled, in units of the scene's diagonal over
/// the cube root of the number of clusters, which is the diagonal of a cube if the scene is cut
/// into as many cubes. Scan lines of a surface stay below it; 400 or more clusters of surfels in
/// random order exceed it. Clusters of a volume in Morton order, the hardest of ordered cases, have
/// 0.6.
constexpr double kLoosest = 2;
/// Clusters announced to the system at once.
constexpr std::size_t kLongestExpected = 4096;

}  // namespace

std::vector<std::string> CloudStreamOptions::problems() const {
  if (batch >= RenderCloud::kClusterSize) return {};
  return {fmt::format("`batch` is {}; it must be >= {}", batch, RenderCloud::kClusterSize)};
}

CloudStream::CloudStream(SurfelSource& source, const CloudStreamOptions& options,
                         const std::string& name)
    : source_(source), options_(options), name_(name) {
  require_usable(options);
}

std::unique_ptr<CloudStream> CloudStream::make(SurfelSource& source,
                                               const CloudStreamOptions& options) {
  if (source.size() / RenderCloud::kClusterSize >= std::numeric_limits<std::uint32_t>::max()) {
    throw_input("", "more than a billion of clusters; split the cloud");
  }
  std::unique_ptr<CloudStream> stream(new CloudStream(source, options, {}));
  if (!stream->make_index()) return nullptr;
  stream->allocate();
  return stream;
}

std::unique_ptr<CloudStream> CloudStream::make(SurfelSource& source, const ClusterTree& tree,
                                               bool levels, const CloudStreamOptions& options,
                                               const std::string& name) {
  std::unique_ptr<CloudStream> stream(new CloudStream(source, options, name));
  stream->from_tree_ = true;
  RenderCloud& cloud = stream->cloud_;
  cloud.origin_ = source.origin();
  cloud.take_clusters(tree, levels);
  const std::size_t skipped = source.size() - cloud.size_;
  for (const Cluster& cluster : cloud.clusters_) stream->surfel_.push_back(skipped + cluster.begin);
  stream->attributes_ = source.attributes();
  stream->attributes_.alpha = stream->attributes_.alpha && stream->finest_transparent(tree);
  stream->allocate();
  return stream;
}

SurfaceSample CloudStream::sample(const SurfelSource& source, std::size_t begin, std::size_t end) {
  const std::size_t count = end - begin;
  PerWorker<RenderCloud> workers;
  PerWorker<SurfaceSampler> parts([count] { return std::make_unique<SurfaceSampler>(count); });
  parallel_for(count, RenderCloud::kBlock, [&](std::size_t first, std::size_t last, int w) {
    RenderCloud& rows = workers[w];
    if (rows.x.empty()) rows.allocate(RenderCloud::kBlock, source.attributes(), {}, "");
    source.fill(begin + first, begin + last, rows, 0);
    UnusableSurfels ignored;
    for (std::size_t i = 0; i < last - first; ++i) {
      if (rows.usable(i, ignored)) parts[w].add(rows.sample_point(i));
    }
  });
  SurfaceSampler all(count);
  parts.for_each([&](const SurfaceSampler& part) { all.add(part); });
  return all.sample(source.origin());
}

bool CloudStream::have_one_color(const SurfelSource& source) {
  constexpr std::size_t kPlaces = 64;
  constexpr std::size_t kEach = 64;
  RenderCloud rows;
  rows.allocate(kEach, source.attributes(), {}, "");
  std::optional<std::array<float, 3>> first;
  for (std::size_t place = 0; place < kPlaces; ++place) {
    const std::size_t begin = source.size() * place / kPlaces;
    const std::size_t count = std::min(kEach, source.size() - begin);
    source.fill(begin, begin + count, rows, 0);
    for (std::size_t i = 0; i < count; ++i) {
      const std::array<float, 3> color{rows.red[i], rows.green[i], rows.blue[i]};
      if (color != first.value_or(color)) return false;
      first = color;
    }
  }
  return true;
}

bool CloudStream::all_black(const SurfelSource& source) {
  if (!source.attributes().color) return false;
  RenderCloud rows;
  rows.allocate(RenderCloud::kBlock, source.attributes(), {}, "");
  for (std::size_t begin = 0; begin < source.size(); begin += RenderCloud::kBlock) {
    const std::size_t end = std::min(begin + RenderCloud::kBlock, source.size());
    source.fill(begin, end, rows, 0);
    for (std::size_t i = 0; i < end - begin; ++i) {
      if (rows.red[i] != 0 || rows.green[i] != 0 || rows.blue[i] != 0) return false;
    }
  }
  return source.size() > 0;
}

/// Allocates the columns of a batch.
void CloudStream::allocate() {
  slot_.assign(cloud_.clusters_.size(), kNone);
  holder_.assign(std::min(batch_clusters(), cloud_.clusters_.size()), kNone);
  cloud_.allocate(holder_.size() * RenderCloud::kClusterSize, attributes_,
                  {.places = options_.places}, "");
  cloud_.read_rows_ = [this](std::uint32_t cluster, RenderCloud& scratch,
                             RenderCloud::RowVisitor visit) {
    const std::uint64_t begin = surfel_[cluster];
    std::size_t end = surfel_end(cluster) - begin;
    read(begin, begin + end, scratch);
    UnusableSurfels ignored;
    drop_unusable(scratch, 0, end, ignored);
    visit(scratch, 0, end);
  };
}

std::size_t CloudStream::surfel_end(std::uint32_t cluster) const {
  if (!from_tree_) return std::min(surfel_[cluster] + RenderCloud::kClusterSize, source_.size());
  return surfel_[cluster] + (cloud_.clusters_[cluster].end - cloud_.clusters_[cluster].begin);
}

/// Reads surfels [begin, end) of the file, a block at most, into a worker's rows.
const RenderCloud& CloudStream::read(std::size_t begin, std::size_t end, RenderCloud& rows) const {
  if (rows.x.empty()) rows.allocate(RenderCloud::kBlock, source_.attributes(), {}, "");
  source_.fill(begin, end, rows, 0);
  return rows;
}

/// Is the alpha of some surfel of the finest level below 1?
bool CloudStream::finest_transparent(const ClusterTree& tree) const {
  const auto leaves = std::span(tree).subspan(first_leaf(tree));
  PerWorker<RenderCloud> workers;
  std::atomic<bool> found = false;
  parallel_for(leaves.size(), kRunLength, [&](std::size_t begin, std::size_t end, int w) {
    if (found) return;
    const std::size_t first = leaves[begin].begin;
    const std::size_t count = leaves[end - 1].end - first;
    const RenderCloud& rows = read(first, first + count, workers[w]);
    if (rows.totals(0, count).transparent) found = true;
  });
  return found;
}

/// Moves the surfels of rows [begin, end) that are drawn to the front; `end` follows the last.
void CloudStream::drop_unusable(RenderCloud& rows, std::size_t begin, std::size_t& end,
                                UnusableSurfels& dropped) const {
  std::size_t kept = begin;
  for (std::size_t i = begin; i < end; ++i) {
    if (!rows.usable(i, dropped)) continue;
    if (kept < i) {
      for (Array<float>* column : RenderCloud::float_columns(rows)) {
        if (!column->empty()) (*column)[kept] = (*column)[i];
      }
      if (!rows.material.empty()) rows.material[kept] = rows.material[i];
      if (!rows.place.empty()) rows.place[kept] = rows.place[i];
    }
    ++kept;
  }
  end = kept;
}

/// Bounds all clusters, in one pass over the file (two where the surfels lie far from the origin).
/// False if they are too large to be of use.
bool CloudStream::make_index() {
  const std::size_t size = source_.size();
  const std::size_t count = (size + RenderCloud::kClusterSize - 1) / RenderCloud::kClusterSize;
  std::vector<SurfelTotals> totals;
  struct Worker {
    RenderCloud rows;
    UnusableSurfels dropped;
  };
  PerWorker<Worker> workers;
  Bounds box;
  const auto pass = [&] {
    totals.assign(count, {});
    workers.for_each([](Worker& worker) { worker.dropped = {}; });
    cloud_.clusters_.assign(count, {});
    parallel_for(size, RenderCloud::kBlock, [&](std::size_t begin, std::size_t end, int w) {
      RenderCloud& rows = workers[w].rows;
      read(begin, end, rows);
      for (std::size_t i = begin; i < end; i += RenderCloud::kClusterSize) {
        const std::size_t c = i / RenderCloud::kClusterSize;
        const std::size_t row = i - begin;
        std::size_t row_end = std::min<std::size_t>(end - begin, row + RenderCloud::kClusterSize);
        totals[c] = rows.make_cluster(row, row_end, cloud_.clusters_[c]);
        if (!totals[c].usable || totals[c].invisible) {
          drop_unusable(rows, row, row_end, workers[w].dropped);
          totals[c] = rows.make_cluster(row, row_end, cloud_.clusters_[c]);
        }
      }
    });
    const SurfelTotals all = added_up(totals);
    box.min = all.min.cast<double>();
    box.max = all.max.cast<double>();
  };
  pass();
  if (source_.recenter(box)) pass();

  double radii = 0;
  for (std::size_t c = 0; c < count; ++c) {
    const Cluster& cluster = cloud_.clusters_[c];
    const std::size_t surfels = cluster.end - cluster.begin;
    if (surfels == 0) continue;
    radii += cluster.radius;
    cloud_.size_ += surfels;
    cloud_.clusters_[surfel_.size()] = cluster;
    totals[surfel_.size()] = totals[c];
    surfel_.push_back(c * RenderCloud::kClusterSize);
  }
  const auto kept = static_cast<double>(surfel_.size());
  if (radii > kept * kLoosest * box.diagonal() / portable::pow(kept, 1.0 / 3)) return false;
  cloud_.clusters_.resize(surfel_.size());
  totals.resize(surfel_.size());
  workers.for_each([&](const Worker& worker) { cloud_.dropped_.add(worker.dropped); });
  cloud_.origin_ = source_.origin();
  const SurfelTotals all = added_up(totals);
  attributes_ = source_.attributes();
  attributes_.alpha = attributes_.alpha && all.transparent;
  if (cloud_.size_ > 0) cloud_.mean_deviation_ = all.deviations / static_cast<double>(cloud_.size_);
  cloud_.make_box(all.reach_min, all.reach_max);
  return true;
}

/// Indices of the clusters that have no slot, in the order of the file.
std::vector<std::uint32_t> CloudStream::missing(std::span<const VisibleCluster> clusters) const {
  std::vector<std::uint32_t> indices;
  for (const VisibleCluster& cluster : clusters) {
    if (slot_[cluster.index] == kNone) indices.push_back(cluster.index);
  }
  std::sort(indices.begin(), indices.end());
  return indices;
}

/// Joins ascending clusters to runs of at most `longest` clusters that follow one another in the
/// file, and in their slots if they have any.
std::vector<CloudStream::Run> CloudStream::runs(const std::vector<std::uint32_t>& clusters,
                                                std::size_t longest) const {
  std::vector<Run> out;
  for (const std::uint32_t c : clusters) {
    const bool follows =
        !out.empty() && out.back().first + out.back().count == c &&
        surfel_end(c - 1) == surfel_[c] && out.back().count < longest &&
        (slot_[c] == kNone || (slot_[c] == slot_[c - 1] + 1 &&
                               surfel_[c] == surfel_[c - 1] + RenderCloud::kClusterSize));
    if (follows) {
      ++out.back().count;
    } else {
      out.push_back({c, 1});
    }
  }
  return out;
}

/// Gives the missing clusters slots that none of `clusters` has.
void CloudStream::make_room(std::span<const VisibleCluster> clusters,
                            const std::vector<std::uint32_t>& missing) {
  if (missing.empty()) return;
  std::vector<bool> kept(holder_.size());
  for (const VisibleCluster& cluster : clusters) {
    if (slot_[cluster.index] != kNone) kept[slot_[cluster.index]] = true;
  }
  for (const std::uint32_t c : missing) {
    while (kept[next_slot_]) next_slot_ = (next_slot_ + 1) % holder_.size();
    std::uint32_t& holder = holder_[next_slot_];
    if (holder != kNone) slot_[holder] = kNone;
    holder = c;
    slot_[c] = static_cast<std::uint32_t>(next_slot_);
    next_slot_ = (next_slot_ + 1) % holder_.size();
  }
}

void CloudStream::fetch(std::span<const VisibleCluster> clusters) {
  const std::vector<std::uint32_t> wanted = missing(clusters);
  make_room(clusters, wanted);
  const std::vector<Run> all = runs(wanted, kRunLength);
  const auto fill = [&](std::size_t i, std::size_t, int) {
    const Run& run = all[i];
    source_.fill(surfel_[run.first], surfel_end(run.first + run.count - 1), cloud_,
                 std::size_t{slot_[run.first]} * RenderCloud::kClusterSize);
    for (std::uint32_t c = run.first; c < run.first + run.count; ++c) {
      Cluster& cluster = cloud_.clusters_[c];
      const std::size_t begin = std::size_t{slot_[c]} * RenderCloud::kClusterSize;
      std::size_t end = begin + (surfel_end(c) - surfel_[c]);
      cloud_.number_rows(begin, end, surfel_[c]);
      if (end - begin != cluster.end - cluster.begin) {
        UnusableSurfels counted_before;
        drop_unusable(cloud_, begin, end, counted_before);
      }
      cluster.begin = static_cast<std::uint32_t>(begin);
      cluster.end = static_cast<std::uint32_t>(end);
      if (from_tree_) cloud_.measure(cluster, cloud_.check_levels(cluster, name_));
    }
  };
  try {
    parallel_for(all.size(), 1, fill);
  } catch (...) {
    for (const std::uint32_t c : wanted) holder_[std::exchange(slot_[c], kNone)] = kNone;
    throw;
  }
}

void CloudStream::expect(std::span<const VisibleCluster> clusters) const {
  for (const Run& run : runs(missing(clusters), kLongestExpected)) {
    source_.expect(surfel_[run.first], surfel_end(run.first + run.count - 1));
  }
}

}  // namespace surfel
