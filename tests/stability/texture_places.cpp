// Fits of textures: nearly singular and singular R, seams, uv without area.

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/sample/procedural_image.h>
#include <surfel/texture/texture_fit.h>
#include <surfel/truth/supersample.h>

#include "stability/views.h"

namespace surfel::test {
namespace {

ProceduralTexture checker() {
  ProceduralTextureOptions options;
  options.frequency = 8;
  return procedural_texture("checker", options);
}

TextureSet checker_textures() {
  TextureSet textures;
  textures.maps.emplace_back(rasterize(checker(), 512, 512, 1), WrapMode::kClamp);
  return textures;
}

SurfelCloud fitted(const SurfelCloud& source, TextureFitKind kind) {
  SurfelCloud cloud = source;
  TextureSet textures = checker_textures();
  TextureFitOptions options;
  options.kind = kind;
  fit_texture(cloud, textures, options);
  return cloud;
}

/// R of SS01 (11), all pairs, in double.
Eigen::MatrixXd gram_matrix(const SurfelCloud& cloud) {
  const auto n = static_cast<Eigen::Index>(cloud.size());
  Eigen::MatrixXd R(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      const double v = static_cast<double>(cloud.variance[i]) + cloud.variance[j];
      const double d2 =
          (cloud.position[i].cast<double>() - cloud.position[j].cast<double>()).squaredNorm();
      R(i, j) = static_cast<double>(cloud.area[i]) * cloud.area[j] * std::exp(-d2 / (2 * v)) /
                (2 * M_PI * v);
    }
  }
  return R;
}

/// R w = c, solved as it stands by a dense Cholesky factorisation: c_k is the inner product of r_k
/// with the texture, its mean under the kernel times the kernel's integral.
SurfelCloud fitted_as_published(const SurfelCloud& source, const Eigen::MatrixXd& R) {
  SurfelCloud cloud = fitted(source, TextureFitKind::kEwa);
  Eigen::MatrixXd c(R.rows(), 3);
  for (Eigen::Index i = 0; i < R.rows(); ++i) {
    c.row(i) = static_cast<double>(cloud.area[i]) * cloud.coefficient[i].cast<double>().transpose();
  }
  const Eigen::MatrixXd w = R.ldlt().solve(c);
  for (Eigen::Index i = 0; i < R.rows(); ++i) {
    cloud.coefficient[i] = w.row(i).transpose().cast<float>();
  }
  return cloud;
}

double condition_number(const Eigen::MatrixXd& R) {
  const Eigen::VectorXd eigen =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(R, Eigen::EigenvaluesOnly).eigenvalues();
  // What is lost in rounding is reported as such.
  const double least = std::max(eigen.minCoeff(), eigen.maxCoeff() * 1e-16);
  return eigen.maxCoeff() / least;
}

/// The checkered square itself, filtered.
Image true_checker(const Camera& camera, Effort effort) {
  const ProceduralTexture texture = checker();
  return supersample(camera, {.samples = effort == Effort::kTest ? 4 : 8, .lowpass = 1},
                     [&](double x, double y, int) -> Rgba {
                       const ViewRay ray = view_ray(camera, x, y);
                       const Vec3d origin = camera.eye + ray.origin;
                       const Vec3d p = origin - origin.z() / ray.direction.z() * ray.direction;
                       if (std::abs(p.x()) > 1 || std::abs(p.y()) > 1) return {};
                       const Vec3f c = texture((p.x() + 1) / 2, (p.y() + 1) / 2);
                       return {c.x(), c.y(), c.z(), 1};
                     });
}

void add_fit_row(Place& place, const std::string& input, double bound, Effort effort) {
  const HardScene scene = make_hard_case(input);
  const Camera camera = case_camera(scene.view, effort);
  const Image truth = true_checker(camera, effort);
  const Eigen::MatrixXd R = gram_matrix(scene.cloud);
  const SurfelCloud published = fitted_as_published(scene.cloud, R);
  const std::string note =
      effort == Effort::kTest ? "" : fmt::format("cond(R) = {:.0e}", condition_number(R));
  place.rows.push_back({input, psnr(draw(published, camera), truth),
                        psnr(draw(fitted(scene.cloud, TextureFitKind::kRender), camera), truth),
                        bound, note});
}

Place fit_place() {
  return {.measure = "PSNR of the picture to the texture itself, dB",
          .higher_better = true,
          .slack = 0.1,
          .published = "SS01 (11): R w = c, all of R, dense Cholesky, rendered as (9)",
          .ours = "`surfel-texture --image checker:8 --wrap clamp --fit render`"};
}

Place condition(Effort effort) {
  Place place = fit_place();
  place.title = "Nearly singular R";
  place.why =
      "the fit is to what the renderer shows, truncated and normalised, and is held to "
      "view-independent EWA where the data say nothing";
  for (const double width : {0.15, 0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.4}) {
    if (effort == Effort::kTest && width != 1) continue;
    add_fit_row(place, named("condition", width), width < 0.5 ? 17 : 20, effort);
  }
  return place;
}

Place duplicates(Effort effort) {
  Place place = fit_place();
  place.title = "Duplicate surfels: singular R";
  place.why =
      "duplicates share their coefficient; the normal matrix is definite whatever the "
      "surfels";
  add_fit_row(place, "duplicates:2", 20, effort);
  return place;
}

Place seam(Effort effort) {
  Place place{.title = "Seam between charts",
              .measure = "largest error of a coefficient on a white surface",
              .slack = 1e-3,
              .published = "SS01 section 5 on the picture: `surfel-texture --no-charts`",
              .ours = "`surfel-texture --mesh M.obj` (from `--mesh M.obj --image M.png`)",
              .why = "kernels take no colour from outside of their chart"};
  for (const double texels : {64, 512}) {
    if (effort == Effort::kTest && texels != 64) continue;
    const HardScene scene = make_hard_case(named("seam", texels));
    const auto error = [&](bool charts) {
      SurfelCloud cloud = scene.cloud;
      TextureSet textures;
      textures.maps.emplace_back(*scene.image, WrapMode::kRepeat);
      if (charts) textures.charts.emplace(*scene.mesh);
      fit_texture(cloud, textures, {});
      double worst = 0;
      for (const Vec3f& w : cloud.coefficient) {
        worst = std::max<double>(worst, (w - Vec3f(1, 1, 1)).cwiseAbs().maxCoeff());
      }
      return worst;
    };
    place.rows.push_back({named("seam", texels), error(false), error(true), 0.01});
  }
  return place;
}

Place uv_degenerate(Effort) {
  Place place{.title = "uv without area, mirrored uv",
              .measure = "share of the coefficients that are not finite",
              .published = "SS01 section 5: T^-1 V T^-T by the inverse of T",
              .ours = "`surfel-texture --image checker:8`",
              .why =
                  "what has no kernel in the picture takes the colour at its place, and is "
                  "counted"};
  const HardScene scene = make_hard_case("uv-degenerate");
  std::size_t published = 0;
  for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
    // T's inverse maps the frame (dpdu, n x dpdu) to texture space.
    const Vec3d t = scene.cloud.dpdu[i].cast<double>().normalized();
    const Vec3d b = scene.cloud.normal[i].cast<double>().cross(t);
    Eigen::Matrix2d T;
    T << scene.cloud.dpdu[i].cast<double>().dot(t), scene.cloud.dpdv[i].cast<double>().dot(t),
        scene.cloud.dpdu[i].cast<double>().dot(b), scene.cloud.dpdv[i].cast<double>().dot(b);
    const Eigen::Matrix2d inverse = T.inverse();
    published += (inverse * inverse.transpose()).allFinite() ? 0 : 1;
  }
  const SurfelCloud ours = fitted(scene.cloud, TextureFitKind::kEwa);
  const auto bad = std::count_if(ours.coefficient.begin(), ours.coefficient.end(),
                                 [](const Vec3f& w) { return !w.allFinite(); });
  const auto all = static_cast<double>(scene.cloud.size());
  place.rows.push_back(
      {"uv-degenerate", static_cast<double>(published) / all, static_cast<double>(bad) / all, 0});
  return place;
}

}  // namespace

std::vector<Measurement> texture_places() {
  return {{"Condition", one<condition>},
          {"Duplicates", one<duplicates>},
          {"Seam", one<seam>},
          {"UvDegenerate", one<uv_degenerate>}};
}

}  // namespace surfel::test
