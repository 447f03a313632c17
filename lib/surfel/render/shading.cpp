#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/rotation.h>
#include <surfel/render/environment_map.h>
#include <surfel/render/lighting-inl.h>
#include <surfel/render/shading.h>

namespace surfel {
namespace {

/// Mean of both polarisations' reflectances; 1 at total reflection.
float dielectric_reflectance(float ior, float cosine) {
  const float eta = 1 / ior;
  const float transmitted2 = 1 - eta * eta * (1 - cosine * cosine);
  if (transmitted2 <= 0) return 1;
  const float transmitted = std::sqrt(transmitted2);
  const float perpendicular = (eta * cosine - transmitted) / (eta * cosine + transmitted);
  const float parallel = (cosine - eta * transmitted) / (cosine + eta * transmitted);
  return 0.5F * (perpendicular * perpendicular + parallel * parallel);
}

/// See lit_color().
struct ArrayOps {
  static Eigen::Array3f set(const float* v) { return Eigen::Array3f(v); }
  static float dot(const Eigen::Array3f& a, const Eigen::Array3f& b) {
    return a.matrix().dot(b.matrix());
  }
  static float length(const Eigen::Array3f& a) { return a.matrix().norm(); }
  static Eigen::Array3f normalized(const Eigen::Array3f& a) { return a.matrix().normalized(); }
  static float positive_part(float x) { return std::max(0.0F, x); }
  static float highlight(float cosine, float half_cosine, float length, float shininess) {
    if (!(cosine > 0)) return 0;
    const float exponent = shininess * length / (length + shininess * (1 - length));
    const float lobe = portable::pow(std::max(0.0F, half_cosine / length), exponent);
    return (1 + exponent) / (1 + shininess) * lobe;
  }
};

/// \param place  gives the surface's place relative to the eye, for point lights.
template <class Place>
HWY_ATTR Vec3f lit_by(const Lighting& lighting, const Lighting::Reflection& reflection,
                      const Vec3f& color, const SeenSurface& surface, const Place& place) {
  return HWY_NAMESPACE::lit_color<ArrayOps>(lighting, reflection, Eigen::Array3f(color),
                                            Eigen::Array3f(surface.mean_length * surface.normal),
                                            Eigen::Array3f(surface.to_eye),
                                            [&] { return Eigen::Array3f(place()); });
}

void to_plain(const Vec3f& from, float* to) { std::copy_n(from.data(), 3, to); }

Lighting::Light plain_light(const Vec3f& vector, const Vec3f& color, bool point) {
  Lighting::Light light{};
  light.point = point;
  to_plain(vector, light.vector);
  to_plain(color, light.color);
  return light;
}

}  // namespace

Vec3f fresnel_reflectance(const Vec3f& normal_reflectance, std::optional<float> ior, float cosine) {
  float rise = 0;  // From normal incidence, 0, to grazing, 1.
  if (ior) {
    const float normal = dielectric_reflectance(*ior, 1);
    rise = (dielectric_reflectance(*ior, cosine) - normal) / (1 - normal);
  } else {
    const float less = 1 - cosine;
    rise = less * less * less * less * less;
  }
  Vec3f reflectance(0, 0, 0);
  for (int c = 0; c < 3; ++c) {
    const float r = normal_reflectance[c];
    if (r > 0) reflectance[c] = r + (1 - r) * rise;
  }
  return reflectance;
}

RefractedRay refract(const Vec3f& to_eye, const Vec3f& normal, float ior, float layers) {
  const float eta = portable::pow(1 / ior, layers);
  const float cosine = std::clamp(normal.dot(to_eye), 0.0F, 1.0F);
  const Vec3f across = cosine * normal - to_eye;  // Its length is sin(theta_I).
  const float transmitted2 = 1 - eta * eta * across.squaredNorm();
  if (transmitted2 <= 0) return {(2 * cosine * normal - to_eye).normalized(), 2, 1};
  const float transmitted = std::sqrt(transmitted2);
  // d theta_T / d theta_I = eta cos(theta_I) / cos(theta_T); without a bound at total reflection.
  const float by_direction = std::min(2.0F, eta * cosine / transmitted);
  return {(eta * across - transmitted * normal).normalized(), std::abs(1 - by_direction),
          by_direction};
}

float microfacet_variance(const Material& material) {
  const float alpha = material.roughness * material.roughness;
  return 0.5F * alpha * alpha;
}

void SeenThrough::add(const Fragment& surface, float surfaces, float coverage, float opacity) {
  if (opaque_) return;
  layers_ += surfaces * coverage;
  opaque_ = opacity >= kOpaqueAlpha;
  const float share = uncovered_ - (1 - coverage);
  if (!(share > 0)) return;
  uncovered_ = 1 - coverage;
  if (count_ < kMost) {
    surface_[static_cast<std::size_t>(count_)] = surface;
    share_[static_cast<std::size_t>(count_++)] = share;
  } else {
    share_.back() += share;
  }
}

Shader::Shader(const Scene* scene, const Camera& camera, double lowpass, bool mapped)
    : scene_(scene),
      world_from_camera_(camera.camera_from_world.transpose().cast<float>()),
      map_from_world_(Eigen::Matrix3f::Identity()),
      ray_variance_(0) {
  lighting_.inv_focal_x = static_cast<float>(1 / camera.focal_x);
  lighting_.inv_focal_y = static_cast<float>(1 / camera.focal_y);
  lighting_.center_x = static_cast<float>(camera.center_x);
  lighting_.center_y = static_cast<float>(camera.center_y);
  lighting_.orthographic = camera.orthographic;
  lighting_.mapped = mapped;
  if (!scene) return;
  if (scene->environment) {
    environment_ = &*scene->environment;
    if (!environment_->map) throw_usage("the environment has not been loaded: load_environment()");
    const float angle = environment_->rotation * std::numbers::pi_v<float> / 180;
    map_from_world_ = rotation_about(Vec3d::UnitY(), -angle).matrix().cast<float>();
    // Rays of orthographic cameras have all the same direction.
    if (!lighting_.orthographic) {
      ray_variance_ = static_cast<float>(portable::squared(lowpass / camera.focal_y));
    }
  }
  for (const Light& light : scene->lights) {
    if (light.type == Light::Type::kPoint) {
      lights_.push_back(plain_light((light.vector - camera.eye).cast<float>(), light.color, true));
      continue;
    }
    const Vec3d along = light.type == Light::Type::kHeadlight
                            ? Vec3d(camera.camera_from_world.transpose() * light.vector)
                            : light.vector;
    lights_.push_back(plain_light((-along.normalized()).cast<float>(), light.color, false));
  }
  Vec3f ambient = scene->ambient;
  Vec3f sky(0, 0, 0);
  if (scene->sky) {
    ambient += 0.5F * (scene->sky->color + scene->sky->ground);
    sky = 0.5F * (scene->sky->color - scene->sky->ground);
    lighting_.has_sky = true;
    to_plain(scene->sky->up.value_or(Vec3d::UnitY()).normalized().cast<float>(), lighting_.up);
  }
  for (const Material& material : scene->materials) {
    Lighting::Reflection& plain = materials_.emplace_back();
    to_plain(material.ambient.cwiseProduct(ambient), plain.ambient);
    to_plain(material.ambient.cwiseProduct(sky), plain.sky);
    to_plain(material.diffuse, plain.diffuse);
    to_plain(material.specular, plain.specular);
    plain.shininess = material.shininess;
  }
  lighting_.lights = lights_.data();
  lighting_.light_count = lights_.size();
  lighting_.materials = materials_.data();
  lighting_.material_count = materials_.size();
  for (int row = 0; row < 3; ++row) {
    to_plain(world_from_camera_.row(row).transpose(), lighting_.world_from_camera[row]);
  }
}

Rgba Shader::shade(const Fragment& fragment, float x, float y, float full_weight,
                   Reflected& reflected) const {
  const float* c = fragment.channel;
  const float inv_weight = 1.0F / c[kWeight];
  const float alpha = c[kAlpha] * inv_weight;
  const float coverage = std::min(1.0F, c[kWeight] / full_weight);
  if (!lit()) {
    const float scale = inv_weight * coverage;
    return {c[kRed] * scale, c[kGreen] * scale, c[kBlue] * scale, alpha * coverage};
  }
  if (const OtherMaterial other(c[kOther]); other.share > 0) {
    return shade_mixed(fragment, other, x, y, full_weight);
  }
  const SeenSurface at = surface(fragment, x, y);
  const bool reflects = environment_ && !at.material.reflectivity.isZero();
  if (!(c[kAlpha] > 0) && !reflects) return {};
  const float opacity = alpha * coverage;
  Vec3f out(0, 0, 0);
  if (c[kAlpha] > 0) {
    const Vec3f color = Vec3f(c[kRed], c[kGreen], c[kBlue]) / c[kAlpha];
    out = opacity * lit_color(color, at, x, y, c[kDepth] * inv_weight);
  }
  if (!reflects) return {out.x(), out.y(), out.z(), opacity};

  if (reflected.material != &at.material || reflected.normal != at.normal ||
      reflected.normal_variance != at.normal_variance) {
    // Mapped normals of faces that are seen from the side may look away from the eye.
    const float cosine = std::max(0.0F, at.normal.dot(at.to_eye));
    const Vec3f mirrored = 2 * cosine * at.normal - at.to_eye;
    reflected = {&at.material, at.normal, at.normal_variance,
                 fresnel_reflectance(at.material.reflectivity, at.material.ior, cosine),
                 radiance(mirrored, 4 * at.normal_variance + ray_variance_)};
  }
  const Vec3f& reflectance = reflected.reflectance;
  out = out.cwiseProduct(Vec3f::Ones() - reflectance) +
        coverage * reflectance.cwiseProduct(reflected.radiance);
  const float share = reflectance.mean();
  return {out.x(), out.y(), out.z(), coverage * share + (1 - share) * opacity};
}

Rgba Shader::shade_mixed(const Fragment& fragment, const OtherMaterial& other, float x, float y,
                         float full_weight) const {
  Fragment main = fragment;
  main.channel[kOther] = 0;
  const Rgba a = shade(main, x, y, full_weight);
  const Rgba b = shade(of_material(fragment, other.material), x, y, full_weight);
  const auto mean = [&](float Rgba::*c) { return a.*c + other.share * (b.*c - a.*c); };
  return {mean(&Rgba::red), mean(&Rgba::green), mean(&Rgba::blue), mean(&Rgba::alpha)};
}

Vec3f Shader::from_eye(float x, float y, float z) const {
  return world_from_camera_ * Vec3f((x - lighting_.center_x) * lighting_.inv_focal_x,
                                    (y - lighting_.center_y) * lighting_.inv_focal_y, z);
}

Vec3f Shader::ray(float x, float y) const {
  return lighting_.orthographic ? Vec3f(world_from_camera_.col(2)) : from_eye(x, y, 1);
}

SeenSurface Shader::surface(const Fragment& fragment, float x, float y) const {
  const float* c = fragment.channel;
  const std::size_t material = std::min<std::size_t>(
      std::bit_cast<std::uint32_t>(c[kTag]) >> kMaterialShift, scene_->materials.size() - 1);
  SeenSurface at{scene_->materials[material], -ray(x, y).normalized(), {}, 1, 0};
  at.normal = Vec3f(c[kNormalX], c[kNormalY], c[kNormalZ]);
  const float length = at.normal.norm();
  at.normal = length > 0 ? Vec3f(at.normal / length) : at.to_eye;
  const bool away =
      lighting_.mapped ? length > 0 && !shows_front(c[kTag]) : at.normal.dot(at.to_eye) < 0;
  if (away) at.normal = -at.normal;
  const float weight = c[kWeight] > 0 ? c[kWeight] : 1;  // Merged: mean normals.
  if (length > 0) at.mean_length = std::min(1.0F, length / weight);
  if (environment_) {
    at.normal_variance = microfacet_variance(at.material) - portable::log(at.mean_length);
  }
  return at;
}

Vec3f Shader::radiance(const Vec3f& direction, float variance) const {
  return environment_->intensity *
         environment_->map->radiance(map_from_world_ * direction, variance);
}

Vec3f Shader::behind(const Fragment& nearest, float x, float y, float layers) const {
  if (!environment_) return {0, 0, 0};
  if (const OtherMaterial other(nearest.channel[kOther]); other.share > 0) {
    Fragment main = nearest;
    main.channel[kOther] = 0;
    return (1 - other.share) * behind(main, x, y, layers) +
           other.share * behind(of_material(nearest, other.material), x, y, layers);
  }
  const SeenSurface at = surface(nearest, x, y);
  const Material& material = at.material;
  const float count = scene_->refraction == Refraction::kSingle ? 1.0F : layers;
  const auto refracted = [&](float ior) {
    const RefractedRay ray = refract(at.to_eye, at.normal, ior, count);
    return radiance(ray.direction, ray.by_normal * ray.by_normal * at.normal_variance +
                                       ray.by_direction * ray.by_direction * ray_variance_);
  };
  Vec3f color;
  if (!material.ior) {
    color = radiance(-at.to_eye, ray_variance_);
  } else if (material.dispersion == 0) {
    color = refracted(*material.ior);
  } else {
    for (int c = 0; c < 3; ++c) {
      const float part = static_cast<float>(c - 1) / 2;
      color[c] = refracted(*material.ior * (1 + part * material.dispersion))[c];
    }
  }
  for (int c = 0; c < 3; ++c) color[c] *= portable::pow(1 - material.absorption[c], count);  // (11)
  return color;
}

Rgba Shader::open_view(float x, float y) const {
  if (!environment_ || !environment_->visible) return {};
  const Vec3f seen = radiance(ray(x, y), ray_variance_);
  return {seen.x(), seen.y(), seen.z(), 1};
}

void Shader::add_environment(Rgba& color, const SeenThrough& surfaces, float x, float y) const {
  if (!environment_) return;
  const float left = 1 - color.alpha;
  if (!(left > 0)) return;
  const auto add = [&](const Vec3f& radiance, float share) {
    color.red += share * radiance.x();
    color.green += share * radiance.y();
    color.blue += share * radiance.z();
    color.alpha += share;
  };
  const float straight = std::min(left, surfaces.uncovered());
  const float covered = 1 - surfaces.uncovered();
  for (int i = 0; i < surfaces.count(); ++i) {
    const Fragment& surface = surfaces.surface(i);
    if (environment_->visible || this->surface(surface, x, y).material.ior) {
      add(behind(surface, x, y, surfaces.layers()),
          (left - straight) * surfaces.share(i) / covered);
    }
  }
  if (straight > 0 && environment_->visible) add(radiance(ray(x, y), ray_variance_), straight);
}

Vec3f Shader::lit_color(const Vec3f& color, const SeenSurface& surface, float x, float y,
                        float depth) const {
  return lit_by(lighting_, reflection(surface), color, surface, [&] {
    const Vec3f along = ray(x, y) * z(depth);
    return lighting_.orthographic ? Vec3f(along + from_eye(x, y, 0)) : along;
  });
}

Vec3f Shader::lit_color(const Vec3f& color, const SeenSurface& surface, const Vec3f& place) const {
  return lit_by(lighting_, reflection(surface), color, surface, [&] { return place; });
}

}  // namespace surfel
