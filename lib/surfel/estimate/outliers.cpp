#include <algorithm>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/plugin.h>
#include <surfel/estimate/filters_plugin.h>
#include <surfel/estimate/outliers.h>

namespace surfel {

std::vector<std::string> OutlierOptions::problems() const {
  std::vector<std::string> found;
  check_option(found, neighbors >= 1 && neighbors <= 1024, "neighbors", neighbors, "in 1..1024");
  check_option(found, deviations > 0 && deviations <= 1e6, "deviations", deviations, "in (0, 1e6]");
  return found;
}

Array<std::uint8_t> inliers(const Array<Vec3f>& points, const OutlierOptions& options) {
  require_usable(options);
  Array<std::uint8_t> inlier(points.size());
  if (points.size() <= static_cast<std::size_t>(options.neighbors)) {
    std::fill(inlier.begin(), inlier.end(), std::uint8_t{1});
    return inlier;
  }
  std::fill(inlier.begin(), inlier.end(), std::uint8_t{0});
  OutlierWork work;
  work.points = points.front().data();
  work.count = points.size();
  work.neighbors = options.neighbors;
  work.deviations = options.deviations;
  work.inlier = inlier.data();
  static const auto remove =
      reinterpret_cast<RemoveOutliers*>(plugin_symbol("filters", kRemoveOutliersSymbol));
  if (!remove(work)) throw Error(ErrorKind::kNumeric, "PCL failed to look for outliers");
  return inlier;
}

}  // namespace surfel
