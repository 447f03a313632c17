#include <algorithm>
#include <limits>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/box_tree.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/lod/curve_blocks.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/sp06/group_blocks.h>

namespace surfel {
namespace {

constexpr std::size_t kRunLength = 1024;
constexpr std::size_t kHaloGrain = 64;
/// Surfels that are read at once for the index.
constexpr std::size_t kIndexPiece = 64 * kRunLength;

/// Box around the centres of some consecutive splats, and how far they reach: shrunk or enlarged by
/// the overlap that is allowed.
struct SplatRun {
  Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
  Vec3f high = Vec3f::Constant(-std::numeric_limits<float>::infinity());
  float reach = 0;

  void add(const Vec3f& center, float radius) {
    low = low.cwiseMin(center);
    high = high.cwiseMax(center);
    reach = std::max(reach, radius);
  }
  void add(const SplatRun& other) {
    low = low.cwiseMin(other.low);
    high = high.cwiseMax(other.high);
    reach = std::max(reach, other.reach);
  }
  bool empty() const { return !(low.x() <= high.x()); }
  /// False only if no splat of this run overlaps a splat of the other one.
  bool may_overlap(const SplatRun& other) const {
    if (empty() || other.empty()) return false;
    constexpr float kRounding = 1 + 1e-5F;
    const Vec3f gap = (low - other.high).cwiseMax(other.low - high).cwiseMax(0.0F);
    return gap.norm() <= (reach + other.reach) * kRounding;
  }
};

/// How far splat i reaches; 0 if it is not usable.
float reach_of(const SurfelCloud& cloud, std::size_t i, const OverlapOptions& options) {
  return static_cast<float>(options.overlap) * splat_radius(cloud, i, options.cutoff);
}

/// A splat as a run. Where splats may overlap as they like, splats of no reach are usable, too.
SplatRun run_of(const SurfelCloud& cloud, std::size_t i, const OverlapOptions& options) {
  SplatRun run;
  if (splat_radius(cloud, i, options.cutoff) > 0) {
    run.add(cloud.position[i], reach_of(cloud, i, options));
  }
  return run;
}

/// The runs of kRunLength surfels each.
std::vector<SplatRun> runs_of(const SurfelCloud& cloud, const OverlapOptions& options) {
  std::vector<SplatRun> runs((cloud.size() + kRunLength - 1) / kRunLength);
  parallel_for(cloud.size(), kRunLength, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      runs[begin / kRunLength].add(run_of(cloud, i, options));
    }
  });
  return runs;
}

/// Finds out which splats, and runs of splats, may overlap the splats of a block. A curve through
/// space jumps: boxes of some consecutive splats may be as large as the cloud, the boxes of single
/// splats are not.
class BlockSplats {
 public:
  BlockSplats(const SurfelCloud& block, const OverlapOptions& options) : splat_(block.size()) {
    parallel_each(block.size(), kRunLength,
                  [&](std::size_t i) { splat_[i] = run_of(block, i, options); });
    tree_ = {splat_.size(), [&](std::size_t i) { return splat_[i]; }};
  }

  bool may_overlap(const SplatRun& other) const {
    if (other.empty()) return false;
    bool found = false;
    tree_.for_each_leaf([&](const SplatRun& run) { return !found && run.may_overlap(other); },
                        [&](std::size_t leaf) {
                          tree_.for_each_item(leaf, [&](std::size_t i) {
                            found = found || splat_[i].may_overlap(other);
                          });
                        });
    return found;
  }

 private:
  Array<SplatRun> splat_;
  BoxTree<SplatRun, 8, 4> tree_;
};

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

class BlockGrouping {
 public:
  BlockGrouping(const SurfelRanges& cloud, const GroupingOptions& options, GroupingReport& report,
                const std::string& name)
      : cloud_(cloud), options_(options), report_(report), name_(name), group_(cloud.size()) {}

  void read_index() {
    ProgressStage stage("measuring splats", cloud_.size(), "surfels");
    for (std::size_t begin = 0; begin < cloud_.size(); begin += kIndexPiece) {
      const std::size_t end = std::min(begin + kIndexPiece, cloud_.size());
      const std::vector<SplatRun> runs = runs_of(cloud_.read(begin, end), options_.overlap);
      run_.insert(run_.end(), runs.begin(), runs.end());
      stage.add(end - begin);
    }
  }

  /// The surfels [begin, end) with their groups.
  SurfelCloud group(std::size_t begin, std::size_t end) {
    SurfelCloud block = cloud_.read(begin, end);
    const Around around = with_neighbors(block, begin);
    color(around, begin, end);
    block.group.assign(group_.begin() + static_cast<std::ptrdiff_t>(begin),
                       group_.begin() + static_cast<std::ptrdiff_t>(end));
    block.group_radius.clear();
    block.tree = {};
    return block;
  }

