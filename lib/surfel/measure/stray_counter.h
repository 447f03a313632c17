#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <surfel/base/bounds.h>
#include <surfel/base/coordinate_spread.h>
#include <surfel/measure/cloud_needs.h>
#include <surfel/measure/cloud_summary.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Counts the points outside of CoordinateSpread::core() in a cloud whose pieces are handed on
/// twice in their order: to add() and, once it has had all of them, to look(). Internal to the
/// module.
class StrayCounter {
 public:
  void add(const SurfelCloud& piece);
  void look(const SurfelCloud& piece);
  /// Unset where there are none.
  const std::optional<StrayPoints>& strays() const { return strays_; }
  /// What to do about them. \param file  the cloud's file in the command.
  CloudNeed need(const std::string& file) const;

 private:
  /// The core, unless it is the box of all points; finds it at the first call.
  const std::optional<Bounds>& core();

  CoordinateSpread spread_;
  bool chosen_ = false;
  std::optional<Bounds> core_;
  std::uint64_t looked_at_ = 0;
  std::optional<StrayPoints> strays_;
};

}  // namespace surfel
