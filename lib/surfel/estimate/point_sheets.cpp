#include <algorithm>
#include <bit>
#include <cstddef>
#include <span>
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
/// Points of a block whose small sheets are joined by one thread.
constexpr std::size_t kSheetBlock = 32768;
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
    to_.resize(count_);
    join_small_within_blocks();
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

  bool small(std::size_t i) const { return edges_.known(i) && size_[part_[i]] < least_; }

  /// Finds the best edge of a point to another sheet, and appends a key that sorts by its weight,
  /// then by the point, to `keys`.
  void add_best_edge(std::size_t i, std::vector<std::uint64_t>& keys) {
    const auto [w, to] = best_edge_out(i);
    if (w == SurfaceEdges::kNoEdge) return;
    to_[i] = to;
    keys.push_back(std::uint64_t{std::bit_cast<std::uint32_t>(w)} << 32 | i);
  }

  /// Joins sheets along the edges of keys, in their order, as long as the sheet of the edge's first
  /// point is small. Returns whether any were joined. Looks at the roots of part_ and what they are
  /// joined to alone.
  bool join_along(std::span<const std::uint64_t> keys) {
    const auto find = [&](std::uint32_t i) {
      const SignedSets::Root root = sets_.find(part_[i]);
      return SignedSets::Root{root.index, root.opposed != (opposed_[i] != 0)};
    };
    bool any = false;
    for (const std::uint64_t key : keys) {
      const auto from = static_cast<std::uint32_t>(key);
      const SignedSets::Root a = find(from);
      if (size_[a.index] >= least_) continue;
      const SignedSets::Root b = find(to_[from]);
      if (a.index == b.index) continue;
      const std::uint32_t points = size_[a.index] + size_[b.index];
      size_[sets_.join(a, b, edges_.opposed(from, to_[from]))] = points;
      any = true;
    }
    return any;
  }

  /// Joins small sheets to others by the best edge of each of their points, the best first, as far
  /// as both sheets' roots are in one block of successive points: in parallel, and within caches.
  /// Noise leaves as many sheets as points, of which this leaves few.
  void join_small_within_blocks() {
    parallel_for(count_, kSheetBlock, [&](std::size_t begin, std::size_t end, int) {
      const auto inside = [&](std::size_t i) { return part_[i] >= begin && part_[i] < end; };
      std::vector<std::uint64_t> keys;
      for (std::size_t i = begin; i < end; ++i) {
        // Sizes of sheets whose roots lie in other blocks change meanwhile.
        if (!inside(i) || !small(i)) continue;
        add_best_edge(i, keys);
        if (!keys.empty() && static_cast<std::uint32_t>(keys.back()) == i && !inside(to_[i])) {
          keys.pop_back();
        }
      }
      std::sort(keys.begin(), keys.end());
      join_along(keys);
    });
  }

  /// Joins small sheets to others by the best edge of each of their points, the best first, as
  /// long as they are small. Returns whether any were joined.
  bool join_small() {
    std::vector<std::vector<std::uint64_t>> found((count_ + kSheetGrain - 1) / kSheetGrain);
    parallel_for(count_, kSheetGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        if (small(i)) add_best_edge(i, found[begin / kSheetGrain]);
      }
    });
    Array<std::uint64_t> keys;
    for (const std::vector<std::uint64_t>& some : found) {
      keys.insert(keys.end(), some.begin(), some.end());
    }
    sort_keys(keys);
    return join_along(keys);
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
  Array<std::uint32_t> to_;      ///< Where the best edges of points in small sheets lead.
};

}  // namespace

PointSheets cut_sheets(const Array<Vec3f>& position, const NeighborSearch& search,
                       std::size_t least, Array<Vec3f>& normal) {
  return SheetCutter(position, search, least, normal).run();
}

}  // namespace surfel
