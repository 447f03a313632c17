#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/measure/cloud_needs.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/measure/streamed_statistics.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/store/attribute_values.h>

namespace surfel {

/// Points that lie far from most of a cloud.
struct StrayPoints {
  std::uint64_t count = 0;
  std::uint64_t first = 0;  ///< The first one's number in the cloud, from 0 on.
  Vec3d place{0, 0, 0};     ///< Its world coordinates.
};

/// What can be told of a cloud.
struct CloudSummary {
  /// One surfel with all columns, and with all that holds for the whole cloud: the first one with a
  /// known normal, or the first one. Empty where the cloud is.
  SurfelCloud like;
  bool tells_sensors = false;  ///< SurfelCloud::sensors() of the cloud are not empty.
  CloudStatistics statistics;
  std::optional<StrayPoints> strays;      ///< Points outside of CoordinateSpread::core(), if any.
  std::array<std::size_t, 3> by_lines{};  ///< Surfels by the number of half-planes that cut them.
  std::size_t cut_off = 0;                ///< Surfels whose centre a half-plane cuts off.
  ViewGuess view;
  std::vector<std::pair<std::string, AttributeSummary>> attributes;  ///< Of measured_attributes().
  std::vector<CloudNeed> needs;
};

/// Bytes that summarize_cloud() takes for surfels of which each takes `row_bytes` in memory, the
/// surfels included.
SURFEL_API std::uint64_t summary_bytes(std::uint64_t surfels, std::size_t row_bytes);

/// Summarises a cloud in memory.
/// \param cloud    Surfels or points, with any columns.
/// \param options  Cutoff and samples of the measures.
/// \param file     Name of the cloud's file in the commands that needs are met by.
///
/// Throws Error(kUsage) for bad options.
SURFEL_API CloudSummary summarize_cloud(const SurfelCloud& cloud,
                                        const CloudStatisticsOptions& options,
                                        const std::string& file);

/// Summarises a cloud that comes piece by piece, in any order, within some memory: the same figures
/// to the last bit. The cloud is read six times or more: once more for every attribute beyond those
/// that fit into the memory together, 9 MB each, and three times for every cutoff that is tried
/// where there are holes. Beside the samples, half of the memory at most, a piece is in memory.
/// Throws Error(kUsage) for bad options, and where the samples do not fit into the memory.
SURFEL_API CloudSummary summarize_cloud(const CloudPasses& pieces,
                                        const CloudStatisticsOptions& options,
                                        const std::string& file, std::uint64_t memory);

}  // namespace surfel
