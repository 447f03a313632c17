#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include <surfel/truth/ray_surfaces.h>

namespace surfel {

Disc::Disc(const RenderCloud& cloud, std::uint32_t i, const Camera& camera)
    : center(Vec3d(cloud.x[i], cloud.y[i], cloud.z[i]) - (camera.eye - cloud.origin())),
      normal(cloud.normal_x[i], cloud.normal_y[i], cloud.normal_z[i]),
      deviation_u(cloud.deviation_u[i]),
      deviation_v(cloud.anisotropic() ? cloud.deviation_v[i] : cloud.deviation_u[i]),
      area(cloud.area[i]),
      surfel(i) {
  if (normal.isZero()) {
    normal = camera.orthographic ? Vec3d(-camera.camera_from_world.row(2)) : Vec3d(-center);
  }
  normal.normalize();
  tangent = normal.unitOrthogonal();
  if (cloud.anisotropic()) {
    // Perpendicular to stored normals, but to single precision only, and not to the eye's
    // direction.
    const Vec3d stored(cloud.tangent_x[i], cloud.tangent_y[i], cloud.tangent_z[i]);
    const Vec3d t = stored - normal * normal.dot(stored);
    if (!t.isZero()) tangent = t.normalized();
  }
  bitangent = normal.cross(tangent);
  for (std::size_t j = 0; j < lines.size(); ++j) {
    lines[j] = {Vec3d(0, 0, 0), 0};
    const RenderCloud::ClipColumns& clip = cloud.clip[j];
    if (!RenderCloud::clips(clip, i)) continue;
    const Vec3d direction(clip.x[i], clip.y[i], clip.z[i]);
    lines[j] = {(direction - normal * normal.dot(direction)).normalized(), clip.distance[i]};
  }
}

void RaySurfaces::separate(const std::vector<RayHit>& hits) {
  surfaces_.clear();
  for (const RayHit& hit : hits) {
    Surface* surface = nullptr;
    double least = hit.epsilon;
    for (Surface& open : surfaces_) {
      const double distance = std::abs(open.mean_z() - hit.z);
      if (open.front == hit.front && distance < least) {
        surface = &open;
        least = distance;
      }
    }
    const std::uint32_t i = hit.surfel;
    const std::uint32_t material = cloud_.material.empty() ? 0 : cloud_.material[i];
    if (!surface) {
      surface = &surfaces_.emplace_back();
      surface->material = material;
      surface->front = hit.front;
    }
    const double opacity =
        scene_.materials[std::min<std::size_t>(material, scene_.materials.size() - 1)].opacity;
    const double weighted_alpha =
        hit.weight * opacity * (cloud_.alpha.empty() ? 1 : cloud_.alpha[i]);
    surface->weight += hit.weight;
    surface->z += hit.weight * hit.z;
    surface->color += weighted_alpha * Vec3d(cloud_.red[i], cloud_.green[i], cloud_.blue[i]);
    surface->alpha += weighted_alpha;
    surface->normal += hit.weight * cloud_.shading(i).cast<double>();
  }
  // Later hits may have moved one surface's mean behind another's.
  std::sort(surfaces_.begin(), surfaces_.end(),
            [](const Surface& a, const Surface& b) { return a.mean_z() < b.mean_z(); });
}

Rgba RaySurfaces::color(std::vector<RayHit>& hits, double x, double y) {
  std::sort(hits.begin(), hits.end(), [](const RayHit& a, const RayHit& b) {
    return std::pair(a.z, a.surfel) < std::pair(b.z, b.surfel);
  });
  separate(hits);
  Rgba color;
  SeenThrough seen_through;
  for (const Surface& surface : surfaces_) {
    // Normalised by the sum of rho here, in double, since that may be beyond single precision.
    Fragment fragment{};
    float* c = fragment.channel;
    const double z = surface.mean_z();
    const double inv_weight = 1 / surface.weight;
    c[kWeight] = 1;
    c[kDepth] = shader_.depth(static_cast<float>(z));
    c[kRed] = static_cast<float>(surface.color.x() * inv_weight);
    c[kGreen] = static_cast<float>(surface.color.y() * inv_weight);
    c[kBlue] = static_cast<float>(surface.color.z() * inv_weight);
    c[kAlpha] = static_cast<float>(surface.alpha * inv_weight);
    c[kTag] =
        std::bit_cast<float>((surface.front ? kFrontTag : 0U) | surface.material << kMaterialShift);
    c[kNormalX] = static_cast<float>(surface.normal.x() * inv_weight);
    c[kNormalY] = static_cast<float>(surface.normal.y() * inv_weight);
    c[kNormalZ] = static_cast<float>(surface.normal.z() * inv_weight);
    const Rgba shaded = shader_.shade(fragment, static_cast<float>(x), static_cast<float>(y),
                                      static_cast<float>(full_weight_ * inv_weight));
    color.composite(shaded);
    const auto coverage = static_cast<float>(std::min(1.0, surface.weight / full_weight_));
    seen_through.add(fragment, 1, coverage, shaded.alpha);
  }
  shader_.add_environment(color, seen_through, static_cast<float>(x), static_cast<float>(y));
  return color;
}

}  // namespace surfel
