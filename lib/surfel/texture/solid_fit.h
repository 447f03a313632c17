#pragma once

#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/ewa_fit.h>
#include <surfel/texture/solid_texture.h>
#include <surfel/texture/surfel_basis.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// Coefficients by a solid texture: w_k is its mean over the Gaussian of V_k in the tangent plane
/// about u_k, as view-independent EWA filters an image [SS01 section 5]. Surfels without a function
/// in the basis get the colour at their place, and without a place the texture's mean. The result
/// is the same for any number of threads.
/// \param basis   of the cloud (make_basis()).
/// \param points  if not null, the texture at the points, filtered as cover_surface() asks for.
void fit_solid_ewa(SurfelCloud& cloud, const SolidTexture& texture, const SurfelBasis& basis,
                   const TextureFitOptions& options, TextureFitReport& report,
                   PointColors* points = nullptr);

}  // namespace surfel
