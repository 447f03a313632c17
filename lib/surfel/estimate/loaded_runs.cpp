#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <surfel/estimate/loaded_runs.h>

namespace surfel {
namespace {

// Distances between boxes round.
constexpr float kUp = 1 + 1e-5F;
constexpr float kDown = 1 - 1e-5F;

/// Distances, a little less for rounding, from places to the nearest of some boxes. Halves of the
/// places, which follow a curve through space, have fewer and fewer boxes that may be the nearest.
void nearest_distances(std::span<const Vec3f> places, std::span<const RunBox> boxes,
                       float* distance) {
  constexpr std::size_t kFewPlaces = 8;
  constexpr std::size_t kFewBoxes = 4;
  if (places.size() <= kFewPlaces || boxes.size() <= kFewBoxes) {
    for (std::size_t i = 0; i < places.size(); ++i) {
      float least2 = std::numeric_limits<float>::infinity();
      for (const RunBox& box : boxes) least2 = std::min(least2, box.distance2(places[i]));
      distance[i] = kDown * std::sqrt(least2);
    }
    return;
  }
  std::vector<RunBox> near;
  std::vector<float> distance2(boxes.size());
  const std::size_t half = places.size() / 2;
  for (const auto& [begin, end] :
       {std::pair(std::size_t{0}, half), std::pair(half, places.size())}) {
    const std::span<const Vec3f> some = places.subspan(begin, end - begin);
    RunBox around;
    for (const Vec3f& place : some) around.add(place);
    float nearest2 = std::numeric_limits<float>::infinity();
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      distance2[b] = boxes[b].distance2(around);
      nearest2 = std::min(nearest2, distance2[b]);
    }
    const float most = kUp * (std::sqrt(nearest2) + (around.high - around.low).norm());
    near.clear();
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      if (distance2[b] <= most * most) near.push_back(boxes[b]);
    }
    nearest_distances(some, near, distance + begin);
  }
}

}  // namespace

void LoadedRuns::add(std::size_t run) {
  if (loaded_[run] != 0) return;
  loaded_[run] = 1;
  finite_ += index_[run].finite;
}

void LoadedRuns::add_near(const RunBox& box, float reach) {
  const float reach2 = reach * reach * kUp;
  const auto near = [&](const RunBox& other) { return other.distance2(box) <= reach2; };
  index_.tree().for_each_leaf(near, [&](std::size_t leaf) {
    index_.tree().for_each_item(leaf, [&](std::size_t run) {
      if (near(index_[run].box)) add(run);
    });
  });
}

void LoadedRuns::known_around(std::span<const Vec3f> places, bool exact, float* known) const {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  RunBox box;
  for (const Vec3f& place : places) box.add(place);
  // The nearest run that is not loaded is nearest to one of the places at most; to each place the
  // nearest one is among the runs that come as near to the box as that one, and the box's diagonal.
  const auto missing = [&](std::size_t run) { return loaded_[run] == 0 && index_[run].finite > 0; };
  const auto distance = [&](const RunBox& other) { return other.distance2(box); };
  float nearest2 = kInfinity;
  const auto enter = [&](const RunBox&, std::size_t, float distance2) {
    return distance2 < nearest2;
  };
  index_.tree().search(distance, enter, [&](std::size_t run) {
    if (missing(run)) nearest2 = std::min(nearest2, distance(index_[run].box));
  });
  const float nearest = std::sqrt(nearest2);
  const float diagonal = (box.high - box.low).norm();
  // Far from what is missing, places seldom need distances of their own.
  if (std::isinf(nearest) || (!exact && !(nearest < diagonal))) {
    std::fill_n(known, places.size(), kDown * nearest);
    return;
  }
  const float most = kUp * (nearest + diagonal);
  std::vector<RunBox> around;
  const auto near = [&](const RunBox& other) { return other.distance2(box) <= most * most; };
  index_.tree().for_each_leaf(near, [&](std::size_t leaf) {
    index_.tree().for_each_item(leaf, [&](std::size_t run) {
      if (missing(run) && near(index_[run].box)) around.push_back(index_[run].box);
    });
  });
  nearest_distances(places, around, known);
}

}  // namespace surfel
