#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/plugin.h>
#include <surfel/estimate/filters_plugin.h>
#include <surfel/estimate/smoothing.h>

namespace surfel {
namespace {

/// Coefficients of a polynomial of two variables.
int coefficients(int order) { return (order + 1) * (order + 2) / 2; }

std::size_t neighborhood_size(const SmoothingOptions& options) {
  return static_cast<std::size_t>(
      std::lround(std::numbers::pi * options.spacings * options.spacings));
}

/// The neighbourhoods that the plug-in asks for.
struct Neighborhoods {
  const NeighborSearch& search;
  std::size_t size;
  Array<float> radius;  ///< Distance to the farthest neighbour, by point.

  void for_each(SmoothingWork::Visit visit, const void* context) {
    PerWorker<std::vector<std::uint32_t>> scratch;
    search.for_each_nearest(
        size, [&](std::size_t i, std::span<const Neighbor> neighbors, int worker) {
          std::vector<std::uint32_t>& indices = scratch[worker];
          indices.clear();
          for (const Neighbor& n : neighbors) indices.push_back(n.index);
          radius[i] = std::sqrt(neighbors.back().distance2);
          visit(context, i, indices.data(), indices.size(), static_cast<double>(radius[i]));
        });
  }
};

/// Puts points that have no fit, or one out of reach, back to their places, and sums up the moves.
void settle(const Array<Vec3f>& points, const Array<float>& radius, SmoothedPoints& out) {
  constexpr std::size_t kSettleGrain = 4096;
  struct Sums {
    std::size_t stayed = 0;
    double shift = 0;
    double largest = 0;
  };
  std::vector<Sums> sums((points.size() + kSettleGrain - 1) / kSettleGrain);
  parallel_for(points.size(), kSettleGrain, [&](std::size_t begin, std::size_t end, int) {
    Sums& sum = sums[begin / kSettleGrain];
    for (std::size_t i = begin; i < end; ++i) {
      const double shift = (out.position[i] - points[i]).cast<double>().norm();
      if (shift <= radius[i] && out.normal[i].allFinite()) {  // False for NaN as well.
        sum.shift += shift;
        sum.largest = std::max(sum.largest, shift);
        continue;
      }
      ++sum.stayed;
      out.position[i] = points[i];
      out.normal[i] = Vec3f(0, 0, 0);
    }
  });
  for (const Sums& sum : sums) {
    out.stayed += sum.stayed;
    out.mean_shift += sum.shift / static_cast<double>(points.size());
    out.largest_shift = std::max(out.largest_shift, sum.largest);
  }
}

}  // namespace

std::vector<std::string> SmoothingOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, order >= 1 && order <= 5, "order", order, "in 1..5");
  check_option(found, spacings >= 1 && spacings <= 20, "spacings", spacings, "in 1..20");
  if (!found.empty()) return found;
  // As many points as coefficients would be interpolated, noise and all.
  const auto least = static_cast<std::size_t>(3 * coefficients(order) / 2);
  check_rule(
      found, neighborhood_size(*this) >= least,
      fmt::format("`spacings` of {} takes in {} points, too few for polynomials of `order` "
                  "{}; take {:.1f} or more",
                  spacings, neighborhood_size(*this), order,
                  std::ceil(10 * std::sqrt(static_cast<double>(least) / std::numbers::pi)) / 10));
  return found;
}

SmoothedPoints smooth_points(const Array<Vec3f>& points, const NeighborSearch& search,
                             const SmoothingOptions& options) {
  require_usable(options);
  SmoothedPoints out;
  if (points.empty()) return out;
  static const auto smooth =
      reinterpret_cast<SmoothPoints*>(plugin_symbol("filters", kSmoothPointsSymbol));
  out.position.resize(points.size());
  out.normal.resize(points.size());
  Neighborhoods neighborhoods{search, neighborhood_size(options), Array<float>(points.size())};
  SmoothingWork work;
  work.points = points.front().data();
  work.count = points.size();
  work.order = options.order;
  work.for_each = [](void* self, SmoothingWork::Visit visit, const void* context) {
    static_cast<Neighborhoods*>(self)->for_each(visit, context);
  };
  work.self = &neighborhoods;
  work.position = out.position.front().data();
  work.normal = out.normal.front().data();
  smooth(work);
  settle(points, neighborhoods.radius, out);
  return out;
}

}  // namespace surfel
