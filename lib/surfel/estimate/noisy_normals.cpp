#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <vector>

#include <surfel/base/median.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/neighborhood_plane.h>
#include <surfel/estimate/noisy_normals.h>
#include <surfel/estimate/range_normals.h>
#include <surfel/estimate/window_moments.h>

namespace surfel {
namespace {

constexpr std::size_t kSampleGrain = 4;
constexpr std::size_t kRefitGrain = 64;
/// Points that tell noise from shape; that a first look at noise takes, which is slow;
/// most points whose noise is noted, and how many points there are for each of them at least.
constexpr std::size_t kNoiseLook = 128;
constexpr std::size_t kMostNoted = 3072;
constexpr std::size_t kLeastPerNoted = 4;
constexpr std::size_t kLeastNeighbors = 16;
constexpr std::size_t kMostGrown = 1024;
/// A plane is uncertain if its normal's standard error is larger, in radians.
constexpr double kUncertain = 0.1;
constexpr double kLeastUncertainShare = 0.15;
constexpr double kLeastNoisyShare = 1.0 / 3;
/// Larger neighbourhoods do not tell noise from trees and roofs above flat land.
constexpr std::size_t kMostTelling = 512;
/// lambda_0 / lambda_1 that a peak exceeds and that a certain plane stays below, and the share of
/// the peak that it falls below.
constexpr double kFlat = 0.1;
constexpr double kDrop = 0.25;
/// Least noise, in spacings on the plane: less does not hide the surface.
constexpr double kLeastNoise = 0.25;
/// Noted points that a point takes its noise from, and the factor for their extent: more flakes are
/// left with 1 where points are dense, and with 1.2 where they are not.
constexpr std::size_t kNotedAround = 16;
constexpr double kExtentFactor = 1.15;
/// Points that a plane is made from at most, about: more take time and make it no better.
constexpr double kEnough = 128;
/// Points share a window if they are nearer than this to one another, in extents.
constexpr double kSharedReach = 0.8;
/// Refits, the distance from which on a point has no weight in the first of them, in standard
/// deviations of all distances, what it shrinks by in each refit, and where it ends, in standard
/// deviations of the noise.
constexpr int kRefits = 3;
constexpr double kFirstScale = 5;
constexpr double kShrink = 0.6;
constexpr double kLeastScale = 7.5;
/// Distances whose variance exceeds the noise's variance by this factor are not noise alone.
constexpr double kShaped = 1.5;

Vec3d offset_between(const Vec3f& from, const Vec3f& to) {
  return to.cast<double>() - from.cast<double>();
}

/// Is the plane of the points nearest to a place uncertain?
bool uncertain_plane(const Vec3f& place, std::span<const Vec3f> near) {
  Moments moments;
  for (const Vec3f& p : near) moments.add(offset_between(place, p));
  if (!(moments.variance() > 0)) return false;  // Coincident points are not noise.
  const Plane plane = plane_of(moments);
  return plane.thin() || !(plane.error(plane.noise()) <= kUncertain);
}

/// Noise at a point, and the neighbourhood that is large enough for it.
struct NotedNoise {
  float extent = 0;  ///< Distance of the furthest neighbour.
  float noise = 0;   ///< Standard deviation of the distances from the plane.
  std::size_t neighbors = 0;
};

/// The noise at a place, if there is any that the shape can be told from.
std::optional<NotedNoise> noise_at(const Vec3f& place, NearestPlaces nearest,
                                   std::vector<Vec3f>& near) {
  near.clear();
  Moments moments;
  double peak = 0;
  std::size_t added = 0;
  for (std::size_t size = kLeastNeighbors; size <= kMostGrown; size *= 2) {
    // Few points need all neighbours.
    if (near.size() < size) nearest(place, std::min(2 * size, kMostGrown), near);
    if (near.size() < size) break;
    for (; added < size; ++added) moments.add(offset_between(place, near[added]));
    if (!(moments.variance() > 0)) continue;
    const Plane plane = plane_of(moments);
    const double flatness = plane.thin() ? 1 : plane.lambda[0] / plane.lambda[1];
    peak = std::max(peak, flatness);
    if (peak > kFlat && flatness < std::min(kFlat, kDrop * peak)) {
      const float extent = std::sqrt((near[size - 1] - place).squaredNorm());
      const auto noise = static_cast<float>(std::sqrt(plane.lambda[0]));
      const double spacing = extent * std::sqrt(std::numbers::pi / static_cast<double>(size));
      if (noise < kLeastNoise * spacing) return std::nullopt;  // Scan lines are thin, too.
      return NotedNoise{extent, noise, size};
    }
  }
  return std::nullopt;
}

class Remaker {
 public:
  Remaker(const Array<Vec3f>& points, const NeighborSearch& search)
      : points_(points), search_(search) {}

