// The k = 16 nearest neighbours of all points, and normals of them, beside FLANN, nanoflann and
// PCL's NormalEstimationOMP on the same points and threads: index and queries together, best of
// --repeats, run in turns, each with the ratio to ours. Peers get their queries in the order of the
// points, as their users would ask, in parallel, and keep indices and distances in one array. Both
// wall-clock time and the time of all cores are printed: where a machine is shared, the ratio of
// the latter (work) is the steadier one.
//
// Usage: neighbors_bench [--count N]... [--order random|morton] [--threads N] [--repeats N]
//                        [--work NAME] [--write FILE]

#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>
#include <limits>

#include <fmt/format.h>
#include <surfel/base/timing.h>
#include <surfel/estimate/normals.h>
#include <surfel/io/cloud_io.h>
#include <surfel/surface/neighbor_search.h>

#include "bench/bench_points.h"
#include "bench/peer_searches.h"
#include "tools/support/options.h"
#include "tools/support/tool.h"

#ifdef SURFEL_HAVE_PCL
#include <pcl/features/normal_3d_omp.h>
#endif

namespace {

using namespace surfel;

constexpr int kNearest = 16;

enum class Work { kAll, kNeighbors, kOurNeighbors, kNormals, kPclNormals };

struct Settings {
  std::size_t count = 1000000;
  bool random_order = true;
  int threads = 0;
  int repeats = 3;
  std::string write;
  Work work = Work::kAll;
};

/// What a search leaves behind, k of every point.
struct Found {
  explicit Found(std::size_t points) : index(points * kNearest), distance2(points * kNearest) {}
  Array<std::uint32_t> index;
  Array<float> distance2;

  /// Of the squared distances, to tell that all found the same.
  double sum() const {
    double s = 0;
    for (const float d : distance2) s += static_cast<double>(d);
    return s;
  }
};

void ours(const Array<Vec3f>& points, Found& found) {
  make_neighbor_search(points)->for_each_nearest(
      kNearest, [&](std::size_t i, std::span<const Neighbor> near, int) {
        for (std::size_t n = 0; n < near.size(); ++n) {
          found.index[i * kNearest + n] = near[n].index;
          found.distance2[i * kNearest + n] = near[n].distance2;
        }
      });
}

/// Of all threads of this process.
double cpu_milliseconds() { return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// Contenders in turns; the first one is ours.
class Contest {
 public:
  void add(std::string name, std::function<void()> work) {
    entries_.push_back({std::move(name), std::move(work)});
  }

  void run(int repeats, const std::string& title) {
    for (int i = 0; i < repeats; ++i) {
      for (Entry& e : entries_) {
        const Timer timer;
        const double cpu = cpu_milliseconds();
        e.work();
        e.best_ms = std::min(e.best_ms, timer.milliseconds());
        e.best_cpu_ms = std::min(e.best_cpu_ms, cpu_milliseconds() - cpu);
      }
    }
    for (const Entry& e : entries_) {
      fmt::print("{} {} ms {:.1f} ratio {:.2f} cpu_ms {:.1f} cpu_ratio {:.2f}\n", title, e.name,
                 e.best_ms, e.best_ms / entries_.front().best_ms, e.best_cpu_ms,
                 e.best_cpu_ms / entries_.front().best_cpu_ms);
    }
    std::fflush(stdout);
  }

 private:
  struct Entry {
    std::string name;
    std::function<void()> work;
    double best_ms = std::numeric_limits<double>::infinity();
    double best_cpu_ms = std::numeric_limits<double>::infinity();
  };
  std::vector<Entry> entries_;
};

void neighbors(const Settings& s, const Array<Vec3f>& points) {
  Found mine(points.size());
  Found theirs(points.size());
  Contest contest;
  contest.add("surfelkit", [&] { ours(points, mine); });
  const bool alone = s.work == Work::kOurNeighbors;
  for (const bench::PeerSearch& peer :
       alone ? std::vector<bench::PeerSearch>() : bench::peer_searches()) {
    contest.add(peer.name, [&, search = peer.search] {
      search(points.front().data(), points.size(), kNearest, s.threads, theirs.index.data(),
             theirs.distance2.data());
    });
  }
  contest.run(s.repeats, fmt::format("neighbors {} threads {}", points.size(), s.threads));
  // Peers compiled with fused multiply-add round differently.
  if (!alone && std::abs(mine.sum() / theirs.sum() - 1) > 1e-6) {
    fmt::print("the searches found different distances: sums {} and {}\n", mine.sum(),
               theirs.sum());
  }
}

#ifdef SURFEL_HAVE_PCL

/// In the order of the search, as estimate_surfels() does.
void our_normals(const Array<Vec3f>& points) {
  SurfelCloud sorted;
  const Array<std::uint32_t> order = morton_order(points);
  sorted.position.resize(points.size());
  parallel_for(points.size(), 1 << 14, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) sorted.position[i] = points[order[i]];
  });
  NormalOptions options;
  options.k = kNearest;
  estimate_normals(sorted.position, *make_neighbor_search(sorted.position), options);
}

void normals(const Settings& s, const Array<Vec3f>& points) {
  const pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  for (const Vec3f& p : points) cloud->emplace_back(p.x(), p.y(), p.z());
  Contest contest;
  if (s.work != Work::kPclNormals) contest.add("surfelkit", [&] { our_normals(points); });
  contest.add("pcl", [&] {
    pcl::NormalEstimationOMP<pcl::PointXYZ, pcl::Normal> estimation(
        static_cast<unsigned>(s.threads));
    estimation.setInputCloud(cloud);
    estimation.setKSearch(kNearest);
    pcl::PointCloud<pcl::Normal> out;
    estimation.compute(out);
  });
  contest.run(s.repeats, fmt::format("normals {} threads {}", points.size(), s.threads));
}

#endif

}  // namespace

int main(int argc, char** argv) {
  Settings s;
  tool::Tool bench("neighbors_bench",
                   "Neighbours and normals of all points, beside FLANN, nanoflann and PCL");
  tool::CommandLine& app = bench.app();
  app.add_option("--count", s.count, "Points")->range(1000, 100000000);
  tool::add_choice(app, "--order", s.random_order, {{"random", true}, {"morton", false}},
                   "Of the points");
  app.add_option("--repeats", s.repeats, "Of which the best counts")->range(1, 1000);
  tool::add_choice(app, "--work", s.work,
                   {{"all", Work::kAll},
                    {"neighbors", Work::kNeighbors},
                    {"our-neighbors", Work::kOurNeighbors},
                    {"normals", Work::kNormals},
                    {"pcl-normals", Work::kPclNormals}},
                   "What to run; our-neighbors and pcl-normals without anything beside them");
  app.add_option("--write", s.write, "Write the (last) points to this PLY file and stop");
  return bench.run(argc, argv, [&] {
    s.threads = thread_count();
    const Array<Vec3f> points = bench::bumpy_sphere(s.count, s.random_order);
    if (!s.write.empty()) {
      SurfelCloud cloud;
      cloud.position = points;
      write_cloud(cloud, s.write);
      return;
    }
    if (s.work <= Work::kOurNeighbors) neighbors(s, points);
#ifdef SURFEL_HAVE_PCL
    if (s.work == Work::kAll || s.work >= Work::kNormals) normals(s, points);
#endif
  });
}
