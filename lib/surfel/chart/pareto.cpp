#include <algorithm>
#include <limits>
#include <numeric>

#include <surfel/chart/pareto.h>

namespace surfel {

std::vector<bool> pareto_front(const std::vector<CostPoint>& points) {
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return points[a].time != points[b].time ? points[a].time < points[b].time
                                            : points[a].error < points[b].error;
  });
  std::vector<bool> front(points.size(), false);
  double least = std::numeric_limits<double>::infinity();  // Error of all that is faster.
  const CostPoint* last = nullptr;                         // The last one on the front.
  for (const std::size_t i : order) {
    const CostPoint& p = points[i];
    const bool equal = last && p.time == last->time && p.error == last->error;
    if (!equal && !(p.error < least)) continue;
    front[i] = true;
    least = p.error;
    last = &p;
  }
  return front;
}

FrontDistance front_distance(const std::vector<CostPoint>& points, std::size_t index) {
  const CostPoint& own = points.at(index);
  FrontDistance d;
  d.faster = d.sharper = index;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].error <= own.error && points[i].time < points[d.faster].time) d.faster = i;
    if (points[i].time <= own.time && points[i].error < points[d.sharper].error) d.sharper = i;
  }
  d.time = own.time / points[d.faster].time;
  d.error = own.error / points[d.sharper].error;
  return d;
}

}  // namespace surfel
