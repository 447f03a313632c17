#pragma once

#include <cstddef>
#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Where surfels lie and which way they look, for culling.
struct ClusterBounds {
  Vec3f center{0, 0, 0};     ///< Centre of a sphere around the surfels' positions.
  float radius = 0;          ///< Radius of that sphere.
  float max_deviation = 0;   ///< Largest standard deviation of the surfels' Gaussians, scene units.
  Vec3f cone_axis{0, 0, 1};  ///< Axis of a cone that holds all normals.
  /// Cosine of the cone's half angle; -1 if no cone narrower than a half-space holds all normals.
  float cone_cosine = -1;
};

/// Cosine below which a cone of normals is of no use for culling.
inline constexpr float kWidestCone = 0.05F;

/// Floats that may be read past the end of every column, whatever they are.
inline constexpr std::size_t kColumnPadding = 16;

/// Columns of `count` surfels, padded by kColumnPadding.
struct ClusterColumns {
  const float* position[3];
  const float* normal[3];    ///< Unit, or zero = unknown.
  const float* deviation_u;  ///< Standard deviations, scene units; the same column twice where
  const float* deviation_v;  ///< they are equal.
  std::size_t count;
};

/// Bounds of surfels. Values that are NaN bound nothing.
SURFEL_API ClusterBounds cluster_bounds(const ClusterColumns& surfels);

/// Figures of some surfels; added_up() makes the whole cloud's figures of them.
struct SurfelTotals {
  Vec3f min, max;  ///< Bounds of the positions that are not NaN; infinite if there is none.
  /// Bounds of the positions, each extended by its surfel's deviation_u.
  Vec3f reach_min, reach_max;
  double deviations = 0;     ///< Sum of every surfel's larger standard deviation, scene units.
  bool usable = true;        ///< What usability() asks for holds for every surfel.
  bool transparent = false;  ///< Some alpha is below 1.
  bool invisible = false;    ///< Some alpha is 0.
};

/// The figures of all surfels, from the figures of their parts.
SURFEL_API SurfelTotals added_up(std::span<const SurfelTotals> parts);

/// The figures of some surfels.
/// \param surfels   Positions, normals and deviations.
/// \param area      Area of every surfel, scene unit^2.
/// \param alpha     Opacity of every surfel, 0..1; null: all are opaque.
/// \param positive  Columns whose values must be above 0.
/// \param bounded   Columns whose values must not be beyond kMostMagnitude.
SURFEL_API SurfelTotals surfel_totals(const ClusterColumns& surfels, const float* area,
                                      const float* alpha, std::span<const float* const> positive,
                                      std::span<const float* const> bounded);

}  // namespace surfel
