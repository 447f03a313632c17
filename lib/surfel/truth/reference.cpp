// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: equations (1), (9), (12).

#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/render/shading.h>
#include <surfel/surface/coverage_threshold.h>
#include <surfel/truth/ray_surfaces.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/supersample.h>

namespace surfel {
namespace {

/// Casts the rays of one worker. A pixel's rays come one after the other and share the search.
class RayCaster {
 public:
  RayCaster(const RenderCloud& cloud, const Scene& scene, const RenderOptions& options,
            const DiscHierarchy& hierarchy, const Shader& shader, const Camera& camera)
      : cloud_(cloud),
        options_(options),
        hierarchy_(hierarchy),
        camera_(camera),
        surfaces_(cloud, scene, shader,
                  options.coverage_threshold.value_or(coverage_threshold(options.cutoff))) {}

  /// Premultiplied colour at picture coordinates.
  Rgba trace(double x, double y) {
    if (pixel_x_ != std::floor(x) || pixel_y_ != std::floor(y)) {
      pixel_x_ = std::floor(x);
      pixel_y_ = std::floor(y);
      find_candidates();
    }
    const ViewRay ray = view_ray(camera_, x, y);
    hits_.clear();
    for (const Disc& disc : candidates_) {
      if (const std::optional<RayHit> hit = meet(disc, ray)) hits_.push_back(*hit);
    }
    return surfaces_.color(hits_, x, y);
  }

 private:
  /// All surfels that some ray through the pixel's square may meet.
  void find_candidates() {
    const ViewRay axis = view_ray(camera_, pixel_x_ + 0.5, pixel_y_ + 0.5);
    Beam beam{camera_.eye - cloud_.origin() + axis.origin, axis.direction, 0, 0};
    // Half the diagonal of the square, and a little for the corner's rounding.
    const double corner = 0.5001 * portable::hypot(1 / camera_.focal_x, 1 / camera_.focal_y);
    (camera_.orthographic ? beam.radius : beam.spread) = corner;
    candidates_.clear();
    hierarchy_.for_each(
        beam, [&](std::uint32_t surfel) { candidates_.emplace_back(cloud_, surfel, camera_); });
  }

  std::optional<RayHit> meet(const Disc& disc, const ViewRay& ray) const {
    const double z = disc.meet(ray);
    if (!(z > camera_.near && std::isfinite(z))) return std::nullopt;
    const bool front = disc.normal.dot(ray.direction) < 0;
    if (options_.cull_back && !front) return std::nullopt;
    const Vec3d offset = ray.origin + z * ray.direction - disc.center;
    const double u = disc.tangent.dot(offset) / disc.deviation_u;
    const double v = disc.bitangent.dot(offset) / disc.deviation_v;
    const double beta = 0.5 * (u * u + v * v);
    if (!(beta < options_.cutoff) || disc.is_cut(offset)) return std::nullopt;
    const double weight = disc.area * portable::exp(-beta) /
                          (2 * std::numbers::pi * disc.deviation_u * disc.deviation_v);
    if (!(weight > 0)) return std::nullopt;
    const double reach = std::sqrt(2 * options_.cutoff) * disc.max_deviation();
    return RayHit{z, weight, options_.epsilon_share() * reach, disc.surfel, front};
  }

  const RenderCloud& cloud_;
  const RenderOptions& options_;
  const DiscHierarchy& hierarchy_;
  const Camera& camera_;

  /// The pixel of the candidates: none yet.
  double pixel_x_ = std::nan(""), pixel_y_ = std::nan("");
  std::vector<Disc> candidates_;
  std::vector<RayHit> hits_;
  RaySurfaces surfaces_;
};

}  // namespace

std::vector<std::string> ReferenceOptions::problems() const {
  if (samples >= 1 && samples <= 64) return {};
  return {fmt::format("`samples` is {}; it must be in 1..64", samples)};
}

ReferenceRenderer::ReferenceRenderer(const RenderCloud& cloud, const Scene& scene,
                                     const RenderOptions& options,
                                     const ReferenceOptions& reference)
    : cloud_(cloud),
      scene_(scene),
      options_(options),
      reference_(reference),
      hierarchy_(cloud, std::sqrt(2 * options.cutoff), DiscHierarchy::Bound::kDisc) {
  require_usable(options);
  require_usable(scene);
  require_usable(reference);
}

Image ReferenceRenderer::render(const Camera& camera,
                                const std::function<void(double)>& progress) const {
  require_usable(camera);
  const Shader shader(options_.lit ? &scene_ : nullptr, camera, 0, cloud_.has_shading());
  PerWorker<RayCaster> workers([&] {
    return std::make_unique<RayCaster>(cloud_, scene_, options_, hierarchy_, shader, camera);
  });
  Image image = supersample(
      camera, {reference_.samples, options_.lowpass},
      [&](double x, double y, int worker) { return workers[worker].trace(x, y); }, progress);
  composite_over(image, camera.drawn_rows(), options_.background);
  return image;
}

}  // namespace surfel
