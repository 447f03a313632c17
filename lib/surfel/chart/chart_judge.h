#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/chart/chart_result.h>

namespace surfel {

/// What a recommendation must reach: one of the two.
struct ChartGoal {
  std::optional<double> min_psnr;  ///< dB.
  std::optional<double> max_time;  ///< Milliseconds of the picture, without reading and writing.
};

/// Order in which settings are tried for a goal, cheapest first under min_psnr, most accurate first
/// under max_time; those that do not meet it, the time with a margin of a fifth for its noise, are
/// left out, and so are settings that the tools refused.
SURFEL_API std::vector<std::size_t> recommendation_order(const std::vector<ChartPoint>& points,
                                                         const ChartGoal& goal);

/// RMSE that rounding to 8 bits leaves, of full scale: points below it are equally accurate.
inline const double kRoundingError = 1 / (255 * std::sqrt(12.0));

/// Share by which a default may be off the Pareto front.
inline constexpr double kFrontTolerance = 0.2;

/// Marks the points on the Pareto front, and judges the default.
SURFEL_API void judge(ChartSweep& sweep);

}  // namespace surfel
