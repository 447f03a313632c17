// Zhang, Pajarola 2006, Single-Pass Point Rendering and Transparent Shading, section 4.2.2 (SP06).

#include <algorithm>
#include <functional>
#include <numbers>
#include <queue>
#include <vector>

#include <surfel/sp06/disc_area.h>
#include <surfel/sp06/duplication.h>

namespace surfel {
namespace {

/// A group that grows.
class GrowingGroup {
 public:
  GrowingGroup(const Discs& discs, const DiscTree& tree)
      : discs_(discs), tree_(tree), is_member_(discs.size()), has_members_(tree.node_count()) {}

  void add(std::uint32_t disc) {
    is_member_[disc] = true;
    tree_.for_each_node_above(disc, [&](std::size_t node) { has_members_[node] = true; });
  }
  bool contains(std::uint32_t disc) const { return is_member_[disc]; }

  /// Area that adding the disc would newly cover, unit^2.
  double gain(std::uint32_t disc) {
    const TangentPlane plane(discs_, disc);
    const Vec3f& center = discs_.center[disc];
    const auto radius = static_cast<double>(discs_.radius[disc]);
    overlapping_.clear();
    bool covered = false;
    const auto enter = [&](const DiscTree::Node& node, std::size_t number, float distance2) {
      const double reach = radius + static_cast<double>(node.radius());
      return !covered && has_members_[number] &&
             static_cast<double>(distance2) <= kBoxRounding * reach * reach;
    };
    const auto visit = [&](std::size_t j) {
      Vec2d place;
      if (covered || !is_member_[j] || !plane.unfold(discs_.center[j], discs_.normal[j], place)) {
        return;
      }
      const auto other = static_cast<double>(discs_.radius[j]);
      const double distance2 = place.squaredNorm();
      if (distance2 >= (radius + other) * (radius + other)) return;
      covered = other >= radius && distance2 <= (other - radius) * (other - radius);
      overlapping_.push_back({place, other});
    };
    tree_.search_around(disc, center, enter, visit);
    if (covered) return 0;
    return uncovered_({Vec2d(0, 0), radius}, overlapping_);
  }

 private:
  const Discs& discs_;
  const DiscTree& tree_;
  std::vector<bool> is_member_;
  /// By node of the tree: whether a disc of the group lies below it.
  std::vector<bool> has_members_;
  std::vector<Circle> overlapping_;
  UncoveredDiscArea uncovered_;
};

struct Candidate {
  double gain;
  std::uint32_t disc;
  /// Is it behind the other in the queue?
  bool operator<(const Candidate& other) const {
    return gain != other.gain ? gain < other.gain : disc > other.disc;
  }
};

}  // namespace

Duplication::Duplication(const Discs& discs, double least_gain)
    : discs_(discs), candidates_(distinct_discs(discs)), tree_(discs), least_gain_(least_gain) {}

Array<std::uint32_t> Duplication::discs_to_add(std::span<const std::uint32_t> members) const {
  GrowingGroup group(discs_, tree_);
  for (const std::uint32_t disc : members) group.add(disc);
  const auto worth = [&](double gain, std::uint32_t disc) {
    const auto radius = static_cast<double>(discs_.radius[disc]);
    return gain > least_gain_ * std::numbers::pi * radius * radius;
  };
  std::vector<Candidate> first;
  for (const std::uint32_t disc : candidates_) {
    if (group.contains(disc)) continue;
    const double gain = group.gain(disc);
    if (worth(gain, disc)) first.push_back({gain, disc});
  }
  std::priority_queue<Candidate> queue(std::less<Candidate>{}, std::move(first));
  Array<std::uint32_t> added;
  while (!queue.empty()) {
    const std::uint32_t disc = queue.top().disc;
    queue.pop();
    const Candidate now{group.gain(disc), disc};
    if (!worth(now.gain, disc)) continue;
    if (!queue.empty() && now < queue.top()) {
      queue.push(now);
      continue;
    }
    group.add(disc);
    added.push_back(disc);
  }
  std::sort(added.begin(), added.end());
  return added;
}

}  // namespace surfel
