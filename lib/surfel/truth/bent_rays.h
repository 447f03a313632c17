#pragma once

#include <Eigen/Core>
#include <optional>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>
#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/shading.h>
#include <surfel/scene/material.h>
#include <surfel/scene/scene.h>

namespace surfel {

/// A surface where a ray meets it.
struct MetSurface {
  float t;               ///< Along the ray, scene units.
  Eigen::Array4f color;  ///< R G B A, premultiplied, linear; the material's opacity not applied.
  Vec3f normal;          ///< Unit, of the side that the ray meets; smooth ones may look away.
  std::size_t material;  ///< Row of the scene's table.
  bool front;            ///< The ray comes from outside of the body that the surface bounds.
};

/// The nearest surface at origin + t direction with t >= from; `direction` is unit.
using NearestSurface =
    FunctionRef<std::optional<MetSurface>(const Vec3f& origin, const Vec3f& direction, float from)>;

/// Rays that surfaces bend and mirror, as geometrical optics says: see MeshRenderer.
struct SURFEL_API BentRays {
  const Scene& scene;    ///< With an environment.
  const Shader& shader;  ///< Of the scene.
  Vec3f eye;             ///< Where the camera is, in the axes of the rays' origins.
  float gap;             ///< Distance from a surface at which a ray goes on behind it, scene units.
  int bounces;           ///< Surfaces that a ray may meet one after another.

  /// Premultiplied radiance from the places origin + t direction, t >= from. Opaque where the ray
  /// meets a surface that bends, mirrors or hides, or sees the environment.
  /// \param direction  unit.
  Rgba trace(NearestSurface nearest, const Vec3f& origin, const Vec3f& direction, float from) const;
};

/// Paths that carry less than this share of a pixel's light see the environment at once: a quarter
/// of a step of an 8-bit picture.
inline constexpr float kFaintPath = 1.0F / 1024;

}  // namespace surfel
