// Every place of docs/stability.md at reduced size: ours keeps its bound and is not worse than the
// published method.

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/sample/hard_cases.h>

#include "stability/place.h"

namespace surfel::test {
namespace {

class StabilityPlaces : public testing::TestWithParam<Measurement> {};

TEST_P(StabilityPlaces, OursKeepsItsBoundAndIsNotWorse) {
  for (const Place& place : GetParam().measure(Effort::kTest)) {
    EXPECT_FALSE(place.rows.empty()) << place.title;
    for (const Row& row : place.rows) {
      const testing::ScopedTrace trace(__FILE__, __LINE__,
                                       place.title + ", " + row.input + " " + row.note);
      EXPECT_TRUE(place.within_bound(row)) << row.ours << ", bound " << row.bound;
      EXPECT_FALSE(place.worse(row)) << row.ours << ", published " << row.published;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, StabilityPlaces, testing::ValuesIn(all_places()),
                         [](const auto& parameter) { return parameter.param.name; });

}  // namespace

/// For GoogleTest.
void PrintTo(const Measurement& measurement, std::ostream* out) { *out << measurement.name; }

}  // namespace surfel::test
