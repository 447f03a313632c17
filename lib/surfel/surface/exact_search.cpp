#include <algorithm>
#include <bit>
#include <compare>
#include <limits>
#include <utility>

#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/surface/exact_search.h>

#ifndef SURFEL_EXACT_SEARCH_SCRATCH
#define SURFEL_EXACT_SEARCH_SCRATCH
namespace surfel {
namespace {

/// Which places are searched for.
struct Wanted {
  std::size_t k;  ///< The k nearest ones; no more than there are.
  float limit2;   ///< Square of the largest distance, or infinity.
};

/// Memory that searches reuse.
struct SearchScratch {
  std::vector<std::uint32_t> leaves;  ///< Gathered leaves.
  Array<float> distance2;             ///< Squared distances of the leaves' entries.
  Array<std::uint32_t> slot;          ///< Entries within the bound.
  Array<std::uint64_t> key;           ///< Keys of the entries within the bound.
  Array<std::int64_t> rank;           ///< By key: how many keys are smaller.
  Array<std::uint64_t> sorted;        ///< The keys in ascending order.
  std::vector<std::uint32_t> ends;    ///< Of buckets of keys.
};

}  // namespace
}  // namespace surfel
#endif

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/surface/exact_search.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/compress-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
constexpr std::size_t kLeafWidth = PointTree::kWidth;
using D = hn::CappedTag<float, kLeafWidth>;
using V = hn::Vec<D>;
using Key = ExactSearch::Key;

/// Box around the queries of a search: distances to the tree's boxes are measured from here.
struct Box {
  Vec3f low, high;
};

/// Sums in the order of Eigen's squaredNorm(), by which the rest of the library computes distances.
HWY_INLINE V squared_length(const V& x, const V& y, const V& z) {
  return hn::Add(hn::Mul(x, x), hn::Add(hn::Mul(y, y), hn::Mul(z, z)));
}

class Searcher {
 public:
  Searcher(const PointTree& tree, const Wanted& wanted, SearchScratch& scratch)
      : tree_(tree),
        k_(wanted.k),
        limit2_(wanted.limit2),
        leaves_(scratch.leaves),
        distance2_(scratch.distance2),
        slot_(scratch.slot),
        key_(scratch.key),
        rank_(scratch.rank),
        sorted_(scratch.sorted),
        ends_(scratch.ends) {}

  /// Calls found(entry, keys) for each place of the leaf.
  template <class Found>
  void search_leaf(std::size_t leaf, Found&& found) {
    const PointTree::Leaf& own = tree_.leaf(leaf);
    const std::size_t count = tree_.leaf_size(leaf);
    const Box box = box_of(own, count);
    const bool limited = limit2_ < kInfinity;
    if (leaf_reach2_ < 0) leaf_reach2_ = first_guess(box, count);
    float reach2 = limited ? limit2_ : leaf_reach2_;
    // Where the density jumps the guess may reach far too much; half of it is a better start.
    constexpr int kMostShrinks = 8;
    int shrinks = 0;
    while (!gather(box, reach2, shrinks < kMostShrinks ? most_leaves() : kNoMost)) {
      reach2 /= 4;
      ++shrinks;
    }
    float furthest2 = 0;
    std::uint32_t pending = (1U << count) - 1;
    for (;;) {
      for (std::uint32_t left = pending; left != 0; left &= left - 1) {
        const auto entry = static_cast<std::size_t>(std::countr_zero(left));
        const Vec3f query(own.x[entry], own.y[entry], own.z[entry]);
        float bound2 = limited ? reach2 : std::min(point_reach2_, reach2);
        std::size_t near = scan(query, bound2);
        while (near < k_ && bound2 < reach2) {
          bound2 = std::min(widened(bound2), reach2);
          near = scan(query, bound2);
        }
        if (near < k_ && reach2 < limit2_) continue;
        const std::span<const Key> keys = select(near);
        const float last2 = keys.empty() ? 0 : distance2(keys.back());
        furthest2 = std::max(furthest2, last2);
        point_reach2_ = kSlack * last2;
        pending &= ~(1U << entry);
        found(entry, keys);
      }
      if (pending == 0) break;
      reach2 = std::min(widened(reach2), limit2_);
      gather(box, reach2, kNoMost);
    }
    leaf_reach2_ = kLeafSlack * furthest2;
  }

