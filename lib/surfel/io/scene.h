#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
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

class EnvironmentMap;

/// Environment::image of the one that is made, procedural_sky() (sample/procedural_sky.h).
inline constexpr char kSkyName[] = "sky";

/// Light from far away in all directions.
struct Environment {
  std::string image;    ///< A lat-long picture (io/lat_long.h), or "sky", which is made.
  float intensity = 1;  ///< Factor for the picture's values, 0..1e6.
  float rotation = 0;   ///< Degrees about +y: what the picture has at +z is turned towards +x.
  bool visible = true;  ///< Is seen directly, too; else only in reflections and by refraction.
  std::shared_ptr<const EnvironmentMap> map{};  ///< Made by load_environment().
};

/// How often a ray is refracted on its way through a pixel's surfaces (SP06 section 5.2.3).
enum class Refraction : std::uint8_t {
  kSingle,  ///< Once, by the nearest one.
  kMulti,   ///< As often as there are surfaces, SP06 (12).
};

/// Light source; colours are linear and unbounded.
struct Light {
  enum class Type {
    kDirectional,  ///< `vector` points from the light into the scene, world axes.
    kHeadlight,    ///< The same in camera axes (x right, y down, z forward): moves with the camera.
    kPoint,        ///< `vector` is the light's place in the world; no fall-off.
  };
  Type type = Type::kHeadlight;
  Vec3d vector{0, 0, 1};
  Vec3f color{1, 1, 1};
};

/// Materials, lights and environment of a picture. As made: one default material, some ambient
/// light, and a headlight over the viewer's left shoulder.
struct Scene {
  std::vector<Material> materials{Material{}};  ///< Surfels name rows; without the column, row 0.
  Vec3f ambient{0.25F, 0.25F, 0.25F};
  std::vector<Light> lights{Light{Light::Type::kHeadlight, {0.3, 0.4, 1}, {0.75F, 0.75F, 0.75F}}};
  std::optional<Environment> environment{};
  Refraction refraction = Refraction::kMulti;
};

/// Reads TOML: `ambient = [r, g, b]`, `refraction` ("single" | "multi"), tables [[light]] (type =
/// "directional" | "headlight" | "point", direction or position, color), [[material]] (name,
/// ambient, diffuse, specular, shininess, opacity, reflectivity, ior, dispersion, roughness,
/// absorption) and [environment] (image, relative to the file's folder; intensity, rotation,
/// visible). A material with an ior but no reflectivity has that of its ior, ((ior - 1) / (ior +
/// 1))^2. A file without lights, or without materials, has the default ones. Environments are named
/// here and loaded by load_environment() (render/environment_map.h). Throws Error naming file and
/// line; an unknown key is an error.
SURFEL_API Scene read_scene(const std::string& path);

}  // namespace surfel
