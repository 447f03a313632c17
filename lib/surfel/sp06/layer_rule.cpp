#include <algorithm>
#include <cmath>
#include <limits>

#include <surfel/sp06/layer_rule.h>

namespace surfel {
namespace {

/// Most steps of (6): they and a fraction fit a float.
constexpr double kMostSteps = 1 << 20;

}  // namespace

LayerRule layer_rule(const RenderCloud& cloud, const RenderOptions& options, Voronoi voronoi,
                     const Camera& camera) {
  double nearest = std::numeric_limits<double>::infinity();
  double farthest = -nearest;
  for (const Cluster& cluster : cloud.clusters()) {
    const Vec3d p =
        camera.camera_from_world * (cloud.origin() - camera.eye + cluster.center.cast<double>());
    nearest = std::min(nearest, p.z() - cluster.radius - cluster.max_deviation);
    farthest = std::max(farthest, p.z() + cluster.radius + cluster.max_deviation);
  }
  LayerRule rule{.voronoi = voronoi, .orthographic = camera.orthographic};
  if (!camera.orthographic) nearest = std::max(nearest, camera.near);
  if (!(farthest > nearest)) return rule;
  const double z = camera.orthographic ? 1 : (nearest + farthest) / 2;
  const double epsilon = options.epsilon_share() * std::sqrt(2 * options.cutoff) *
                         (cloud.mean_deviation() + options.filter_deviation() * z / camera.focal_y);
  const double n = std::clamp(std::ceil((farthest - nearest) / epsilon), 1.0, kMostSteps);
  rule.nearest = static_cast<float>(nearest);
  rule.steps_per_unit = static_cast<float>(n / (farthest - nearest));
  return rule;
}

}  // namespace surfel
