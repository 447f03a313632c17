#include <algorithm>
#include <limits>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/radix_sort.h>
#include <surfel/base/random.h>
#include <surfel/simplify/edges.h>
#include <surfel/simplify/sheet_clusters.h>

namespace surfel {
namespace {

/// Where there are too few seeds, further ones are let in at smaller squared distances, by the
/// seed's radius: each round at kCloser times the distance of the round before, down to kClosest,
/// and then at any distance. Larger factors fill up more evenly and take more rounds.
constexpr float kCloser = 0.8F;
constexpr float kClosest = 1e-3F;

class Clusterer {
 public:
  Clusterer(const SurfelCloud& cloud, const NeighborSearch& search, const Array<float>& radius,
            const SheetRules& rules, std::span<const LinedSurfel> edges)
      : cloud_(cloud),
        search_(search),
        radius_(radius),
        surfels_(edges),
        least_cosine_(rules.least_cosine()),
        stretch2_(static_cast<float>(rules.sheet_weight * rules.sheet_weight - 1)),
        nearest2_(cloud.size(), std::numeric_limits<float>::infinity()),
        seed_of_(cloud.size()) {}

  /// Makes surfels seeds, up to `most`, that are at least this far, squared and by radii, from all
  /// seeds.
  void throw_darts(const Array<std::uint32_t>& order, float least2, std::size_t most) {
    for (const std::uint32_t i : order) {
      if (seeds_ >= most) return;
      if (nearest2_[i] >= least2 && !is_seed(i)) add_seed(i);
    }
  }

  std::size_t seeds() const { return seeds_; }

  SheetClusters clusters() const {
    SheetClusters out;
    const std::size_t count = cloud_.size();
    Array<std::uint32_t> number(count);
    for (std::uint32_t i = 0; i < count; ++i) {
      if (!is_seed(i)) continue;
      number[i] = static_cast<std::uint32_t>(out.seed.size());
      out.seed.push_back(i);
    }
    out.begin.assign(out.seed.size() + 1, 0);
    for (std::size_t i = 0; i < count; ++i) ++out.begin[number[seed_of_[i]] + 1];
    for (std::size_t c = 0; c < out.size(); ++c) out.begin[c + 1] += out.begin[c];
    out.member.resize(count);
    Array<std::uint64_t> next = out.begin;
    for (std::uint32_t i = 0; i < count; ++i) out.member[next[number[seed_of_[i]]]++] = i;
    return out;
  }

 private:
  bool is_seed(std::uint32_t i) const { return nearest2_[i] == kSeed; }

  void add_seed(std::uint32_t i) {
    ++seeds_;
    const Vec3f& n = cloud_.normal[i];
    const float r = radius_[i];
    if (r > 0 && n.squaredNorm() > 0) {
      search_.within(cloud_.position[i], r, cloud_.size(), near_);
      if (!surfels_.empty()) edges_.start(surfels_, i, n);
      for (const Neighbor& neighbor : near_) join(neighbor, i, 1 / (r * r));
    }
    nearest2_[i] = kSeed;
    seed_of_[i] = i;
  }

  void join(const Neighbor& neighbor, std::uint32_t seed, float by_radius2) {
    const std::uint32_t k = neighbor.index;
    const Vec3f& n = cloud_.normal[seed];
    // An unknown normal has a cosine of 0, which may be the least cosine, too.
    const float cosine = n.dot(cloud_.normal[k]);
    if (!(cosine >= least_cosine_) || cloud_.normal[k].squaredNorm() == 0) return;
    if (!cloud_.material.empty() && cloud_.material[k] != cloud_.material[seed]) return;
    const float height = n.dot(cloud_.position[k] - cloud_.position[seed]);
    const float d2 = (neighbor.distance2 + stretch2_ * height * height) * by_radius2;
    if (d2 > 1) return;
    if (!surfels_.empty() && k != seed) {
      if (d2 >= nearest2_[k] || !edges_.admits(k)) {
        edges_.add_wall(k);
        return;
      }
      edges_.add_member(k);
    }
    if (d2 >= nearest2_[k]) return;
    nearest2_[k] = d2;
    seed_of_[k] = seed;
  }

  static constexpr float kSeed = -1;

  const SurfelCloud& cloud_;
  const NeighborSearch& search_;
  const Array<float>& radius_;
  std::span<const LinedSurfel> surfels_;  ///< Empty where no surfel is cut.
  float least_cosine_;
  float stretch2_;
  std::size_t seeds_ = 0;
  Array<float> nearest2_;  ///< Squared distance to a seed, by the seed's radius; kSeed for seeds.
  Array<std::uint32_t> seed_of_;
  std::vector<Neighbor> near_;
  ClusterEdges edges_;  ///< Of the seed that surfels join.
};

}  // namespace

SheetClusters cluster_sheets(const SurfelCloud& cloud, const NeighborSearch& search,
                             const Array<float>& radius, const SheetRules& rules,
                             std::uint64_t random_seed, std::size_t fill_to,
                             std::span<const LinedSurfel> edges) {
  require_usable(rules);
  Array<std::uint64_t> key(cloud.size());
  for (std::size_t i = 0; i < key.size(); ++i) key[i] = random_bits(random_seed, i);
  const Array<std::uint32_t> order = sort_keys(key);
  Clusterer clusterer(cloud, search, radius, rules, edges);
  clusterer.throw_darts(order, 1, cloud.size());
  const std::size_t wanted = std::min(fill_to, cloud.size());
  for (float least2 = kCloser; clusterer.seeds() < wanted; least2 *= kCloser) {
    clusterer.throw_darts(order, least2 > kClosest ? least2 : 0, wanted);
  }
  return clusterer.clusters();
}

}  // namespace surfel
