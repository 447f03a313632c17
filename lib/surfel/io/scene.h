#pragma once

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

/// Materials and lights of a picture. As made: one default material, some ambient light, and a
/// headlight over the viewer's left shoulder.
struct Scene {
  std::vector<Material> materials{Material{}};  ///< Surfels name rows; without the column, row 0.
  Vec3f ambient{0.25F, 0.25F, 0.25F};
  std::vector<Light> lights{Light{Light::Type::kHeadlight, {0.3, 0.4, 1}, {0.75F, 0.75F, 0.75F}}};
};

/// Reads TOML: `ambient = [r, g, b]`, tables [[light]] (type = "directional" | "headlight" |
/// "point", direction or position, color) and [[material]] (name, ambient, diffuse, specular,
/// shininess, opacity). A file without lights, or without materials, has the default ones. Throws
/// Error naming file and line; an unknown key is an error.
SURFEL_API Scene read_scene(const std::string& path);

}  // namespace surfel
