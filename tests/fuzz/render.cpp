#include <cmath>
#include <cstring>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/framing.h>
#include <surfel/store/render_cloud.h>

#include "fuzz/checks.h"

namespace surfel::fuzz {
namespace {

/// What else a picture differs by.
enum Way { kPlain, kEllipses, kUnfiltered, kNear };

/// What is seen of the surfels.
struct Aim {
  double zoom = 1;
  bool tall = false;  ///< The picture's three tiles, in two blocks, lie over each other.
};

Image rendered(const SurfelCloud& cloud, const RenderOptions& options, const Aim& aim,
               int threads) {
  set_thread_count(threads);
  RenderCloud surfels(cloud, options.compositing().columns(), "surfels");
  CameraOptions camera;
  camera.width = aim.tall ? 7 : 37;
  camera.height = aim.tall ? 37 : 7;
  camera.zoom = aim.zoom;
  static const Scene scene;
  return Renderer(surfels, scene, options).render(make_camera(camera, surfels.extent()));
}

}  // namespace

/// Renders surfels that the bytes are: pixels are finite, opacities from 0 to 1, and three threads
/// give the bytes that one gives, where they are asked (on_three_threads()).
void render(Bytes bytes) {
  CloudNumbers numbers(bytes);
  const int way = numbers.choice() / 16;
  SurfelCloud cloud;
  constexpr std::size_t kMost = 200;
  while (!numbers.done() && cloud.size() < kMost) {
    const auto vector = [](const auto& next) {
      const float x = next();
      const float y = next();
      return Vec3f(x, y, next());
    };
    const auto length = [&] { return numbers.length(); };
    const auto number = [&] { return numbers.number(); };
    const float unit = numbers.are_any() ? 1 : numbers.scale();
    cloud.position.push_back(vector(length));
    cloud.normal.push_back(vector(number));
    if (way == kEllipses) {
      cloud.tangent.push_back(vector(number));
      cloud.variance_u.push_back(length() * unit);
      cloud.variance_v.push_back(length() * unit);
    } else {
      cloud.variance.push_back(length() * unit);
    }
    cloud.area.push_back(length() * unit);
    cloud.color.push_back(vector(number));
    // Without opacities edges are filtered once more, and lines may cut surfels.
    if (way != kEllipses && way != kNear) cloud.alpha.push_back(number());
    if (way == kEllipses && numbers.choice() % 2 == 1) {
      cloud.clip1.push_back(vector(number));
      cloud.clip1_distance.push_back(length());
      cloud.clip2.push_back(vector(number));
      cloud.clip2_distance.push_back(length());
    }
  }
  RenderOptions options;
  options.lit = numbers.choice() % 2 == 1;
  options.cull_back = numbers.choice() / 2 % 2 == 1;
  options.cutoff = 1 + numbers.choice() / 4 % 4;
  Aim aim{.tall = bytes.size() / 16 % 2 == 1};
  if (way == kEllipses) options.kernel = Kernel::kPerspective;
  if (way == kUnfiltered) {
    options.kernel = Kernel::kAffine;
    options.filter = Filter::kNone;
    options.relief = Relief::kEyeDome;
  }
  if (way == kNear) {
    options.relief = Relief::kOcclusion;
    aim.zoom = 16;
  }
  try {
    const Image one = rendered(cloud, options, aim, 1);
    for (std::size_t i = 0; i < one.data.size(); ++i) {
      require(std::isfinite(one.data[i]), "a pixel that is not finite");
      const bool opacity = i % one.channels.size() == 3;
      require(!opacity || (one.data[i] >= 0 && one.data[i] <= 1.0001F), "an opacity beyond 1");
    }
    if (!on_three_threads(bytes)) return;
    const Image three = rendered(cloud, options, aim, 3);
    require(
        one.data.size() == three.data.size() &&
            std::memcmp(one.data.data(), three.data.data(), one.data.size() * sizeof(float)) == 0,
        "three threads give other bytes than one");
  } catch (const Error& error) {
    require(error.kind() == ErrorKind::kInput, error.what());
  }
}

}  // namespace surfel::fuzz
