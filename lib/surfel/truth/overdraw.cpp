#include <cstddef>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/truth/overdraw.h>
#include <surfel/truth/supersample.h>

namespace surfel {

double mean_overdraw(const DiscHierarchy& discs, const Vec3d& origin, const Camera& camera) {
  constexpr int kRays = 8;  // Along each side of the picture.
  std::size_t met = 0;
  for (int y = 0; y < kRays; ++y) {
    for (int x = 0; x < kRays; ++x) {
      const ViewRay ray =
          view_ray(camera, (x + 0.5) * camera.width / kRays, (y + 0.5) * camera.height / kRays);
      discs.for_each({camera.eye - origin + ray.origin, ray.direction, 0, 0},
                     [&](std::uint32_t) { ++met; });
    }
  }
  return static_cast<double>(met) / (kRays * kRays);
}

void require_bounded_overdraw(const DiscHierarchy& discs, const Vec3d& origin, const Camera& camera,
                              const std::string& name) {
  const double overdraw = mean_overdraw(discs, origin, camera);
  if (overdraw <= kMostOverdraw) return;
  throw_input(name, fmt::format("{:.0f} surfels lie over each place of the picture in the mean, "
                                "more than the {:.0f} that --reference and --filter ewa-source "
                                "draw one by one; make the surfels smaller, move the camera, or "
                                "leave the option out",
                                overdraw, kMostOverdraw));
}

}  // namespace surfel
