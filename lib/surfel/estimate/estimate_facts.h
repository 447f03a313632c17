#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/estimate/estimate.h>
#include <surfel/estimate/run_index.h>
#include <surfel/scene/surfel_ranges.h>

namespace surfel {

/// What the first pass over a cloud that is not in memory finds, which the estimates of its blocks
/// depend on.
struct EstimateFacts {
  explicit EstimateFacts(std::size_t run_length) : index(run_length) {}

  RunIndex index;
  std::vector<Vec3f> sample;       ///< Places of the cloud (place_sample.h).
  std::size_t column_bytes = 0;    ///< Bytes of a point's columns.
  std::size_t without_normal = 0;  ///< Finite points without a usable normal; counted by kAlign.
  bool told_once = false;          ///< The cloud tells a viewpoint for all points.
  bool sensors = false;            ///< Each point tells its sensor.
  Vec3d sensor{0, 0, 0};           ///< Where the points may have been seen from.
  bool at_sensor = false;          ///< A point is there.
};

/// Reads the cloud once. Throws Error(kInput), which starts with `name`, where no point is finite
/// and where consecutive points do not lie close together.
EstimateFacts read_estimate_facts(const SurfelRanges& cloud, const EstimateOptions& options,
                                  std::size_t run_length, const std::string& name);

/// What holds for the whole cloud.
struct CloudRules {
  bool winding = false;     ///< Sides are told by the winding number.
  bool to_sensors = false;  ///< Normals look to what the cloud tells.
  bool scan_lines = false;
};

/// Decides what holds for the whole cloud. Throws Error(kUsage) and Error(kInput) for what cannot
/// be estimated block by block.
CloudRules decide_rules(const SurfelRanges& cloud, const EstimateFacts& facts,
                        const EstimateOptions& options, const std::string& name);

}  // namespace surfel
