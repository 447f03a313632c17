#include <algorithm>

#include <surfel/truth/bent_rays.h>

namespace surfel {
namespace {

/// A ray on its way from the eye.
struct Path {
  Vec3f origin;
  Vec3f direction;       ///< Unit.
  float from;            ///< Where the ray begins along its direction, scene units.
  int bounces;           ///< Surfaces that it may still meet.
  int channel = -1;      ///< The one that it carries after a material has dispersed it; -1: all.
  float weight = 1;      ///< The largest share of a pixel's light that it carries.
  float variance = 0;    ///< Of its direction along an axis, by rough surfaces, radians^2.
  bool straight = true;  ///< Nothing has bent or mirrored it.
};

/// A surface at which a path is parted.
struct Place {
  SeenSurface seen;
  Vec3f lit_normal;      ///< Of the side that is seen, even where it looks away from the eye.
  Vec3f at;              ///< In the axes of the paths' origins.
  Eigen::Array4f color;  ///< The surface's own, premultiplied by all of its opacity.
  bool front;
};

/// What a surface does to a ray.
struct Parted {
  Vec3f reflectance;
  RefractedRay through;
};

/// Index of refraction for the channel that a path carries; unset where nothing is refracted.
std::optional<float> channel_ior(const Material& material, int channel) {
  if (!material.ior || channel < 0) return material.ior;
  return *material.ior * (1 + 0.5F * static_cast<float>(channel - 1) * material.dispersion);
}

/// Snell's law and Fresnel's equations for a ray that enters the medium (front) or leaves it.
Parted part(const SeenSurface& seen, std::optional<float> ior, bool front) {
  const Vec3f& normal_reflectance = seen.material.reflectivity;
  const float cosine = seen.normal.dot(seen.to_eye);
  if (!ior) return {fresnel_reflectance(normal_reflectance, ior, cosine), {-seen.to_eye, 0, 1}};
  const RefractedRay bent = refract(seen.to_eye, seen.normal, *ior, front ? 1.0F : -1.0F);
  const float leaving = -seen.normal.dot(bent.direction);
  if (leaving < 0) return {Vec3f::Ones(), bent};  // Total reflection.
  // Fresnel's equations take the angle outside of the medium.
  return {fresnel_reflectance(normal_reflectance, ior, front ? cosine : leaving), bent};
}

class PathTracer {
 public:
  PathTracer(const BentRays& rays, NearestSurface nearest) : rays_(rays), nearest_(nearest) {}

  Rgba follow(const Path& path) const {
    const std::optional<MetSurface> met = path.bounces > 0 && path.weight >= kFaintPath
                                              ? nearest_(path.origin, path.direction, path.from)
                                              : std::nullopt;
    if (!met) return unhindered(path);
    const Place place = meet(path, *met);
    const Material& material = place.seen.material;
    if (path.channel >= 0 || !material.ior || material.dispersion == 0) return part_at(path, place);
    Rgba sum;
    for (int channel = 0; channel < 3; ++channel) {
      Path one = path;
      one.channel = channel;
      const Rgba seen = part_at(one, place);
      const float colors[3] = {seen.red, seen.green, seen.blue};
      (channel == 0 ? sum.red : channel == 1 ? sum.green : sum.blue) = colors[channel];
      sum.alpha = std::max(sum.alpha, seen.alpha);
    }
    return sum;
  }

 private:
  Rgba unhindered(const Path& path) const {
    if (path.straight && !rays_.scene.environment->visible) return {};
    const Vec3f radiance = rays_.shader.radiance(path.direction, path.variance);
    return {radiance.x(), radiance.y(), radiance.z(), 1};
  }

  Place meet(const Path& path, const MetSurface& met) const {
    const Material& material =
        rays_.scene.materials[std::min(met.material, rays_.scene.materials.size() - 1)];
    const Vec3f to_eye = -path.direction;
    const Vec3f normal = met.normal.dot(to_eye) < 0 ? Vec3f(-met.normal) : met.normal;
    return {{material, to_eye, normal, 1, microfacet_variance(material)},
            met.normal,
            path.origin + met.t * path.direction,
            material.opacity * met.color,
            met.front};
  }

  Path onward(const Path& path, const Place& place, const Vec3f& direction, float share,
              float variance) const {
    Path next = path;
    next.origin = place.at;
    next.direction = direction;
    next.from = rays_.gap;
    --next.bounces;
    next.weight *= share;
    next.variance = variance;
    next.straight = path.straight && direction == path.direction;
    return next;
  }

  Rgba part_at(const Path& path, const Place& place) const {
    const SeenSurface& seen = place.seen;
    const auto [reflectance, through] =
        part(seen, channel_ior(seen.material, path.channel), place.front);
    const float opacity = place.color[3];
    Vec3f out(0, 0, 0);
    if (opacity > 0) {
      const Vec3f color = place.color.head<3>() / opacity;
      SeenSurface lit = seen;
      lit.normal = place.lit_normal;
      out = opacity * rays_.shader.lit_color(color, lit, place.at - rays_.eye);
    }
    const Vec3f passes = (1 - opacity) * (Vec3f::Ones() - seen.material.absorption);  // (11)
    const Vec3f kept = Vec3f::Ones() - reflectance;
    float alpha = opacity;
    if (const float share = passes.cwiseProduct(kept).maxCoeff(); share > 0) {
      const float variance = through.by_normal * through.by_normal * seen.normal_variance +
                             through.by_direction * through.by_direction * path.variance;
      const Rgba behind = follow(onward(path, place, through.direction, share, variance));
      out += passes.cwiseProduct(Vec3f(behind.red, behind.green, behind.blue));
      alpha += (1 - opacity) * behind.alpha;
    }
    out = out.cwiseProduct(kept);
    if (!reflectance.isZero()) {
      const float cosine = seen.normal.dot(seen.to_eye);
      const Vec3f mirrored = (2 * cosine * seen.normal - seen.to_eye).normalized();
      const Rgba light = follow(onward(path, place, mirrored, reflectance.maxCoeff(),
                                       4 * seen.normal_variance + path.variance));
      out += reflectance.cwiseProduct(Vec3f(light.red, light.green, light.blue));
    }
    const float share = reflectance.mean();
    return {out.x(), out.y(), out.z(), share + (1 - share) * alpha};
  }

  const BentRays& rays_;
  NearestSurface nearest_;
};

}  // namespace

Rgba BentRays::trace(NearestSurface nearest, const Vec3f& origin, const Vec3f& direction,
                     float from) const {
  return PathTracer(*this, nearest).follow({origin, direction, from, bounces});
}

}  // namespace surfel
