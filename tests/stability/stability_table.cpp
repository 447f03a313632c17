// Prints the table of docs/stability.md; tests/stability.sh calls it. With a name as argument, that
// place alone. Ends with 1 where ours is worse than the published method, or beyond its bound.

#include <cmath>
#include <string>

#include <fmt/format.h>

#include "stability/place.h"

namespace {

using namespace surfel::test;

/// Two digits; decibels one behind the point.
std::string text_of(double figure, bool decibels) {
  if (std::isnan(figure)) return "not a number";
  return decibels ? fmt::format("{:.1f}", figure) : fmt::format("{:.2g}", figure);
}

/// Prints a place's rows; returns how many are worse than published, or beyond their bound.
int print(const Place& place) {
  int failures = 0;
  const bool decibels = place.higher_better;  // All such measures are.
  bool first = true;
  for (const Row& row : place.rows) {
    const std::string note = row.note.empty() ? "" : " (" + row.note + ")";
    const bool worse = place.worse(row);
    fmt::print("| {} | `{}`{} | {} | {} | {} | {} | {}{} | {} {} | {} |\n",
               first ? place.title : "", row.input, note, first ? place.measure : "",
               first ? place.published : "", text_of(row.published, decibels),
               first ? place.ours : "", text_of(row.ours, decibels), worse ? " **worse**" : "",
               decibels ? ">=" : "<=", text_of(row.bound, decibels), first ? place.why : "");
    first = false;
    if (worse || !place.within_bound(row)) {
      ++failures;
      fmt::print(stderr, "{}, {}{}: {} against {} published, bound {}\n", place.title, row.input,
                 note, row.ours, row.published, row.bound);
    }
  }
  std::fflush(stdout);
  return failures;
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
    for (const Place& place : measurement.measure(Effort::kTable)) failures += print(place);
  }
  return failures == 0 ? 0 : 1;
}
