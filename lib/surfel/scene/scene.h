#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/light.h>
#include <surfel/scene/material.h>

namespace surfel {

class EnvironmentMap;

/// The value of Environment::image that stands for procedural_sky() (sample/procedural_sky.h).
inline constexpr char kSkyName[] = "sky";

/// Light from far away in all directions.
struct Environment {
  std::string image;    ///< A lat-long picture (scene/lat_long.h), or "sky", which is made.
  float intensity = 1;  ///< Factor for the picture's values, 0..1e6.
  float rotation = 0;   ///< Degrees about +y: the picture's direction +z is turned towards +x.
  bool visible = true;  ///< Is seen directly, too; else only in reflections and by refraction.
  std::shared_ptr<const EnvironmentMap> map{};  ///< Made by load_environment().
  std::string named_by{};  ///< The file that names the picture (open_named()); empty: none does.
};

/// Ambient light that comes from the sky above and the ground below, evenly from each half: a
/// surface sees of both the shares that its tilt against `up` leaves, and nothing hides them.
struct Sky {
  /// Any length but zero, world axes; unset: +y.
  std::optional<Vec3d> up{};
  Vec3f color{0, 0, 0};   ///< Light on a surface that faces up; linear, like Scene::ambient.
  Vec3f ground{0, 0, 0};  ///< Light on a surface that faces down.
};

/// How often a ray is refracted on its way through a pixel's surfaces (SP06 section 5.2.3).
enum class Refraction : std::uint8_t {
  kSingle,  ///< A ray is refracted once, by the nearest surface.
  kMulti,   ///< As often as there are surfaces, SP06 (12).
};

/// Materials, lights and environment of a picture. As made: one default material, some ambient
/// light, and a headlight over the viewer's left shoulder.
struct Scene {
  std::vector<Material> materials{Material{}};  ///< Surfels name rows; without the column, row 0.
  Vec3f ambient{0.25F, 0.25F, 0.25F};
  std::vector<Light> lights{Light{Light::Type::kHeadlight, {0.3, 0.4, 1}, {0.75F, 0.75F, 0.75F}}};
  std::optional<Sky> sky{};  ///< Adds to `ambient`.
  std::optional<Environment> environment{};
  Refraction refraction = Refraction::kMulti;

  /// Empty if usable, else one sentence per violated rule.
  SURFEL_API std::vector<std::string> problems() const;
};

/// The light of pictures for which nobody has described a scene: a headlight, a sky and the ground.
SURFEL_API Scene default_scene();

}  // namespace surfel
