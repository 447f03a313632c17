#pragma once

#include <optional>
#include <string>

#include <surfel/base/types.h>

namespace surfel {

/// Row of the material table. Reflectances multiply the surface's filtered colour (specular: the
/// light's alone).
struct Material {
  std::string name = "default";
  Vec3f ambient{1, 1, 1};
  Vec3f diffuse{1, 1, 1};
  Vec3f specular{0, 0, 0};
  float shininess = 32;  ///< Exponent of Blinn and Phong, >= 0.
  float opacity = 1;     ///< Multiplies the surfels' alpha, 0..1.

  // What follows shows in scenes with an environment only.

  /// Share of the environment's light that is reflected at normal incidence, 0..1; it rises to 1 at
  /// grazing angles. 0: no reflection at any angle. Tints are for opaque materials: what a surface
  /// lets through is less by the mean of the three.
  Vec3f reflectivity{0, 0, 0};
  /// Index of refraction of what the surface encloses, relative to what is around it, 0.25..4: the
  /// reciprocal of SP06's refraction ratio. Unset: nothing is refracted.
  std::optional<float> ior{};
  float dispersion = 0;  ///< (ior of blue - ior of red) / ior, 0..0.5; that of green is `ior`.
  /// Burley's, 0..1: its square is the width alpha of the microfacets' distribution. For the
  /// environment alone: `shininess` is that of lights.
  float roughness = 0;
  Vec3f absorption{0, 0, 0};  ///< Share of the environment's light that a layer takes, 0..1.
};

}  // namespace surfel
