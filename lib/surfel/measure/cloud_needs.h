#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Something that a cloud lacks, or has without need.
struct CloudNeed {
  std::string topic;    ///< One word: normals, variance, colors, holes, ...
  std::string measure;  ///< What was found, with its figure.
  std::string command;  ///< What mends it.
};

/// What can be told from measures alone:
/// - columns that are missing, and the tool that adds them; values that are not usable;
/// - holes, with the cutoff from which on discs leave none, if there is one up to 4;
/// - discs that overlap more than kMuchOverlap times, where those of estimated sizes do 2 to 3;
/// - areas that are not those of the surfels' cells: sums of kernels are then not about one;
/// - the cutoff that coefficients were fitted for; coincident surfels; opacities;
/// - ellipses where discs would do, and at which error;
/// - levels of detail where a picture of kPicturePixels has more surfels than pixels.
/// \param file        to name in commands.
/// \param statistics  of the cloud, measured with `options`. Holes are measured again at other
///                    cutoffs, if there are some.
SURFEL_API std::vector<CloudNeed> cloud_needs(const SurfelCloud& cloud,
                                              const CloudStatistics& statistics,
                                              const CloudStatisticsOptions& options,
                                              const std::string& file);

/// Holes up to this share are not worth mentioning: real surfaces have some.
inline constexpr double kFewHoles = 2e-3;
inline constexpr double kMuchOverlap = 8;
/// Areas of surfels within this factor of their cells' are right.
inline constexpr double kAreaFactor = 1.5;
/// Half axes of ellipses that differ from a disc's of the same area by less are round.
inline constexpr double kRound = 0.1;
inline constexpr double kPicturePixels = 512.0 * 512.0;

}  // namespace surfel
