#include <algorithm>
#include <bit>
#include <cstddef>
#include <utility>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/point_sheets.h>
#include <surfel/estimate/spanning_forest.h>
#include <surfel/estimate/surface_edges.h>

namespace surfel {
namespace {

constexpr std::size_t kSheetGrain = 1024;
/// Edges within a sheet are below this weight: 8 degrees between the normals, or 6 to a plane.
constexpr float kSheetWeight = 0.01F;
/// Rounds in which small sheets are joined: each at least halves how many there are.
constexpr int kSheetRounds = 8;

class SheetCutter {
 public:
  SheetCutter(const Array<Vec3f>& position, const NeighborSearch& search, std::size_t least,
              Array<Vec3f>& normal)
      : count_(position.size()),
        least_(least),
        normal_(normal),
        edges_(position, normal),
        graph_{search.rows(kOrientationNeighbors + 1), {}},
        sets_(count_),
        part_(count_),
        opposed_(count_) {}

  PointSheets run() {
    join_flat_edges();
    look_up();
    for (int round = 0; round < kSheetRounds && join_small(); ++round) look_up();
    parallel_each(count_, kSheetGrain, [&](std::size_t i) {
      if (opposed_[i] != 0) normal_[i] = -normal_[i];
    });
    return numbered();
  }

 private:
  float weight(std::size_t i, std::size_t j) const {
    return j != i && edges_.known(i) && edges_.known(j) ? edges_.weight(i, j)
                                                        : SurfaceEdges::kNoEdge;
  }

  void join_flat_edges() {
    graph_.length.resize(count_ * graph_.degree());
    parallel_for(count_, kSheetGrain, [&](std::size_t begin, std::size_t end, int) {
      std::uint16_t* length = graph_.length.data() + begin * graph_.degree();
      for (std::size_t i = begin; i < end; ++i) {
        for (const std::uint32_t j : graph_.rows.of(i)) {
          const float w = weight(i, j);
          *length++ = w < kSheetWeight ? static_cast<std::uint16_t>(w / kSheetWeight * 65534)
                                       : NeighborGraph::kNoEdge;
        }
      }
    });
    unite_spanning_forest(
        graph_, false, [&](std::uint32_t i, std::uint32_t j) { return edges_.opposed(i, j); },
        sets_);
    graph_.length = {};
  }

  /// Finds the sheet of every point, and how many points with normals it has.
  void look_up() {
    parallel_each(count_, kSheetGrain, [&](std::size_t i) {
      const SignedSets::Root root = sets_.root(static_cast<std::uint32_t>(i));
      part_[i] = root.index;
      opposed_[i] = root.opposed ? 1 : 0;
    });
    size_.assign(count_, 0);
    for (std::size_t i = 0; i < count_; ++i) size_[part_[i]] += edges_.known(i) ? 1 : 0;
  }

  /// Joins small sheets to others by the best edge of each of their points, the best first, as
  /// long as they are small. Returns whether any were joined.
  bool join_small() {
    // Keys sort by the weight, then by the point.
    std::vector<std::vector<std::uint64_t>> found((count_ + kSheetGrain - 1) / kSheetGrain);
    parallel_for(count_, kSheetGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        if (!edges_.known(i) || size_[part_[i]] >= least_) continue;
        const auto [w, to] = best_edge_out(i);
        if (w == SurfaceEdges::kNoEdge) continue;
        found[begin / kSheetGrain].push_back(std::uint64_t{std::bit_cast<std::uint32_t>(w)} << 32 |
                                             i);
      }
    });
    Array<std::uint64_t> keys;
    for (const std::vector<std::uint64_t>& some : found) {
      keys.insert(keys.end(), some.begin(), some.end());
    }
    sort_keys(keys);
    bool any = false;
    for (const std::uint64_t key : keys) {
      const auto from = static_cast<std::uint32_t>(key);
      const SignedSets::Root a = sets_.find(from);
      if (size_[a.index] >= least_) continue;
      const std::uint32_t to = best_edge_out(from).second;
      const SignedSets::Root b = sets_.find(to);
      if (a.index == b.index) continue;
      const std::uint32_t points = size_[a.index] + size_[b.index];
      size_[sets_.join(a, b, edges_.opposed(from, to))] = points;
      any = true;
    }
    return any;
  }

  /// The edge of least weight from a point to another sheet, and where it leads.
  std::pair<float, std::uint32_t> best_edge_out(std::size_t i) const {
    std::pair<float, std::uint32_t> best{SurfaceEdges::kNoEdge, 0};
    for (const std::uint32_t j : graph_.rows.of(i)) {
      if (part_[j] == part_[i]) continue;
      const float w = weight(i, j);
      if (w < best.first) best = {w, j};
    }
    return best;
  }

  PointSheets numbered() const {
    PointSheets out;
    out.of.assign(count_, PointSheets::kNone);
    Array<std::uint32_t> number;
    number.assign(count_, PointSheets::kNone);
    for (std::size_t i = 0; i < count_; ++i) {
      if (!edges_.known(i)) continue;
      std::uint32_t& sheet = number[part_[i]];
      if (sheet == PointSheets::kNone) sheet = out.count++;
      out.of[i] = sheet;
    }
    return out;
  }

  std::size_t count_;
  std::size_t least_;
  Array<Vec3f>& normal_;
  SurfaceEdges edges_;
  NeighborGraph graph_;
  SignedSets sets_;
  Array<std::uint32_t> part_;    ///< One point that stands for the sheet.
  Array<std::uint8_t> opposed_;  ///< 1: the normal is on the other side than the one of part_.
  Array<std::uint32_t> size_;    ///< By that point.
};

}  // namespace

PointSheets cut_sheets(const Array<Vec3f>& position, const NeighborSearch& search,
                       std::size_t least, Array<Vec3f>& normal) {
  return SheetCutter(position, search, least, normal).run();
}

}  // namespace surfel
