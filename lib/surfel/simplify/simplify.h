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

struct SURFEL_API SimplifyOptions {
  /// Error that must not be exceeded, as SimplifyError::total() has it, > 0. Either
  std::optional<double> max_error;
  std::optional<std::size_t> count;  ///< this or the number of surfels to keep, >= 1.
  /// Distance from the surface, scene units, > 0, that counts as much as black against white.
  /// Unset: 1/30 of the bounding box's diagonal.
  std::optional<double> unit_deviation;
  /// Strength of the light that pictures will have, 0..100: by how much a normal's error tells.
  double light = 1;
  SheetRules sheets;
  double cutoff = 1;       ///< c of the renderer: the surface closes, and colours fit, 0.1..16.
  std::uint64_t seed = 1;  ///< Of the order in which surfels are looked at.
  /// Called with the share that is done; may be empty.
  std::function<void(double)> progress{};
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// Root mean square errors over the surface, measured at the surfels that a cloud had before it was
/// simplified, each by the surface that it stands for. At each, the simplified surface is what the
/// renderer makes of the surfels there, seen from near: the mean of their values, weighted by their
/// kernels.
struct SimplifyError {
  double color = 0;  ///< Per channel, linear light (opacity is a fourth one), 1 = black to white.
  /// Of a surface lit by one light of the given strength, from anywhere in front: of the normals
  /// (per axis) by the mean brightness of the cloud. The same unit.
  double shading = 0;
  double shape = 0;         ///< Of the distance along the normal, in units of unit_deviation.
  double max_distance = 0;  ///< The largest, scene units.
  SURFEL_API double total() const;  ///< Root of the sum of the squares of the first three.
};

/// What simplify() met and made.
struct SimplifyReport {
  UnusableSurfels dropped;    ///< Left out.
  std::size_t surfels = 0;    ///< Usable ones, before ...
  std::size_t merged = 0;     ///< ... of which so many were merged with others ...
  std::size_t result = 0;     ///< ... and surfels there are now.
  std::size_t no_normal = 0;  ///< Kept as they are, as they face no side.
  double unit_deviation = 0;  ///< Scene units.
  SimplifyError error;        ///< Measured.
  std::size_t uncovered = 0;  ///< Places that were covered and that merging left a gap at: closed.
  bool reached = true;        ///< count: that many. max_error: met with fewer surfels than before.
  int rounds = 0;             ///< Times that a simplified cloud was made and measured.
  std::vector<std::string> left_out;  ///< Columns that say nothing of merged surfels.
  StageTimes times;
};

/// The same surface with fewer surfels: few, large ones where it is flat and its colours are
/// smooth, all of them where it has detail.
///
/// 1. Spacing: octree cells are chosen such that a further surfel lowers the squared error most
///    where it is spent (detail_tree.h, sizing_field.h).
/// 2. Seeds: a Poisson-disk subset with that spacing; every surfel joins the nearest on its sheet
///    (sheet_clusters.h). What faces differently or has another material is never merged.
/// 3. Every cluster becomes one surfel (surfel_merge.h): mean position, normal and colour. One of a
///    single surfel stays as it is.
/// 4. Sizes: Gaussians of the kind that the cloud has that just cover their cluster's places at the
///    cutoff (covering_gaussian.h), with more weight where a place was covered and is not.
/// 5. Coefficients: least squares in the renderer's basis (render_system.h) against the colours
///    that the cloud shows at all of its surfels' places.
/// With max_error, the errors are then measured, and steps 2 to 5 repeated with another spacing,
/// until it is met, if only just.
///
/// Columns: position, normal, variances, area, colours, coefficients, alpha and material are those
/// of the merged surfels; uv is moved along with the position; other columns are those of the
/// member nearest to it; group, group_radius and source are left out. Surfels come out along a
/// Morton curve. Throws Error(kUsage) for bad options, Error(kInput), its message starting with
/// `name`, if there is no usable surfel, or no column of normals or variances. Does not depend on
/// the number of threads, nor on the order of the surfels.
SURFEL_API SurfelCloud simplify_surfels(const SurfelCloud& cloud, const SimplifyOptions& options,
                                        SimplifyReport* report = nullptr,
                                        const std::string& name = {});

}  // namespace surfel
