#pragma once

#include <string>
#include <vector>

namespace surfel::test {

/// How much is measured: for the unit tests, or for docs/stability.md.
enum class Effort { kTest, kTable };

/// One input, and what became of it.
struct Row {
  std::string input;  ///< What follows `surfel-generate --case`.
  double published = 0;
  double ours = 0;
  double bound = 0;    ///< Of `ours`.
  std::string note{};  ///< On the input, for the table.
};

/// A place where methods fail, measured.
struct Place {
  std::string title{};
  std::string measure{};       ///< With its unit.
  bool higher_better = false;  ///< Of two figures.
  double slack = 0;            ///< Differences up to this one are none.
  double saturation = 0;       ///< Figures beyond it (dB) are as good as it; 0: there is no such.
  std::string published{};     ///< The method held against, and ...
  std::string ours{};          ///< ... ours: what a user types.
  std::string why{};
  std::vector<Row> rows{};

  /// Is ours worse than the published method's figure? One that is not a number is the worst.
  bool worse(const Row& row) const;
  bool within_bound(const Row& row) const;
};

/// A way to measure one or more.
struct Measurement {
  std::string name;  ///< Of its test.
  std::vector<Place> (*measure)(Effort);
};

/// A function that measures one, as a Measurement has it.
template <Place (*measure)(Effort)>
std::vector<Place> one(Effort effort) {
  return {measure(effort)};
}

/// All, in the order of docs/stability.md, by the file they are in.
std::vector<Measurement> projection_places();
std::vector<Measurement> point_places();
std::vector<Measurement> visibility_places();
std::vector<Measurement> texture_places();
std::vector<Measurement> group_places();
std::vector<Measurement> number_places();
std::vector<Measurement> flicker_places();
std::vector<Measurement> all_places();

}  // namespace surfel::test