  void finish() {
    report_.splats = cloud_.size();
    report_.groups = static_cast<std::uint32_t>(report_.sizes.size());
    report_.edges = ends_ / 2;
    const std::size_t usable = report_.splats - report_.unusable;
    report_.mean_degree = usable > 0 ? static_cast<double>(ends_) / static_cast<double>(usable) : 0;
  }

 private:
  /// A block among the splats that may overlap its own, in the order of the cloud.
  struct Around {
    SurfelCloud cloud;
    std::vector<std::size_t> number;  ///< In the whole cloud.
  };

  Around with_neighbors(const SurfelCloud& block, std::size_t begin) const {
    const std::size_t end = begin + block.size();
    const BlockSplats own(block, options_.overlap);
    const auto meets = [&](const SplatRun& other) { return own.may_overlap(other); };
    Around out;
    std::vector<SurfelCloud> parts;
    const auto take_halo = [&](std::size_t from, std::size_t to) {
      if (from >= to) return;
      const SurfelCloud piece = cloud_.read(from, to);
      Array<std::uint8_t> near(piece.size());
      parallel_each(piece.size(), kHaloGrain, [&](std::size_t i) {
        near[i] = meets(run_of(piece, i, options_.overlap)) ? 1 : 0;
      });
      Array<std::uint32_t> rows;
      for (std::size_t i = 0; i < piece.size(); ++i) {
        if (near[i] == 0) continue;
        rows.push_back(static_cast<std::uint32_t>(i));
        out.number.push_back(from + i);
      }
      if (!rows.empty()) {
        parts.push_back(overlap_columns(piece, options_.overlap).gathered(rows));
      }
    };
    const auto take_runs = [&](std::size_t from, std::size_t to) {
      for (std::size_t r = from / kRunLength; r * kRunLength < to; ++r) {
        if (!meets(run_[r])) continue;
        take_halo(std::max(from, r * kRunLength), std::min(to, (r + 1) * kRunLength));
      }
    };
    take_runs(0, begin);
    parts.push_back(overlap_columns(block, options_.overlap));
    for (std::size_t i = begin; i < end; ++i) out.number.push_back(i);
    take_runs(end, cloud_.size());

    out.cloud = cloud_of_rows(parts.front(), out.number.size());
    std::size_t at = 0;
    for (const SurfelCloud& part : parts) {
      copy_rows(part, 0, part.size(), out.cloud, at);
      at += part.size();
    }
    return out;
  }

  bool holds_usable(const Around& around, std::size_t begin, std::size_t end) const {
    for (std::size_t i = 0; i < around.number.size(); ++i) {
      const bool own = around.number[i] >= begin && around.number[i] < end;
      if (own && splat_radius(around.cloud, i, options_.overlap.cutoff) > 0) return true;
    }
    return false;
  }

  void color(const Around& around, std::size_t begin, std::size_t end) {
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
  std::vector<SplatRun> run_;
  Array<std::uint16_t> group_;  ///< Of the surfels of finished blocks.
  std::uint64_t ends_ = 0;      ///< Of edges, at the splats of finished blocks.
};

}  // namespace

std::uint64_t group_block_bytes(std::size_t surfels, std::size_t row_bytes) {
  // A splat's place in the graph, some 20 ends of edges, twice, and its part of what is around.
  constexpr std::uint64_t kInGraph = 350;
  return surfels * sizeof(std::uint16_t) + surfels / kRunLength * sizeof(SplatRun) +
         kGroupBlock * (kInGraph + 3 * row_bytes);
}

bool group_by_blocks(const SurfelRanges& cloud, const GroupingOptions& options,
                     FunctionRef<void(std::size_t begin, SurfelCloud block)> visit,
                     GroupingReport* report, const std::string& name, std::size_t most) {
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
  const CurveBlocks blocks = curve_blocks(cloud, most);
  if (!blocks.in_order) return false;
  BlockGrouping grouping(cloud, options, r, name);
  grouping.read_index();
  ProgressStage stage("grouping", cloud.size(), "surfels");
  // Surfels that cannot be drawn, without any that can, are in no block.
  const std::size_t end = blocks.blocks.empty() ? 0 : blocks.blocks.back().end;
  for (const CurveBlock& block : blocks.blocks) {
    visit(block.begin, grouping.group(block.begin, block.end));
    stage.add(block.end - block.begin);
  }
  if (end < cloud.size()) visit(end, grouping.group(end, cloud.size()));
  grouping.finish();
  if (r.sizes.empty()) {
    throw_input(name, fmt::format("none of {} splats has a finite position and a positive variance",
                                  cloud.size()));
  }
  return true;
}

}  // namespace surfel
