#pragma once

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/render_system.h>

namespace surfel {

/// What a surface made of surfels shows at places, seen from near along their normals: the means of
/// its surfels' values there, weighted by their kernels, as the renderer has them [SS01 (9)].
struct ShownSurface {
  Array<Channels> color;  ///< Red, green, blue in linear light, and opacity.
  Array<Vec3f> normal;    ///< Unit, or zero = unknown.
  Array<float> height;    ///< Of the surface above the place, along its own normal, scene units.
  Array<float> coverage;  ///< Sum of the kernels; 0 where there is none.
};

/// Colour to render of a surfel, and its opacity.
SURFEL_API Channels shown_color(const SurfelCloud& cloud, std::size_t surfel);

/// \param places     the surfels of this cloud are the places; what no kernel reaches shows what
///                   it is itself.
/// \param basis      of the surface's surfels. \param w  their colours and opacities.
/// \param evaluated  the basis at points, row by row those of ...
/// \param place      ... these places, each at most once.
SURFEL_API ShownSurface shown_surface(const SurfelCloud& places, const SurfelBasis& basis,
                                      const Array<Channels>& w, const EvaluatedBasis& evaluated,
                                      const Array<std::uint32_t>& place);

}  // namespace surfel
