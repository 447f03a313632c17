#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/surface/voronoi_cell.h>
#include <surfel/texture/kernel_overlap.h>
#include <surfel/texture/reach_tree.h>

namespace surfel {
namespace {

constexpr std::size_t kSample = 256;  ///< Functions, spread evenly along the curve.
constexpr double kMostOverlap = 512;

}  // namespace

double kernel_overlap(const SurfelBasis& basis, double cutoff) {
  if (basis.size() == 0) return 0;
  const ReachTree reaching(basis, cutoff);
  const ReachTree centers(basis, 0);
  const std::size_t sample = std::min(kSample, basis.size());
  std::vector<std::size_t> found(sample);
  parallel_each(sample, 4, [&](std::size_t i) {
    const SurfelBasis::Function& f = basis.function[i * basis.size() / sample];
    std::size_t reached_by = 0;
    std::size_t near = 0;
    reaching.meeting(f.position, 0, [&](std::size_t) { ++reached_by; });
    centers.meeting(f.position, 2 * kBorderReach * std::sqrt(f.area), [&](std::size_t) { ++near; });
    found[i] = std::max(reached_by, near);
  });
  double sum = 0;
  for (const std::size_t n : found) sum += static_cast<double>(n);
  return sum / static_cast<double>(sample);
}

void require_bounded_overlap(const SurfelBasis& basis, double cutoff, const std::string& name) {
  const double overlap = kernel_overlap(basis, cutoff);
  if (overlap <= kMostOverlap) return;
  throw_input(name,
              fmt::format("{:.0f} of the {} surfels reach a place in the mean, more than the "
                          "{} that a fit takes; remove surfels that lie in one place, or make "
                          "the surfels smaller",
                          overlap, basis.size(), kMostOverlap));
}

}  // namespace surfel
