#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Something that a cloud lacks, or has without need.
struct CloudNeed {
  std::string topic;    ///< One word: normals, variance, colors, holes, ...
  std::string measure;  ///< The finding, with its figure.
  std::string command;  ///< The command that mends it.
};

/// What needs are told from beside statistics.
struct MeasuredFacts {
  bool normals = false;  ///< There is such a column, as below.
  bool variances = false;
  bool render_colors = false;  ///< Colours or coefficients.
  bool colors = false;
  bool uv = false;
  std::optional<double> area_mean;
  std::size_t ellipses = 0;         ///< Usable ones; 0 where there are no ellipses.
  std::size_t long_ellipses = 0;    ///< Less round than kRound.
  float ellipse_percentile_95 = 0;  ///< Half axes from the radius of the disc of the same area,
  float ellipse_most = 0;           ///< relative.
  std::size_t see_through = 0;      ///< Surfels of an opacity below 0.99.
  std::optional<double> basis_cutoff;
  std::size_t coarser_skipped = 0;
};

/// Finds the facts of a cloud whose pieces are handed on twice in their order: to add() and, once
/// it has had all of them, to look().
class SURFEL_API CloudFactCounter {
 public:
  CloudFactCounter();
  ~CloudFactCounter();

  void add(const SurfelCloud& piece);
  void look(const SurfelCloud& piece);
  MeasuredFacts facts();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Needs that can be told from measures alone:
/// - columns that are missing, and the tool that adds them; values that are not usable;
/// - holes, with the cutoff from which on discs leave none, if there is one up to 4;
/// - discs that overlap more than kMuchOverlap times, where estimated sizes overlap 2 to 3 times;
/// - areas that differ from the areas of the surfels' cells: sums of kernels are not about one
///   then;
/// - the cutoff that coefficients were fitted for; coincident surfels; opacities;
/// - ellipses where discs would do, and the error of discs;
/// - levels of detail where a picture of kPicturePixels has more surfels than pixels.
///
/// \param cloud       Surfels, with any columns.
/// \param statistics  Statistics of the cloud, measured with `options`. Where there are holes they
///                    are measured again at other cutoffs.
/// \param options     The options that the statistics were measured with.
/// \param file        Name of the cloud's file in the commands.
///
/// Throws Error(kUsage) for bad options.
SURFEL_API std::vector<CloudNeed> cloud_needs(const SurfelCloud& cloud,
                                              const CloudStatistics& statistics,
                                              const CloudStatisticsOptions& options,
                                              const std::string& file);
/// The needs of a cloud that need not be in memory.
/// \param facts       Facts that CloudFactCounter found.
/// \param statistics  Statistics of the cloud, measured with `options`.
/// \param options     The options that the statistics were measured with.
/// \param file        Name of the cloud's file in the commands.
/// \param holes       Measures the share of holes with other options.
SURFEL_API std::vector<CloudNeed> cloud_needs(
    const MeasuredFacts& facts, const CloudStatistics& statistics,
    const CloudStatisticsOptions& options, const std::string& file,
    FunctionRef<double(const CloudStatisticsOptions& options)> holes);

/// Holes up to this share are not worth mentioning: real surfaces have some.
inline constexpr double kFewHoles = 2e-3;
/// Discs over a point from which on there are too many: three times as many as close a surface.
inline constexpr double kMuchOverlap = 8;
/// Mean areas of surfels within this factor of their cells' mean area are right: borders and
/// irregular places make about as much of a difference.
inline constexpr double kAreaFactor = 1.5;
/// Ellipses are round whose half axes differ by less, relative, from the disc of the same area.
inline constexpr double kRound = 0.1;
/// A picture of 512 x 512 pixels, as surfel-render makes them by default.
inline constexpr double kPicturePixels = 512.0 * 512.0;

}  // namespace surfel
