#pragma once

#include <optional>

#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/ewa_fit.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// Replaces the cloud's coefficients w_ewa (and alpha, where report.alpha is set) by the solution
/// of R w = c [SS01 (11)], pulled towards w_ewa by lambda.
///
/// c_k is w_ewa times (R 1)_k, the inner product of r_k with the sum of all functions, instead of
/// with 1: the kernels' sum is no more than about constant, and so the fit of a constant texture is
/// a constant, whatever lambda.
void fit_gram(SurfelCloud& cloud, const SurfelBasis& basis, const TextureFitOptions& options,
              TextureFitReport& report);

/// Replaces the cloud's coefficients w_ewa (and alpha, where report.alpha is set) by the least
/// squares fit to `colors` in the renderer's basis (render_system.h), and notes the cutoff that
/// this basis is for in the cloud.
void fit_render(SurfelCloud& cloud, PointColors colors, const RenderSystemOptions& render_options,
                const TextureFitOptions& options, TextureFitReport& report);

}  // namespace surfel
