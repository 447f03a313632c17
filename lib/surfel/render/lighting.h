#pragma once

#include <cstddef>

namespace surfel {

/// Lights and materials by which a Shader lights fragments where there is no environment: plain
/// numbers for SIMD code.
struct Lighting {
  struct Light {
    float vector[3];  ///< Towards the light, unit; of point lights the place relative to the eye.
    float color[3];
    bool point;
  };
  struct Reflection {
    float ambient[3];  ///< The material's times the scene's, and the mean of sky and ground.
    /// The material's ambient times half of what the sky gives more than the ground.
    float sky[3];
    float diffuse[3];
    float specular[3];
    float shininess;
  };
  const Light* lights = nullptr;
  std::size_t light_count = 0;
  const Reflection* materials = nullptr;
  std::size_t material_count = 0;
  float world_from_camera[3][3];
  float inv_focal_x, inv_focal_y, center_x, center_y;
  bool orthographic;
  bool has_sky = false;
  float up[3];  ///< Of the sky, unit.
  /// Normals come from a normal map: see Shader.
  bool mapped = false;
};

}  // namespace surfel
