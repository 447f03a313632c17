#pragma once

// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001, sections 4, 6 and 7, as
// they are printed: what docs/stability.md holds the renderer against.

#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel::test {

struct PublishedOptions {
  int layers = 3;              ///< l.
  double cutoff = 1;           ///< c.
  double coverage = 0.4;       ///< tau.
  double depth_threshold = 0;  ///< Scene units; 0: the radius of each disc, sqrt(2 c V).
};

/// The unlit picture, premultiplied R G B A, by SS01 in precision T, world coordinates included.
///
/// As printed: J by the inverse of the projected screen axes; the affine kernel (6); surfels in the
/// order of the cloud; the z threshold alone decides what is one surface; with no layer free the
/// two fragments next to each other in z are shaded and merged (12); alpha' = alpha min(1, q /
/// tau). Corrected as lib/README.md says: V = h^2 I, the exponent, the amplitude. Where the
/// paper is silent it gets the better choice: the tangent plane's z is exact, not stepped;
/// contributions that match a shaded fragment are dropped.
template <class T>
Image render_published(const SurfelCloud& cloud, const Camera& camera,
                       const PublishedOptions& options = {});

extern template Image render_published<float>(const SurfelCloud&, const Camera&,
                                              const PublishedOptions&);
extern template Image render_published<double>(const SurfelCloud&, const Camera&,
                                               const PublishedOptions&);

}  // namespace surfel::test
