#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <vector>

#include <surfel/gaussian/gaussian_extent.h>

namespace surfel {
namespace {

/// Opacities below this are nearly clear; the amplitudes of densities have another unit.
constexpr float kClear = 0.1F;
constexpr double kDeviations = 2;
/// Share of the Gaussians beyond the part that is framed, at either end of an axis.
constexpr double kOuter = 0.01;
/// What lies no further beyond them than this share of their extent is a part of them, such as the
/// tips of what they show.
constexpr double kTips = 0.15;

/// Gaussians as spheres.
struct Sphere {
  Vec3d center;  ///< World.
  double radius;
};

std::vector<Sphere> spheres_of(const GaussianCloud& cloud) {
  const bool density = cloud.rule == AmplitudeRule::kDensity;
  const auto list = [&](float least) {
    std::vector<Sphere> out;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (cloud.amplitude[i] < least) continue;
      out.push_back({cloud.origin + cloud.position[i].cast<double>(),
                     kDeviations * double{cloud.scale[i].maxCoeff()}});
    }
    return out;
  };
  std::vector<Sphere> out = list(density ? 0 : kClear);
  return out.empty() ? list(0) : out;
}

SceneExtent extent_of(std::shared_ptr<const std::vector<Sphere>> spheres) {
  SceneExtent extent;
  for (const Sphere& s : *spheres) {
    extent.box.add(s.center - Vec3d::Constant(s.radius));
    extent.box.add(s.center + Vec3d::Constant(s.radius));
  }
  extent.support = [spheres = std::move(spheres)](const Vec3d& a, double b) {
    double most = -std::numeric_limits<double>::infinity();
    for (const Sphere& s : *spheres) most = std::max(most, a.dot(s.center) + b * s.radius);
    return most;
  };
  return extent;
}

/// The box of the middle 98 % of the centres along each axis, and of what is close to them.
Bounds middle(const std::vector<Sphere>& spheres) {
  Bounds box;
  std::vector<double> along(spheres.size());
  const auto outer = static_cast<std::ptrdiff_t>(kOuter * static_cast<double>(spheres.size()));
  for (int axis = 0; axis < 3; ++axis) {
    std::transform(spheres.begin(), spheres.end(), along.begin(),
                   [&](const Sphere& s) { return s.center[axis]; });
    const auto first = along.begin() + outer;
    std::nth_element(along.begin(), first, along.end());
    box.min[axis] = *first;
    const auto last = along.end() - 1 - outer;
    std::nth_element(along.begin(), last, along.end());
    box.max[axis] = *last;
    const double margin = kTips * (box.max[axis] - box.min[axis]);
    box.min[axis] -= margin;
    box.max[axis] += margin;
  }
  return box;
}

}  // namespace

SceneExtent gaussian_extent(const GaussianCloud& cloud) {
  auto all = std::make_shared<std::vector<Sphere>>(spheres_of(cloud));
  if (all->empty()) return {};
  const Bounds box = middle(*all);
  auto core = std::make_shared<std::vector<Sphere>>();
  // Sizes, too, have strays, which would push the camera away.
  const double most = box.diagonal() / 4;
  for (const Sphere& s : *all) {
    if (box.contains(s.center)) core->push_back({s.center, std::min(s.radius, most)});
  }
  SceneExtent extent = extent_of(all);
  if (!core->empty()) {
    extent.core = std::make_shared<const SceneExtent>(extent_of(std::move(core)));
  }
  return extent;
}

SurfaceSample sample_surface(const GaussianCloud& cloud) {
  const std::vector<Sphere> spheres = spheres_of(cloud);
  return sample_surface(
      spheres.size(), spheres.size(), cloud.origin, [&](std::size_t i) -> SurfaceSample::Point {
        return {(spheres[i].center - cloud.origin).cast<float>(), Vec3f::Zero(), 1};
      });
}

}  // namespace surfel
