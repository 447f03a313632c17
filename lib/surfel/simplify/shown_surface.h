#pragma once

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/texture/render_system.h>

namespace surfel {

/// Look of a surface made of surfels at places, seen from near along the places' normals: the means
/// of the surfels' values, weighted by their kernels, as the renderer computes them [SS01 (9)].
struct ShownSurface {
  Array<Channels> color;  ///< Red, green, blue in linear light, and opacity.
  Array<Vec3f> normal;    ///< Unit, or zero = unknown.
  Array<float> height;    ///< Height of the surface above the place along `normal`, scene units.
  Array<float> coverage;  ///< Sum of the kernels; 0 where no kernel reaches.

  /// Leaves the first places alone.
  void resize(std::size_t places) {
    color.resize(places);
    normal.resize(places);
    height.resize(places);
    coverage.resize(places);
  }
};

/// Colour that a surfel is rendered in, and its opacity.
SURFEL_API Channels shown_color(const SurfelCloud& cloud, std::size_t surfel);

/// Look of the surface at places.
/// \param places     cloud whose surfels are the places; a place that no kernel reaches shows the
///                   colour and normal of its surfel.
/// \param basis      basis functions of the surface's surfels.
/// \param w          colours and opacities of the basis functions.
/// \param evaluated  the basis evaluated at points, a row for each point.
/// \param place      place of each row; each place has one row at most.
SURFEL_API ShownSurface shown_surface(const SurfelCloud& places, const SurfelBasis& basis,
                                      const Array<Channels>& w, const EvaluatedBasis& evaluated,
                                      const Array<std::uint32_t>& place);

}  // namespace surfel
