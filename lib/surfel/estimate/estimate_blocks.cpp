#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/estimate/block_pass.h>
#include <surfel/estimate/block_sizes.h>
#include <surfel/estimate/block_totals.h>
#include <surfel/estimate/block_walk.h>
#include <surfel/estimate/estimate_blocks.h>
#include <surfel/estimate/surfel_blocks.h>
#include <surfel/estimate/winding_blocks.h>

namespace surfel {
namespace {

/// Number of the checkpoint that says whether ellipses are worth it; blocks have smaller ones.
constexpr std::uint64_t kEllipses = std::numeric_limits<std::uint64_t>::max();

/// Are ellipses worth it in some runs, spread evenly?
bool guess_ellipses(const SurfelPass& pass, const BlockCloud& cloud) {
  constexpr std::size_t kProbes = 16;
  BlockTotals totals;
  std::size_t points = 0;
  const std::size_t probes = std::min(kProbes, cloud.index().size());
  for (std::size_t p = 0; p < probes; ++p) {
    const std::size_t run = p * cloud.index().size() / probes;
    const SurfelBlock block = pass.make(run, run + 1);
    totals.add(BlockTotals::of(block, cloud));
    points += block.points.cloud.size();
  }
  return worth_ellipses(totals.elongated, points);
}

/// Makes the surfels of all blocks that are this process's. Returns the totals of all processes.
BlockTotals make_surfels(const SurfelPass& pass, const BlockCloud& cloud, Checkpoints* checkpoints,
                         SurfelSink& sink, StageTimer& stage) {
  sink.begin(pass.first_surfel(), cloud.finite());
  ProgressStage progress("estimating surfels", cloud.index().points(), "points");
  BlockWalk walk(cloud, checkpoints);
  std::size_t done = 0;
  while (const std::optional<BlockWalk::Block> at = walk.next()) {
    SurfelBlock block = pass.make(at->begin_run, at->end_run);
    const BlockTotals totals = BlockTotals::of(block, cloud);
    stage.end("estimates");
    const std::size_t surfels = block.points.cloud.size();
    if (surfels > 0) sink.put(SurfelPass::surfels(std::move(block)), at->surfel);
    walk.finish(*at, surfels, totals);
    stage.end("surfels");
    progress.add(walk.points_done() - std::exchange(done, walk.points_done()));
  }
  progress.add(cloud.index().points() - done);
  BlockTotals totals = walk.totals();
  totals.add_up(cloud.peers);
  return totals;
}

}  // namespace

std::vector<std::string> block_problems(const EstimateOptions& options) {
  std::vector<std::string> found;
  const auto refuse = [&](bool asked_for, const char* what) {
    if (asked_for) {
      found.push_back(std::string(what) +
                      " cannot be done block by block: all points have to fit into memory for it");
    }
  };
  refuse(options.outliers.has_value(), "removal of `outliers`");
  refuse(options.voxels.has_value(), "averaging in `voxels`");
  refuse(options.smoothing.has_value(), "`smoothing`");
  refuse(options.edges.has_value(), "looking for `edges`");
  refuse(options.search != SearchMethod::kExact, "a `search` other than exact");
  const Orientation sides = options.orientation.method;
  if (sides == Orientation::kMst || sides == Orientation::kOutward) {
    found.emplace_back(
        "sides along the surface (mst, outward) cannot be found block by block: orient by winding, "
        "up or viewpoint, or let all points fit into memory");
  }
  return found;
}

std::uint64_t estimate_bytes(std::size_t points, std::size_t point_bytes) {
  // The cloud, and the surfels with their normals, sizes and properties, are in memory at once.
  constexpr std::uint64_t kSurfelBytes = 40;
  return points * std::uint64_t{250 + kSurfelBytes + 2 * point_bytes};
}

void estimate_by_blocks(const SurfelRanges& cloud, const EstimateOptions& options,
                        const BlockOptions& blocks, SurfelSink& sink, EstimateReport* report,
                        const std::string& name) {
  require_usable(options);
  if (const std::vector<std::string> problems = block_problems(options); !problems.empty()) {
    throw_usage(fmt::format("{}", fmt::join(problems, "; ")));
  }
  EstimateReport r;
  StageTimer stage(r.times);
  // Processes that had different blocks would leave some out.
  BlockOptions agreed = blocks;
  agreed.memory = least_of(blocks.peers, blocks.memory);
  const EstimateFacts facts = read_estimate_facts(cloud, options, run_length(cloud, agreed), name);
  BlockCloud whole{.points = cloud,
                   .options = options,
                   .facts = facts,
                   .grid = cloud.grid(),
                   .beside = agreed.beside,
                   .name = name,
                   .peers = agreed.peers};
  whole.options.normals.grow_in_noise = false;
  whole.sizes = block_sizes(facts.index, facts.column_bytes, agreed);
  whole.rules = decide_rules(cloud, facts, options, name);
  stage.end("index");

  std::unique_ptr<StoredSides> winding;
  if (whole.rules.winding) winding = find_sides_by_winding(whole);
  stage.end("sides");

  SurfelPass pass(whole, winding.get());
  const bool cover = options.size.rule == VarianceRule::kCover;
  const bool decide_ellipses = cover && options.size.anisotropy == Anisotropy::kAuto;
  bool ellipses = cover && options.size.anisotropy == Anisotropy::kOn;
  if (decide_ellipses) {
    const std::optional<std::string> known =
        blocks.checkpoints ? blocks.checkpoints->finished(kEllipses) : std::nullopt;
    ellipses = known ? *known == "worth it" : guess_ellipses(pass, whole);
  }
  stage.end("probes");
  for (;;) {
    pass.set_ellipses(ellipses);
    const BlockTotals totals = make_surfels(pass, whole, blocks.checkpoints, sink, stage);
    const bool worth = worth_ellipses(totals.elongated, facts.index.finite());
    if (!decide_ellipses || worth == ellipses) {
      totals.fill(whole, r);
      break;
    }
    ellipses = worth;
    if (blocks.checkpoints) {
      blocks.checkpoints->finish(kEllipses, {}, worth ? "worth it" : "not worth it");
    }
  }
  r.anisotropic = ellipses;
  if (report) *report = std::move(r);
}

}  // namespace surfel
