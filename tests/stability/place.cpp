#include "stability/place.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace surfel::test {
namespace {

/// Lower is better, for all.
double badness(const Place& place, double figure) {
  if (std::isnan(figure)) return std::numeric_limits<double>::infinity();
  if (!place.higher_better) return figure;
  return -(place.saturation > 0 ? std::min(figure, place.saturation) : figure);
}

}  // namespace

bool Place::worse(const Row& row) const {
  return badness(*this, row.ours) > badness(*this, row.published) + slack;
}

bool Place::within_bound(const Row& row) const {
  return higher_better ? row.ours >= row.bound : row.ours <= row.bound;
}

std::vector<Measurement> all_places() {
  std::vector<Measurement> all;
  for (const auto& places : {projection_places(), point_places(), visibility_places(),
                             texture_places(), group_places(), number_places(), flicker_places()}) {
    all.insert(all.end(), places.begin(), places.end());
  }
  return all;
}

}  // namespace surfel::test
