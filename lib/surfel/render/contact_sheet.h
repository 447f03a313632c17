#pragma once

#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/store/cluster_store.h>

namespace surfel {

/// Number of surfels of the finest level whose centres lie in each pixel, seen or hidden, row by
/// row. Brings the surfels of a store that is not resident into memory one batch after another.
SURFEL_API std::vector<float> surfels_per_pixel(ClusterStore& store, const Camera& camera);

/// One picture of six, three beside each other, each as large as the picture that they explain:
/// its colours; the normals, x y z as red green blue; the depth, and below the density, the holes
/// and the weight, each of them with its range. Depths are those between which 98 in 100 pixels
/// lie, density and weight run from 0 to what 99 in 100 covered pixels stay below. Holes are
/// pixels of coverage below 1/2 that others surround; they are red.
///
/// \param picture  as Renderer::render() makes it with RenderOptions::aovs, without background.
/// \param density  of surfels_per_pixel().
/// \param background  linear R G B, opaque.
///
/// Throws Error(kUsage) for a picture without these channels, or if the sheet would have more than
/// Camera::kMostSide pixels either way.
SURFEL_API Image contact_sheet(const Image& picture, const std::vector<float>& density,
                               const Vec3f& background);

}  // namespace surfel
