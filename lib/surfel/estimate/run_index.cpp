#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/base/parallel.h>
#include <surfel/estimate/range_normals.h>
#include <surfel/estimate/run_index.h>

namespace surfel {
namespace {

/// Square of the distance between unit vectors, one along an axis and one from the sensor to any
/// place of a box, at least; infinite for an empty box.
float direction_distance2(const RunBox& box, const Vec3d& sensor, const Vec3d& axis) {
  if (!(box.low.x() <= box.high.x())) return std::numeric_limits<float>::infinity();
  // The ball around the box is seen under the angle a, its middle at the angle b to the axis: what
  // is in it is at the angle b - a at least.
  const Vec3d low = box.low.cast<double>();
  const Vec3d high = box.high.cast<double>();
  const Vec3d to = (low + high) / 2 - sensor;
  const double range = to.norm();
  const double sine_a = range > 0 ? (high - low).norm() / (2 * range) : 1;
  if (!(sine_a < 1)) return 0;
  const double cosine_a = std::sqrt(1 - sine_a * sine_a);
  const double cosine_b = std::clamp(axis.dot(to) / range, -1.0, 1.0);
  if (!(cosine_b < cosine_a)) return 0;
  const double sine_b = std::sqrt(1 - cosine_b * cosine_b);
  // Directions are rounded.
  constexpr double kRounding = 1e-6;
  const double chord2 = 2 - 2 * (cosine_b * cosine_a + sine_b * sine_a);
  const double chord = std::max(0.0, std::sqrt(std::max(0.0, chord2)) - kRounding);
  return static_cast<float>((1 - kRounding) * chord * chord);
}

}  // namespace

void RunIndex::add(const Array<Vec3f>& piece) {
  constexpr std::size_t kGrain = 16;
  const std::size_t first = runs_.size();
  const std::size_t count = (piece.size() + length_ - 1) / length_;
  runs_.resize(first + count);
  parallel_each(count, kGrain, [&](std::size_t r) {
    Run run;
    for (std::size_t i = r * length_; i < std::min((r + 1) * length_, piece.size()); ++i) {
      if (!piece[i].allFinite()) continue;
      run.box.add(piece[i]);
      ++run.finite;
    }
    runs_[first + r] = run;
  });
  points_ += piece.size();
  for (std::size_t r = first; r < runs_.size(); ++r) finite_ += runs_[r].finite;
}

void RunIndex::finish() {
  tree_ = Tree(runs_.size(), [&](std::size_t run) { return runs_[run].box; });
  std::uint64_t before = 0;
  for (const Run& run : runs_) {
    finite_before_.push_back(before);
    before += run.finite;
  }
}

std::size_t RunIndex::median_meeting() const {
  constexpr std::size_t kProbedRuns = 31;
  std::vector<std::size_t> meeting;
  for (std::size_t k = 0; k < std::min(kProbedRuns, size()); ++k) {
    const Run& probe = runs_[size() * k / std::min(kProbedRuns, size())];
    meeting.push_back(
        static_cast<std::size_t>(std::count_if(runs_.begin(), runs_.end(), [&](const Run& run) {
          return run.box.distance2(probe.box) == 0;
        })));
  }
  if (meeting.empty()) return 0;
  const auto middle = meeting.begin() + static_cast<std::ptrdiff_t>(meeting.size() / 2);
  std::nth_element(meeting.begin(), middle, meeting.end());
  return *middle;
}

/// As the keys of exact_search.h by distance, then as morton_order().
bool RunSearch::before(const Found& a, const Found& b) {
  if (a.distance2 != b.distance2) return a.distance2 < b.distance2;
  if (a.code != b.code) return a.code < b.code;
  if (a.position != b.position) return before_on_curve(a.position, b.position);
  return a.index < b.index;
}

const Array<Vec3f>& RunSearch::read(std::size_t run) {
  constexpr std::size_t kMostKept = 256;
  for (const Kept& kept : kept_) {
    if (kept.run == run) return kept.position;
  }
  if (kept_.size() < kMostKept) kept_.emplace_back();
  Kept& place = kept_[next_];
  next_ = (next_ + 1) % kMostKept;
  place = {run, cloud_.positions(index_.begin(run), index_.begin(run + 1))};
  return place.position;
}

void RunSearch::nearest(const Vec3f& place, std::size_t k, std::vector<Vec3f>& out) {
  out.clear();
  k = std::min(k, index_.finite());
  if (k == 0) return;
  std::vector<Found> found;  // A heap, the furthest first, of k points at most.
  const auto can_hold = [&](float distance2) {
    return found.size() < k || distance2 <= found[0].distance2;
  };
  const auto take = [&](std::size_t run) {
    if (index_[run].finite == 0 || !can_hold(index_[run].box.distance2(place))) return;
    const Array<Vec3f>& position = read(run);
    for (std::size_t i = 0; i < position.size(); ++i) {
      const Vec3f& p = position[i];
      if (!p.allFinite()) continue;
      const float distance2 = (p - place).squaredNorm();
      if (found.size() == k && distance2 > found[0].distance2) continue;
      const Found next{distance2, grid_.code(p), index_.begin(run) + i, p};
      if (found.size() == k) {
        if (!before(next, found[0])) continue;
        std::pop_heap(found.begin(), found.end(), before);
        found.pop_back();
      }
      found.push_back(next);
      std::push_heap(found.begin(), found.end(), before);
    }
  };
  index_.tree().search(
      [&](const RunBox& box) { return box.distance2(place); },
      [&](const RunBox&, std::size_t, float distance2) { return can_hold(distance2); }, take);
  std::sort_heap(found.begin(), found.end(), before);
  for (const Found& f : found) out.push_back(f.position);
}

void RunSearch::nearest_directions(const Vec3d& sensor, const Vec3f& direction, std::size_t k,
                                   std::vector<float>& distance2) {
  distance2.clear();
  k = std::min(k, index_.finite());
  if (k == 0) return;
  const Vec3d axis = direction.cast<double>();
  const auto can_hold = [&](float least2) {
    return distance2.size() < k || least2 < distance2[0];  // A heap, the furthest first.
  };
  const auto take = [&](std::size_t run) {
    const RunIndex::Run& some = index_[run];
    if (some.finite == 0 || !can_hold(direction_distance2(some.box, sensor, axis))) return;
    for (const Vec3f& p : read(run)) {
      if (!p.allFinite()) continue;
      const float next = (direction_from(sensor, p) - direction).squaredNorm();
      if (distance2.size() == k) {
        if (!(next < distance2[0])) continue;
        std::pop_heap(distance2.begin(), distance2.end());
        distance2.pop_back();
      }
      distance2.push_back(next);
      std::push_heap(distance2.begin(), distance2.end());
    }
  };
  index_.tree().search([&](const RunBox& box) { return direction_distance2(box, sensor, axis); },
                       [&](const RunBox&, std::size_t, float least2) { return can_hold(least2); },
                       take);
  std::sort_heap(distance2.begin(), distance2.end());
}

}  // namespace surfel
