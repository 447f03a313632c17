#include <algorithm>
#include <cmath>
#include <numeric>

#include <surfel/base/option_check.h>
#include <surfel/lod/surfel_partition.h>

namespace surfel {
namespace {

/// A group with a conflict counts as this many times as large: surfels that must not be merged are
/// cut apart before any group that is less than four times as long is cut.
constexpr float kConflictSize = 4;
/// A group with a conflict is cut between the conflicting normals or sheets once it is no longer
/// than this many mean groups; in longer groups normals differ because the surface is curved.
constexpr float kConflictReach = 3;

/// Direction of the largest variance of a covariance (xx xy xz yy yz zz), by power iteration from
/// its longest column, and that variance.
std::pair<Vec3f, float> principal_direction(const std::array<float, 6>& c) {
  Eigen::Matrix3f C;
  C << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
  Eigen::Index longest = 0;
  C.colwise().squaredNorm().maxCoeff(&longest);
  Vec3f v = C.col(longest);
  // A direction that is not quite the longest makes a slightly longer piece, no more.
  constexpr int kSteps = 6;
  for (int i = 0; i < kSteps; ++i) {
    const float length = v.norm();
    if (!(length > 0)) return {Vec3f(0, 0, 0), 0.0F};
    v = C * (v / length);
  }
  const float length = v.norm();
  if (!(length > 0)) return {Vec3f(0, 0, 0), 0.0F};
  return {v / length, length};
}

}  // namespace

SurfelPartition::Group SurfelPartition::measure(std::uint32_t begin, std::uint32_t end) const {
  Group group{begin, end, 0, 0, false, Vec3f(0, 0, 0), Vec3f(0, 0, 0)};
  const Member& first = surfels_[order_[begin]];
  if (end - begin == 1) {
    group.extent2 = first.extent2;
    return group;
  }
  float weights = 0;
  Vec3f offset(0, 0, 0);
  Vec3f normal(0, 0, 0);
  float extent2 = 0;
  for (std::uint32_t k = begin; k < end; ++k) {
    const Member& s = surfels_[order_[k]];
    // Areas of zero must not leave a group without a mean.
    const float w = s.area + 1e-6F * piece2_;
    weights += w;
    offset += w * (s.position - first.position);
    normal += w * s.normal;
    extent2 += w * s.extent2;
    group.conflict = group.conflict || s.material != first.material || s.oriented != first.oriented;
  }
  if (!(weights > 0)) weights = 1;
  offset /= weights;
  group.mean = first.position + offset;
  const float length = normal.norm();
  if (length > 0) normal /= length;

  // Covariance with offsets along the normal stretched.
  std::array<float, 6> c{};
  float least_cosine = 1;
  for (std::uint32_t k = begin; k < end; ++k) {
    const Member& s = surfels_[order_[k]];
    const float w = (s.area + 1e-6F * piece2_) / weights;
    const Vec3f d = s.position - first.position - offset;
    const Vec3f e = d + (stretch_ - 1) * normal.dot(d) * normal;
    c[0] += w * e.x() * e.x();
    c[1] += w * e.x() * e.y();
    c[2] += w * e.x() * e.z();
    c[3] += w * e.y() * e.y();
    c[4] += w * e.y() * e.z();
    c[5] += w * e.z() * e.z();
    if (s.oriented) least_cosine = std::min(least_cosine, normal.dot(s.normal));
  }
  group.conflict = group.conflict || least_cosine < normal_cosine_;
  const auto [direction, variance] = principal_direction(c);
  group.cut = direction + (stretch_ - 1) * normal.dot(direction) * normal;
  // A uniform piece of length l has the variance l^2 / 12.
  group.extent2 = 12 * variance + extent2 / weights;
  group.badness = group.extent2 * (group.conflict ? kConflictSize * kConflictSize : 1.0F);
  return group;
}

/// Brings the members of one side to the front, both sides in their order; returns where the other
/// side begins. Where all are on one side, the halves are the sides.
template <class Side>
std::uint32_t SurfelPartition::divide(const Group& group, Side side) {
  scratch_.clear();
  std::uint32_t middle = group.begin;
  for (std::uint32_t k = group.begin; k < group.end; ++k) {
    const std::uint32_t i = order_[k];
    if (side(surfels_[i])) {
      order_[middle++] = i;
    } else {
      scratch_.push_back(i);
    }
  }
  std::copy(scratch_.begin(), scratch_.end(), order_.begin() + middle);
  if (middle == group.begin || middle == group.end) {
    return group.begin + (group.end - group.begin) / 2;
  }
  return middle;
}

std::uint32_t SurfelPartition::cut_conflict(const Group& group) {
  const Member& first = surfels_[order_[group.begin]];
  const auto like_first = [&](const Member& s) {
    return s.material == first.material && s.oriented == first.oriented;
  };
  const auto members = this->order_.begin();
  if (!std::all_of(members + group.begin, members + group.end,
                   [&](std::uint32_t i) { return like_first(surfels_[i]); })) {
    return divide(group, like_first);
  }
  // Two normals far from each other, and the members that are closer to either.
  const auto farthest_from = [&](const Vec3f& normal) {
    Vec3f found = normal;
    float least = 2;
    for (std::uint32_t k = group.begin; k < group.end; ++k) {
      const Vec3f& n = surfels_[order_[k]].normal;
      if (n.dot(normal) < least) {
        least = n.dot(normal);
        found = n;
      }
    }
    return found;
  };
  const Vec3f a = farthest_from(first.normal);
  const Vec3f b = farthest_from(a);
  return divide(group, [&](const Member& s) { return s.normal.dot(a) > s.normal.dot(b); });
}

std::uint32_t SurfelPartition::cut(const Group& group) {
  if (group.conflict && group.extent2 <= kConflictReach * kConflictReach * piece2_) {
    return cut_conflict(group);
  }
  return divide(group, [&](const Member& s) { return group.cut.dot(s.position - group.mean) < 0; });
}

void SurfelPartition::run(std::span<const MergeSurfel> surfels, std::size_t groups,
                          const SheetRules& rules) {
  require_usable(rules);
  normal_cosine_ = rules.least_cosine();
  stretch_ = static_cast<float>(rules.sheet_weight);
  float area = 0;
  surfels_.clear();
  for (const MergeSurfel& s : surfels) {
    surfels_.push_back({s.position, s.area, s.normal, s.extent2, s.material, !s.normal.isZero()});
    area += s.area;
  }
  piece2_ = area / static_cast<float>(groups);

  order_.resize(surfels.size());
  std::iota(order_.begin(), order_.end(), 0U);
  groups_.clear();
  groups_.push_back(measure(0, static_cast<std::uint32_t>(surfels.size())));
  heap_.assign(1, 0);
  const auto less = [&](std::uint32_t a, std::uint32_t b) {
    return groups_[a].badness != groups_[b].badness ? groups_[a].badness < groups_[b].badness
                                                    : a > b;
  };
  while (groups_.size() < groups) {
    std::pop_heap(heap_.begin(), heap_.end(), less);
    const std::uint32_t worst = heap_.back();
    heap_.pop_back();
    const Group group = groups_[worst];
    const std::uint32_t middle = cut(group);
    groups_[worst] = measure(group.begin, middle);
    groups_.push_back(measure(middle, group.end));
    for (const std::uint32_t part : {worst, static_cast<std::uint32_t>(groups_.size() - 1)}) {
      if (groups_[part].end - groups_[part].begin < 2) continue;
      heap_.push_back(part);
      std::push_heap(heap_.begin(), heap_.end(), less);
    }
  }
  // In the order of the surfels, so that neighbours stay so from level to level.
  std::sort(groups_.begin(), groups_.end(),
            [](const Group& a, const Group& b) { return a.begin < b.begin; });
}

}  // namespace surfel
