// Prints the table of alignments in docs/estimation.md: scans are moved from their right places,
// and how well these are found again is measured; tests/estimation.sh calls it.

#include <algorithm>
#include <cstdio>
#include <functional>

#include <fmt/format.h>
#include <surfel/align/align_scans.h>
#include <surfel/align/scan.h>
#include <surfel/base/error.h>

#include "align/partial_scans.h"

namespace {

using namespace surfel;
using namespace surfel::test;

/// One row: the worst scan of all.
void row(const std::string& name, const std::vector<SurfelCloud>& right, double degrees,
         double spacings) {
  const double spacing = make_scan(right[0], name).spacing;
  const Perturbed moved = perturbed(right, degrees, spacings * spacing);
  const std::vector<std::string> names(right.size(), name);
  fmt::print("| {}, {} scans | {} / {} |", name, right.size(), degrees, spacings);
  try {
    const AlignReport report = align_scans(moved.scans, {}, names);
    PoseError worst;
    for (std::size_t k = 1; k < right.size(); ++k) {
      const PoseError error = pose_error(right[k], report.scans[k].pose, moved.by[k]);
      worst.degrees = std::max(worst.degrees, error.degrees);
      worst.distance = std::max(worst.distance, error.distance);
    }
    fmt::print(" {:.3f} / {:.3f} | {:.3f} | {} |\n", worst.degrees, worst.distance / spacing,
               report.rms / spacing, report.rounds);
  } catch (const Error&) {
    fmt::print(" refused | | |\n");
  }
  std::fflush(stdout);
}

}  // namespace

int main() {
  fmt::print(
      "| scans | moved by | left: degrees / spacings | RMS of the matches, spacings | rounds |\n"
      "|---|---|---|---|---|\n");
  const std::vector<SurfelCloud> lion = lion_scans();
  const std::vector<SurfelCloud> bunny = bunny_scans();
  for (const auto& [degrees, spacings] :
       {std::pair{0.0, 0.0}, std::pair{1.0, 2.0}, std::pair{3.0, 4.0}, std::pair{5.0, 8.0},
        std::pair{10.0, 16.0}}) {
    row("lion", lion, degrees, spacings);
    row("bunny", bunny, degrees, spacings);
  }
}
