#include <algorithm>
#include <vector>

#include <surfel/measure/volume_statistics.h>

namespace surfel {

VolumeStatistics volume_statistics(const Volume& volume) {
  constexpr std::size_t kParts = 16;
  VolumeStatistics out;
  out.value = distribution(std::vector<double>(volume.value.begin(), volume.value.end()));
  const double least = out.value.min;
  const double range = out.value.max - least;
  for (std::size_t k = 0; k <= kParts; ++k) {
    out.values.edges.push_back(least + range * static_cast<double>(k) / kParts);
  }
  out.values.counts.assign(kParts, 0);
  for (const float value : volume.value) {
    const double at = range > 0 ? (static_cast<double>(value) - least) / range * kParts : 0.0;
    ++out.values.counts[std::min(kParts - 1, static_cast<std::size_t>(at))];
  }
  return out;
}

}  // namespace surfel
