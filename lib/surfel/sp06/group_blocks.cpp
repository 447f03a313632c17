#include <algorithm>
#include <cstring>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/scene/curve_blocks.h>
#include <surfel/scene/surfel_halo.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/sp06/group_blocks.h>

namespace surfel {
namespace {

/// The columns that tell which splats overlap.
SurfelCloud overlap_columns(const SurfelCloud& cloud, const OverlapOptions& options) {
  SurfelCloud out;
  out.origin = cloud.origin;
  out.position = cloud.position;
  out.variance = cloud.variance;
  out.tangent = cloud.tangent;
  out.variance_u = cloud.variance_u;
  out.variance_v = cloud.variance_v;
  if (!options.relax_coplanar && !options.relax_opposite) return out;
  out.normal = cloud.normal;
  out.color = cloud.color;
  out.coefficient = cloud.coefficient;
  out.alpha = cloud.alpha;
  out.material = cloud.material;
  return out;
}

/// Splats meet where they may overlap: their radii are shrunk or enlarged by the overlap that is
/// allowed. Where splats may overlap as they like, they reach no further than their centres.
SurfelHaloOptions halo_options(const OverlapOptions& options) {
  return {
      .reach =
          [&options](const SurfelCloud& cloud, std::size_t begin, std::size_t end, float* reach) {
            for (std::size_t i = begin; i < end; ++i) {
              const float radius = splat_radius(cloud, i, options.cutoff);
              reach[i - begin] = radius > 0 ? static_cast<float>(options.overlap) * radius : -1;
            }
          },
      .columns = [&options](const SurfelCloud& cloud) { return overlap_columns(cloud, options); }};
}

/// What a later run has to know once a block is done, beside the sizes of all groups so far and the
/// groups of the block's splats. All sums are of the blocks up to this one.
struct KeptGroups {
  std::uint64_t begin, end, unusable, ends, max_degree, graph_bytes, groups;
};

class BlockGrouping {
 public:
  BlockGrouping(const SurfelRanges& cloud, const GroupingOptions& options, GroupingReport& report,
                const std::string& name)
      : cloud_(cloud),
        options_(options),
        report_(report),
        name_(name),
        halo_(cloud, halo_options(options.overlap)),
        group_(cloud.size()) {}

  /// The surfels [begin, end) with their groups.
  SurfelCloud group(std::size_t begin, std::size_t end) {
    SurfelCloud block = cloud_.read(begin, end);
    color(halo_.around(block, begin), begin, end);
    block.group.assign(group_.begin() + static_cast<std::ptrdiff_t>(begin),
                       group_.begin() + static_cast<std::ptrdiff_t>(end));
    block.group_radius.clear();
    block.tree = {};
    return block;
  }

  /// A surfel with the columns that all blocks have.
  SurfelCloud first() const {
    SurfelCloud one = cloud_.read(0, 1);
    one.group.assign(1, 0);
    one.group_radius.clear();
    one.tree = {};
    return one;
  }

  /// What take_up() takes up once the surfels [begin, end) have their groups.
  std::string state(std::size_t begin, std::size_t end) const {
    std::string out;
    const auto append = [&](const auto* values, std::size_t count) {
      out.append(reinterpret_cast<const char*>(values), count * sizeof(*values));
    };
    const KeptGroups kept{begin,
                          end,
                          report_.unusable,
                          ends_,
                          report_.max_degree,
                          report_.graph_bytes,
                          report_.sizes.size()};
    append(&kept, 1);
    for (const std::uint64_t size : report_.sizes) append(&size, 1);
    append(group_.data() + begin, end - begin);
    return out;
  }

  /// False if the state is not of these surfels.
  bool take_up(const std::string& state, std::size_t begin, std::size_t end) {
    KeptGroups kept;
    if (state.size() < sizeof(kept)) return false;
    std::memcpy(&kept, state.data(), sizeof(kept));
    const std::size_t groups = kept.groups * sizeof(std::uint64_t);
    const std::size_t bytes = sizeof(kept) + groups + (end - begin) * sizeof(group_[0]);
    if (kept.begin != begin || kept.end != end || state.size() != bytes) return false;
    std::vector<std::uint64_t> sizes(kept.groups);
    std::memcpy(sizes.data(), state.data() + sizeof(kept), groups);
    report_.sizes.assign(sizes.begin(), sizes.end());
    std::memcpy(group_.data() + begin, state.data() + sizeof(kept) + groups,
                (end - begin) * sizeof(group_[0]));
    report_.unusable = kept.unusable;
    report_.max_degree = static_cast<decltype(report_.max_degree)>(kept.max_degree);
    report_.graph_bytes = kept.graph_bytes;
    ends_ = kept.ends;
    return true;
  }

