#pragma once

// Where the points lie that the estimates of some points need.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

/// Points of a box, and of what lies no further than `reach` from it.
struct Region {
  Vec3f low, high;
  float reach = 0;

  /// Does the box with its reach touch another box?
  bool touches(const Vec3f& other_low, const Vec3f& other_high) const {
    constexpr float kRounding = 1 + 1e-5F;
    const Vec3f gap = (low - other_high).cwiseMax(other_low - high).cwiseMax(0.0F);
    return gap.norm() <= reach * kRounding;
  }
  /// How far all points around a point are known where the points of this region are; below zero
  /// outside of its reach.
  float known_around(const Vec3f& p) const {
    constexpr float kRounding = 1e-5F;
    const Vec3f gap = (low - p).cwiseMax(p - high);
    const float most = gap.maxCoeff();
    // Most points are far outside, which is told without their distance.
    if (most > reach) return -1;
    // Inside the box this is less than zero, by the distance to the nearest side.
    const float outside = most <= 0 ? most : gap.cwiseMax(0.0F).norm();
    if (outside > reach) return -1;
    return std::max(0.0F, reach - outside - kRounding * (reach + std::abs(outside)));
  }
};

/// Regions, in the order of a space-filling curve as far as possible, with the boxes of some
/// consecutive ones.
class Regions {
 public:
  void add(const Region& region) {
    if (region_.size() % kGroup == 0) group_.push_back(region);
    Region& group = group_.back();
    group.low = group.low.cwiseMin(region.low);
    group.high = group.high.cwiseMax(region.high);
    group.reach = std::max(group.reach, region.reach);
    region_.push_back(region);
  }

  /// The regions that touch a box.
  void touching(const Vec3f& low, const Vec3f& high, std::vector<const Region*>& out) const {
    out.clear();
    find(low, high, [&](const Region& region) {
      out.push_back(&region);
      return true;
    });
  }
  /// Does one of them touch a box?
  bool touch(const Vec3f& low, const Vec3f& high) const {
    return !find(low, high, [](const Region&) { return false; });
  }

 private:
  /// Calls visit(region) for the regions that touch a box until it returns false; did it never?
  template <class Visit>
  bool find(const Vec3f& low, const Vec3f& high, const Visit& visit) const {
    for (std::size_t g = 0; g < group_.size(); ++g) {
      if (!group_[g].touches(low, high)) continue;
      const std::size_t end = std::min((g + 1) * kGroup, region_.size());
      for (std::size_t r = g * kGroup; r < end; ++r) {
        if (region_[r].touches(low, high) && !visit(region_[r])) return false;
      }
    }
    return true;
  }

  static constexpr std::size_t kGroup = 32;
  std::vector<Region> region_;
  std::vector<Region> group_;
};

}  // namespace surfel