  std::span<const Key> search_point(const Vec3f& query) {
    const Box box{query, query};
    float reach2 = limit2_;
    if (reach2 < kInfinity && gather(box, reach2, most_leaves())) {
      return select(scan(query, reach2));
    }
    // The k-th distance within the smallest node around that holds k places is a bound.
    gather_node(query);
    std::size_t near = scan(query, reach2);
    if (near >= k_) reach2 = std::min(reach2, last_distance2(near));
    // Where the density jumps the bound may reach far too much.
    const float bound2 = reach2;
    constexpr int kMostShrinks = 64;
    int shrinks = 0;
    while (!gather(box, reach2, shrinks < kMostShrinks ? most_leaves() : kNoMost)) {
      reach2 /= 4;
      ++shrinks;
    }
    near = scan(query, reach2);
    while (near < k_ && reach2 < bound2) {
      reach2 = std::min(widened(reach2), bound2);
      gather(box, reach2, kNoMost);
      near = scan(query, reach2);
    }
    return select(near);
  }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr std::size_t kNoMost = std::numeric_limits<std::size_t>::max();
  /// The k-th neighbour of a point is expected within kSlack times the squared distance that the
  /// k-th neighbour of the point before it has. Larger values take longer to select from, smaller
  /// values miss more often.
  static constexpr float kSlack = 1.5F;
  /// The furthest k-th neighbour of a leaf's points is expected within kLeafSlack times the squared
  /// distance of the leaf before it.
  static constexpr float kLeafSlack = 1.2F;
  /// Up to this many keys counting all smaller ones is faster than sorting.
  static constexpr std::size_t kMostRanked = 96;

  /// Leaves that k neighbours hardly ever need more of.
  std::size_t most_leaves() const { return 64 + k_; }

  static float widened(float reach2) {
    return std::max(4 * reach2, std::numeric_limits<float>::min());
  }
  static float distance2(Key key) {
    return std::bit_cast<float>(static_cast<std::uint32_t>(key >> 32));
  }

  static Box box_of(const PointTree::Leaf& leaf, std::size_t count) {
    Box box{Vec3f(leaf.x[0], leaf.y[0], leaf.z[0]), Vec3f(leaf.x[0], leaf.y[0], leaf.z[0])};
    for (std::size_t i = 1; i < count; ++i) {
      const Vec3f p(leaf.x[i], leaf.y[i], leaf.z[i]);
      box.low = box.low.cwiseMin(p);
      box.high = box.high.cwiseMax(p);
    }
    return box;
  }

  /// Reach, squared, that k places would have if the leaf (or the root, if the leaf has no extent)
  /// were a square with its places spread evenly.
  float first_guess(const Box& box, std::size_t count) const {
    float diagonal2 = (box.high - box.low).squaredNorm();
    if (!(diagonal2 > 0)) {
      const PointTree::Node& root = tree_.node(tree_.levels() - 1, 0);
      for (int d = 0; d < 3; ++d) {
        const float side = *std::max_element(root.high[d], root.high[d] + root.children) -
                           *std::min_element(root.low[d], root.low[d] + root.children);
        diagonal2 += side * side;
      }
      count = tree_.places();
    }
    return diagonal2 * static_cast<float>(k_) / static_cast<float>(count);
  }

