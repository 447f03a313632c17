#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/cloud_stream.h>
#include <surfel/render/splat_lists.h>

namespace surfel {
namespace {

/// Clusters read at once; each worker keeps as many.
constexpr std::size_t kRunLength = RenderCloud::kBlock / RenderCloud::kClusterSize;
/// Mean radius of the clusters that is still worth it, in units of what is left of the scene's
/// diagonal where it is cut into as many cubes: scan lines of a surface stay below, surfels in
/// random order from 400 clusters on above.
constexpr double kLoosest = 2;
/// Clusters announced to the system at once.
constexpr std::size_t kLongestExpected = 4096;

}  // namespace

std::unique_ptr<CloudStream> CloudStream::make(SurfelSource& source,
                                               const CloudStreamOptions& options) {
  if (source.size() / RenderCloud::kClusterSize >= std::numeric_limits<std::uint32_t>::max()) {
    throw_input("", "more than a billion of clusters; split the cloud");
  }
  std::unique_ptr<CloudStream> stream(new CloudStream(source, options));
  if (!stream->make_index()) return nullptr;
  RenderCloud& cloud = stream->cloud_;
  cloud.allocate(std::min(options.batch, cloud.clusters_.size() * RenderCloud::kClusterSize),
                 stream->attributes_, {}, "");
  return stream;
}

std::size_t CloudStream::surfel_end(std::uint32_t cluster) const {
  return std::min(surfel(cluster) + RenderCloud::kClusterSize, source_.size());
}

/// Moves the surfels of rows [begin, end) that can be drawn to the front, and the end with them.
void CloudStream::drop_unusable(RenderCloud& rows, std::size_t begin, std::size_t& end,
                                UnusableSurfels& dropped) const {
  std::size_t kept = begin;
  for (std::size_t i = begin; i < end; ++i) {
    if (!rows.usable(i, dropped)) continue;
    if (kept < i) {
      for (Array<float>* column : rows.float_columns()) {
        if (!column->empty()) (*column)[kept] = (*column)[i];
      }
      if (!rows.material.empty()) rows.material[kept] = rows.material[i];
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
  std::vector<RenderCloud> workers(static_cast<std::size_t>(thread_count()));
  std::vector<UnusableSurfels> dropped;
  Bounds box;
  const auto pass = [&] {
    totals.assign(count, {});
    dropped.assign(workers.size(), {});
    cloud_.clusters_.assign(count, {});
    parallel_for(size, RenderCloud::kBlock, [&](std::size_t begin, std::size_t end, int w) {
      RenderCloud& rows = workers[w];
      if (rows.x.empty()) rows.allocate(RenderCloud::kBlock, source_.attributes(), {}, "");
      source_.fill(begin, end, rows, 0);
      for (std::size_t i = begin; i < end; i += RenderCloud::kClusterSize) {
        const std::size_t c = i / RenderCloud::kClusterSize;
        const std::size_t row = i - begin;
        std::size_t row_end = std::min<std::size_t>(end - begin, row + RenderCloud::kClusterSize);
        totals[c] = rows.make_cluster(row, row_end, cloud_.clusters_[c]);
        if (!totals[c].usable) {
          drop_unusable(rows, row, row_end, dropped[w]);
          totals[c] = rows.make_cluster(row, row_end, cloud_.clusters_[c]);
        }
      }
    });
    box = {};
    for (const SurfelTotals& t : totals) {
      box.min = box.min.cwiseMin(t.min.cast<double>());
      box.max = box.max.cwiseMax(t.max.cast<double>());
    }
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
    cloud_.clusters_[block_.size()] = cluster;
    totals[block_.size()] = totals[c];
    block_.push_back(static_cast<std::uint32_t>(c));
  }
  // In order clusters of a volume, the hardest case, have radii of 0.6 of this.
  const auto kept = static_cast<double>(block_.size());
  if (radii > kept * kLoosest * box.diagonal() / std::cbrt(kept)) return false;
  cloud_.clusters_.resize(block_.size());
  totals.resize(block_.size());
  for (const UnusableSurfels& d : dropped) cloud_.dropped_.add(d);
  cloud_.origin_ = source_.origin();
  attributes_ = source_.attributes();
  attributes_.alpha = cloud_.make_extent(totals) && attributes_.alpha;
  return true;
}

/// The clusters in the order of the file, those that follow one another as one.
std::vector<CloudStream::Run> CloudStream::runs(std::span<const VisibleCluster> clusters,
                                                std::size_t longest) const {
  std::vector<std::uint32_t> indices;
  for (const VisibleCluster& cluster : clusters) indices.push_back(cluster.index);
  std::sort(indices.begin(), indices.end());
  std::vector<Run> out;
  for (const std::uint32_t index : indices) {
    const bool follows = !out.empty() && out.back().first + out.back().count == index &&
                         surfel_end(index - 1) == surfel(index) && out.back().count < longest;
    if (follows) {
      ++out.back().count;
    } else {
      out.push_back({index, 1});
    }
  }
  return out;
}

void CloudStream::fetch(std::span<const VisibleCluster> clusters) {
  const std::vector<Run> all = runs(clusters, kRunLength);
  std::vector<std::size_t> row(all.size());
  for (std::size_t i = 1; i < all.size(); ++i) {
    row[i] = row[i - 1] + all[i - 1].count * RenderCloud::kClusterSize;
  }
  parallel_for(all.size(), 1, [&](std::size_t i, std::size_t, int) {
    const Run& run = all[i];
    source_.fill(surfel(run.first), surfel_end(run.first + run.count - 1), cloud_, row[i]);
    for (std::uint32_t k = 0; k < run.count; ++k) {
      Cluster& cluster = cloud_.clusters_[run.first + k];
      const std::size_t begin = row[i] + k * RenderCloud::kClusterSize;
      std::size_t end = begin + surfel_end(run.first + k) - surfel(run.first + k);
      if (end - begin != cluster.end - cluster.begin) {
        UnusableSurfels counted_before;
        drop_unusable(cloud_, begin, end, counted_before);
      }
      cluster.begin = static_cast<std::uint32_t>(begin);
      cluster.end = static_cast<std::uint32_t>(end);
    }
  });
}

void CloudStream::expect(std::span<const VisibleCluster> clusters) const {
  for (const Run& run : runs(clusters, kLongestExpected)) {
    source_.expect(surfel(run.first), surfel_end(run.first + run.count - 1));
  }
}

}  // namespace surfel
