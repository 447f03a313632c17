#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/spanning_forest.h>

namespace surfel {
namespace {

constexpr std::size_t kOrientationGrain = 1024;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr float kLongestWeight = 65534;  ///< The largest length below NeighborGraph::kNoEdge.
/// Squared sine of 51 degrees: steeper edges to a tangent plane lead to another sheet. 45 degrees
/// (along_sheet() in surface/sheet.h) would be too strict here, as all edges across a right-angled
/// bend may have them, and the bend's sides would fall apart.
constexpr float kSteepestSine2 = 0.6F;
/// Weight of a pair of points without an edge, above all weights of edges.
constexpr float kNoEdge = 2;
/// Cosine of 45 degrees: bends by more need the edge to tell the side, as the normals' own product
/// is near zero, and its sign chance.
constexpr float kBend = 0.7F;
/// Parts are joined by edges below this weight, to the kJoinNeighbors nearest points, in
/// kJoinRounds rounds: each round at least halves the parts that can be joined.
constexpr float kJoinWeight = 0.1F;
constexpr std::size_t kJoinNeighbors = 64;
constexpr int kJoinRounds = 8;

class Spreader {
 public:
  Spreader(const Array<Vec3f>& position, const NeighborSearch& search, Array<Vec3f>& normal)
      : position_(position), search_(search), normal_(normal), sets_(position.size()) {}

  /// Makes points whose sides are right one part, and keeps their sides.
  void settle(const std::vector<bool>& given) {
    for (std::uint32_t i = 0; i < given.size(); ++i) {
      if (!given[i]) continue;
      if (settled_ == kNone) settled_ = i;
      sets_.unite(settled_, i, [] { return false; });
    }
  }
  /// One of the settled points, or kNone.
  std::uint32_t settled() const { return settled_; }

  /// Turns the normals of each part to one side, whichever that is unless points are settled.
  void spread() {
    join_neighbors();
    look_up();
    for (int round = 0; round < kJoinRounds && parts_ > 1 && join_parts(); ++round) look_up();
    const bool right_opposed = settled_ != kNone && opposed_[settled_] != 0;
    const std::uint32_t right = settled_ == kNone ? kNone : part_[settled_];
    parallel_each(position_.size(), kOrientationGrain, [&](std::size_t i) {
      if ((opposed_[i] != 0) != (part_[i] == right && right_opposed)) normal_[i] = -normal_[i];
    });
  }

  bool known(std::size_t i) const { return !normal_[i].isZero(0); }
  /// For each point the one point that stands for its part. Set by spread().
  const Array<std::uint32_t>& part() const { return part_; }
  /// How many parts there are, besides points without a normal.
  std::size_t parts() const { return parts_; }

 private:
  /// Weight of an edge in 0..1, see orient_normals(), or kNoEdge.
  float weight(std::size_t i, std::size_t j) const {
    const Vec3f edge = position_[j] - position_[i];
    const float length2 = edge.squaredNorm();
    float sine2 = 0;
    if (length2 > 0) {
      const float a = edge.dot(normal_[i]);
      const float b = edge.dot(normal_[j]);
      sine2 = std::min(1.0F, std::max(a * a, b * b) / length2);
    }
    if (sine2 > kSteepestSine2) return kNoEdge;
    return 1 - std::min(1.0F, std::abs(agreement(i, j))) * (1 - sine2);
  }

  /// Above zero where the normals are on the same side of the surface: their product, or in sharp
  /// bends the product of n_j and n_i mirrored at the plane half-way between the points.
  float agreement(std::size_t i, std::size_t j) const {
    const float product = normal_[i].dot(normal_[j]);
    const Vec3f edge = position_[j] - position_[i];
    const float length2 = edge.squaredNorm();
    if (std::abs(product) >= kBend || !(length2 > 0)) return product;
    const float mirrored = product - 2 * edge.dot(normal_[i]) * edge.dot(normal_[j]) / length2;
    return std::abs(mirrored) > std::abs(product) ? mirrored : product;
  }

  bool opposed(std::size_t i, std::size_t j) const { return agreement(i, j) < 0; }

  /// Joins points along the spanning forest of the edges to the nearest points.
  void join_neighbors() {
    NeighborGraph graph{search_.rows(kOrientationNeighbors + 1), {}};
    graph.length.resize(position_.size() * graph.degree());
    parallel_for(position_.size(), kOrientationGrain, [&](std::size_t begin, std::size_t end, int) {
      std::uint16_t* length = graph.length.data() + begin * graph.degree();
      for (std::size_t i = begin; i < end; ++i) {
        for (const std::uint32_t j : graph.rows.of(i)) {
          const float w = j != i && known(i) && known(j) ? weight(i, j) : kNoEdge;
          *length++ = w == kNoEdge ? NeighborGraph::kNoEdge
                                   : static_cast<std::uint16_t>(w * kLongestWeight + 0.5F);
        }
      }
    });
    unite_spanning_forest(
        graph, settled_ != kNone, [&](std::uint32_t i, std::uint32_t j) { return opposed(i, j); },
        sets_);
  }

