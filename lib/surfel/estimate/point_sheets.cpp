#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

#include <surfel/base/group_by_key.h>
#include <surfel/base/parallel.h>
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

/// The weight of an edge, to 1 %: the higher half of its bits, which ascend with it.
constexpr std::uint16_t length_of(float weight) {
  return static_cast<std::uint16_t>(std::bit_cast<std::uint32_t>(weight) >> 16);
}
constexpr std::uint16_t kNoLength = length_of(SurfaceEdges::kNoEdge);

class SheetCutter {
 public:
  SheetCutter(const Array<Vec3f>& position, const NeighborSearch& search, std::size_t least,
              Array<Vec3f>& normal)
      : count_(position.size()),
        least_(least),
        normal_(normal),
        edges_(position, normal),
        graph_{search.rows(kOrientationNeighbors + 1), {}, length_of(kSheetWeight)},
        sets_(count_),
        part_(count_),
        opposed_(count_) {}

  PointSheets run() {
    join_flat_edges();
    look_up();
    to_.resize(count_);
    out_.resize(count_);
    join_small_within_blocks();
    look_up();
    for (int round = 0; round < kSheetRounds && join_small(); ++round) look_up();
    parallel_each(count_, kSheetGrain, [&](std::size_t i) {
      if (opposed_[i] != 0) normal_[i] = -normal_[i];
    });
    return numbered();
  }

 private:
  void join_flat_edges() {
    graph_.length.resize(count_ * graph_.degree());
    parallel_for(count_, kSheetGrain, [&](std::size_t begin, std::size_t end, int) {
      std::uint16_t* length = graph_.length.data() + begin * graph_.degree();
      for (std::size_t i = begin; i < end; ++i) {
        for (const std::uint32_t j : graph_.rows.of(i)) {
          *length++ = j != i && edges_.known(i) && edges_.known(j) ? length_of(edges_.weight(i, j))
                                                                   : kNoLength;
        }
      }
    });
    unite_spanning_forest(
        graph_, false, [&](std::uint32_t i, std::uint32_t j) { return edges_.opposed(i, j); },
        sets_);
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

  /// Finds the best edge of a point in a small sheet to another sheet.
  void find_edge_out(std::size_t i) {
    out_[i] = kNoLength;
    if (!small(i)) return;
    const std::uint16_t* length = graph_.length.data() + i * graph_.degree();
    for (const std::uint32_t j : graph_.rows.of(i)) {
      const std::uint16_t l = *length++;
      if (l >= out_[i] || part_[j] == part_[i]) continue;
      out_[i] = l;
      to_[i] = j;
    }
  }

  /// Joins the sheets of points, from `begin` to `end`, to others along their edges out, the best
  /// first, as long as the sheets are small. Returns whether any were joined. Looks at the roots of
  /// part_ and what they are joined to alone.
  bool join_along_edges_out(std::size_t begin, std::size_t end) {
    const Grouped<std::uint32_t> by_length =
        group_by_key<std::uint32_t>(kNoLength, [&](const auto& add) {
          for (std::size_t i = begin; i < end; ++i) {
            if (out_[i] != kNoLength) add(out_[i], static_cast<std::uint32_t>(i));
          }
        });
    const auto find = [&](std::uint32_t i) {
      const SignedSets::Root root = sets_.find(part_[i]);
      return SignedSets::Root{root.index, root.opposed != (opposed_[i] != 0)};
    };
    bool any = false;
    for (const std::uint32_t from : by_length.item) {
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
      for (std::size_t i = begin; i < end; ++i) {
        // Sizes of sheets whose roots lie in other blocks change meanwhile.
        if (inside(i)) find_edge_out(i);
        if (!inside(i) || (out_[i] != kNoLength && !inside(to_[i]))) out_[i] = kNoLength;
      }
      join_along_edges_out(begin, end);
    });
  }

  /// Joins small sheets to others by the best edge of each of their points, the best first, as
  /// long as they are small. Returns whether any were joined.
  bool join_small() {
    parallel_each(count_, kSheetGrain, [&](std::size_t i) { find_edge_out(i); });
    return join_along_edges_out(0, count_);
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
  /// Lengths of the best edges of points in small sheets to other sheets, or kNoLength ...
  Array<std::uint16_t> out_;
  Array<std::uint32_t> to_;  ///< ... and where they lead.
};

}  // namespace

PointSheets cut_sheets(const Array<Vec3f>& position, const NeighborSearch& search,
                       std::size_t least, Array<Vec3f>& normal) {
  return SheetCutter(position, search, least, normal).run();
}

}  // namespace surfel
