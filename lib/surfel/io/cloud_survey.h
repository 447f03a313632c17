#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>

#include <surfel/base/bounds.h>
#include <surfel/base/coordinate_spread.h>
#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// What must be known of all surfels before the first is written: how many there are, and which
/// types hold their values. Pieces are added in their order.
class SURFEL_API CloudSurvey {
 public:
  /// Values of a column that is neither a coordinate nor a colour.
  struct Range {
    double least = std::numeric_limits<double>::infinity();  ///< Of the finite values.
    double most = -std::numeric_limits<double>::infinity();  ///< Of the finite values.
    std::uint64_t count = 0;
    std::uint64_t fractions = 0;  ///< Finite values that are no whole numbers.
    std::uint64_t nan = 0;        ///< Values that are not a number.
    std::uint64_t outside = 0;    ///< Values below 0 or above 65535, infinite ones too.
    std::uint64_t infinite = 0;
  };

  /// \param path  the file that will be written: its format decides what is looked at.
  explicit CloudSurvey(const std::string& path);
  void add(const SurfelCloud& piece);
  /// Gives a piece the types of coordinates that fit all pieces.
  void settle(SurfelCloud& piece) const;
  /// The part of `box` that an origin of double coordinates suits: without stray points.
  Bounds core() const { return spread_.core(box); }

  std::uint64_t count = 0;
  Bounds box;  ///< Of the finite positions as they stand in a file, world coordinates.
  /// The first surfel whose position is not finite.
  std::optional<std::uint64_t> nowhere;
  std::optional<int> decimals;         ///< SurfelCloud::decimals, the most of all pieces.
  bool float_positions = true;         ///< All coordinates are floats, wherever the origins lie.
  bool exact = false;                  ///< Floats do not hold all coordinates (SurfelCloud).
  std::map<std::string, Range> range;  ///< By the column's name in files; for LAS alone.

 private:
  void add_ranges(const SurfelCloud& piece);
  bool with_ranges_;
  CoordinateSpread spread_;
};

}  // namespace surfel