  /// Finds the part of every point.
  void look_up() {
    part_.resize(position_.size());
    opposed_.resize(position_.size());
    parts_ = count_where(position_.size(), [&](std::size_t i) {
      const SignedSets::Root root = sets_.root(static_cast<std::uint32_t>(i));
      part_[i] = root.index;
      opposed_[i] = root.opposed ? 1 : 0;
      return root.index == i && known(i);
    });
  }

  /// Joins parts to other parts near them; returns whether any were joined.
  bool join_parts() {
    const std::size_t count = position_.size();
    Array<std::uint32_t> size;  // Known points of each part, by the part's root.
    size.assign(count, 0);
    for (std::size_t i = 0; i < count; ++i) size[part_[i]] += known(i) ? 1 : 0;
    // The largest part (of several, the part of the lowest point) waits for the others to come.
    std::uint32_t largest = kNone;
    for (std::uint32_t i = 0; i < count; ++i) {
      if (known(i) && (largest == kNone || size[part_[i]] > size[largest])) largest = part_[i];
    }
    struct Join {
      float weight;
      std::uint32_t from, to;
    };
    PerWorker<std::vector<Join>> found;
    const auto comes = [&](std::size_t i) { return known(i) && part_[i] != largest; };
    const auto look = [&](std::size_t i, std::span<const Neighbor> near, int worker) {
      Join best{kJoinWeight, static_cast<std::uint32_t>(i), kNone};
      for (const Neighbor& n : near) {
        if (!known(n.index) || part_[n.index] == part_[i]) continue;
        const float w = weight(i, n.index);
        if (w < best.weight) {
          best.weight = w;
          best.to = n.index;
        }
      }
      if (best.to != kNone) found[worker].push_back(best);
    };
    if (2 * count_where(count, comes) > count) {
      // A search for all points takes less time than one for each of most of them.
      search_.for_each_nearest(kJoinNeighbors,
                               [&](std::size_t i, std::span<const Neighbor> near, int worker) {
                                 if (comes(i)) look(i, near, worker);
                               });
    } else {
      PerWorker<std::vector<Neighbor>> scratch;
      parallel_for(count, kOrientationGrain, [&](std::size_t begin, std::size_t end, int worker) {
        for (std::size_t i = begin; i < end; ++i) {
          if (!comes(i)) continue;
          search_.nearest(position_[i], kJoinNeighbors, scratch[worker]);
          look(i, scratch[worker], worker);
        }
      });
    }
    std::vector<Join> joins;
    found.for_each([&](const std::vector<Join>& some) {
      joins.insert(joins.end(), some.begin(), some.end());
    });
    std::sort(joins.begin(), joins.end(), [](const Join& a, const Join& b) {
      return a.weight != b.weight ? a.weight < b.weight : a.from < b.from;
    });
    for (const Join& join : joins) {
      sets_.unite(join.from, join.to, [&] { return opposed(join.from, join.to); });
    }
    return !joins.empty();
  }

