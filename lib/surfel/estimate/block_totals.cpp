#include <algorithm>
#include <limits>
#include <type_traits>
#include <vector>

#include <surfel/estimate/block_totals.h>

namespace surfel {

BlockTotals BlockTotals::of(const SurfelBlock& block, const BlockCloud& cloud) {
  const NormalOptions& o = cloud.options.normals;
  // Neighbourhoods of more points than were searched for were enlarged.
  const std::size_t searched =
      o.radius > 0 ? std::numeric_limits<std::size_t>::max()
                   : std::min(static_cast<std::size_t>(o.adaptive ? o.k_max : o.k), cloud.finite());
  const PointEstimates& e = block.estimates;
  BlockTotals totals;
  for (std::size_t i = 0; i < block.points.cloud.size(); ++i) {
    const NormalQuality& quality = e.normals.quality[i];
    ++totals.flagged[static_cast<std::size_t>(quality.flag)];
    totals.neighbors += quality.neighbors;
    totals.extended += quality.neighbors > searched ? 1 : 0;
    totals.flipped += block.turned[i];
    totals.unknown += e.normals.normal[i].isZero(0) ? 1 : 0;
    const CellKind kind = e.sizes.kind[i];
    totals.border += kind != CellKind::kClosed ? 1 : 0;
    totals.capped += kind == CellKind::kAlone ? 1 : 0;
    totals.elongated += surfel::elongated(e.sizes.of[i], kind) ? 1 : 0;
  }
  totals.confidence = sum_of_confidences(e.side_confidence);
  totals.unusable_colors = surfel::unusable_colors(block.points.cloud);
  totals.components = block.components;
  totals.method = block.method;
  return totals;
}

void BlockTotals::add(const BlockTotals& more) {
  for (std::size_t f = 0; f < kPointFlags; ++f) flagged[f] += more.flagged[f];
  neighbors += more.neighbors;
  extended += more.extended;
  flipped += more.flipped;
  unknown += more.unknown;
  border += more.border;
  capped += more.capped;
  elongated += more.elongated;
  unusable_colors += more.unusable_colors;
  confidence += more.confidence;
  components = std::max(components, more.components);
  if (more.method != Orientation::kNone) method = more.method;
}

void BlockTotals::add_up(Peers* peers) {
  static_assert(std::is_trivially_copyable_v<BlockTotals>);
  const std::vector<std::vector<BlockTotals>> all =
      gather_lists(peers, std::vector<BlockTotals>{*this});
  *this = {};
  for (const std::vector<BlockTotals>& totals : all) add(totals.front());
}

void BlockTotals::fill(const BlockCloud& cloud, EstimateReport& report) const {
  const RunIndex& index = cloud.index();
  report.points = index.points();
  report.nonfinite = index.points() - index.finite();
  report.unusable_colors = unusable_colors;
  report.flagged = flagged;
  report.extended = extended;
  report.mean_neighbors = static_cast<double>(neighbors) / static_cast<double>(index.finite());
  report.orientation.method = method;
  report.orientation.components = components;
  report.orientation.flipped = flipped;
  report.orientation.unknown = unknown;
  if (cloud.options.orientation.method != Orientation::kNone) {
    report.side_confidence = mean_confidence(confidence, index.finite());
  }
  report.border = border;
  report.capped = capped;
}

}  // namespace surfel
