#pragma once

#include <surfel/base/export.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/measure/histogram.h>
#include <surfel/scene/volume.h>

namespace surfel {

/// What the values of a volume are.
struct VolumeStatistics {
  Distribution value;
  Histogram values;  ///< Sixteen equal parts of the range.
};

SURFEL_API VolumeStatistics volume_statistics(const Volume& volume);

}  // namespace surfel