  /// The children within reach, as bits.
  HWY_INLINE std::uint32_t children_within(const PointTree::Node& node, const Box& box,
                                           float reach2) const {
    const D d;
    const V zero = hn::Zero(d);
    const auto gap = [&](int axis, std::size_t i) HWY_ATTR {
      const V below = hn::Sub(hn::Load(d, node.low[axis] + i), hn::Set(d, box.high[axis]));
      const V above = hn::Sub(hn::Set(d, box.low[axis]), hn::Load(d, node.high[axis] + i));
      return hn::Max(hn::Max(below, above), zero);
    };
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < kLeafWidth; i += hn::Lanes(d)) {
      const V distance2 = squared_length(gap(0, i), gap(1, i), gap(2, i));
      std::uint8_t bytes[8] = {};
      hn::StoreMaskBits(d, hn::Le(distance2, hn::Set(d, reach2)), bytes);
      bits |= (bytes[0] | static_cast<std::uint32_t>(bytes[1]) << 8) << i;
    }
    return bits & ((1U << node.children) - 1);
  }

  void use_leaf(std::size_t leaf) { leaves_.push_back(static_cast<std::uint32_t>(leaf)); }

  void visit(std::size_t level, std::size_t index, const Box& box, float reach2, std::size_t most) {
    const PointTree::Node& node = tree_.node(level, index);
    for (std::uint32_t bits = children_within(node, box, reach2); bits != 0; bits &= bits - 1) {
      const std::size_t child = node.first_child + std::countr_zero(bits);
      if (level == 0) {
        use_leaf(child);
      } else {
        visit(level - 1, child, box, reach2, most);
      }
      if (leaves_.size() > most) return;
    }
  }

  /// Gathers the leaves within reach of a box; false if there are more than `most`: some are left
  /// out then.
  bool gather(const Box& box, float reach2, std::size_t most) {
    leaves_.clear();
    visit(tree_.levels() - 1, 0, box, reach2, most);
    make_room();
    return leaves_.size() <= most;
  }

  /// How far a child's box is from a point and, where boxes overlap, how large it is: of boxes
  /// around one point, as where clusters of many scales lie in each other, the smallest has the
  /// point's neighbours.
  struct Nearness {
    float distance2, diagonal2;
    auto operator<=>(const Nearness&) const = default;
  };
  static Nearness nearness(const PointTree::Node& node, std::size_t child, const Vec3f& query) {
    Vec3f gap;
    Vec3f diagonal;
    for (int d = 0; d < 3; ++d) {
      const float low = node.low[d][child];
      const float high = node.high[d][child];
      gap[d] = std::max({low - query[d], query[d] - high, 0.0F});
      diagonal[d] = high - low;
    }
    return {gap.squaredNorm(), diagonal.squaredNorm()};
  }

  struct LeafRange {
    std::size_t begin, end;
  };
  /// The leaves under a node.
  LeafRange leaves_under(std::size_t level, std::size_t index) const {
    LeafRange range{index, index + 1};
    for (std::size_t l = level + 1; l-- > 0;) {
      const PointTree::Node& last = tree_.node(l, range.end - 1);
      range = {tree_.node(l, range.begin).first_child, last.first_child + last.children};
    }
    return range;
  }

  /// Gathers the leaves of the smallest node that holds k places, on the way down to the nearest
  /// leaf.
  void gather_node(const Vec3f& query) {
    std::size_t level = tree_.levels() - 1;
    LeafRange range = leaves_under(level, 0);
    for (std::size_t index = 0; level > 0; --level) {
      const PointTree::Node& node = tree_.node(level, index);
      std::size_t nearest = 0;
      for (std::size_t c = 1; c < node.children; ++c) {
        if (nearness(node, c, query) < nearness(node, nearest, query)) nearest = c;
      }
      index = node.first_child + nearest;
      const LeafRange smaller = leaves_under(level - 1, index);
      if (tree_.first_place(smaller.end) - tree_.first_place(smaller.begin) < k_) break;
      range = smaller;
    }
    leaves_.clear();
    for (std::size_t leaf = range.begin; leaf < range.end; ++leaf) use_leaf(leaf);
    make_room();
  }

  void make_room() {
    // A vector is stored whole, however few of its lanes count.
    const std::size_t slots = leaves_.size() * kLeafWidth;
    if (distance2_.size() < slots) {
      distance2_.resize(slots);
      slot_.resize(slots + kLeafWidth);
      key_.resize(slots + kLeafWidth);
      rank_.resize(slots + kLeafWidth);
      sorted_.resize(slots + kLeafWidth);
    }
  }

  /// Notes the places of the gathered leaves within bound2, and returns how many there are.
  HWY_INLINE std::size_t scan(const Vec3f& query, float bound2) {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const V x = hn::Set(d, query.x());
    const V y = hn::Set(d, query.y());
    const V z = hn::Set(d, query.z());
    const V bound = hn::Set(d, bound2);
    // Made once: Iota() of a variable start goes through memory.
    const auto lanes = hn::Iota(du, 0);
    float* distance2 = distance2_.data();
    std::uint32_t* slot = slot_.data();
    std::size_t count = 0;
    for (std::size_t j = 0; j < leaves_.size(); ++j) {
      const PointTree::Leaf& leaf = tree_.leaf(leaves_[j]);
      for (std::size_t i = 0; i < kLeafWidth; i += hn::Lanes(d)) {
        const V length2 =
            squared_length(hn::Sub(hn::Load(d, leaf.x + i), x), hn::Sub(hn::Load(d, leaf.y + i), y),
                           hn::Sub(hn::Load(d, leaf.z + i), z));
        const std::size_t first = j * kLeafWidth + i;
        hn::Store(length2, d, distance2 + first);
        const auto near = hn::Le(length2, bound);
        const auto slots = hn::Add(lanes, hn::Set(du, static_cast<std::uint32_t>(first)));
        const Compressor<D> within(near);
        within.store(slots, du, slot + count);
        count += within.count();
      }
    }
    return count;
  }

  /// The k-th of the squared distances of the `count` places that scan() noted, k of them at least.
  float last_distance2(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      key_[i] = std::bit_cast<std::uint32_t>(distance2_[slot_[i]]);
    }
    const auto last = key_.begin() + static_cast<std::ptrdiff_t>(k_ - 1);
    std::nth_element(key_.begin(), last, key_.begin() + static_cast<std::ptrdiff_t>(count));
    return std::bit_cast<float>(static_cast<std::uint32_t>(*last));
  }

  /// The first `kept` of `count` keys, ascending. Squared distances to places of a surface are
  /// spread about evenly, so that as many buckets as keys have few keys each.
  std::span<const Key> sorted_by_buckets(std::size_t count, std::size_t kept) {
    const std::span<const Key> keys(key_.data(), count);
    const float largest = distance2(*std::max_element(keys.begin(), keys.end()));
    float scale = static_cast<float>(count - 1) / largest;
    if (!(scale < kInfinity)) scale = 0;
    // Infinite distances, times zero no numbers, come last.
    const auto bucket = [last = static_cast<float>(count - 1), scale](Key key) {
      return static_cast<std::size_t>(std::min(last, distance2(key) * scale));
    };
    ends_.assign(count, 0);
    for (const Key key : keys) ++ends_[bucket(key)];
    // Buckets that begin behind the last key that is wanted stay out.
    std::size_t used = 0;
    std::uint32_t begin = 0;
    for (; begin < kept; ++used) begin += std::exchange(ends_[used], begin);
    for (const Key key : keys) {
      const std::size_t b = bucket(key);
      if (b < used) sorted_[ends_[b]++] = key;
    }
    begin = 0;
    for (std::size_t b = 0; b < used; begin = ends_[b++]) {
      const auto first = sorted_.begin() + begin;
      const auto last = sorted_.begin() + ends_[b];
      constexpr std::ptrdiff_t kMostInserted = 16;
      if (last - first > kMostInserted) {
        std::sort(first, last);
        continue;
      }
      for (auto k = first; k != last; ++k) {
        const Key key = *k;
        auto to = k;
        for (; to != first && key < to[-1]; --to) *to = to[-1];
        *to = key;
      }
    }
    return {sorted_.data(), kept};
  }

  /// The first k keys, ascending, of the `count` places that scan() noted.
  HWY_INLINE std::span<const Key> select(std::size_t count) {
    Key* key = key_.data();
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t slot = slot_[i];
      const PointTree::Leaf& leaf = tree_.leaf(leaves_[slot / kLeafWidth]);
      key[i] =
          Key{std::bit_cast<std::uint32_t>(distance2_[slot])} << 32 | leaf.index[slot % kLeafWidth];
    }
    const std::size_t kept = std::min(count, k_);
    if (count > kMostRanked) return sorted_by_buckets(count, kept);
    // The place of a key is the number of smaller keys. As signed numbers keys have the same order,
    // since the sign of a squared distance is clear, and more instruction sets compare signed ones.
    const hn::CappedTag<std::int64_t, kLeafWidth / 2> d;
    const auto* signed_key = reinterpret_cast<const std::int64_t*>(key);
    for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
      const auto own = hn::Load(d, signed_key + i);
      auto rank = hn::Zero(d);
      for (std::size_t j = 0; j < count; ++j) {
        const auto smaller = hn::Lt(hn::Set(d, signed_key[j]), own);
        rank = hn::Sub(rank, hn::VecFromMask(d, smaller));
      }
      hn::Store(rank, d, rank_.data() + i);
    }
    for (std::size_t i = 0; i < count; ++i) sorted_[rank_[i]] = key[i];
    return {sorted_.data(), kept};
  }

  const PointTree& tree_;
  std::size_t k_;
  float limit2_;
  float leaf_reach2_ = -1;  ///< Guess for the next leaf; below 0: none yet.
  float point_reach2_ = kInfinity;
  std::vector<std::uint32_t>& leaves_;
  Array<float>& distance2_;
  Array<std::uint32_t>& slot_;
  Array<Key>& key_;
  Array<std::int64_t>& rank_;
  Array<Key>& sorted_;
  std::vector<std::uint32_t>& ends_;
};

}  // namespace

