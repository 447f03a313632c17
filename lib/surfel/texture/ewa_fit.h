#pragma once

#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/render_system.h>
#include <surfel/texture/texture_fit.h>

namespace surfel {

/// The texture at points of the surface: at a surfel's uv, moved by the point's offset along the
/// surfel's derivatives.
struct PointColors {
  const SurfelBasis& basis;
  Quadrature quadrature;        ///< Points, and the filters for each function of the basis.
  Array<Channels> color{};      ///< Out: R, G, B, alpha.
  Array<std::uint8_t> known{};  ///< Out: 0 where the point lies off its surfel's chart.
};

/// The part of a texture that a surfel averages, and by which kernel.
struct EwaFootprint {
  TexelKernel kernel;
  bool point = false;    ///< The surfel's own kernel is not usable.
  bool widened = false;  ///< Its aspect was limited.
};

/// G_{f T^-1 V_k T^-T + n^2 I} about the surfel's place in the image, f being
/// TextureFitOptions::prefilter; the surfel's uv are finite.
EwaFootprint ewa_footprint(const SurfelCloud& cloud, std::size_t surfel, const TextureMap& map,
                           const TextureFitOptions& options);

/// View-independent EWA [SS01 section 5]: w_k = sum_i c_i g_i / sum_i g_i over the texels i, with
/// g = G_{T^-1 V_k T^-T + n^2 I} about the surfel's place in the image, n being the reconstruction
/// kernel's standard deviation (see ewa_footprint()). These coefficients solve SS01 (11) where the
/// basis is taken as orthonormal. fit_texture() must have checked the columns. Builds the maps'
/// pyramids as far as needed. The result is the same for any number of threads.
/// \param points  if not null, sampled at the same time, as the textures are then at hand.
void fit_ewa(SurfelCloud& cloud, TextureSet& textures, const TextureFitOptions& options,
             TextureFitReport& report, PointColors* points = nullptr);

/// Requests what fit_ewa() will sample, of all maps, and loads none.
void request_ewa(SurfelCloud& cloud, TextureSet& textures, const TextureFitOptions& options,
                 PointColors* points = nullptr);

}  // namespace surfel
