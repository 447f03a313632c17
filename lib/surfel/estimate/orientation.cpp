#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/orientation.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1024;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr float kLongestWeight = 65535;
/// Edges steeper than 51 degrees to a tangent plane lead to another sheet: across a right-angled
/// bend there are always some of 45.
constexpr float kSteepestSine2 = 0.6F;
/// Weight of what is no edge: above those that there are.
constexpr float kNoEdge = 2;
/// Bends by more than 45 degrees need the edge to tell the side: the normals' own product is near
/// zero, its sign chance.
constexpr float kBend = 0.7F;
/// Parts are joined by edges below this weight among that many nearest points, in that many rounds.
constexpr float kJoinWeight = 0.1F;
constexpr std::size_t kJoinNeighbors = 64;
constexpr int kJoinRounds = 8;

/// Disjoint sets of points [Tarjan 1975], each with a sign relative to its set's root.
class SignedSets {
 public:
  explicit SignedSets(std::size_t count) : parent_(count), opposed_(count), rank_(count) {
    for (std::size_t i = 0; i < count; ++i) {
      parent_[i] = static_cast<std::uint32_t>(i);
      opposed_[i] = 0;
      rank_[i] = 0;
    }
  }

  struct Root {
    std::uint32_t index;
    bool opposed;  ///< The point's sign is the other than its root's.
  };

  /// Halves the path as it goes.
  Root find(std::uint32_t i) {
    bool opposed = false;
    while (parent_[i] != i) {
      const std::uint32_t parent = parent_[i];
      if (parent_[parent] != parent) {
        opposed_[i] ^= opposed_[parent];
        parent_[i] = parent_[parent];
      }
      opposed ^= opposed_[i] != 0;
      i = parent_[i];
    }
    return {i, opposed};
  }

  /// Calls opposed() for whether i and j have different signs, unless they are in one set already.
  template <class Opposed>
  void unite(std::uint32_t i, std::uint32_t j, Opposed&& opposed) {
    Root a = find(i);
    Root b = find(j);
    if (a.index == b.index) return;
    if (rank_[a.index] < rank_[b.index]) std::swap(a, b);
    if (rank_[a.index] == rank_[b.index]) ++rank_[a.index];
    parent_[b.index] = a.index;
    opposed_[b.index] = static_cast<std::uint8_t>(a.opposed ^ b.opposed ^ opposed());
  }

 private:
  Array<std::uint32_t> parent_;
  Array<std::uint8_t> opposed_;
  Array<std::uint8_t> rank_;
};

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
  /// A point that is settled, or kNone.
  std::uint32_t settled() const { return settled_; }

  /// Turns the normals of each part to one side, whichever that is unless points are settled.
  void spread(std::size_t neighbors) {
    if (position_.size() * neighbors <= kNone) {
      join_neighbors<std::uint32_t>(neighbors);
    } else {
      join_neighbors<std::uint64_t>(neighbors);
    }
    for (int round = 0; round < kJoinRounds; ++round) {
      if (!join_parts()) break;
    }
    const SignedSets::Root right =
        settled_ == kNone ? SignedSets::Root{kNone, false} : sets_.find(settled_);
    for (std::uint32_t i = 0; i < position_.size(); ++i) {
      const SignedSets::Root root = sets_.find(i);
      if (root.opposed != (root.index == right.index && right.opposed)) normal_[i] = -normal_[i];
    }
  }

  bool known(std::size_t i) const { return !normal_[i].isZero(0); }
  std::uint32_t part(std::uint32_t i) { return sets_.find(i).index; }

 private:
  /// In 0..1, see orient_normals(), or kNoEdge.
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
  /// bends that of n_j and n_i mirrored at the plane half-way between the points.
  float agreement(std::size_t i, std::size_t j) const {
    const float product = normal_[i].dot(normal_[j]);
    const Vec3f edge = position_[j] - position_[i];
    const float length2 = edge.squaredNorm();
    if (std::abs(product) >= kBend || !(length2 > 0)) return product;
    const float mirrored = product - 2 * edge.dot(normal_[i]) * edge.dot(normal_[j]) / length2;
    return std::abs(mirrored) > std::abs(product) ? mirrored : product;
  }

  bool opposed(std::size_t i, std::size_t j) const { return agreement(i, j) < 0; }

  /// Kruskal's algorithm over the edges to the nearest points; edge e is of point e / neighbors,
  /// and Edge a type that counts them.
  template <class Edge>
  void join_neighbors(std::size_t neighbors) {
    const std::size_t count = position_.size() * neighbors;
    Array<std::uint32_t> to(count);
    Array<std::uint16_t> length(count);
    search_.for_each_nearest(
        neighbors + 1, [&](std::size_t i, std::span<const Neighbor> near, int) {
          std::size_t e = i * neighbors;
          const std::size_t end = e + neighbors;
          for (const Neighbor& n : near) {
            if (n.index == i || e == end || !known(i) || !known(n.index)) continue;
            const float w = weight(i, n.index);
            if (w == kNoEdge) continue;
            to[e] = n.index;
            length[e++] = static_cast<std::uint16_t>(std::lround(w * kLongestWeight));
          }
          for (; e < end; ++e) {
            to[e] = kNone;
            length[e] = 0;
          }
        });
    // Edges by weight, equal ones by index.
    std::vector<std::size_t> begin(65537);
    for (const std::uint16_t l : length) ++begin[l + 1U];
    for (std::size_t l = 0; l + 1 < begin.size(); ++l) begin[l + 1] += begin[l];
    Array<Edge> sorted(count);
    for (std::size_t e = 0; e < count; ++e) sorted[begin[length[e]]++] = static_cast<Edge>(e);
    for (const Edge e : sorted) {
      const auto from = static_cast<std::uint32_t>(e / neighbors);
      if (to[e] != kNone) sets_.unite(from, to[e], [&] { return opposed(from, to[e]); });
    }
  }

  /// Joins parts to others near them. Did any?
  bool join_parts() {
    const std::size_t count = position_.size();
    Array<std::uint32_t> part_of(count);
    std::unordered_map<std::uint32_t, std::size_t> sizes;
    for (std::uint32_t i = 0; i < count; ++i) {
      part_of[i] = part(i);
      if (known(i)) ++sizes[part_of[i]];
    }
    if (sizes.size() < 2) return false;
    // The largest part waits for the others to come to it.
    std::uint32_t largest = kNone;
    for (std::uint32_t i = 0; i < count; ++i) {
      if (known(i) && (largest == kNone || sizes[part_of[i]] > sizes[largest])) {
        largest = part_of[i];
      }
    }
    struct Join {
      float weight;
      std::uint32_t from, to;
    };
    std::vector<std::vector<Join>> found((count + kGrain - 1) / kGrain);
    parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end, int) {
      std::vector<Neighbor> near;
      for (std::size_t i = begin; i < end; ++i) {
        if (!known(i) || part_of[i] == largest) continue;
        search_.nearest(position_[i], kJoinNeighbors, near);
        Join best{kJoinWeight, static_cast<std::uint32_t>(i), kNone};
        for (const Neighbor& n : near) {
          if (!known(n.index) || part_of[n.index] == part_of[i]) continue;
          const float w = weight(i, n.index);
          if (w < best.weight) {
            best.weight = w;
            best.to = n.index;
          }
        }
        if (best.to != kNone) found[begin / kGrain].push_back(best);
      }
    });
    std::vector<Join> joins;
    for (const auto& some : found) joins.insert(joins.end(), some.begin(), some.end());
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

