#pragma once

// Deferred shading, SS01 section 4: each fragment once, with its filtered normal.

#include <vector>

#include <surfel/io/camera.h>
#include <surfel/io/scene.h>
#include <surfel/render/a_buffer.h>

namespace surfel {

/// Turns fragments into colours: unlit (the filtered texture itself) or lit by a scene's lights
/// with the reflection model of Blinn and Phong. Normals are seen from both sides. For one camera.
class Shader {
 public:
  /// `scene` null: unlit.
  Shader(const Scene* scene, const Camera& camera);

  bool lit() const { return scene_ != nullptr; }

  /// Colour of an unmerged fragment seen at picture coordinates (x, y), pixels, pixel centres at
  /// +1/2: normalised by the sum of rho (9), shaded, its opacity multiplied with its coverage
  /// min(1, sum of rho / full_weight).
  Rgba shade(const Fragment& fragment, float x, float y, float full_weight) const;

  /// z of a depth as splats hold it, and back.
  float z(float depth) const { return orthographic_ ? -depth : 1.0F / depth; }
  float depth(float z) const { return orthographic_ ? -z : 1.0F / z; }

 private:
  Vec3f lit_color(const Vec3f& color, Vec3f normal, const Material& material, float x, float y,
                  float depth) const;

  struct LightInWorld {
    Vec3f vector;  ///< Towards the light, unit; of point lights the place relative to the eye.
    Vec3f color;
    bool point;
  };
  const Scene* scene_;
  std::vector<LightInWorld> lights_;
  Eigen::Matrix3f world_from_camera_;
  float inv_focal_x_, inv_focal_y_, center_x_, center_y_;
  bool orthographic_;
};

}  // namespace surfel
