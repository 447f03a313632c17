// Zhang, Pajarola 2006, "Single-Pass Point Rendering and Transparent Shading", section 4.1.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include <fmt/format.h>
#include <surfel/base/box_tree.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/radix_sort.h>
#include <surfel/base/stage_timer.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/sp06/overlap_graph.h>

namespace surfel {
namespace {

constexpr std::size_t kLanes = 8;         ///< Splats in a block.
constexpr std::size_t kBlockGrain = 256;  ///< Blocks.
constexpr std::size_t kSplatGrain = 1 << 14;
constexpr double kOctavesPerClass = 2;  ///< Radii of one class differ by less than 4 : 1.
/// Unless told otherwise pairs may take so much for each splat, which is 256 neighbours in the
/// mean: four times as many as discs have that overlap fourfold on two sheets ...
constexpr std::uint64_t kBytesPerSplat = 4096;
constexpr std::uint64_t kBytesOfFewSplats = 96 << 20;  ///< ... or this, whatever is more.
/// Single precision decides with this margin which pairs are worth a look in double. Its own error
/// is below 10 roundings of 6e-8.
constexpr float kMargin = 1 + 2e-6F;
constexpr float kTiny = std::numeric_limits<float>::min();  ///< Where squares underflow.

/// kLanes splats that follow each other. Lanes without a splat are NaN: no comparison holds.
struct Block {
  float x[kLanes], y[kLanes], z[kLanes];
  float reach[kLanes];  ///< overlap r
};

/// Box around splats' centres.
struct Box {
  Eigen::Array3f min = Eigen::Array3f::Constant(std::numeric_limits<float>::infinity());
  Eigen::Array3f max = Eigen::Array3f::Constant(-std::numeric_limits<float>::infinity());
  float reach = 0;  ///< Largest.

  void add(const Box& other) {
    min = min.min(other.min);
    max = max.max(other.max);
    reach = std::max(reach, other.reach);
  }
  /// False only if no splat of this box overlaps a splat of the other box.
  bool may_overlap(const Box& other) const {
    const float distance2 = (min - other.max).max(other.min - max).max(0.0F).matrix().squaredNorm();
    const float sum = reach + other.reach;
    return distance2 <= sum * sum * kMargin + kTiny;
  }
};

/// The attributes that the relaxations compare.
struct Look {
  Vec3d normal;           ///< Unit, or zero.
  Eigen::Vector4f color;  ///< Linear, alpha last.
  std::uint16_t material;
};

Vec3d unit_or_zero(const Vec3f& normal) {
  const Vec3d n = normal.cast<double>();
  const double length = n.norm();
  return std::isfinite(length) && length > 0 ? Vec3d(n / length) : Vec3d(0, 0, 0);
}

class OverlapSearch {
 public:
  OverlapSearch(const SurfelCloud& cloud, const Array<std::uint32_t>& splat,
                const OverlapOptions& options)
      : options_(options),
        count_(splat.size()),
        min_cosine_(portable::cos(options.coplanar_angle * std::numbers::pi / 180)),
        max_sine_(portable::sin(options.coplanar_angle * std::numbers::pi / 180)),
        position_(count_),
        radius_(count_),
        blocks_((count_ + kLanes - 1) / kLanes) {
    gather(cloud, splat);
    parallel_for(blocks_.size(), kBlockGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t b = begin; b < end; ++b) fill_block(b);
    });
    tree_ = {count_, [&](std::size_t v) { return box_of(v / kLanes, v % kLanes); }};
  }

  std::size_t blocks() const { return blocks_.size(); }
  std::size_t lanes(std::size_t block) const { return tree_.leaf_size(block); }

  /// Blocks that may hold neighbours of block b's splats, ascending.
  void collect(std::size_t b, std::vector<std::uint32_t>& blocks) const {
    blocks.clear();
    tree_.for_each_leaf(
        [&](const Box& box) { return tree_.leaf(b).may_overlap(box); },
        [&](std::size_t leaf) { blocks.push_back(static_cast<std::uint32_t>(leaf)); });
  }

