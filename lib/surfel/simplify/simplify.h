#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/usable_surfels.h>
#include <surfel/simplify/sheet_clusters.h>

namespace surfel {

/// Goal of simplify_surfels(), and what counts as an error.
struct SURFEL_API SimplifyOptions {
  /// Largest SimplifyError::total() allowed, > 0. Either `max_error` or `count` is set.
  std::optional<double> max_error = {};
  std::optional<std::size_t> count = {};  ///< Number of surfels to keep, >= 1.
  /// Distance from the surface, scene units, > 0, that counts as much as black against white.
  /// Unset: 1/30 of the bounding box's diagonal.
  std::optional<double> unit_deviation = {};
  /// Strength of the light that pictures will have, 0..100: by how much a normal's error tells.
  double light = 1;
  SheetRules sheets = {};  ///< Which surfels may be merged.
  double cutoff = 1;       ///< Cutoff of the renderer for which the surface closes and colours fit,
                           ///< 0.1..16.
  std::uint64_t seed = 1;  ///< Chooses the order in which surfels are looked at.
  /// Called with the share of the work that is done; may be empty.
  std::function<void(double)> progress{};
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Root mean square errors over the surface, measured at the surfels that a cloud had before it was
/// simplified, weighted by their areas. The simplified surface at a place is seen from near: the
/// mean of the surfels' values there, weighted by their kernels, as the renderer draws it.
struct SimplifyError {
  double color = 0;  ///< Error per channel, linear light, opacity being a fourth channel; 1 = black
                     ///< against white.
  /// Error of the shading by one light of the given strength, from anywhere in front: the error of
  /// the normals (per axis) times the mean brightness of the cloud; 1 = black against white.
  double shading = 0;
  double shape = 0;         ///< Error of the distance along the normal, in units of unit_deviation.
  double max_distance = 0;  ///< Largest distance along the normal, scene units.
  SURFEL_API double total() const;  ///< Root of the sum of the squares of color, shading and shape.
};

/// Figures of a simplify_surfels().
struct SimplifyReport {
  UnusableSurfels dropped;    ///< Surfels left out.
  std::size_t surfels = 0;    ///< Usable surfels before, mirror images left out.
  std::size_t merged = 0;     ///< Usable surfels that were merged with others.
  std::size_t result = 0;     ///< Surfels after, mirror images left out.
  std::size_t mirrored = 0;   ///< Mirror images of the result, which come on top of `count`.
  std::size_t no_normal = 0;  ///< Surfels without a normal, which are kept as they are.
  double unit_deviation = 0;  ///< Scene units.
  SimplifyError error;        ///< Measured error of the result.
  std::size_t uncovered = 0;  ///< Places where merging would have left a gap; gaps are closed.
  bool reached = true;        ///< With `count`: there are as many surfels. With `max_error`: fewer
                              ///< surfels than before keep the error.
  int rounds = 0;             ///< Times that a simplified cloud was made and measured.
  std::vector<std::string> left_out;  ///< Columns left out, as they do not apply to merged surfels.
  StageTimes times;
};

/// Makes a surface of fewer surfels: few, large ones where it is flat and its colours are smooth,
/// all of them where it has detail.
///
/// 1. Spacing: octree cells are chosen such that a further surfel lowers the squared error most
///    where it is spent (detail_tree.h, sizing_field.h).
/// 2. Seeds: a Poisson-disk subset with this spacing; every surfel joins the nearest seed on its
///    sheet (sheet_clusters.h). Surfels that face differently, or of different materials, are never
///    merged, nor those on two sides of a line at which surfels end (edges.h).
/// 3. Every cluster becomes one surfel (surfel_merge.h): mean position, normal and colour. A
///    cluster of a single surfel stays as it is.
/// 4. Sizes: Gaussians that just cover their cluster's places at the cutoff (covering_gaussian.h),
///    discs or ellipses as the cloud has them, with more weight where a place would be uncovered.
///    They end at the lines at which their members end.
/// 5. Coefficients: least squares in the renderer's basis (render_system.h) against the colours
///    that the cloud shows at all places of its surfels.
/// With max_error, the errors are then measured, and steps 2 to 5 are repeated with another
/// spacing, until the error is only just kept.
///
/// Columns: position, normal, variances, area, colours, coefficients, alpha and material are
/// merged; uv is moved along with the position; other columns come from the member nearest to the
/// position; group, group_radius and source are left out. Surfels come out along a Morton curve,
/// and mirror images (surfels whose centres half-planes cut off) behind them. Throws Error(kUsage)
/// for bad options, Error(kInput), its message starting with `name`, if there is no usable surfel,
/// or no column of normals or variances. Of more than kMostAtOnce surfels blocks along the curve
/// are simplified one by one (simplify_blocks.h). Does not depend on the number of threads, nor on
/// the order of the surfels.
SURFEL_API SurfelCloud simplify_surfels(const SurfelCloud& cloud, const SimplifyOptions& options,
                                        SimplifyReport* report = nullptr,
                                        const std::string& name = {});

}  // namespace surfel
