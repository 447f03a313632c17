// Grazing angles, the eye's plane, splats far larger and far smaller than a pixel.

#include <algorithm>
#include <cmath>

#include "render/inverse_jacobian.h"
#include "render/scenes.h"
#include "stability/published_renderer.h"
#include "stability/views.h"

namespace surfel::test {
namespace {

/// Largest relative error of J J^T over the surfels of a case, in single precision; failures (not
/// finite, or off by more than all of it) count as 1.
template <class Method>
double jacobian_error(const HardScene& scene, Method method) {
  const Camera camera = case_camera(scene.view, Effort::kTable);
  double worst = 0;
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    const Vec3f P = (camera.camera_from_world * (scene.cloud.world(i) - camera.eye)).cast<float>();
    const Vec3f n = (camera.camera_from_world * scene.cloud.normal[i].cast<double>()).cast<float>();
    const Eigen::Matrix<long double, 2, 2> truth =
        Sigma_direct<long double>(P.cast<long double>(), n.cast<long double>());
    const Eigen::Matrix<long double, 2, 2> got = method(P, n).template cast<long double>();
    const auto error = static_cast<double>((got - truth).norm() / truth.norm());
    worst = std::max(worst, error <= 1 ? error : 1.0);
  }
  return worst;
}

Place jacobian(Effort effort) {
  Place place{.title = "Grazing angle: J",
              .measure = "largest relative error of J J^T, single precision; 1: not finite",
              .slack = 1e-6,
              .published = "SS01 section 4: J by the inverse of the screen axes on the plane",
              .ours = "J's columns directly (`render/ewa_kernel.h`), always on",
              .why =
                  "the screen's axes projected along the line of sight grow without limit, the "
                  "surfel's projected onto the screen do not"};
  for (const double angle : {60.0, 75.0, 85.0, 89.0, 89.9, 89.99, 90.0}) {
    if (effort == Effort::kTest && angle != 60 && angle != 90) continue;
    const HardScene scene = make_hard_case(named("grazing", angle));
    place.rows.push_back(
        {named("grazing", angle),
         jacobian_error(scene, [](const auto& P, const auto& n) { return Sigma_by_inverse(P, n); }),
         jacobian_error(scene, [](const auto& P, const auto& n) { return Sigma_direct(P, n); }),
         1e-5});
  }
  return place;
}

/// Rows of `--kernel affine` against `auto`, by the reference.
void compare_kernels(Place& place, Effort effort, const std::string& name,
                     const std::vector<std::pair<double, double>>& value_and_bound) {
  place.measure = "PSNR to `--reference` where that is opaque, dB";
  place.higher_better = true;
  place.slack = 0.1;
  place.saturation = 60;
  place.published = "SS01 (4): `--kernel affine`";
  place.ours = "`--kernel auto` (default)";
  RenderOptions affine;
  affine.kernel = Kernel::kAffine;
  for (const auto& [value, bound] : value_and_bound) {
    const HardScene scene = make_hard_case(named(name, value));
    const Camera camera = case_camera(scene.view, effort);
    const Image truth = draw_reference(scene.cloud, camera, effort);
    place.rows.push_back({named(name, value), psnr_inside(draw(scene.cloud, camera, affine), truth),
                          psnr_inside(draw(scene.cloud, camera), truth), bound});
    if (effort == Effort::kTest) break;
  }
}

Place grazing(Effort effort) {
  Place place{.title = "Grazing angle: picture"};
  compare_kernels(place, effort, "grazing", {{60, 36}, {75, 34}, {80, 33}, {85, 31}, {88, 27}});
  place.why = "a disc that recedes is no ellipse on screen; linearised in every pixel it is right";
  return place;
}

Place near_plane(Effort effort) {
  Place place{.title = "Near plane crossed"};
  compare_kernels(place, effort, "near-plane", {{0.005, 35}, {0.02, 35}, {0.1, 33}});
  place.why =
      "surfels beside and behind the eye have no affine projection; discs are clipped in "
      "camera space, kernels are evaluated on their planes";
  return place;
}

Place inside(Effort effort) {
  Place place{.title = "Viewer inside the surface"};
  compare_kernels(place, effort, "inside", {{0.005, 45}, {0.02, 45}, {0.1, 45}});
  place.why = "the wall at the eye is seen along itself, its discs reach behind the eye";
  return place;
}

Place large_splats(Effort effort) {
  Place place{.title = "Splats larger than the screen"};
  compare_kernels(place, effort, "splat-size", {{1e4, 50}, {1e3, 45}, {100, 38}, {10, 32}});
  place.why =
      "the affine error grows with a splat's depth extent; where it may pass 0.1 pixels "
      "the exact kernel takes over";
  return place;
}

/// Share by which a picture's alpha is off the area that the surfels have on screen.
double light_error(const Image& image, double area) {
  double sum = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) sum += image.pixel(x, y)[3];
  }
  const double error = std::abs(sum / area - 1);
  return std::isfinite(error) ? error : 1;
}

