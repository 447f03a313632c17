#include <algorithm>
#include <bit>
#include <limits>

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_single_index.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/surface/flann_plugin.h>

namespace surfel {
namespace {

using Index = flann::KDTreeSingleIndex<flann::L2_Simple<float>>;
constexpr int kLeafSize = 12;  ///< Points; FLANN's default is 10.
constexpr std::size_t kGrain = 256;

/// The distinct positions, in Morton order, each with the points that lie there. The tree is built
/// over these: however many points coincide, they are one entry, and equal distances at which the
/// tree would have to visit everything do not arise from them.
struct Places {
  explicit Places(const Array<Vec3f>& points) : member(morton_order(points)) {
    for (std::size_t i = 0; i < member.size(); ++i) {
      const Vec3f& p = points[member[i]];
      if (!position.empty() && position.back() == p) continue;
      position.push_back(p);
      first.push_back(static_cast<std::uint32_t>(i));
    }
    first.push_back(static_cast<std::uint32_t>(member.size()));
  }

  std::size_t size() const { return position.size(); }
  std::span<const std::uint32_t> at(std::size_t place) const {
    return {member.data() + first[place], member.data() + first[place + 1]};
  }

  Array<Vec3f> position;
  Array<std::uint32_t> first;   ///< Place to its first entry of `member`; one more at the end.
  Array<std::uint32_t> member;  ///< Points by place, ascending within each.
};

/// Key of the order among neighbours: by distance, then index. Floats that are not negative are
/// ordered as their bits are.
std::uint64_t rank(const Neighbor& n) {
  return std::uint64_t{std::bit_cast<std::uint32_t>(n.distance2)} << 32 | n.index;
}
bool nearer(const Neighbor& a, const Neighbor& b) { return rank(a) < rank(b); }

/// Keeps the nearest neighbours within a distance, up to a number, in the order of nearer().
class NearestSet final : public flann::ResultSet<float> {
 public:
  NearestSet(const Places& places, std::vector<Neighbor>& out) : places_(places), out_(out) {}

  void start(const Vec3f& query, std::size_t most, float limit2) {
    query_ = query;
    most_ = most;
    sorted_ = most <= kMostSorted;
    out_.clear();
    set_bound(limit2);
  }

  void finish() {
    if (sorted_) return;
    if (out_.size() == most_) {
      std::sort_heap(out_.begin(), out_.end(), nearer);
    } else {
      std::sort(out_.begin(), out_.end(), nearer);
    }
  }

  bool full() const override { return out_.size() == most_; }
  float worstDist() const override { return reach2_; }

  void addPoint(float /*distance2*/, std::size_t place) override {
    const float distance2 = (places_.position[place] - query_).squaredNorm();
    if (!(distance2 <= bound2_)) return;
    for (const std::uint32_t index : places_.at(place)) {
      if (!add({index, distance2})) return;  // The others there have higher indices.
    }
  }

 private:
  /// Up to here an insertion into a sorted array is faster than a heap.
  static constexpr std::size_t kMostSorted = 96;

  bool add(const Neighbor& candidate) {
    if (out_.size() < most_) {
      out_.push_back(candidate);
      if (sorted_) {
        sink(out_.size() - 1, candidate);
      } else if (out_.size() == most_) {
        std::make_heap(out_.begin(), out_.end(), nearer);
      }
    } else {
      if (!nearer(candidate, worst())) return false;
      if (sorted_) {
        sink(most_ - 1, candidate);
      } else {
        std::pop_heap(out_.begin(), out_.end(), nearer);
        out_.back() = candidate;
        std::push_heap(out_.begin(), out_.end(), nearer);
      }
    }
    if (out_.size() == most_) set_bound(worst().distance2);
    return true;
  }

  /// Inserts in front of the neighbours that are further away; the one at `last` is overwritten.
  void sink(std::size_t last, const Neighbor& candidate) {
    for (; last > 0 && nearer(candidate, out_[last - 1]); --last) out_[last] = out_[last - 1];
    out_[last] = candidate;
  }

  const Neighbor& worst() const { return sorted_ ? out_.back() : out_.front(); }

  void set_bound(float bound2) {
    bound2_ = bound2;
    // FLANN skips points that are as far as the bound, where a lower index may still count, and
    // adds up its distances to boxes step by step, with rounding of up to 4 * 2^-24 each. The
    // margin is beyond both for any tree; the smallest normal float makes a margin at distance 0,
    // too.
    reach2_ = bound2 * (1 + 0x1p-14F) + std::numeric_limits<float>::min();
  }

  const Places& places_;
  std::vector<Neighbor>& out_;  ///< Ascending if sorted_, else a heap once it is full.
  Vec3f query_{0, 0, 0};
  std::size_t most_ = 0;
  bool sorted_ = true;
  float bound2_ = 0;
  float reach2_ = 0;  ///< The bound that FLANN is told: wider than bound2_, see set_bound().
};

class FlannSearch final : public NeighborSearch {
 public:
  FlannSearch(const Array<Vec3f>& points, bool approximate) : places_(points) {
    parameters_.checks = flann::FLANN_CHECKS_UNLIMITED;
    parameters_.eps = approximate ? 1.0F : 0.0F;
    if (points.empty()) return;
    // FLANN's interface is not const where it only reads.
    const flann::Matrix<float> matrix(places_.position.data()->data(), places_.size(), 3);
    index_ = std::make_unique<Index>(matrix, flann::KDTreeSingleIndexParams(kLeafSize, true));
    index_->buildIndex();
  }

  std::size_t size() const override { return places_.member.size(); }

  void search(const Vec3f& query, std::size_t most, float limit2,
              std::vector<Neighbor>& out) const override {
    NearestSet set(places_, out);
    run(set, query, most, limit2);
  }

  /// Goes from place to place along the Morton curve, whatever the order of the points: successive
  /// queries find the tree's nodes and the points in the cache. Points at one place share a search.
  void for_each(std::size_t most, float limit2, Body body) const override {
    PerWorker<std::vector<Neighbor>> scratch;
    parallel_for(places_.size(), kGrain, [&](std::size_t begin, std::size_t end, int worker) {
      std::vector<Neighbor>& out = scratch[worker];
      NearestSet set(places_, out);
      for (std::size_t place = begin; place < end; ++place) {
        run(set, places_.position[place], most, limit2);
        for (const std::uint32_t i : places_.at(place)) body(i, out, worker);
      }
    });
  }

 private:
  void run(NearestSet& set, const Vec3f& query, std::size_t most, float limit2) const {
    set.start(query, std::min(most, size()), limit2);
    if (!index_ || most == 0) return;
    index_->findNeighbors(set, query.data(), parameters_);
    set.finish();
  }

  Places places_;
  std::unique_ptr<Index> index_;
  flann::SearchParams parameters_;
};

}  // namespace
}  // namespace surfel

extern "C" SURFEL_API void surfel_make_flann_search(
    const surfel::Array<surfel::Vec3f>& points, bool approximate,
    std::unique_ptr<surfel::NeighborSearch>& search) {
  search = std::make_unique<surfel::FlannSearch>(points, approximate);
}