/// Calls found(place, keys) for every place of the leaves begin to end - 1.
void search_leaves(const PointTree& tree, std::size_t begin, std::size_t end, const Wanted& wanted,
                   SearchScratch& scratch,
                   FunctionRef<void(std::size_t, std::span<const Key>)> found) {
  Searcher searcher(tree, wanted, scratch);
  for (std::size_t leaf = begin; leaf < end; ++leaf) {
    searcher.search_leaf(leaf, [&](std::size_t entry, std::span<const Key> keys) {
      found(tree.first_place(leaf) + entry, keys);
    });
  }
}

void search_point(const PointTree& tree, const Vec3f& query, const Wanted& wanted,
                  SearchScratch& scratch, FunctionRef<void(std::span<const Key>)> found) {
  found(Searcher(tree, wanted, scratch).search_point(query));
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {
namespace {

HWY_EXPORT(search_leaves);
HWY_EXPORT(search_point);

/// Leaves of a range, within which the guess of the reach is carried on from leaf to leaf.
constexpr std::size_t kLeafGrain = 128;

Neighbor neighbor_of(ExactSearch::Key key) {
  return {static_cast<std::uint32_t>(key),
          std::bit_cast<float>(static_cast<std::uint32_t>(key >> 32))};
}

}  // namespace

/// Turns the nearest places into their points. The `most` nearest places hold the `most` nearest
/// points: fewer than `most` places have a first point before any of these points.
void ExactSearch::expand(std::span<const Key> places, std::size_t most,
                         std::vector<Neighbor>& out) const {
  out.clear();
  if (tree_.places() == tree_.size()) {
    for (const Key key : places) out.push_back(neighbor_of(key));
    return;
  }
  for (std::size_t i = 0; i < places.size() && out.size() < most;) {
    const float distance2 = neighbor_of(places[i]).distance2;
    const auto first = static_cast<std::ptrdiff_t>(out.size());
    std::size_t same = 0;
    for (; i < places.size() && neighbor_of(places[i]).distance2 == distance2; ++i, ++same) {
      const auto members = tree_.at(tree_.place_of(neighbor_of(places[i]).index));
      for (const std::uint32_t index : members.first(std::min(members.size(), most - first))) {
        out.push_back({index, distance2});
      }
    }
    if (same > 1) {
      std::sort(out.begin() + first, out.end(),
                [](const Neighbor& a, const Neighbor& b) { return a.index < b.index; });
    }
    out.resize(std::min(out.size(), most));
  }
}

void ExactSearch::search(const Vec3f& query, std::size_t most, float limit2,
                         std::vector<Neighbor>& out) const {
  out.clear();
  if (size() == 0 || most == 0) return;
  // Single queries come by the million; allocating would take longer than searching.
  thread_local SearchScratch scratch;
  HWY_DYNAMIC_DISPATCH(search_point)
  (tree_, query, {std::min(most, tree_.places()), limit2}, scratch,
   [&](std::span<const Key> keys) { expand(keys, most, out); });
}

void ExactSearch::for_each(std::size_t most, float limit2, Body body) const {
  if (tree_.leaves() == 0) return;
  ProgressStage stage("searching neighbours", tree_.first_place(tree_.leaves()), "points");
  struct Scratch {
    SearchScratch search;
    std::vector<Neighbor> neighbors;
  };
  PerWorker<Scratch> scratch;
  parallel_for(tree_.leaves(), kLeafGrain, [&](std::size_t begin, std::size_t end, int worker) {
    stage.add(tree_.first_place(end) - tree_.first_place(begin));
    Scratch& memory = scratch[worker];
    std::vector<Neighbor>& out = memory.neighbors;
    const auto found = [&](std::size_t place, std::span<const Key> keys) {
      expand(keys, most, out);
      for (const std::uint32_t i : tree_.at(place)) body(i, out, worker);
    };
    if (most == 0) {
      for (std::size_t place = tree_.first_place(begin); place < tree_.first_place(end); ++place) {
        found(place, {});
      }
      return;
    }
    HWY_DYNAMIC_DISPATCH(search_leaves)
    (tree_, begin, end, {std::min(most, tree_.places()), limit2}, memory.search, found);
  });
}

}  // namespace surfel
#endif
