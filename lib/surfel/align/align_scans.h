#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/transform.h>

namespace surfel {

/// How far and how long align_scans() searches.
struct AlignOptions {
  double reach = 0;  ///< How far points may be from their right places at first, scene units, 0 or
                     ///< 1e-9..1e9; 0: a twentieth of the largest scan's diameter.
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// How one scan lies on the others.
struct ScanFit {
  Similarity pose;          ///< From where the scan was to its place; scale 1.
  std::size_t points = 0;   ///< Points that were looked at.
  std::size_t matched = 0;  ///< Points of them that have a counterpart on another scan.
  double rms = 0;           ///< Of their distances to the counterparts' planes, scene units.
  double moved = 0;         ///< Largest move of a point, scene units.
};

/// The poses that align_scans() has found, and how well they fit.
struct AlignReport {
  std::vector<ScanFit> scans;
  double reach = 0;         ///< As it was taken, scene units.
  double rms = 0;           ///< Of all matches' distances to planes, scene units.
  std::size_t matches = 0;  ///< Matches of all pairs of scans.
  int rounds = 0;           ///< Bundles that were solved.
  /// The last round moved no point by more than a thousandth of a spacing.
  bool converged = false;
  StageTimes times;
};

/// Poses that put several scans of one surface into the frame of the first, which stays.
///
/// One after another, that with the most matches first, scans are moved onto those already placed
/// by PCL's iterative closest points. Then all poses are found at once (a bundle): Ceres minimises
/// Cauchy's function of the distances of matched points of all pairs of scans to the planes of
/// their counterparts, with matches found anew each round [Pulli 1999 for the bundle; Chen, Medioni
/// 1992 for planes]. The scale of Cauchy's function is 2.385 standard deviations, told from the
/// median. Matches have to be nearer from round to round, in the end 2.5 spacings. All is done in
/// double about the scans' centres, so that scans far from the origin lose nothing.
///
/// Surfaces that slide along themselves (planes, spheres, cylinders) do not tell a pose; along
/// these directions scans stay near to where they were.
///
/// \param clouds   The scans, two at least, each in its own frame. The first one stays.
/// \param options  How far scans may be from their right places at first.
/// \param names    One for each cloud, for messages.
/// \return The pose of every scan, and how well the scans fit.
///
/// The result does not depend on the number of threads. Throws Error(kUsage) for bad options or
/// fewer than two clouds, Error(kInput) for clouds that are too small or do not overlap the others,
/// Error(kIo) if a plug-in cannot be loaded.
SURFEL_API AlignReport align_scans(std::span<const SurfelCloud> clouds, const AlignOptions& options,
                                   std::span<const std::string> names);

}  // namespace surfel
