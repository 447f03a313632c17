#pragma once

// What cloud_statistics() looks at around a surfel: the same of a cloud in memory and of one that
// comes piece by piece. Internal to the measure module.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <surfel/base/box_tree.h>
#include <surfel/base/random.h>
#include <surfel/base/types.h>
#include <surfel/measure/cloud_statistics.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/surface/neighbor_search.h>
#include <surfel/surface/tangent_frame.h>
#include <surfel/surface/voronoi_cell.h>

namespace surfel {

/// Neighbours that bound a Voronoi cell; on a random surface six do on average.
inline constexpr std::size_t kCellNeighbors = 24;
static_assert(NeighborCounts::kMost <= kCellNeighbors);
/// Discs looked at per cell; more over one point than this are not counted.
inline constexpr std::size_t kMostDiscs = 1024;
inline constexpr int kPointsPerCell = 16;  ///< 20,000 cells tell a share to 0.1 % then.
/// Cells are measured in so many rounds, each spread over the cloud, of which the last are left out
/// once discs have been looked at so often for each cell in the mean. Discs that just close a
/// surface take a quarter of it; thousands over each other would take all the time there is.
inline constexpr std::size_t kCellRounds = 16;
inline constexpr std::size_t kDiscsPerCell = 48;
/// Where the largest radius is more than this times the median one, what lies over a place is
/// looked for by each disc's own radius.
inline constexpr float kLikeRadii = 4;

/// Balls around cells are wider by this factor, so that rounding leaves nothing out.
inline constexpr float kReachRounding = 1.0001F;

inline bool finite(float value) { return std::isfinite(value); }
inline bool finite(const Vec2f& value) { return value.allFinite(); }
inline bool finite(const Vec3f& value) { return value.allFinite(); }
inline bool finite(const Vec3d& value) { return value.allFinite(); }
template <class Integer>
requires std::is_integral_v<Integer>
bool finite(Integer) { return true; }

inline float largest_variance(const SurfelCloud& cloud, std::size_t i) {
  return cloud.anisotropic() ? std::max(cloud.variance_u[i], cloud.variance_v[i])
                             : cloud.variance[i];
}

/// sqrt(2 c max variance), or 0 where that is no number.
inline float disc_radius(const SurfelCloud& cloud, std::size_t i, double cutoff) {
  const double variance = largest_variance(cloud, i);
  const bool usable = std::isfinite(variance) && variance > 0;
  return usable ? static_cast<float>(std::sqrt(2 * cutoff * variance)) : 0.0F;
}

/// The surfels with finite positions, which spacing and coverage are measured of.
struct MeasuredDiscs {
  Array<Vec3f> position;
  Array<std::uint32_t> surfel;  ///< Index into the cloud.
  Array<float> radius;          ///< sqrt(2 c max variance); empty without variances.
};

MeasuredDiscs finite_discs(const SurfelCloud& cloud, double cutoff);

/// Finds discs that may lie over places near a place by the radius of each, so that small ones
/// around a large one do not all count.
class DiscsAround {
 public:
  /// \param largest_radius  of all discs of the cloud
  DiscsAround(const MeasuredDiscs& discs, float largest_radius);

  /// The discs that may lie over places in the ball; false if there are more than kMostDiscs.
  bool within(const Vec3f& center, double radius, std::vector<Neighbor>& out) const;

 private:
  static constexpr float kRounding = 1.0001F;

  /// Box around what the discs reach.
  struct Box {
    Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::max());
    Eigen::Array3f high = Eigen::Array3f::Constant(-std::numeric_limits<float>::max());
    float largest = 0;  ///< Reach of one disc.

    void add(const Box& other) {
      low = low.min(other.low);
      high = high.max(other.high);
      largest = std::max(largest, other.largest);
    }
    float distance2(const Eigen::Array3f& p) const {
      return (low - p).max(p - high).max(0).matrix().squaredNorm();
    }
  };

  const MeasuredDiscs& discs_;
  Array<float> reach_;
  Array<std::uint32_t> order_;
  BoxTree<Box, 4, 2> tree_;
};

/// Do two normals show the same surface? Within 60 degrees they do (surface/sheet.h says why no
/// more). The rule that sizes are estimated by is another on purpose: coverage is a second opinion
/// on the sizes.
inline bool same_surface(const Vec3f& a, const Vec3f& b) {
  constexpr float kAgreeingCosine = 0.5F;
  return a.dot(b) > kAgreeingCosine;
}

/// What was found around a surfel.
struct CellCoverage {
  double area = 0;  ///< 0 where the cell is open.
  int points = 0;
  int holes = 0;
  double overlap = 0;         ///< Discs over the points, summed.
  std::size_t looked_at = 0;  ///< Discs that may lie over the points.
};

/// The Voronoi cell of a surfel in its tangent plane, and its points.
struct SurfelCell {
  double area = 0;
  double radius = 0;
  std::array<Vec3d, kPointsPerCell> points;  ///< Relative to the origin of the cloud.
};

/// A neighbour of a surfel, or the surfel itself.
struct CellNeighbor {
  Vec3f position;
  bool same_surface;  ///< By the normals of the two.
};

/// The cell of a surfel.
/// \param surfel  its number in the cloud, which chooses the points
/// \param near    its kCellNeighbors + 1 nearest, itself included, nearest first
///
/// Unset where the cell is open, or neighbours that were not looked at could still cut it.
std::optional<SurfelCell> surfel_cell(const Vec3f& position, const Vec3f& normal,
                                      std::uint64_t surfel, std::uint64_t seed,
                                      const std::vector<CellNeighbor>& near);

/// Does surfel i of a cloud, whose disc has this radius, cover a place of a surface with the normal
/// `normal`?
bool covers(const SurfelCloud& cloud, std::size_t i, float radius, double cutoff,
            const Vec3f& normal, const Vec3d& place);

/// `samples` of [0, count), spread evenly, one from each of equal stretches; all if there are
/// fewer.
std::vector<std::size_t> sampled(std::size_t count, std::size_t samples, std::uint64_t seed);

/// The coverage that cells show; none where none is closed.
std::optional<Coverage> coverage_of_cells(const std::vector<CellCoverage>& cells);

/// Adds the flaws of a piece of a cloud.
void count_flaws(const SurfelCloud& cloud, CloudStatistics& out);

}  // namespace surfel
