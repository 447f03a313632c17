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

/// Direction of the largest variance of a covariance, and that variance; zeros if it has none.
std::pair<Vec3f, float> principal_direction(const Eigen::Matrix3f& covariance) {
  const float trace = covariance.trace();
  if (!(trace > 0)) return {Vec3f(0, 0, 0), 0.0F};
  // The longest column of the fourth power points nearly along it. Where no direction is much
  // longer than the others it lies nearer to an axis of space than the eigenvector does, so that
  // groups side by side are cut alike.
  const Eigen::Matrix3f scaled = covariance / trace;
  const Eigen::Matrix3f square = scaled.lazyProduct(scaled);
  const Eigen::Matrix3f power = square.lazyProduct(square);
  Eigen::Index longest = 0;
  const float length2 = power.colwise().squaredNorm().maxCoeff(&longest);
  if (!(length2 > 0)) return {Vec3f(0, 0, 0), 0.0F};
  const Vec3f direction = power.col(longest) / std::sqrt(length2);
  return {direction, (covariance * direction).norm()};
}

}  // namespace

SurfelPartition::Group SurfelPartition::measure(std::uint32_t begin, std::uint32_t end) const {
  using Vec4f = Eigen::Vector4f;
  Group group{begin, end, 0, 0, false, Vec4f::Zero(), Vec4f::Zero()};
  const Member& first = surfels_[order_[begin]];
  if (end - begin == 1) {
    group.extent2 = first.facing[3];
    return group;
  }
  // Moments about the first position; the last number of each sum of places means nothing.
  float weights = 0;
  Vec4f offset = Vec4f::Zero();
  Vec4f facing = Vec4f::Zero();
  Vec4f by_x = Vec4f::Zero();
  Vec4f by_y = Vec4f::Zero();
  Vec4f by_z = Vec4f::Zero();
  for (std::uint32_t k = begin; k < end; ++k) {
    const Member& s = surfels_[order_[k]];
    // Areas of zero must not leave a group without a mean.
    const float w = s.area() + 1e-6F * piece2_;
    const Vec4f d = s.place - first.place;
    const Vec4f weighted = w * d;
    weights += w;
    offset += weighted;
    facing += w * s.facing;
    by_x += d[0] * weighted;
    by_y += d[1] * weighted;
    by_z += d[2] * weighted;
    group.conflict = group.conflict || s.material != first.material || s.oriented != first.oriented;
  }
  if (!(weights > 0)) weights = 1;
  offset /= weights;
  group.mean = first.place + offset;
  Vec3f normal = facing.head<3>();
  const float length = normal.norm();
  if (length > 0) normal /= length;
  float least_cosine = 1;
  for (std::uint32_t k = begin; k < end; ++k) {
    const Member& s = surfels_[order_[k]];
    if (s.oriented) least_cosine = std::min(least_cosine, normal.dot(s.facing.head<3>()));
  }
  group.conflict = group.conflict || least_cosine < normal_cosine_;

  Eigen::Matrix3f covariance;
  covariance << by_x.head<3>(), by_y.head<3>(), by_z.head<3>();
  const Vec3f mean = offset.head<3>();
  covariance = covariance / weights - mean * mean.transpose();
  // Offsets along the normal are stretched.
  const Eigen::Matrix3f stretched =
      Eigen::Matrix3f::Identity() + (stretch_ - 1) * normal * normal.transpose();
  covariance = Eigen::Matrix3f(stretched.lazyProduct(covariance)).lazyProduct(stretched).eval();
  const auto [direction, variance] = principal_direction(covariance);
  group.cut.head<3>() = direction + (stretch_ - 1) * normal.dot(direction) * normal;
  // A uniform piece of length l has the variance l^2 / 12.
  group.extent2 = 12 * variance + facing[3] / weights;
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
      const Vec3f n = surfels_[order_[k]].facing.head<3>();
      if (n.dot(normal) < least) {
        least = n.dot(normal);
        found = n;
      }
    }
    return found;
  };
  const Vec3f a = farthest_from(first.facing.head<3>());
  const Vec3f b = farthest_from(a);
  return divide(group, [&](const Member& s) {
    const Vec3f normal = s.facing.head<3>();
    return normal.dot(a) > normal.dot(b);
  });
}

std::uint32_t SurfelPartition::cut(const Group& group) {
  if (group.conflict && group.extent2 <= kConflictReach * kConflictReach * piece2_) {
    return cut_conflict(group);
  }
  return divide(group, [&](const Member& s) { return group.cut.dot(s.place - group.mean) < 0; });
}

void SurfelPartition::run(std::span<const MergeSurfel> surfels, std::size_t groups,
                          const SheetRules& rules) {
  require_usable(rules);
  normal_cosine_ = rules.least_cosine();
  stretch_ = static_cast<float>(rules.sheet_weight);
  float area = 0;
  surfels_.clear();
  for (const MergeSurfel& s : surfels) {
    surfels_.push_back({{s.position.x(), s.position.y(), s.position.z(), s.area},
                        {s.normal.x(), s.normal.y(), s.normal.z(), s.extent2},
                        s.material,
                        !s.normal.isZero()});
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
