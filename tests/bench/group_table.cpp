// Prints rows of docs/groups.md. See tests/groups.sh, which calls it.

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include <boost/graph/compressed_sparse_row_graph.hpp>
#include <boost/graph/sequential_vertex_coloring.hpp>
#include <fmt/format.h>
#include <surfel/base/parallel.h>
#include <surfel/base/timing.h>
#include <surfel/io/cloud_io.h>
#include <surfel/sp06/coloring.h>
#include <surfel/sp06/disc_tree.h>
#include <surfel/sp06/missed_samples.h>
#include <surfel/sp06/overlap_graph.h>

namespace {

using namespace surfel;

/// Share of the samples of a surface that no disc of a group covers, mean of the groups. The discs
/// have the radius `group_radius` where there is one, else that of beta < 1.
double uncovered(const SurfelCloud& samples, const SurfelCloud& groups) {
  const Discs all = make_discs(groups, 1);
  std::vector<std::vector<std::uint32_t>> members;
  for (std::uint32_t i = 0; i < all.size(); ++i) {
    const std::size_t group = groups.group[all.surfel[i]];
    if (members.size() <= group) members.resize(group + 1);
    members[group].push_back(i);
  }
  std::vector<Vec3f> places;
  for (const Vec3f& p : samples.position) {
    places.emplace_back(p + (samples.origin - groups.origin).cast<float>());
  }
  double missed = 0;
  for (const std::vector<std::uint32_t>& group : members) {
    Discs discs = all.gathered(group);
    if (!groups.group_radius.empty()) {
      for (std::size_t i = 0; i < discs.size(); ++i) {
        discs.radius[i] = groups.group_radius[discs.surfel[i]];
      }
    }
    missed += missed_share(discs, places, samples.normal);
  }
  return missed / static_cast<double>(members.size());
}

/// The colouring beside Boost.Graph's in the same order; least times of `runs`.
void print_coloring(const SurfelCloud& cloud, double cutoff, int runs) {
  OverlapOptions options;
  options.cutoff = cutoff;
  using Graph =
      boost::compressed_sparse_row_graph<boost::directedS, boost::no_property, boost::no_property,
                                         boost::no_property, std::uint32_t, std::uint64_t>;
  double pairs = std::numeric_limits<double>::infinity();
  double ours = pairs;
  double peer = pairs;
  OverlapGraph graph;
  for (int run = 0; run < runs; ++run) {
    const Timer timer;
    graph = make_overlap_graph(cloud, options);
    pairs = std::min(pairs, timer.milliseconds());
  }
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
  edges.reserve(graph.neighbor.size());
  for (std::uint32_t v = 0; v < graph.size(); ++v) {
    for (const std::uint32_t w : graph.neighbors(v)) edges.emplace_back(v, w);
  }
  const Graph boost_graph(boost::edges_are_sorted, edges.begin(), edges.end(),
                          static_cast<std::uint32_t>(graph.size()));
  std::size_t colors = 0;
  std::uint32_t our_colors = 0;
  for (int run = 0; run < runs; ++run) {
    Timer timer;
    const Array<std::uint32_t> order = coloring_order(graph, ColoringOrder::kLargestFirst);
    our_colors = greedy_coloring(graph, order).colors;
    ours = std::min(ours, timer.milliseconds());
    // Boost.Graph's is given the order.
    timer.restart();
    std::vector<std::uint32_t> color(graph.size());
    colors = boost::sequential_vertex_coloring(
        boost_graph,
        boost::make_iterator_property_map(order.begin(), boost::identity_property_map()),
        boost::make_iterator_property_map(color.begin(), get(boost::vertex_index, boost_graph)));
    peer = std::min(peer, timer.milliseconds());
  }
  fmt::print("| {} | {:.1f} | {} | {} | {:.0f} ms | {:.0f} ms | {:.0f} ms | {:.2f} |\n",
             graph.size(), graph.mean_degree(), our_colors, colors, pairs, ours, peer, ours / peer);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  if (what == "coverage" && argc == 4) {
    const SurfelCloud samples = read_cloud(argv[2]);
    const SurfelCloud groups = read_cloud(argv[3]);
    fmt::print("{:.2f} %\n", 100 * uncovered(samples, groups));
    return 0;
  }
  if (what == "coloring" && argc == 5) {
    print_coloring(read_cloud(argv[2]), std::stod(argv[3]), std::stoi(argv[4]));
    return 0;
  }
  fmt::print(stderr,
             "group_table coverage SAMPLES GROUPS | group_table coloring SURFELS CUTOFF RUNS\n");
  return 2;
}