Place small_splats(Effort effort) {
  Place place{
      .title = "Splats far below a pixel",
      .measure = "relative error of the light in the picture",
      .slack = 1e-3,
      .published = "SS01 sections 4 and 7, tau = 0.4 (`tests/stability/published_renderer.h`)",
      .ours = "`surfel-render`",
      .why =
          "tau below the mean sum of kernels makes what is smaller than a pixel too "
          "bright; at edges ours weighs by the mean sum"};
  for (const double pixels : {0.1, 0.01, 0.001}) {
    if (effort == Effort::kTest && pixels != 0.1) continue;
    const HardScene scene = make_hard_case(named("splat-size", pixels));
    const Camera camera = case_camera(scene.view, effort);
    double area = 0;
    for (const float a : scene.cloud.area) area += a;
    area *= camera.focal_x * camera.focal_y;  // At distance 1, front-on.
    place.rows.push_back({named("splat-size", pixels),
                          light_error(render_published<float>(scene.cloud, camera), area),
                          light_error(draw(scene.cloud, camera), area), 0.18});
  }
  return place;
}

/// Largest relative error of |J V J^T + I| in single precision over the surfels of a case.
template <class Determinant>
double determinant_error(const HardScene& scene, Determinant determinant) {
  const Camera camera = case_camera(scene.view, Effort::kTable);
  double worst = 0;
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    const SurfelInCamera surfel = in_camera(scene.cloud, i, camera);
    Eigen::Matrix2d J = screen_from_tangent_jacobian(surfel, camera);
    J.col(0) *= std::sqrt(surfel.variance_u);
    J.col(1) *= std::sqrt(surfel.variance_v);
    const Eigen::Matrix2f rounded = J.cast<float>();
    const Eigen::Matrix<long double, 2, 2> exact = rounded.cast<long double>();
    const Eigen::Matrix<long double, 2, 2> JVJ = exact * exact.transpose();
    const long double truth = exact.determinant() * exact.determinant() + JVJ.trace() + 1;
    worst = std::max(worst, static_cast<double>(std::abs(determinant(rounded) / truth - 1)));
  }
  return worst;
}

Place slivers(Effort effort) {
  Place place{.title = "Slivers: det Sigma",
              .measure = "largest relative error of det Sigma, single precision",
              .slack = 1e-6,
              .published = "ac - b^2 of the matrix (6)",
              .ours = "det J V J^T + h_s^2 tr J V J^T + h_s^4, always on",
              .why =
                  "of a long ellipse the two products are nearly equal; a sum of positive terms "
                  "does not cancel"};
  for (const double aspect : {10.0, 1e3, 1e5}) {
    if (effort == Effort::kTest && aspect != 1e3) continue;
    const HardScene scene = make_hard_case(named("slivers", aspect));
    place.rows.push_back({named("slivers", aspect),
                          determinant_error(scene,
                                            [](const Eigen::Matrix2f& J) {
                                              const Eigen::Matrix2f s =
                                                  J * J.transpose() + Eigen::Matrix2f::Identity();
                                              return s(0, 0) * s(1, 1) - s(0, 1) * s(0, 1);
                                            }),
                          determinant_error(scene,
                                            [](const Eigen::Matrix2f& J) {
                                              const float d = J.determinant();
                                              return d * d + J.squaredNorm() + 1;
                                            }),
                          1e-5});
  }
  return place;
}

}  // namespace

std::vector<Measurement> projection_places() {
  return {{"Jacobian", one<jacobian>},       {"Grazing", one<grazing>},
          {"Slivers", one<slivers>},         {"NearPlane", one<near_plane>},
          {"Inside", one<inside>},           {"LargeSplats", one<large_splats>},
          {"SmallSplats", one<small_splats>}};
}

}  // namespace surfel::test