  const Array<Vec3f>& position_;
  const NeighborSearch& search_;
  Array<Vec3f>& normal_;
  SignedSets sets_;
  std::uint32_t settled_ = kNone;
  Array<std::uint32_t> part_;
  Array<std::uint8_t> opposed_;  ///< 1: the normal is on the other side than the one of part_.
  std::size_t parts_ = 0;
};

/// Directions that the extreme points of a part are looked for in.
std::vector<Vec3f> probes(Orientation method) {
  if (method != Orientation::kOutward) return {Vec3f(0, 0, 1)};
  std::vector<Vec3f> out;
  for (const float x : {-1.0F, 0.0F, 1.0F}) {
    for (const float y : {-1.0F, 0.0F, 1.0F}) {
      for (const float z : {-1.0F, 0.0F, 1.0F}) {
        const Vec3f d(x, y, z);
        if (!d.isZero(0)) out.push_back(d.normalized());
      }
    }
  }
  return out;
}

/// Turns whole parts, except the part `settled`, so that the furthest point of a part in a probed
/// direction looks there, by the sum over the directions.
void turn_parts(const Array<Vec3f>& position, const Array<std::uint32_t>& part,
                std::uint32_t settled, Orientation method, Array<Vec3f>& normal) {
  const std::size_t count = position.size();
  Array<std::uint32_t> number(count);
  std::uint32_t parts = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (part[i] == i) number[i] = parts++;
  }
  std::vector<double> vote(parts);
  for (const Vec3f& d : probes(method)) {
    // The furthest point of each part; of several, the first.
    const auto further = [&](std::uint32_t i, std::uint32_t j) {
      const float a = position[i].dot(d);
      const float b = position[j].dot(d);
      return a > b || (a == b && i < j);
    };
    const auto keep_further = [&](std::uint32_t i, std::uint32_t& at) {
      if (at == kNone || further(i, at)) at = i;
    };
    PerWorker<std::vector<std::uint32_t>> extreme(
        [&] { return std::make_unique<std::vector<std::uint32_t>>(parts, kNone); });
    parallel_for(count, kOrientationGrain, [&](std::size_t begin, std::size_t end, int worker) {
      std::vector<std::uint32_t>& most = extreme[worker];
      for (std::size_t i = begin; i < end; ++i) {
        if (!normal[i].isZero(0))
          keep_further(static_cast<std::uint32_t>(i), most[number[part[i]]]);
      }
    });
    for (std::uint32_t n = 0; n < parts; ++n) {
      std::uint32_t at = kNone;
      extreme.for_each([&](const std::vector<std::uint32_t>& most) {
        if (most[n] != kNone) keep_further(most[n], at);
      });
      if (at != kNone) vote[n] += static_cast<double>(normal[at].dot(d));
    }
  }
  parallel_each(count, kOrientationGrain, [&](std::size_t i) {
    if (normal[i].isZero(0) || part[i] == settled) return;
    if (vote[number[part[i]]] < 0) normal[i] = -normal[i];
  });
}

/// Turns normals to the side of given ones; returns which points have one.
std::vector<bool> align(const Array<Vec3f>& previous, Array<Vec3f>& normal) {
  std::vector<bool> given(previous.size());
  for (std::size_t i = 0; i < previous.size(); ++i) {
    if (!previous[i].allFinite() || previous[i].isZero(0) || normal[i].isZero(0)) continue;
    if (normal[i].dot(previous[i]) < 0) normal[i] = -normal[i];
    given[i] = true;
  }
  return given;
}

}  // namespace

std::vector<std::string> OrientationOptions::problems() const {
  std::vector<std::string> found;
  if (viewpoint && !viewpoint->allFinite())
    found.emplace_back("`viewpoint` must be three finite numbers");
  if (!up.allFinite() || up.isZero(0)) found.emplace_back("`up` must be finite and not zero");
  return found;
}

OrientationReport orient_normals(const Array<Vec3f>& position, const Vec3d& origin,
                                 const NeighborSearch& search, const Array<Vec3f>& previous,
                                 const OrientationOptions& options, Array<Vec3f>& normal) {
  require_usable(options);
  OrientationReport report;
  const std::size_t count = position.size();
  // Turning a normal changes the sign of its x, of a zero too.
  Array<std::uint8_t> before(count);
  const auto negative = [&](std::size_t i) { return std::signbit(normal[i].x()) ? 1 : 0; };
  parallel_each(count, kOrientationGrain,
                [&](std::size_t i) { before[i] = static_cast<std::uint8_t>(negative(i)); });
  switch (options.method) {
    case Orientation::kNone:
      break;
    case Orientation::kViewpoint:
    case Orientation::kUp: {
      const bool up = options.method == Orientation::kUp;
      const bool several = !up && !options.viewpoint;
      if (several && previous.size() != count) {
        throw_usage("`viewpoint` is not given, and the points do not tell it; give three numbers");
      }
      const Vec3d eye = options.viewpoint.value_or(Vec3d(0, 0, 0)) - origin;
      parallel_each(count, kOrientationGrain, [&](std::size_t i) {
        const Vec3d to = up        ? options.up
                         : several ? Vec3d(previous[i].cast<double>())
                                   : Vec3d(eye - position[i].cast<double>());
        if (normal[i].cast<double>().dot(to) < 0) normal[i] = -normal[i];
      });
      break;
    }
    case Orientation::kMst:
    case Orientation::kOutward:
    case Orientation::kAlign: {
      Spreader spreader(position, search, normal);
      if (options.method == Orientation::kAlign) spreader.settle(align(previous, normal));
      spreader.spread();
      report.components = spreader.parts();
      const Array<std::uint32_t>& part = spreader.part();
      const std::uint32_t settled = spreader.settled() == kNone ? kNone : part[spreader.settled()];
      turn_parts(position, part, settled, options.method, normal);
      break;
    }
  }
  const auto unknown = [&](std::size_t i) { return normal[i].isZero(0); };
  report.unknown = count_where(count, unknown);
  report.flipped =
      count_where(count, [&](std::size_t i) { return !unknown(i) && negative(i) != before[i]; });
  return report;
}

}  // namespace surfel
