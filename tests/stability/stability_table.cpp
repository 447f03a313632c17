// Prints the table of docs/stability.md; tests/stability.sh calls it. With a name as argument, that
// place alone. Ends with 1 where ours is worse than the published method, or beyond its bound.

#include <cmath>
#include <string>

#include <fmt/format.h>

#include "stability/place.h"

namespace {

using namespace surfel::test;

/// Three digits; decibels one behind the point.
std::string text_of(double figure, bool decibels) {
  if (std::isnan(figure)) return "not a number";
  return decibels ? fmt::format("{:.1f}", figure) : fmt::format("{:.2g}", figure);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string only = argc > 1 ? argv[1] : "";
  fmt::print(
      "| place | input: `surfel-generate --case` | measure | published method | | ours | | bound | "
      "why |\n|---|---|---|---|---|---|---|---|---|\n");
  int failures = 0;
  for (const Measurement& measurement : all_places()) {
    if (!only.empty() && measurement.name != only) continue;
    const Place place = measurement.measure(Effort::kTable);
    bool first = true;
    for (const Row& row : place.rows) {
      // A measure in decibels is one where higher is better.
      const bool decibels = place.higher_better;
      const std::string note = row.note.empty() ? "" : " (" + row.note + ")";
      fmt::print("| {} | `{}`{} | {} | {} | {} | {} | **{}** | {} {} | {} |\n",
                 first ? place.title : "", row.input, note, first ? place.measure : "",
                 first ? place.published : "", text_of(row.published, decibels),
                 first ? place.ours : "", text_of(row.ours, decibels),
                 decibels ? ">=" : "<=", text_of(row.bound, decibels), first ? place.why : "");
      first = false;
      if (place.worse(row) || !place.within_bound(row)) {
        ++failures;
        fmt::print(stderr, "{}, {}{}: {} against {} published, bound {}\n", place.title, row.input,
                   note, row.ours, row.published, row.bound);
      }
    }
    std::fflush(stdout);
  }
  return failures == 0 ? 0 : 1;
}
