#include <algorithm>
#include <bit>
#include <cmath>

#include <surfel/render/shading.h>

namespace surfel {

Shader::Shader(const Scene* scene, const Camera& camera)
    : scene_(scene),
      world_from_camera_(camera.camera_from_world.transpose().cast<float>()),
      inv_focal_x_(static_cast<float>(1 / camera.focal_x)),
      inv_focal_y_(static_cast<float>(1 / camera.focal_y)),
      center_x_(static_cast<float>(camera.center_x)),
      center_y_(static_cast<float>(camera.center_y)),
      orthographic_(camera.orthographic) {
  if (!scene) return;
  for (const Light& light : scene->lights) {
    if (light.type == Light::Type::kPoint) {
      lights_.push_back({(light.vector - camera.eye).cast<float>(), light.color, true});
      continue;
    }
    const Vec3d along = light.type == Light::Type::kHeadlight
                            ? Vec3d(camera.camera_from_world.transpose() * light.vector)
                            : light.vector;
    lights_.push_back({(-along.normalized()).cast<float>(), light.color, false});
  }
}

Rgba Shader::shade(const Fragment& fragment, float x, float y, float full_weight) const {
  const float* c = fragment.channel;
  const float inv_weight = 1.0F / c[kWeight];
  const float alpha = c[kAlpha] * inv_weight;
  const float coverage = std::min(1.0F, c[kWeight] / full_weight);
  if (!lit()) {
    const float scale = inv_weight * coverage;
    return {c[kRed] * scale, c[kGreen] * scale, c[kBlue] * scale, alpha * coverage};
  }
  if (!(c[kAlpha] > 0)) return {};
  const Vec3f color = Vec3f(c[kRed], c[kGreen], c[kBlue]) / c[kAlpha];
  const std::size_t material = std::min<std::size_t>(
      std::bit_cast<std::uint32_t>(c[kTag]) >> kMaterialShift, scene_->materials.size() - 1);
  const Vec3f lit = lit_color(color, Vec3f(c[kNormalX], c[kNormalY], c[kNormalZ]),
                              scene_->materials[material], x, y, c[kDepth] * inv_weight);
  const float opacity = alpha * coverage;
  return {lit.x() * opacity, lit.y() * opacity, lit.z() * opacity, opacity};
}

Vec3f Shader::lit_color(const Vec3f& color, Vec3f normal, const Material& material, float x,
                        float y, float depth) const {
  // From the eye through (x, y), in world axes.
  const float px = (x - center_x_) * inv_focal_x_;
  const float py = (y - center_y_) * inv_focal_y_;
  const Vec3f ray = world_from_camera_ * (orthographic_ ? Vec3f(0, 0, 1) : Vec3f(px, py, 1));
  const Vec3f to_eye = -ray.normalized();
  const float length = normal.norm();
  normal = length > 0 ? Vec3f(normal / length) : to_eye;
  if (normal.dot(to_eye) < 0) normal = -normal;

  Vec3f diffuse = material.ambient.cwiseProduct(scene_->ambient);
  Vec3f specular(0, 0, 0);
  for (const LightInWorld& light : lights_) {
    Vec3f to_light = light.vector;
    if (light.point) {
      const Vec3f place = orthographic_ ? Vec3f(world_from_camera_ * Vec3f(px, py, z(depth)))
                                        : Vec3f(ray * z(depth));
      to_light = (light.vector - place).normalized();
    }
    const float cosine = normal.dot(to_light);
    if (!(cosine > 0)) continue;
    diffuse += cosine * material.diffuse.cwiseProduct(light.color);
    if (!material.specular.isZero()) {
      const float half_cosine = std::max(0.0F, normal.dot((to_light + to_eye).normalized()));
      specular +=
          std::pow(half_cosine, material.shininess) * material.specular.cwiseProduct(light.color);
    }
  }
  return color.cwiseProduct(diffuse) + specular;
}

}  // namespace surfel