  /// Appends the neighbours of splat `lane` of block b, ascending. Returns how many pairs it looked
  /// at closely, those included that a relaxation took out.
  std::size_t append_neighbors(std::size_t b, std::size_t lane,
                               const std::vector<std::uint32_t>& near,
                               std::vector<std::uint32_t>& out) const {
    const std::size_t v = b * kLanes + lane;
    const Box row = box_of(b, lane);
    std::size_t looked_at = 0;
    for (const std::uint32_t other : near) {
      if (!row.may_overlap(tree_.leaf(other))) continue;
      std::uint32_t candidates[kLanes];
      const std::size_t found = find_candidates(row, other, candidates);
      looked_at += found;
      for (std::size_t i = 0; i < found; ++i) {
        if (candidates[i] != v && overlap(v, candidates[i])) out.push_back(candidates[i]);
      }
    }
    return looked_at - 1;  // Without the splat itself.
  }

 private:
  void gather(const SurfelCloud& cloud, const Array<std::uint32_t>& splat) {
    const bool relaxed = options_.relax_coplanar || options_.relax_opposite;
    if (relaxed) look_.resize(count_);
    const Array<Vec3f>* color = cloud.render_color();
    parallel_for(count_, kSplatGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t v = begin; v < end; ++v) {
        const std::uint32_t k = splat[v];
        position_[v] = cloud.position[k];
        radius_[v] = splat_radius(cloud, k, options_.cutoff);
        if (!relaxed) continue;
        Look& look = look_[v];
        look.normal = cloud.normal.empty() ? Vec3d(0, 0, 0) : unit_or_zero(cloud.normal[k]);
        const Vec3f c = color ? (*color)[k] : Vec3f(0, 0, 0);
        look.color = {c.x(), c.y(), c.z(), cloud.alpha.empty() ? 1.0F : cloud.alpha[k]};
        look.material = cloud.material.empty() ? std::uint16_t{0} : cloud.material[k];
      }
    });
  }

  void fill_block(std::size_t b) {
    constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();
    Block& block = blocks_[b];
    for (float* column : {block.x, block.y, block.z, block.reach}) {
      std::fill_n(column, kLanes, kNowhere);
    }
    const std::size_t lanes = std::min(kLanes, count_ - b * kLanes);
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      const Vec3f& p = position_[b * kLanes + lane];
      block.x[lane] = p.x();
      block.y[lane] = p.y();
      block.z[lane] = p.z();
      block.reach[lane] = static_cast<float>(options_.overlap * radius_[b * kLanes + lane]);
    }
  }

  /// A splat as a box.
  Box box_of(std::size_t b, std::size_t lane) const {
    const Block& block = blocks_[b];
    Box box;
    box.min = box.max = {block.x[lane], block.y[lane], block.z[lane]};
    box.reach = block.reach[lane];
    return box;
  }

  /// Splats of block b that overlap the splat of `row` to single precision, and a few more.
  std::size_t find_candidates(const Box& row, std::size_t b, std::uint32_t* candidates) const {
    const Block& q = blocks_[b];
    std::uint32_t hit[kLanes];
    for (std::size_t i = 0; i < kLanes; ++i) {
      const float dx = q.x[i] - row.min.x();
      const float dy = q.y[i] - row.min.y();
      const float dz = q.z[i] - row.min.z();
      const float reach = q.reach[i] + row.reach;
      hit[i] = dx * dx + dy * dy + dz * dz <= reach * reach * kMargin + kTiny ? 1 : 0;
    }
    std::size_t n = 0;
    for (std::size_t i = 0; i < kLanes; ++i) {
      candidates[n] = static_cast<std::uint32_t>(b * kLanes + i);
      n += hit[i];
    }
    return n;
  }

  /// SP06 (5) and its relaxations. All results have the same bits when the two splats are
  /// exchanged.
  bool overlap(std::size_t v, std::size_t w) const {
    const Vec3d d = position_[w].cast<double>() - position_[v].cast<double>();
    const double reach =
        options_.overlap * (static_cast<double>(radius_[v]) + static_cast<double>(radius_[w]));
    const double distance2 = d.squaredNorm();
    if (!(distance2 < reach * reach)) return false;
    if (look_.empty()) return true;
    const Look& a = look_[v];
    const Look& b = look_[w];
    const double cosine = a.normal.dot(b.normal);
    if (options_.relax_opposite && cosine < 0) return false;
    if (!options_.relax_coplanar || !(cosine >= min_cosine_)) return true;
    const double rise = max_sine_ * std::sqrt(distance2);
    const bool coplanar = std::abs(a.normal.dot(d)) <= rise && std::abs(b.normal.dot(d)) <= rise;
    return !(coplanar && a.material == b.material &&
             (a.color - b.color).cwiseAbs().maxCoeff() <= options_.coplanar_color);
  }

  const OverlapOptions& options_;
  std::size_t count_;
  double min_cosine_;
  double max_sine_;
  Array<Vec3f> position_;
  Array<float> radius_;
  Array<Look> look_;  ///< Empty if no relaxation needs it.
  Array<Block> blocks_;
  BoxTree<Box, kLanes, 4> tree_;  ///< Its leaves are the blocks.
};