/// Turns whole parts but `settled`: a part's extreme point in a direction looks there, if any.
void turn_parts(const Array<Vec3f>& position, const Array<std::uint32_t>& part,
                std::uint32_t settled, Orientation method, Array<Vec3f>& normal) {
  std::unordered_map<std::uint32_t, double> vote;
  for (const Vec3f& d : probes(method)) {
    std::unordered_map<std::uint32_t, std::uint32_t> extreme;
    for (std::uint32_t i = 0; i < position.size(); ++i) {
      if (normal[i].isZero(0)) continue;
      const auto [at, fresh] = extreme.try_emplace(part[i], i);
      if (!fresh && position[i].dot(d) > position[at->second].dot(d)) at->second = i;
    }
    for (const auto& [root, i] : extreme) vote[root] += static_cast<double>(normal[i].dot(d));
  }
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (normal[i].isZero(0) || part[i] == settled) continue;
    if (vote[part[i]] < 0) normal[i] = -normal[i];
  }
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
  if (!viewpoint.allFinite()) found.emplace_back("viewpoint must be three finite numbers");
  if (!up.allFinite() || up.isZero(0)) found.emplace_back("up must be finite and not zero");
  if (neighbors < 2 || neighbors > 64) {
    found.push_back(fmt::format("orient-k is {}; it must be in 2..64", neighbors));
  }
  return found;
}

OrientationReport orient_normals(const Array<Vec3f>& position, const Vec3d& origin,
                                 const NeighborSearch& search, const Array<Vec3f>& previous,
                                 const OrientationOptions& options, Array<Vec3f>& normal) {
  for (const std::string& problem : options.problems()) throw_usage(problem);
  OrientationReport report;
  const std::size_t count = position.size();
  // Turning a normal changes the sign of its x, of a zero too.
  std::vector<bool> before(count);
  for (std::size_t i = 0; i < count; ++i) before[i] = std::signbit(normal[i].x());
  switch (options.method) {
    case Orientation::kNone:
      break;
    case Orientation::kViewpoint:
    case Orientation::kUp: {
      const bool towards_point = options.method == Orientation::kViewpoint;
      const Vec3d eye = options.viewpoint - origin;
      parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t i = begin; i < end; ++i) {
          const Vec3d to = towards_point ? Vec3d(eye - position[i].cast<double>()) : options.up;
          if (normal[i].cast<double>().dot(to) < 0) normal[i] = -normal[i];
        }
      });
      break;
    }
    case Orientation::kMst:
    case Orientation::kOutward:
    case Orientation::kAlign: {
      Spreader spreader(position, search, normal);
      if (options.method == Orientation::kAlign) spreader.settle(align(previous, normal));
      spreader.spread(static_cast<std::size_t>(options.neighbors));
      Array<std::uint32_t> part(count);
      for (std::uint32_t i = 0; i < count; ++i) {
        part[i] = spreader.part(i);
        if (part[i] == i && spreader.known(i)) ++report.components;
      }
      const std::uint32_t settled = spreader.settled() == kNone ? kNone : part[spreader.settled()];
      turn_parts(position, part, settled, options.method, normal);
      break;
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    const bool unknown = normal[i].isZero(0);
    report.unknown += unknown ? 1 : 0;
    report.flipped += !unknown && std::signbit(normal[i].x()) != before[i] ? 1 : 0;
  }
  return report;
}

}  // namespace surfel