  void run(NormalEstimate& out) {
    if (!note_noise()) return;
    const std::size_t count = points_.size();
    std::vector<std::uint8_t> remade(count);
    out.noise.resize(count);
    parallel_for(count, kRefitGrain, [&](std::size_t begin, std::size_t end, int worker) {
      std::size_t i = begin;
      while (i < end) i += remake(i, end, shared_[worker], out, remade);
    });
    out.remade = static_cast<std::size_t>(std::count(remade.begin(), remade.end(), 1));
  }

 private:
  /// Notes the noise at points spread evenly, and thins the cloud as far as the noise allows; false
  /// if none of them has any.
  bool note_noise() {
    const std::size_t count = std::min(kMostNoted, points_.size() / kLeastPerNoted);
    std::vector<std::optional<NotedNoise>> found(count);
    parallel_for(count, kSampleGrain, [&](std::size_t begin, std::size_t end, int) {
      auto nearest = nearest_places(points_, search_);
      std::vector<Vec3f> near;
      for (std::size_t s = begin; s < end; ++s) {
        found[s] = noise_at(points_[s * points_.size() / count], nearest, near);
      }
    });
    double neighbors = 0;
    for (std::size_t s = 0; s < count; ++s) {
      if (!found[s]) continue;
      noted_at_.push_back(points_[s * points_.size() / count]);
      noted_.push_back(*found[s]);
      neighbors += static_cast<double>(found[s]->neighbors);
    }
    if (noted_.empty()) return false;
    noted_search_ = make_neighbor_search(noted_at_);
    const double around =
        kExtentFactor * kExtentFactor * neighbors / static_cast<double>(noted_.size());
    const auto step = static_cast<std::size_t>(std::max(1.0, around / kEnough));
    for (std::size_t i = 0; i < points_.size(); i += step) thinned_.push_back(points_[i]);
    thinned_search_ = make_neighbor_search(thinned_);
    return true;
  }

  /// Points that share their neighbours.
  struct Group {
    std::vector<Neighbor> near;
    std::vector<float> extents, noises;
    SharedWindow window;
    WindowPoints points;
    WindowMoments moments;
    PlaneBatch planes;
  };

  /// How many points, from `first` on and before `end`, are within `reach` of the first of them.
  std::size_t group_size(std::size_t first, std::size_t end, double reach) const {
    const std::size_t most = std::min(end, first + WindowPoints::kSize);
    std::size_t i = first + 1;
    while (i < most && offset_between(points_[first], points_[i]).squaredNorm() <= reach * reach)
      ++i;
    return i - first;
  }

  /// Makes the normals of a group of points anew, from `first` on and before `end`; notes of which
  /// there are enough points around. Returns how many points the group has.
  std::size_t remake(std::size_t first, std::size_t end, Group& group, NormalEstimate& out,
                     std::vector<std::uint8_t>& remade) const {
    noted_search_->nearest(points_[first], kNotedAround, group.near);
    group.extents.clear();
    group.noises.clear();
    for (const Neighbor& n : group.near) {
      group.extents.push_back(noted_[n.index].extent);
      group.noises.push_back(noted_[n.index].noise);
    }
    const double extent = kExtentFactor * static_cast<double>(median(group.extents));
    const auto noise = static_cast<double>(median(group.noises));
    const std::size_t count = group_size(first, end, kSharedReach * extent);
    Vec3d middle(0, 0, 0);  // All offsets are from the first point.
    for (std::size_t k = 0; k < count; ++k)
      middle += offset_between(points_[first], points_[first + k]);
    middle /= static_cast<double>(count);
    WindowPoints& points = group.points;
    double radius = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const Vec3d p = offset_between(points_[first], points_[first + k]);
      points.x[k] = p.x();
      points.y[k] = p.y();
      points.z[k] = p.z();
      points.reach2[k] = extent * extent;
      points.inverse_scale[k] = 0;
      radius = std::max(radius, (p - middle).norm());
      out.noise[first + k] = static_cast<float>(noise);
    }
    const Vec3f query = (points_[first].cast<double>() + middle).cast<float>();
    thinned_search_->within(query, static_cast<float>(extent + radius), kMostGrown, group.near);
    group.window.clear();
    for (const Neighbor& n : group.near) {
      group.window.add(offset_between(points_[first], thinned_[n.index]));
    }
    fit(first, count, noise, group, out, remade);
    return count;
  }

