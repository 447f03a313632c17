#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Spread of a sampled quantity.
struct Distribution {
  double mean = 0;
  double min = 0;
  double percentile_5 = 0;
  double median = 0;
  double percentile_95 = 0;
  double max = 0;
};

/// Rank of the value below which a share of `count` values is: floor(share (count - 1) + 1/2).
SURFEL_API std::size_t rank_of(double share, std::size_t count);
/// Spread of one value or more; the percentiles are the values of rank_of().
SURFEL_API Distribution distribution(std::vector<double> values);

/// What cloud_statistics() measures, and at how many surfels.
struct CloudStatisticsOptions {
  double cutoff = 1;            ///< c of beta < c: a disc reaches sqrt(2 c variance), > 0.
  std::size_t samples = 20000;  ///< Surfels that are looked at closely, >= 1.
  std::uint64_t seed = 1;       ///< Chooses the surfels and the points of their cells.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// How well the discs of a cloud cover its surface, at points drawn uniformly from the Voronoi
/// cells of sampled surfels in their tangent planes. Surfels at a border, whose cells are open, and
/// surfels without normal are left out. A disc covers a point where beta < cutoff in the disc's
/// plane, the normals agree within 60 degrees and the point is no further from the plane than the
/// disc's radius.
struct Coverage {
  std::size_t cells = 0;      ///< Closed cells that were sampled.
  double hole_share = 0;      ///< Share of the points that no disc covers.
  double overlap = 0;         ///< Mean number of discs over a point.
  double cell_area_mean = 0;  ///< Mean area of the cells, unit^2, which `area` should have.
};

/// How many other surfels have their centres within a surfel's radius: sampled surfels by that
/// number.
struct NeighborCounts {
  static constexpr std::size_t kMost = 24;  ///< This many or more are not told apart.
  std::array<std::size_t, kMost + 1> surfels{};

  /// Adds a surfel with so many.
  SURFEL_API void add(std::size_t neighbors);
  /// Sampled surfels.
  SURFEL_API std::size_t samples() const;
  bool operator==(const NeighborCounts&) const = default;
};

/// Counts and measures of a cloud. Lengths are in scene units.
struct CloudStatistics {
  std::size_t count = 0;
  std::size_t nonfinite_positions = 0;
  std::size_t nonfinite_normals = 0;
  std::size_t zero_normals = 0;        ///< Unknown normals.
  std::size_t non_unit_normals = 0;    ///< Finite, not zero, length off one by more than 1e-3.
  std::size_t nonfinite_values = 0;    ///< Surfels with NaN or infinity in any other column.
  std::size_t negative_variances = 0;  ///< Surfels whose variance is below zero.
  Bounds bounds;                       ///< Bounds of the finite positions, world coordinates.

  /// Distance from sampled surfels to the nearest other one; needs two finite positions.
  std::optional<Distribution> spacing;
  std::optional<NeighborCounts> neighbors;  ///< Of the same surfels; needs variances, too.
  double coincident_share = 0;         ///< Share of sampled surfels with another at the same place.
  std::optional<Distribution> radius;  ///< sqrt(2 c max variance) of all surfels.
  std::optional<Coverage> coverage;    ///< Needs normals, variances and closed cells.
};

/// Counts are exact; spacing and coverage are measured at `samples` surfels, spread evenly over the
/// file, among all surfels (by the exact search, about 40 bytes a surfel). Results do not depend
/// on the number of threads. Throws Error(kUsage) for bad options.
SURFEL_API CloudStatistics cloud_statistics(const SurfelCloud& cloud,
                                            const CloudStatisticsOptions& options = {});

/// Name and type of a property as write_cloud() would write it to PLY.
struct PropertyInfo {
  std::string name;
  std::string type;
};
/// The properties of a cloud. Radii, which write_cloud() makes of the variances, are not listed.
SURFEL_API std::vector<PropertyInfo> cloud_properties(const SurfelCloud& cloud);

}  // namespace surfel
