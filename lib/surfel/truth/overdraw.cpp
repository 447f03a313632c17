#include <cmath>
#include <cstddef>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/truth/overdraw.h>
#include <surfel/truth/ray_surfaces.h>
#include <surfel/truth/supersample.h>

namespace surfel {

double mean_overdraw(const RenderCloud& cloud, const DiscHierarchy& discs, double reach,
                     const Camera& camera) {
  constexpr int kRays = 8;  // Along each side of the picture.
  std::size_t met = 0;
  for (int y = 0; y < kRays; ++y) {
    for (int x = 0; x < kRays; ++x) {
      const ViewRay ray =
          view_ray(camera, (x + 0.5) * camera.width / kRays, (y + 0.5) * camera.height / kRays);
      const auto meets = [&](const Disc& disc) {
        const double z = disc.meet(ray);
        if (!(z > camera.near && std::isfinite(z))) return false;
        const Vec3d offset = ray.origin + z * ray.direction - disc.center;
        const Vec2d u(disc.tangent.dot(offset) / disc.deviation_u,
                      disc.bitangent.dot(offset) / disc.deviation_v);
        return u.squaredNorm() < reach * reach;
      };
      discs.for_each(
          {camera.eye - cloud.origin() + ray.origin, ray.direction, 0, 0},
          [&](std::uint32_t surfel) { met += meets(Disc(cloud, surfel, camera)) ? 1 : 0; });
    }
  }
  return static_cast<double>(met) / (kRays * kRays);
}

void require_bounded_overdraw(const RenderCloud& cloud, const DiscHierarchy& discs, double reach,
                              const Camera& camera, const std::string& name) {
  const double overdraw = mean_overdraw(cloud, discs, reach, camera);
  if (overdraw <= kMostOverdraw) return;
  throw_input(name, fmt::format("{:.0f} surfels lie over each place of the picture in the mean, "
                                "more than the {:.0f} that renderers which draw each of them take; "
                                "make the surfels smaller, move the camera, or render without "
                                "a reference or filtering at the source",
                                overdraw, kMostOverdraw));
}

}  // namespace surfel
