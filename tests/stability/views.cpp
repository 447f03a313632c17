#include "stability/views.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/scene/framing.h>
#include <surfel/truth/image_error.h>

namespace surfel::test {

Camera case_camera(const CameraOptions& view, Effort effort) {
  CameraOptions options = view;
  if (effort == Effort::kTest) {
    options.width = 40 * view.width / view.height;
    options.height = 40;
    options.zoom = static_cast<double>(view.height) / options.height;
  }
  return make_camera(options, SceneExtent{});
}

Image draw(const SurfelCloud& cloud, const Camera& camera, RenderOptions options) {
  options.lit = false;
  RenderCloud surfels(cloud);
  const Scene scene;
  return Renderer(surfels, scene, options).render(camera);
}

Image draw_reference(const SurfelCloud& cloud, const Camera& camera, Effort effort,
                     RenderOptions options) {
  options.lit = false;
  RenderCloud surfels(cloud);
  const Scene scene;
  const ReferenceOptions reference{.samples = effort == Effort::kTest ? 3 : 8};
  return ReferenceRenderer(surfels, scene, options, reference).render(camera);
}

double psnr(const Image& image, const Image& truth) {
  return std::min(image_error(image, truth).psnr, 99.9);
}

double psnr_inside(const Image& image, const Image& truth) {
  const auto opaque = [&](int x, int y) { return truth.pixel(x, y)[3] >= 0.99F; };
  return std::min(-20 * std::log10(rms(image, truth, opaque)), 99.9);
}

double rms(const Image& image, const Image& truth, const std::function<bool(int, int)>& use) {
  double sum = 0;
  std::size_t count = 0;
  for (int y = 0; y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      if (use && !use(x, y)) continue;
      for (int c = 0; c < 4; ++c) {
        const double d = image.pixel(x, y)[c] - truth.pixel(x, y)[c];
        sum += d * d;
        ++count;
      }
    }
  }
  return count == 0 ? 0 : std::sqrt(sum / static_cast<double>(count));
}

std::string named(const std::string& name, double number) {
  return fmt::format("{}:{:g}", name, number);
}

}  // namespace surfel::test