/// The usable splats, by class of radius, then along a Morton curve. Splats of very different
/// radius do not share a block, whose box would be as wide as the largest.
Array<std::uint32_t> ordered_splats(const SurfelCloud& cloud, double cutoff) {
  const Array<std::uint32_t> along_curve = morton_order(cloud.position);
  const std::size_t n = cloud.size();
  Array<float> radius(n);
  std::vector<float> largest((n + kSplatGrain - 1) / kSplatGrain, 0.0F);
  parallel_for(n, kSplatGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      radius[i] = splat_radius(cloud, along_curve[i], cutoff);
      largest[begin / kSplatGrain] = std::max(largest[begin / kSplatGrain], radius[i]);
    }
  });
  const double max_radius = n == 0 ? 0 : *std::max_element(largest.begin(), largest.end());

  constexpr auto kUnusable = std::numeric_limits<std::uint64_t>::max();
  Array<std::uint64_t> keys(n);
  parallel_for(n, kSplatGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      keys[i] = radius[i] > 0 ? static_cast<std::uint64_t>(portable::log2(max_radius / radius[i]) /
                                                           kOctavesPerClass)
                              : kUnusable;
    }
  });
  Array<std::uint32_t> order = sort_keys(keys);
  while (!order.empty() && keys[order.size() - 1] == kUnusable) order.pop_back();
  for (std::uint32_t& i : order) i = along_curve[i];
  return order;
}

[[noreturn]] void throw_too_many(const OverlapGraph& graph, std::uint64_t most,
                                 const std::string& name) {
  throw_input(
      name,
      fmt::format(
          "more than {} pairs of the {} splats overlap, the most that memory and "
          "time are set aside for; lower `overlap` or `cutoff`, remove splats that lie in one "
          "place, or raise `max_memory`",
          most / 2, graph.size()));
}

/// Pairs that all rows look at together, estimated low from a sample of them: the longest rows of
/// the sample (a few splats may overlap all others) are left out, so that the estimate exceeds the
/// number only by chance.
std::uint64_t least_entries(const OverlapSearch& search, std::size_t splats) {
  constexpr std::size_t kSample = 256;  // Rows, spread evenly.
  constexpr std::size_t kLeftOut = 16;  // The longest.
  if (splats < 4 * kSample) return 0;
  std::vector<std::size_t> length(kSample);
  parallel_for(kSample, 4, [&](std::size_t begin, std::size_t end, int) {
    std::vector<std::uint32_t> near;
    std::vector<std::uint32_t> neighbors;
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t v = i * splats / kSample;
      neighbors.clear();
      search.collect(v / kLanes, near);
      length[i] = search.append_neighbors(v / kLanes, v % kLanes, near, neighbors);
    }
  });
  std::sort(length.begin(), length.end());
  return std::accumulate(length.begin(), length.end() - kLeftOut, std::uint64_t{0}) * splats /
         kSample;
}

