#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/chart/chart_result.h>

namespace surfel {

/// Goal of a recommendation; exactly one member is set.
struct ChartGoal {
  std::optional<double> min_psnr;  ///< Least PSNR, dB.
  /// Longest time of a picture without reading and writing, ms, > 0.
  std::optional<double> max_time;

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// Order in which settings are tried for a goal: cheapest first under min_psnr, most accurate first
/// under max_time. Settings that miss the goal are left out, where times need a margin of a fifth
/// for their noise, and so are settings that the tools refused. Throws Error(kUsage) for a goal
/// with problems().
SURFEL_API std::vector<std::size_t> recommendation_order(const std::vector<ChartPoint>& points,
                                                         const ChartGoal& goal);

/// RMSE that rounding to 8 bits leaves, of full scale: points below it are equally accurate.
inline const double kRoundingError = 1 / (255 * std::sqrt(12.0));

/// Share by which a default may be off the Pareto front.
inline constexpr double kFrontTolerance = 0.2;

/// Marks the points on the Pareto front, and judges the default.
SURFEL_API void judge(ChartSweep& sweep);

}  // namespace surfel
