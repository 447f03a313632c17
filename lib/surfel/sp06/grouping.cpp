#include <utility>

#include <fmt/format.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/stage_timer.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/sp06/group_blocks.h>
#include <surfel/sp06/grouping.h>

namespace surfel {

std::vector<std::string> GroupingOptions::problems() const {
  std::vector<std::string> found = overlap.problems();
  if (groups < 0 || groups > static_cast<int>(kMaxGroups)) {
    found.push_back(
        fmt::format("`groups` is {}; it must be 0 (as few as it takes) to {}", groups, kMaxGroups));
  }
  return found;
}

namespace {

/// Gathers the groups of a cloud in memory.
class GroupSink final : public SurfelSink {
 public:
  explicit GroupSink(const SurfelCloud& cloud) : order_(morton_order(cloud.position)) {}
  void begin(const SurfelCloud& /*like*/, std::size_t count) override { group_.resize(count); }
  void put(SurfelCloud surfels, std::size_t at) override {
    for (std::size_t i = 0; i < surfels.size(); ++i) group_[order_[at + i]] = surfels.group[i];
  }
  Array<std::uint16_t> take() { return std::move(group_); }

 private:
  Array<std::uint32_t> order_;
  Array<std::uint16_t> group_;
};

Array<std::uint16_t> groups_by_blocks(const SurfelCloud& cloud, const GroupingOptions& options,
                                      GroupingReport& report, const std::string& name) {
  GroupSink sink(cloud);
  group_by_blocks(OrderedCloud(cloud), options, sink, &report, name);
  return sink.take();
}

}  // namespace

Array<std::uint16_t> make_groups(const SurfelCloud& cloud, const GroupingOptions& options,
                                 GroupingReport* report, const std::string& name) {
  require_usable(options);
  GroupingReport own;
  GroupingReport& r = report ? *report : own;
  r = {};
  if (options.groups == 0 && cloud.size() > kMostGroupedAtOnce) {
    return groups_by_blocks(cloud, options, r, name);
  }
  const OverlapGraph graph = make_overlap_graph(cloud, options.overlap, &r.times, name);
  StageTimer stages(r.times);
  const Array<std::uint32_t> order = coloring_order(graph, options.order);
  const Coloring coloring =
      options.groups == 0
          ? greedy_coloring(graph, order, kMaxGroups, name)
          : least_overlap_groups(cloud, graph, options.overlap.cutoff, order,
                                 static_cast<std::uint32_t>(options.groups), &r.overlap.emplace());
  stages.end("color");

  r.splats = cloud.size();
  r.unusable = graph.unusable;
  r.groups = coloring.colors;
  r.max_degree = graph.max_degree();
  r.mean_degree = graph.mean_degree();
  r.edges = graph.edges();
  r.graph_bytes = graph.memory_bytes();
  r.sizes.assign(coloring.colors, 0);
  Array<std::uint16_t> group;
  group.assign(cloud.size(), 0);
  for (std::size_t v = 0; v < graph.size(); ++v) {
    group[graph.splat[v]] = coloring.color[v];
    ++r.sizes[coloring.color[v]];
  }
  return group;
}

void group_splats(SurfelCloud& cloud, const GroupingOptions& options, GroupingReport* report,
                  const std::string& name) {
  cloud.group = make_groups(cloud, options, report, name);
  cloud.group_radius.clear();
}

}  // namespace surfel