/// Fills in the rows.
void find_edges(const OverlapSearch& search, std::uint64_t max_memory, const std::string& name,
                OverlapGraph& graph) {
  if (max_memory == 0) {
    max_memory = std::min(available_memory_bytes() / 2,
                          std::max(kBytesOfFewSplats, kBytesPerSplat * graph.size()));
  }
  // Once in the ranges' buffers, once in the graph. Pairs that a relaxation takes out count as
  // well: they take no memory, but as much time.
  const std::uint64_t most = max_memory / (2 * sizeof(std::uint32_t));
  if (least_entries(search, graph.size()) > most) throw_too_many(graph, most, name);
  std::atomic<std::uint64_t> total{0};
  std::vector<Array<std::uint32_t>> found((search.blocks() + kBlockGrain - 1) / kBlockGrain);
  graph.row_begin.resize(graph.size() + 1);
  graph.row_begin[0] = 0;
  ProgressStage stage("finding overlaps", search.blocks(), "blocks of surfels");
  parallel_for(search.blocks(), kBlockGrain, [&](std::size_t begin, std::size_t end, int) {
    stage.add(end - begin);
    std::vector<std::uint32_t> near;
    std::vector<std::uint32_t> neighbors;
    for (std::size_t b = begin; b < end; ++b) {
      std::uint64_t more = 0;
      search.collect(b, near);
      for (std::size_t lane = 0; lane < search.lanes(b); ++lane) {
        const std::size_t before = neighbors.size();
        more += search.append_neighbors(b, lane, near, neighbors);
        graph.row_begin[b * kLanes + lane + 1] = neighbors.size() - before;
      }
      if (total.fetch_add(more, std::memory_order_relaxed) + more > most) {
        throw_too_many(graph, most, name);
      }
    }
    found[begin / kBlockGrain].assign(neighbors.begin(), neighbors.end());
  });

  for (std::size_t v = 0; v < graph.size(); ++v) graph.row_begin[v + 1] += graph.row_begin[v];
  graph.neighbor.resize(graph.row_begin.back());
  parallel_for(found.size(), 1, [&](std::size_t begin, std::size_t, int) {
    const std::uint64_t row = graph.row_begin[begin * kBlockGrain * kLanes];
    std::copy(found[begin].begin(), found[begin].end(), graph.neighbor.data() + row);
    found[begin] = {};
  });
}

}  // namespace

std::vector<std::string> OverlapOptions::problems() const {
  std::vector<std::string> found;
  const auto check = [&](const char* option, double value, double min, double max) {
    if (value >= min && value <= max) return;
    found.push_back(fmt::format("`{}` is {}; it must be {} to {}", option, value, min, max));
  };
  check("cutoff", cutoff, 0.01, 16);
  check("overlap", overlap, 0, 4);
  check("coplanar_angle", coplanar_angle, 0, 45);
  check("coplanar_color", coplanar_color, 0, 1e6);
  return found;
}

std::size_t OverlapGraph::max_degree() const {
  std::size_t most = 0;
  for (std::size_t v = 0; v < size(); ++v) most = std::max(most, degree(v));
  return most;
}

double OverlapGraph::mean_degree() const {
  return size() == 0 ? 0 : static_cast<double>(neighbor.size()) / static_cast<double>(size());
}

std::uint64_t OverlapGraph::memory_bytes() const {
  return splat.size() * sizeof(splat[0]) + row_begin.size() * sizeof(row_begin[0]) +
         neighbor.size() * sizeof(neighbor[0]);
}

float splat_radius(const SurfelCloud& cloud, std::size_t i, double cutoff) {
  if (!cloud.position[i].allFinite()) return 0;
  const Array<float>& u = cloud.anisotropic() ? cloud.variance_u : cloud.variance;
  const Array<float>& v = cloud.anisotropic() ? cloud.variance_v : cloud.variance;
  if (!usable_variance(u[i]) || !usable_variance(v[i])) return 0;
  const float variance = std::max(u[i], v[i]);
  return static_cast<float>(std::sqrt(2 * cutoff * static_cast<double>(variance)));
}

OverlapGraph make_overlap_graph(const SurfelCloud& cloud, const OverlapOptions& options,
                                StageTimes* times, const std::string& name) {
  require_usable(options);
  cloud.check_columns(name);
  if (!has_variance(cloud)) {
    throw_input(name,
                "the splats have no variance (nor radius); make it with surfel-from-mesh or "
                "surfel-estimate");
  }
  StageTimes own;
  StageTimer stages(times ? *times : own);
  OverlapGraph graph;
  graph.splat = ordered_splats(cloud, options.cutoff);
  graph.unusable = cloud.size() - graph.size();
  if (graph.size() == 0) {
    throw_input(name, fmt::format("none of {} splats has a finite position and a positive variance",
                                  cloud.size()));
  }
  stages.end("sort");
  const OverlapSearch search(cloud, graph.splat, options);
  stages.end("hierarchy");
  find_edges(search, options.max_memory, name, graph);
  stages.end("search");
  return graph;
}

}  // namespace surfel