  void finish() {
    report_.splats = cloud_.size();
    report_.groups = static_cast<std::uint32_t>(report_.sizes.size());
    report_.edges = ends_ / 2;
    const std::size_t usable = report_.splats - report_.unusable;
    report_.mean_degree = usable > 0 ? static_cast<double>(ends_) / static_cast<double>(usable) : 0;
  }

 private:
  bool holds_usable(const SurfelHalo::Around& around, std::size_t begin, std::size_t end) const {
    for (std::size_t i = 0; i < around.number.size(); ++i) {
      const bool own = around.number[i] >= begin && around.number[i] < end;
      if (own && splat_radius(around.cloud, i, options_.overlap.cutoff) > 0) return true;
    }
    return false;
  }

  void color(const SurfelHalo::Around& around, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) group_[i] = 0;
    if (!holds_usable(around, begin, end)) {
      report_.unusable += end - begin;
      return;
    }
    const OverlapGraph graph =
        make_overlap_graph(around.cloud, options_.overlap, &report_.times, name_);
    StageTimer stages(report_.times);
    const auto number = [&](std::uint32_t v) { return around.number[graph.splat[v]]; };
    Array<std::uint32_t> order = coloring_order(graph, options_.order);
    std::erase_if(order, [&](std::uint32_t v) { return number(v) < begin || number(v) >= end; });
    std::vector<std::uint32_t> colors(graph.size(), kUncolored);
    for (std::uint32_t v = 0; v < graph.size(); ++v) {
      if (number(v) < begin) colors[v] = group_[number(v)];
    }
    color_greedily(graph, order, kMaxGroups, colors, name_);
    for (const std::uint32_t v : order) {
      group_[number(v)] = static_cast<std::uint16_t>(colors[v]);
      if (report_.sizes.size() <= colors[v]) report_.sizes.resize(colors[v] + std::size_t{1}, 0);
      ++report_.sizes[colors[v]];
      ends_ += graph.degree(v);
      report_.max_degree = std::max(report_.max_degree, graph.degree(v));
    }
    report_.unusable += graph.unusable;
    report_.graph_bytes = std::max(report_.graph_bytes, graph.memory_bytes());
    stages.end("color");
  }

  const SurfelRanges& cloud_;
  const GroupingOptions& options_;
  GroupingReport& report_;
  const std::string& name_;
  SurfelHalo halo_;
  Array<std::uint16_t> group_;  ///< Of the surfels of finished blocks.
  std::uint64_t ends_ = 0;      ///< Of edges, at the splats of finished blocks.
};

}  // namespace

std::uint64_t group_block_bytes(std::size_t surfels, std::size_t row_bytes) {
  // A splat's place in the graph, some 20 ends of edges, twice, and its part of what is around.
  constexpr std::uint64_t kInGraph = 350;
  return surfels * sizeof(std::uint16_t) + surfels / kHaloRun * sizeof(ReachBox) +
         kGroupBlock * (kInGraph + 3 * row_bytes);
}

bool group_by_blocks(const SurfelRanges& cloud, const GroupingOptions& options, SurfelSink& sink,
                     GroupingReport* report, const std::string& name,
                     const GroupBlockOptions& parts) {
  require_usable(options);
  if (options.groups != 0) throw_usage("a number of groups is kept in memory alone");
  GroupingReport own;
  GroupingReport& r = report ? *report : own;
  r = {};
  const SurfelCloud first = cloud.read(0, std::min<std::size_t>(1, cloud.size()));
  if (!has_variance(first)) {
    throw_input(name,
                "the splats have no variance (nor radius); make it with surfel-from-mesh or "
                "surfel-estimate");
  }
  const CurveBlocks blocks = curve_blocks(cloud, parts.most);
  if (!blocks.in_order) return false;
  BlockGrouping grouping(cloud, options, r, name);
  ProgressStage stage("grouping", cloud.size(), "surfels");
  // Surfels that cannot be drawn, without any that can, are in no block.
  const std::size_t end = blocks.blocks.empty() ? 0 : blocks.blocks.back().end;
  sink.begin(grouping.first(), cloud.size());
  Checkpoints* const checkpoints = parts.checkpoints;
  const auto group = [&](std::size_t begin, std::size_t block_end) {
    const std::optional<std::string> state =
        checkpoints ? checkpoints->finished(begin) : std::nullopt;
    if (!state || !grouping.take_up(*state, begin, block_end)) {
      sink.put(grouping.group(begin, block_end), begin);
      const RowSpan rows{begin, block_end};
      if (checkpoints) checkpoints->finish(begin, {&rows, 1}, grouping.state(begin, block_end));
    }
    stage.add(block_end - begin);
  };
  for (const CurveBlock& block : blocks.blocks) group(block.begin, block.end);
  if (end < cloud.size()) group(end, cloud.size());
  grouping.finish();
  if (r.sizes.empty()) {
    throw_input(name, fmt::format("none of {} splats has a finite position and a positive variance",
                                  cloud.size()));
  }
  return true;
}

}  // namespace surfel
