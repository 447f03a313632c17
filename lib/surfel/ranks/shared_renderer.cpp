// After the sort-middle class of Molnar, Cox, Ellsworth, Fuchs, "A Sorting Classification of
// Parallel Rendering", 1994: what is drawn is sent to the owners of its place on the screen.

#include <algorithm>
#include <cstring>
#include <utility>

#include <surfel/base/timing.h>
#include <surfel/ranks/shared_renderer.h>
#include <surfel/render/frame.h>

namespace surfel {
namespace {

/// Most clusters that a process sends at a time: some 30 MB.
constexpr std::size_t kSentTogether = 2048;

/// Rows of one of `parts` parts of a range, which ends where tiles end.
RowRange part_of_rows(const RowRange& rows, int part, int parts) {
  const int together = (rows.end - rows.begin + kRowsTogether - 1) / kRowsTogether;
  const auto first = [&](int i) {
    return std::min(rows.end, rows.begin + together * i / parts * kRowsTogether);
  };
  return {first(part), first(part + 1)};
}

}  // namespace

SharedRenderer::SharedRenderer(const LoadedCloud& loaded, Peers& peers, const Scene& scene,
                               const RenderOptions& options)
    : store_(loaded.store()),
      part_(*loaded.part()),
      peers_(peers),
      gathered_(loaded.surfels()),
      options_(options),
      renderer_(gathered_, scene, options),
      culling_(store_.cloud(), options_, renderer_.list_options()) {}

/// The rows of each peer.
std::vector<RowRange> SharedRenderer::rows_of_all(const RowRange& rows) {
  std::vector<RowRange> all;
  for (const std::vector<int>& range :
       gather_lists(&peers_, std::vector<int>{rows.begin, rows.end})) {
    all.push_back({range[0], range[1]});
  }
  return all;
}

/// What the whole picture shows, of which this process draws `visible`. Process 0 sorts all.
PictureLoad SharedRenderer::load_of(std::span<const VisibleCluster> visible) {
  struct Entry {
    VisibleCluster cluster;
    double share;
  };
  const auto count = static_cast<std::size_t>(peers_.count());
  std::vector<Bytes> to(count);
  for (const VisibleCluster& v : visible) {
    const Entry entry{{v.nearest, part_.number[v.index]}, culling_.share(v)};
    append_values(&entry, 1, to[0]);
  }
  std::vector<Entry> all;
  for (const Bytes& from : peers_.exchange(std::move(to))) {
    const std::vector<Entry> entries = values_of<Entry>(from);
    all.insert(all.end(), entries.begin(), entries.end());
  }
  std::sort(all.begin(), all.end(),
            [](const Entry& a, const Entry& b) { return drawn_before(a.cluster, b.cluster); });
  const PictureLoad load{all.size(),
                         mean_of_sample(all.size(), [&](std::size_t i) { return all[i].share; })};
  std::vector<Bytes> told(count);
  for (Bytes& bytes : told) {
    if (peers_.rank() == 0) append_values(&load, 1, bytes);
  }
  return values_of<PictureLoad>(peers_.exchange(std::move(told)).front()).front();
}

/// The processes whose rows a cluster of the part reaches into.
template <class Visit>
void SharedRenderer::visit_receivers(std::span<const RowRange> seen, std::uint32_t cluster,
                                     const Visit& visit) const {
  const TileRange tiles = culling_.tiles_of(store_.cloud().clusters()[cluster]);
  const RowRange rows{tiles.y0 * kTileSize, (tiles.y1 + 1) * kTileSize};
  for (std::size_t r = 0; r < seen.size(); ++r) {
    if (rows.begin < seen[r].end && rows.end > seen[r].begin) visit(r);
  }
}

/// Parts that the rows are drawn in, so that no process gets more surfels for one than it has room
/// for, as far as the clusters' bounds tell.
int SharedRenderer::parts_of(const Camera& camera, std::span<const RowRange> rows,
                             std::span<const VisibleCluster> visible) {
  const auto seen_rows = [&](const RowRange& range) {
    Camera other = camera;
    other.rows = range;
    return range.begin < range.end ? renderer_.rows_seen(other) : RowRange{0, 0};
  };
  const std::size_t most = least_of(&peers_, store_.batch_clusters());
  int parts = 1;
  // A single row of tiles is not divided further, whatever it shows.
  int tallest = 1;
  for (const RowRange& range : rows) {
    tallest = std::max(tallest, tiles_along(range.end - range.begin));
  }
  while (true) {
    std::vector<std::size_t> wanted(rows.size());
    for (int p = 0; p < parts; ++p) {
      std::vector<RowRange> seen;
      for (const RowRange& range : rows) seen.push_back(seen_rows(part_of_rows(range, p, parts)));
      std::vector<std::size_t> here(rows.size());
      for (const VisibleCluster& v : visible) {
        visit_receivers(seen, v.index, [&](std::size_t r) { ++here[r]; });
      }
      std::vector<std::size_t> sums(rows.size());
      for (const std::vector<std::size_t>& of_one : gather_lists(&peers_, here)) {
        for (std::size_t r = 0; r < sums.size(); ++r) sums[r] += of_one[r];
      }
      for (std::size_t r = 0; r < sums.size(); ++r) wanted[r] = std::max(wanted[r], sums[r]);
    }
    if (*std::max_element(wanted.begin(), wanted.end()) <= most || parts == tallest) return parts;
    parts = std::min(2 * parts, tallest);
  }
}

/// Gathers what the peers' parts show in the rows that this one sees, and sends them what its part
/// shows in theirs. \param seen  rows that each peer sees.
void SharedRenderer::gather(std::span<const RowRange> seen, std::span<const VisibleCluster> visible,
                            FrameStatistics& statistics) {
  std::vector<VisibleCluster> wanted;
  for (const VisibleCluster& v : visible) {
    bool any = false;
    visit_receivers(seen, v.index, [&](std::size_t) { any = true; });
    if (any) wanted.push_back(v);
  }
  gathered_.clear();
  const std::size_t together = std::min(kSentTogether, store_.batch_clusters());
  const std::size_t rounds = greatest_of(&peers_, (wanted.size() + together - 1) / together);
  const auto own = static_cast<std::size_t>(peers_.rank());
  for (std::size_t round = 0; round < rounds; ++round) {
    const std::size_t begin = std::min(wanted.size(), round * together);
    const std::size_t end = std::min(wanted.size(), begin + together);
    const std::span<const VisibleCluster> batch = std::span(wanted).subspan(begin, end - begin);
    Timer timer;
    store_.fetch(batch);
    store_.expect(std::span(wanted).subspan(end, std::min(together, wanted.size() - end)));
    std::vector<Bytes> to(seen.size());
    for (const VisibleCluster& v : batch) {
      visit_receivers(seen, v.index, [&](std::size_t r) {
        GatheredClusters::pack(store_.cloud(), v.index, part_.number[v.index], to[r]);
      });
    }
    statistics.stages.add("read", timer.milliseconds());
    timer.restart();
    for (std::size_t r = 0; r < to.size(); ++r) {
      if (r != own) statistics.sent_bytes += to[r].size();
    }
    std::vector<Bytes> from = peers_.exchange(std::move(to));
    for (std::size_t r = 0; r < from.size(); ++r) {
      if (r != own) statistics.most_received_bytes += from[r].size();
      gathered_.add(from[r]);
      Bytes().swap(from[r]);
    }
    statistics.stages.add("exchange", timer.milliseconds());
  }
}

Image SharedRenderer::render(const Camera& camera, FrameStatistics* statistics) {
  FrameStatistics sum;
  Timer timer;
  const RowRange own = camera.drawn_rows();
  const std::vector<RowRange> rows = rows_of_all(own);
  std::vector<VisibleCluster> visible = culling_.cull(camera, Band(camera, 0, camera.height));
  std::erase_if(visible, [&](const VisibleCluster& v) { return !part_.drawn[v.index]; });
  const PictureLoad load = load_of(visible);
  const int parts = parts_of(camera, rows, visible);
  sum.stages.add("cut", timer.milliseconds());
  sum.most_held_clusters = visible.size();
  Image image;
  for (int p = 0; p < parts; ++p) {
    std::vector<RowRange> seen;
    for (const RowRange& range : rows) {
      Camera other = camera;
      other.rows = part_of_rows(range, p, parts);
      const bool some = other.rows.begin < other.rows.end;
      seen.push_back(some ? renderer_.rows_seen(other) : RowRange{0, 0});
    }
    gather(seen, visible, sum);
    gathered_.finish(load);
    Camera mine = camera;
    mine.rows = part_of_rows(own, p, parts);
    if (mine.rows.begin >= mine.rows.end) continue;
    FrameStatistics one;
    Image drawn = renderer_.render(mine, &one);
    sum.add(one);
    if (image.data.empty()) {
      image = std::move(drawn);
    } else {
      std::copy(drawn.pixel(0, mine.rows.begin), drawn.pixel(0, mine.rows.end),
                image.pixel(0, mine.rows.begin));
    }
  }
  sum.clusters = load.clusters;
  sum.exchanges = parts;
  struct Totals {
    std::uint64_t sent, received;
    std::size_t held;
  };
  const Totals mine{sum.sent_bytes, sum.most_received_bytes, sum.most_held_clusters};
  sum.sent_bytes = 0;
  for (const std::vector<Totals>& of_one : gather_lists(&peers_, std::vector<Totals>{mine})) {
    const Totals& t = of_one.front();
    sum.sent_bytes += t.sent;
    sum.most_received_bytes = std::max(sum.most_received_bytes, t.received);
    sum.most_held_clusters = std::max(sum.most_held_clusters, t.held);
  }
  if (statistics) *statistics = sum;
  return image;
}

}  // namespace surfel
