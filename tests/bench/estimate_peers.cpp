// Prints how long plane fits and minimum spanning forests of neighbourhoods take beside Eigen's
// eigenvalue solvers and Boost.Graph, for the table of lib/README.md. Usage: estimate_peers
// [POINTS]

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <limits>

#include <boost/graph/compressed_sparse_row_graph.hpp>
#include <boost/graph/kruskal_min_spanning_tree.hpp>
#include <fmt/format.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/plane_fit.h>
#include <surfel/estimate/spanning_forest.h>
#include <surfel/sample/generate.h>

namespace {

using namespace surfel;
using Symmetric = Eigen::Matrix3d;

/// The least processor time of five runs, milliseconds.
double time_of(const std::function<void()>& work) {
  constexpr int kRuns = 5;
  double least = std::numeric_limits<double>::infinity();
  for (int run = 0; run < kRuns; ++run) {
    const std::clock_t begin = std::clock();
    work();
    least = std::min(least, 1000.0 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  return least;
}

void print(const char* name, double ms, double ours) {
  fmt::print("  {:32} {:8.1f} ms  {:.2f}\n", name, ms, ms / ours);
}

std::vector<Symmetric> covariances(const Array<Vec3f>& points, const NeighborRows& rows) {
  std::vector<Symmetric> all(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    Vec3d sum = Vec3d::Zero();
    Symmetric squares = Symmetric::Zero();
    for (const std::uint32_t j : rows.of(i)) {
      const Vec3d d = (points[j] - points[i]).cast<double>();
      sum += d;
      squares += d * d.transpose();
    }
    const auto n = static_cast<double>(rows.count);
    all[i] = (squares - sum * sum.transpose() / n) / n;
  }
  return all;
}

void fit_batches(const std::vector<Symmetric>& all, Array<Vec3d>& normal) {
  constexpr std::size_t kGrain = 64 * PlaneBatch::kSize;
  parallel_for(all.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    PlaneBatch batch;
    for (std::size_t i = begin; i < end; i += PlaneBatch::kSize) {
      const std::size_t count = std::min(PlaneBatch::kSize, end - i);
      for (std::size_t k = 0; k < count; ++k) {
        const Symmetric& c = all[i + k];
        batch.xx[k] = c(0, 0), batch.xy[k] = c(0, 1), batch.xz[k] = c(0, 2);
        batch.yy[k] = c(1, 1), batch.yz[k] = c(1, 2), batch.zz[k] = c(2, 2);
      }
      fit_planes(count, batch);
      for (std::size_t k = 0; k < count; ++k) {
        normal[i + k] = {batch.normal[0][k], batch.normal[1][k], batch.normal[2][k]};
      }
    }
  });
}

template <class Solve>
void fit_by_eigen(const std::vector<Symmetric>& all, Array<Vec3d>& normal, const Solve& solve) {
  parallel_for(all.size(), 1024, [&](std::size_t begin, std::size_t end, int) {
    Eigen::SelfAdjointEigenSolver<Symmetric> solver;
    for (std::size_t i = begin; i < end; ++i) {
      solve(solver, all[i]);
      normal[i] = solver.eigenvectors().col(0);
    }
  });
}

/// The largest angle between two sets of normals of any side, radians.
double largest_angle(const Array<Vec3d>& a, const Array<Vec3d>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, a[i].cross(b[i]).norm());
  return most;
}

void planes(const Array<Vec3f>& points, const NeighborSearch& search) {
  const std::vector<Symmetric> all = covariances(points, search.rows(16));
  Array<Vec3d> ours(all.size());
  Array<Vec3d> theirs(all.size());
  fmt::print("planes of {} neighbourhoods\n", all.size());
  const double own = time_of([&] { fit_batches(all, ours); });
  print("fit_planes", own, own);
  const double iterative = time_of([&] {
    fit_by_eigen(all, theirs, [](auto& solver, const Symmetric& c) { solver.compute(c); });
  });
  print("Eigen, compute()", iterative, own);
  fmt::print("  largest angle {:.1e}\n", largest_angle(ours, theirs));
  const double direct = time_of([&] {
    fit_by_eigen(all, theirs, [](auto& solver, const Symmetric& c) { solver.computeDirect(c); });
  });
  print("Eigen, computeDirect()", direct, own);
  fmt::print("  largest angle {:.1e}\n", largest_angle(ours, theirs));
}

struct EdgeLength {
  std::uint16_t length = 0;
};

void forests(const Array<Vec3f>& points, const NeighborSearch& search) {
  NeighborGraph graph{search.rows(9), {}};
  graph.length.resize(points.size() * graph.degree());
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
  std::vector<EdgeLength> lengths;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const auto row = graph.rows.of(i);
    for (std::size_t k = 0; k < row.size(); ++k) {
      std::uint16_t& length = graph.length[i * graph.degree() + k];
      // Any function of the two ends does; this one is as good as random.
      length = row[k] == i ? NeighborGraph::kNoEdge
                           : static_cast<std::uint16_t>((row[k] + i) * 2654435761U >> 17);
      if (row[k] == i) continue;
      edges.emplace_back(i, row[k]);
      lengths.push_back({length});
    }
  }
  fmt::print("spanning forests of {} points, {} edges\n", points.size(), edges.size());
  std::size_t joined = 0;
  const double own = time_of([&] {
    SignedSets sets(points.size());
    unite_spanning_forest(
        graph, false, [](std::uint32_t, std::uint32_t) { return false; }, sets);
    joined = 0;
    for (std::uint32_t i = 0; i < points.size(); ++i) joined += sets.root(i).index != i ? 1 : 0;
  });
  print("unite_spanning_forest", own, own);
  using Graph =
      boost::compressed_sparse_row_graph<boost::directedS, boost::no_property, EdgeLength>;
  const Graph peer(boost::edges_are_sorted, edges.begin(), edges.end(), lengths.begin(),
                   points.size());
  std::vector<boost::graph_traits<Graph>::edge_descriptor> forest;
  const double theirs = time_of([&] {
    forest.clear();
    boost::kruskal_minimum_spanning_tree(peer, std::back_inserter(forest),
                                         boost::weight_map(boost::get(&EdgeLength::length, peer)));
  });
  print("Boost.Graph, Kruskal", theirs, own);
  fmt::print("  edges of the forest: {} and {}\n", joined, forest.size());
}

}  // namespace

int main(int argc, char** argv) {
  set_thread_count(1);
  GenerateOptions options;
  options.count = argc > 1 ? static_cast<std::size_t>(std::atoll(argv[1])) : 1000000;
  const SurfelCloud cloud = generate_surfels(procedural_scene("head", 1), options);
  const SurfelCloud ordered = cloud.gathered(morton_order(cloud.position));
  const auto search = make_neighbor_search(ordered.position);
  planes(ordered.position, *search);
  forests(ordered.position, *search);
}