  /// Fits the planes of a group whose window is known.
  static void fit(std::size_t first, std::size_t count, double noise, Group& group,
                  NormalEstimate& out, std::vector<std::uint8_t>& remade) {
    std::array<Plane, WindowPoints::kSize> planes{};
    std::array<double, WindowPoints::kSize> scale{};  // 0: all points have the same weight.
    std::array<std::uint16_t, WindowPoints::kSize> neighbors{};
    for (int refit = 0; refit <= kRefits; ++refit) {
      sum_in_space(count, group.window, group.points, group.moments);
      for (std::size_t k = 0; k < count; ++k) group.moments.of(k).store(k, group.planes);
      fit_planes(count, group.planes);
      bool again = false;
      for (std::size_t k = 0; k < count; ++k) {
        const Moments moments = group.moments.of(k);
        if (refit == 0) {
          const bool enough = moments.n >= static_cast<double>(kLeastNeighbors);
          if (!enough || !(moments.variance() > 0)) continue;
          neighbors[k] = static_cast<std::uint16_t>(moments.n);
        } else if (!(scale[k] > 0) || !(moments.n > 3)) {  // Nothing but the plane before is left.
          scale[k] = 0;
          continue;
        }
        planes[k] = plane_of(group.planes, k, moments.n);
        if (refit == 0 && planes[k].lambda[0] > kShaped * noise * noise) {
          scale[k] = kFirstScale * std::sqrt(planes[k].lambda[0]);
        }
        if (!(scale[k] > 0)) continue;
        again = true;
        group.points.set_plane(k, planes[k].normal, planes[k].normal.dot(moments.mean()));
        group.points.inverse_scale[k] = 1 / std::max(kLeastScale * noise, scale[k]);
        scale[k] *= kShrink;
      }
      if (!again) break;
    }
    for (std::size_t k = 0; k < count; ++k) {
      if (neighbors[k] == 0) continue;
      const Plane& plane = planes[k];
      if (!(plane.lambda[1] > Plane::kLineShare * plane.lambda[2])) continue;
      const std::size_t i = first + k;
      remade[i] = 1;
      out.normal[i] = with_fixed_side(plane.normal);
      out.quality[i] = {static_cast<float>(plane.variation()),
                        static_cast<float>(std::max(0.0, 1 - plane.error(plane.noise()))),
                        neighbors[k], plane.thin() ? PointFlag::kThin : PointFlag::kGood};
    }
  }

  const Array<Vec3f>& points_;
  const NeighborSearch& search_;
  PerWorker<Group> shared_;
  Array<Vec3f> noted_at_;
  std::vector<NotedNoise> noted_;
  std::unique_ptr<NeighborSearch> noted_search_;
  Array<Vec3f> thinned_;
  std::unique_ptr<NeighborSearch> thinned_search_;
};

}  // namespace

bool planes_often_uncertain(std::size_t points, std::span<const Vec3f> sample,
                            NearestPlaces nearest) {
  if (points < kNoiseSample) return false;
  std::vector<Vec3f> near;
  std::size_t uncertain = 0;
  for (const Vec3f& place : sample) {
    nearest(place, kLeastNeighbors, near);
    uncertain += uncertain_plane(place, near) ? 1 : 0;
  }
  return static_cast<double>(uncertain) >=
         kLeastUncertainShare * static_cast<double>(sample.size());
}

bool noise_hides_surface(std::span<const Vec3f> sample, NearestPlaces nearest) {
  std::vector<Vec3f> near;
  const auto share = [&](std::span<const Vec3f> places) {
    std::size_t noisy = 0;
    for (const Vec3f& place : places) {
      const std::optional<NotedNoise> noise = noise_at(place, nearest, near);
      noisy += noise && noise->neighbors <= kMostTelling ? 1 : 0;
    }
    return static_cast<double>(noisy) / static_cast<double>(places.size());
  };
  return !sample.empty() &&
         share(sample.first(std::min(kNoiseLook, sample.size()))) >= kLeastNoisyShare / 2 &&
         share(sample) >= kLeastNoisyShare;
}

void remake_noisy_normals(const Array<Vec3f>& points, const NeighborSearch& search,
                          const std::optional<Vec3d>& sensor, NormalEstimate& out) {
  auto nearest = nearest_places(points, search);
  const std::vector<Vec3f> sample = sample_places(points, kNoiseSample);
  if (!planes_often_uncertain(points.size(), sample, nearest)) return;
  if (!sensor || !remake_range_normals(points, *sensor, out)) {
    if (!noise_hides_surface(sample, nearest)) return;
    Remaker(points, search).run(out);
  }
  out.flagged.fill(0);
  out.neighbors = 0;
  for (const NormalQuality& quality : out.quality) {
    ++out.flagged[static_cast<std::size_t>(quality.flag)];
    out.neighbors += quality.neighbors;
  }
}

}  // namespace surfel
