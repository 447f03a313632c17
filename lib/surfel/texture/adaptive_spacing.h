#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/timing.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/sample/sizing_field.h>
#include <surfel/scene/triangle_mesh.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// Goal and limits of adaptive_spacing().
struct SURFEL_API AdaptiveSpacingOptions {
  /// Root mean square over the surface of the error of colour (per channel, linear light, 0 to 1)
  /// and of shape (distance / unit_deviation) together, > 0. Either max_error or count is set.
  std::optional<double> max_error;
  std::optional<std::size_t> count;  ///< Number of samples to place best, >= 1.
  /// Distance between surfels and surface, scene units, > 0, that counts as much as black against
  /// white. Unset: 1/30 of the bounding box's diagonal.
  std::optional<double> unit_deviation;
  /// MeshSampleOptions::variance_scale of the samples.
  double variance_scale = MeshSampleOptions::kVarianceScale;
  std::uint64_t seed = 1;
  std::size_t most_probes = 1 << 21;          ///< Places to look at, at least 32768 are.
  std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// The field of spacings that adaptive_spacing() chose, and the errors expected of it.
struct AdaptiveSpacingReport {
  std::size_t probes = 0;     ///< Places where the surface was looked at.
  std::size_t cells = 0;      ///< Cells of the field; each has one spacing.
  double unit_deviation = 0;  ///< Scene units.
  double error = 0;           ///< Expected: root of color_error^2 + shape_error^2.
  double color_error = 0;     ///< Root mean square, linear light.
  double shape_error = 0;     ///< Root mean square, in units of unit_deviation.
  double least_spacing = 0;   ///< Scene units.
  bool reached = true;  ///< False: the finest spacing that was looked at does not meet max_error.
  StageTimes times;
};

/// The spacing that gives a mesh the error asked for with the fewest samples, or the least error
/// with a number of them: small where texture, vertex colours or shape have detail (detail_tree.h
/// says what errors are), large elsewhere, changing by at most 0.35 per unit of distance in
/// between, which only lowers the error. Errors are expected of coefficients by view-independent
/// EWA, drawn at cutoff 1, seen from near.
///
/// The mesh is looked at in uniform samples, four times as many each time until few of the surfels
/// would go where detail is as fine as they are.
///
/// \param mesh      The surface to sample.
/// \param textures  Textures of the mesh (load_textures()), or null: its own colours alone.
/// \param options   The error or the number of samples that is asked for.
/// \param report    If not null, filled.
/// \param name      The mesh's file, for messages.
///
/// Throws Error as sample_mesh() and fit_texture() do. The same for any number of threads.
SURFEL_API SizingField adaptive_spacing(const TriangleMesh& mesh, TextureSet* textures,
                                        const AdaptiveSpacingOptions& options,
                                        AdaptiveSpacingReport* report = nullptr,
                                        const std::string& name = {});

}  // namespace surfel
