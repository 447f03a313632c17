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

  // The members below show in scenes with an environment only.

  /// Share of the environment's light that is reflected at normal incidence, 0..1; it rises to 1 at
  /// grazing angles. 0: no reflection at any angle. Tints are for opaque materials: a surface lets
  /// through less light by the mean of the three.
  Vec3f reflectivity{0, 0, 0};
  /// Index of refraction of the medium that the surface encloses, relative to the medium around it,
  /// 0.25..4: the reciprocal of SP06's refraction ratio. Unset: nothing is refracted.
  std::optional<float> ior{};
  float dispersion = 0;  ///< (ior of blue - ior of red) / ior, 0..0.5; `ior` is green's.
  /// Burley's, 0..1: its square is the width alpha of the microfacets' distribution. It blurs the
  /// environment alone; highlights of lights have `shininess`.
  float roughness = 0;
  Vec3f absorption{0, 0, 0};  ///< Share of the environment's light that a layer takes, 0..1.
};

}  // namespace surfel
