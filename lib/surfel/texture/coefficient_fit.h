#pragma once

#include <optional>

#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/ewa_fit.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// <r_k, sum_i n_i o t^-1> of every function, unit^2: a_k times the sum over the texels of
/// G_{T^-1 V_k T^-T + n^2 I}. Times w_ewa it is c_k of SS01 (11), at any density of texels: exact
/// as far as t is affine over the kernel, w_ewa is exact (GaussianPyramid: within 5e-5 of the
/// image's range, 1.2e-4 where n is 0.25 texels, and 1e-3 of the amplitude of the worst frequency
/// from level 1 on), and no kernel was widened. At the border of a chart the surface goes on, and
/// its texture is taken to be as on this side.
Array<double> texture_integrals(const SurfelCloud& cloud, const SurfelBasis& basis,
                                const TextureSet& textures, const TextureFitOptions& options);

/// The lambda by which fit_gram() makes R definite, relative to the mean of its diagonal.
double gram_lambda(const SurfelBasis& basis, const TextureFitOptions& options);

/// Replaces the cloud's coefficients w_ewa (and alpha, where report.alpha is set) by the solution
/// of R w = c [SS01 (11)], pulled towards w_ewa by lambda.
/// \param integrals  c_k / w_ewa of every function: texture_integrals(); empty: (R 1)_k, for
///                   GramRightSide::kNormalised.
void fit_gram(SurfelCloud& cloud, const SurfelBasis& basis, const Array<double>& integrals,
              const TextureFitOptions& options, TextureFitReport& report);

/// Replaces the cloud's coefficients w_ewa (and alpha, where report.alpha is set) by the least
/// squares fit to `colors` in the renderer's basis (render_system.h), and notes the cutoff that
/// this basis is for in the cloud.
void fit_render(SurfelCloud& cloud, PointColors colors, const RenderSystemOptions& render_options,
                const TextureFitOptions& options, TextureFitReport& report);

}  // namespace surfel
