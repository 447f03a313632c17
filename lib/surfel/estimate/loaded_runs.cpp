#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/estimate/loaded_runs.h>

namespace surfel {
namespace {

// Distances between boxes round.
constexpr float kUp = 1 + 1e-5F;
constexpr float kDown = 1 - 1e-5F;

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

void LoadedRuns::known_around(std::span<const Vec3f> places, float* known) const {
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
  // Far from what is missing, places need no distances of their own.
  if (!(nearest < diagonal)) {
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
  for (std::size_t i = 0; i < places.size(); ++i) {
    float least2 = kInfinity;
    for (const RunBox& other : around) least2 = std::min(least2, other.distance2(places[i]));
    known[i] = kDown * std::sqrt(least2);
  }
}

}  // namespace surfel
