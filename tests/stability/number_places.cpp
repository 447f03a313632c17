// Large offsets, large and small scales, single precision.

#include <algorithm>
#include <cmath>

#include "render/scenes.h"
#include "stability/published_renderer.h"
#include "stability/views.h"

namespace surfel::test {
namespace {

Place offset(Effort effort) {
  Place place{
      .title = "Far from the origin",
      .measure = "PSNR to the same method's picture at the origin, dB",
      .higher_better = true,
      .slack = 0.1,
      .saturation = 60,
      .published = "SS01 in single precision (`tests/stability/published_renderer.h`)",
      .ours = "`surfel-render`",
      .why = "a cloud is offsets from one origin in double; only cameras and files know it"};
  const HardScene home = make_hard_case("offset:0");
  const Camera home_camera = case_camera(home.view, effort);
  const Image published = render_published<float>(home.cloud, home_camera);
  const Image ours = draw(home.cloud, home_camera);
  for (const double x : {1.0, 1e2, 1e4, 1e6, 1e7, 1e8}) {
    if (effort == Effort::kTest && x != 1e8) continue;
    const HardScene scene = make_hard_case(named("offset", x));
    const Camera camera = case_camera(scene.view, effort);
    place.rows.push_back({named("offset", x),
                          psnr(render_published<float>(scene.cloud, camera), published),
                          psnr(draw(scene.cloud, camera), ours), 80});
  }
  return place;
}

Place scale(Effort effort) {
  Place place{.title = "Large and small scenes",
              .measure = "PSNR to the same method's picture at scale 1, dB",
              .higher_better = true,
              .slack = 0.1,
              .saturation = 60,
              .published = "SS01 with a z threshold that suits scale 1 (0.05 units)",
              .ours = "`surfel-render`",
              .why = "epsilon follows from each disc's footprint, nothing has a unit"};
  const HardScene home = make_hard_case("scale:1");
  const Camera home_camera = case_camera(home.view, effort);
  const PublishedOptions fixed{.depth_threshold = 0.05};
  const Image published = render_published<float>(home.cloud, home_camera, fixed);
  const Image ours = draw(home.cloud, home_camera);
  for (const double x : {1e-6, 1e-3, 1e3, 1e6}) {
    if (effort == Effort::kTest && x != 1e-6) continue;
    const HardScene scene = make_hard_case(named("scale", x));
    const Camera camera = case_camera(scene.view, effort);
    place.rows.push_back({named("scale", x),
                          psnr(render_published<float>(scene.cloud, camera, fixed), published),
                          psnr(draw(scene.cloud, camera), ours), 70});
  }
  return place;
}

/// Largest difference of a surfel's kernel in two evaluations, by its peak; 1 where one of them has
/// none. Pixels at the cutoff, where one may have ended, are left out.
struct KernelError {
  double peak = 0, worst = 0;
  bool missing = true;
  void add(double single, double exact) {
    if (!(exact > 0)) return;
    peak = std::max(peak, exact);
    if (!(single > 0)) return;
    missing = false;
    worst = std::max(worst, std::abs(single - exact));
  }
  double value() const { return peak == 0 ? 0 : missing ? 1 : std::min(worst / peak, 1.0); }
};

/// SS01's kernel in float by that in double. With a coverage far above all sums alpha is linear in
/// rho.
double published_kernel_error(const SurfelCloud& surfel, const Camera& camera) {
  const PublishedOptions linear{.layers = 1, .coverage = 1e6};
  const Image single = render_published<float>(surfel, camera, linear);
  const Image exact = render_published<double>(surfel, camera, linear);
  KernelError error;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) error.add(single.pixel(x, y)[3], exact.pixel(x, y)[3]);
  }
  return error.value();
}

/// The renderer's affine kernel by ewa_kernel.h, in double.
double our_kernel_error(const SurfelCloud& surfel, const Camera& camera) {
  RenderOptions options;
  options.kernel = Kernel::kAffine;
  const Image single = render_unlit(surfel, camera, options);
  const auto kernel = make_ewa_kernel(in_camera(surfel, 0, camera), camera, options.lowpass);
  KernelError error;
  for (int y = 0; kernel && y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Eigen::Vector2d pixel(x + 0.5, y + 0.5);
      error.add(single.pixel(x, y)[kSumOfRho],
                kernel->beta(pixel) < options.cutoff ? kernel->rho(pixel) : 0);
    }
  }
  return error.value();
}

Place precision(Effort effort) {
  Place place{.title = "Single precision against double",
              .measure = "largest error of a kernel, by its peak; 1: not drawn",
              .slack = 1e-5,
              .published = "SS01 in float against double (`tests/stability/published_renderer.h`)",
              .ours = "`--kernel affine` against `render/ewa_kernel.h`",
              .why =
                  "what cancels is formed so that it does not: J without an inverse, det Sigma "
                  "as a sum"};
  for (const char* input :
       {"grazing:0", "grazing:80", "grazing:89.9", "grazing:89.999", "grazing:89.9999"}) {
    if (effort == Effort::kTest && input != std::string("grazing:89.9")) continue;
    const HardScene scene = make_hard_case(input);
    const Camera camera = case_camera(scene.view, effort);
    Row row{.input = input, .bound = 0.01};
    const auto step = static_cast<std::uint32_t>(
        std::max<std::size_t>(1, scene.cloud.size() / (effort == Effort::kTest ? 10 : 100)));
    for (std::uint32_t i = 0; i < scene.cloud.size(); i += step) {
      const SurfelCloud surfel = scene.cloud.gathered({i});
      row.published = std::max(row.published, published_kernel_error(surfel, camera));
      row.ours = std::max(row.ours, our_kernel_error(surfel, camera));
    }
    place.rows.push_back(row);
  }
  return place;
}

}  // namespace

std::vector<Measurement> number_places() {
  return {{"Offset", one<offset>}, {"Scale", one<scale>}, {"Precision", one<precision>}};
}

}  // namespace surfel::test
