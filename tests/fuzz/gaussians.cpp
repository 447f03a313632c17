#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

#include <surfel/base/bounds.h>
#include <surfel/base/parallel.h>
#include <surfel/gaussian/gaussian_renderer.h>

#include "fuzz/checks.h"

namespace surfel::fuzz {
namespace {

Camera camera_of(const CloudNumbers& numbers) {
  Camera camera;
  camera.width = 37;
  camera.height = 21;
  camera.center_x = 18;
  camera.center_y = 11;
  camera.orthographic = numbers.choice() / 8 % 2 == 1;
  camera.focal_x = camera.focal_y = numbers.choice() / 16 % 2 == 1 ? 300 : 20;
  camera.eye = {0, 0, numbers.are_any() ? 0 : -2 * double{numbers.scale()}};
  return camera;
}

}  // namespace

/// Renders Gaussians whose numbers are made of the bytes, by a profile and with samples that the
/// bytes choose: colours are finite, depths are numbers or infinite, opacities are from 0 to 1, and
/// three threads give the bytes that one gives, where they are asked (on_three_threads()).
void gaussians(Bytes bytes) {
  CloudNumbers numbers(bytes);
  GaussianCloud cloud;
  constexpr std::size_t kMost = 200;
  // What readers let through.
  const auto usable = [](float value) {
    constexpr auto kMostLength = static_cast<float>(kLargestExtent);
    return std::isfinite(value) ? std::clamp(value, -kMostLength, kMostLength) : 0.0F;
  };
  while (!numbers.done() && cloud.size() < kMost) {
    const auto vector = [](const auto& next) {
      const float x = next();
      const float y = next();
      return Vec3f(x, y, next());
    };
    const auto length = [&] { return usable(numbers.length()); };
    cloud.position.push_back(vector(length));
    cloud.scale.push_back(vector([&] { return std::abs(length()); }));
    Eigen::Vector4f q;
    for (float& part : q) part = numbers.unit();
    const float norm = q.norm();
    q = norm > 0 ? Eigen::Vector4f(q / norm) : Eigen::Vector4f(1, 0, 0, 0);
    cloud.rotation.push_back({q[0], q[1], q[2], q[3]});
    cloud.amplitude.push_back(std::abs(numbers.unit()));
    for (int c = 0; c < 3; ++c) cloud.harmonics.push_back(4 * numbers.unit());
  }
  constexpr GaussianProfile kProfiles[] = {GaussianProfile::kInria, GaussianProfile::kGsplat,
                                           GaussianProfile::kMip,   GaussianProfile::k2dgs,
                                           GaussianProfile::kExact, GaussianProfile::kSurfel,
                                           GaussianProfile::kExact, GaussianProfile::kExact};
  const int way = numbers.choice() % 8;
  const GaussianProfile profile = kProfiles[way];
  if (way == 6) cloud.rule = AmplitudeRule::kDensity;
  if (way == 7) cloud.rule = AmplitudeRule::kCompensated;
  const Camera camera = camera_of(numbers);
  const int samples = profile == GaussianProfile::kExact ? numbers.choice() / 32 * 3 : 0;
  const GaussianOptions options{.profile = profile, .samples = samples, .depth = true};
  const auto rendered = [&](int threads) {
    set_thread_count(threads);
    return GaussianRenderer(cloud, options).render(camera);
  };
  const Image one = rendered(1);
  for (std::size_t i = 0; i < one.data.size(); ++i) {
    const std::size_t channel = i % one.channels.size();
    const float value = one.data[i];
    require(channel >= 4 ? !std::isnan(value) : std::isfinite(value), "a pixel that is no number");
    require(channel != 3 || (value >= 0 && value <= 1.0001F), "an opacity beyond 1");
  }
  if (!on_three_threads(bytes)) return;
  const Image three = rendered(3);
  require(std::memcmp(one.data.data(), three.data.data(), one.data.size() * sizeof(float)) == 0,
          "three threads give other bytes than one");
}

}  // namespace surfel::fuzz
