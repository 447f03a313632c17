#include <algorithm>

#include <fmt/format.h>
#include <surfel/base/option_check.h>
#include <surfel/chart/chart_judge.h>

namespace surfel {
namespace {

/// Times of a recommendation stay below the limit by this factor, as they vary from run to run.
constexpr double kTimeMargin = 1.2;

}  // namespace

std::vector<std::string> ChartGoal::problems() const {
  std::vector<std::string> found;
  if (min_psnr.has_value() == max_time.has_value()) {
    found.emplace_back("either `min_psnr` or `max_time` must be given, and not both");
  }
  if (min_psnr && std::isnan(*min_psnr)) found.emplace_back("`min_psnr` is no number");
  if (max_time) check_option(found, *max_time > 0, "max_time", *max_time, "greater than 0");
  return found;
}

std::vector<std::size_t> recommendation_order(const std::vector<ChartPoint>& points,
                                              const ChartGoal& goal) {
  require_usable(goal);
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ChartPoint& p = points[i];
    if (!p.refused.empty()) continue;
    if (goal.min_psnr && !(p.error.psnr >= *goal.min_psnr)) continue;
    if (goal.max_time && !(p.render.median * kTimeMargin <= *goal.max_time)) continue;
    order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    if (goal.max_time && points[a].error.psnr != points[b].error.psnr) {
      return points[a].error.psnr > points[b].error.psnr;
    }
    return points[a].render.median < points[b].render.median;
  });
  return order;
}

void judge(ChartSweep& sweep) {
  std::vector<CostPoint> costs;
  std::vector<ChartPoint*> measured;
  std::optional<std::size_t> standard;
  for (ChartPoint& p : sweep.points) {
    if (!p.refused.empty()) continue;
    if (p.standard) standard = measured.size();
    measured.push_back(&p);
    costs.push_back({p.time.median, std::max(p.error.rmse, kRoundingError)});
  }
  const std::vector<bool> front = pareto_front(costs);
  for (std::size_t i = 0; i < front.size(); ++i) measured[i]->front = front[i];
  if (!standard) return;
  sweep.standard = front_distance(costs, *standard);
  const ChartPoint& own = *measured[*standard];
  const ChartPoint& faster = *measured[sweep.standard.faster];
  const ChartPoint& sharper = *measured[sweep.standard.sharper];
  const double most = 1 + kFrontTolerance;
  // Times vary from run to run: a difference counts where they do not overlap.
  const bool slow = sweep.standard.time > most && own.time.least > faster.time.most &&
                    own.time.least > most * faster.time.least;
  // Errors do not vary; the medians of the times decide.
  const bool coarse = sweep.standard.error > most;
  sweep.standard_off = slow || coarse;
  if (front[*standard]) {
    sweep.verdict = "The default is on the Pareto front.";
  } else if (slow) {
    sweep.verdict = fmt::format(
        "The default is off the Pareto front by more than {:.0f} %: \"{}\" is no less accurate and "
        "{:.2f} times as fast. That is a bug in the default for such an input.",
        100 * kFrontTolerance, faster.label, sweep.standard.time);
  } else if (coarse) {
    sweep.verdict = fmt::format(
        "The default is off the Pareto front by more than {:.0f} %: \"{}\" is no slower and has an "
        "RMSE {:.2f} times smaller. That is a bug in the default for such an input.",
        100 * kFrontTolerance, sharper.label, sweep.standard.error);
  } else if (sweep.standard.time <= most && sweep.standard.error <= most) {
    sweep.verdict =
        fmt::format("The default is next to the Pareto front: {:.0f} % in time, {:.0f} % in RMSE.",
                    100 * (sweep.standard.time - 1), 100 * (sweep.standard.error - 1));
  } else {
    sweep.verdict = fmt::format(
        "The default is {:.0f} % in time and {:.0f} % in RMSE from the Pareto front by the "
        "medians, "
        "which the spread of the repeated times does not bear out.",
        100 * (sweep.standard.time - 1), 100 * (sweep.standard.error - 1));
  }
}

}  // namespace surfel
