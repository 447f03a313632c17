// Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH 2001: equations (8), (9), (12).

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/render/clip_kernel.h>
#include <surfel/render/shading.h>
#include <surfel/surface/coverage_threshold.h>
#include <surfel/truth/ray_surfaces.h>
#include <surfel/truth/source_ewa.h>
#include <surfel/truth/supersample.h>

namespace surfel {
namespace {

/// Below this cosine between normal and line of sight the footprint stops growing.
constexpr double kLeastCosine = 0.1;
/// Contributions end where a pixel is further from a disc's projection than this many times the
/// reach of its filter: where it meets the plane at this many times the disc's depth.
constexpr double kMostDepthRatio = 2;

/// The kernels of one camera.
class SourceKernels {
 public:
  SourceKernels(const RenderOptions& options, const Camera& camera)
      : options_(options),
        camera_(camera),
        radius_(std::sqrt(2 * options.cutoff)),
        pixel_(options.lowpass * std::max(1 / camera.focal_x, 1 / camera.focal_y)) {}

  /// The beam that every disc meets that contributes to the pixel around `ray`; relative to the
  /// eye.
  Beam beam(const ViewRay& ray) const {
    Beam beam{ray.origin, ray.direction, 0, 0};
    (camera_.orthographic ? beam.radius : beam.spread) = kMostDepthRatio * radius_ * pixel_;
    return beam;
  }

  std::optional<RayHit> meet(const Disc& disc, const ViewRay& ray) const {
    const double t = disc.meet(ray);
    if (!(t > camera_.near && std::isfinite(t)) || !touches(beam(ray), disc)) return std::nullopt;
    const bool front = disc.normal.dot(ray.direction) < 0;
    if (options_.cull_back && !front) return std::nullopt;

    const Eigen::Matrix2d J = screen_from_plane(disc, ray, t);
    const Vec3d offset = ray.origin + t * ray.direction - disc.center;
    const Vec2d u(disc.tangent.dot(offset), disc.bitangent.dot(offset));
    const Vec2d V(disc.deviation_u * disc.deviation_u, disc.deviation_v * disc.deviation_v);
    const double h2 = options_.lowpass * options_.lowpass;
    const Eigen::Matrix2d JVJt = J * V.asDiagonal() * J.transpose();
    const Eigen::Matrix2d Sigma = JVJt + h2 * Eigen::Matrix2d::Identity();
    // |Sigma| as a sum of positive terms: a sliver's does not cancel.
    const double det_J = std::abs(J.determinant());
    const double det_Sigma = det_J * det_J * V.x() * V.y() + h2 * JVJt.trace() + h2 * h2;
    const Vec2d x = J * u;
    const double beta = 0.5 *
                        (Sigma(1, 1) * x.x() * x.x() - 2 * Sigma(0, 1) * x.x() * x.y() +
                         Sigma(0, 0) * x.y() * x.y()) /
                        det_Sigma;
    if (!(beta < options_.cutoff)) return std::nullopt;
    const Eigen::Matrix2d K = V.asDiagonal() * J.transpose() * Sigma.inverse();
    const Eigen::Matrix2d left = V.asDiagonal().toDenseMatrix() - K * J * V.asDiagonal();
    double shares[2] = {1, 1};
    Vec2d n[2];
    double s2[2];
    for (std::size_t j = 0; j < disc.lines.size(); ++j) {
      const Disc::Line& line = disc.lines[j];
      n[j] = {line.direction.dot(disc.tangent), line.direction.dot(disc.bitangent)};
      if (n[j].isZero(0)) continue;
      s2[j] = std::max(n[j].dot(left * n[j]), 1e-12 * V.sum());
      const double z = (line.distance - n[j].dot(K * x)) / std::sqrt(s2[j]);
      shares[j] = portable::erfc(-z / std::numbers::sqrt2) / 2;
    }
    double share = shares[0] * shares[1];
    if (!n[0].isZero(0) && !n[1].isZero(0)) {
      const double r = std::clamp(n[0].dot(left * n[1]) / std::sqrt(s2[0] * s2[1]), -1.0, 1.0);
      share = joined(shares[0], shares[1], 2 / std::numbers::pi * portable::asin(r));
    }
    if (share < kLeastClipShare) return std::nullopt;
    const double rho = share * disc.area * det_J * portable::exp(-beta) /
                       (2 * std::numbers::pi * std::sqrt(det_Sigma));
    if (!(rho > 0)) return std::nullopt;

    const double center_z = camera_.camera_from_world.row(2).dot(disc.center);
    const double reach = footprint(disc, center_z);
    const double z = std::clamp(t, center_z - reach, center_z + reach);
    if (!(z > camera_.near)) return std::nullopt;
    return RayHit{z, rho, options_.epsilon_share() * reach, disc.surfel, front};
  }

 private:
  /// Whether the beam touches the disc's ball where it passes its centre.
  bool touches(const Beam& beam, const Disc& disc) const {
    const double t =
        std::max(0.0, beam.direction.dot(disc.center - beam.origin) / beam.direction.squaredNorm());
    return (beam.origin + t * beam.direction - disc.center).norm() <=
           radius_ * disc.max_deviation() + beam.radius + t * beam.spread;
  }

  /// J_x at the ray's t: the derivative of the projection there. A plane vector T moves the
  /// projection of the point z (X, Y, 1) by f / z (T.xy - (X, Y) T.z), orthographic by f T.xy.
  Eigen::Matrix2d screen_from_plane(const Disc& disc, const ViewRay& ray, double t) const {
    Eigen::Matrix<double, 3, 2> T;
    T << camera_.camera_from_world * disc.tangent, camera_.camera_from_world * disc.bitangent;
    const Vec3d direction = camera_.camera_from_world * ray.direction;
    const Eigen::Matrix2d on_image_plane =
        camera_.orthographic
            ? Eigen::Matrix2d(T.topRows<2>())
            : Eigen::Matrix2d((T.topRows<2>() - direction.head<2>() * T.row(2)) / t);
    return Vec2d(camera_.focal_x, camera_.focal_y).asDiagonal() * on_image_plane;
  }

  /// Radius of disc and pixel filter together on the tangent plane, the latter divided by the
  /// cosine; scene units.
  double footprint(const Disc& disc, double center_z) const {
    const double cosine =
        std::abs(camera_.orthographic ? camera_.camera_from_world.row(2).dot(disc.normal)
                                      : disc.normal.dot(disc.center.normalized()));
    const double pixel_on_plane = pixel_ * (camera_.orthographic ? 1 : std::max(0.0, center_z)) /
                                  std::max(cosine, kLeastCosine);
    return radius_ * portable::hypot(disc.max_deviation(), pixel_on_plane);
  }

  const RenderOptions& options_;
  const Camera& camera_;
  double radius_;  ///< Radius of kernels, standard deviations.
  double pixel_;   ///< Standard deviation of the pixel filter at depth 1; orthographic: anywhere.
};

}  // namespace

SourceEwaRenderer::SourceEwaRenderer(const RenderCloud& cloud, const Scene& scene,
                                     const RenderOptions& options)
    : cloud_(cloud),
      scene_(scene),
      options_(options),
      hierarchy_(cloud, std::sqrt(2 * options.cutoff), DiscHierarchy::Bound::kBall) {
  require_usable(options);
  require_usable(scene);
}

Image SourceEwaRenderer::render(const Camera& camera,
                                const std::function<void(double)>& progress) const {
  require_usable(camera);
  const Shader shader(options_.lit ? &scene_ : nullptr, camera, options_.lowpass,
                      cloud_.has_shading());
  const SourceKernels kernels(options_, camera);
  const double full_weight =
      options_.coverage_threshold.value_or(coverage_threshold(options_.cutoff));
  struct Worker {
    RaySurfaces surfaces;
    std::vector<RayHit> hits;
  };
  PerWorker<Worker> workers([&] {
    return std::make_unique<Worker>(Worker{{cloud_, scene_, shader, full_weight}, {}});
  });

  Image image = rgba_image(camera.width, camera.height);
  const RowRange rows = camera.drawn_rows();
  const int count = rows.end - rows.begin;
  std::atomic<int> rows_done{0};
  parallel_for(static_cast<std::size_t>(count), 1, [&](std::size_t row, std::size_t, int w) {
    Worker& worker = workers[w];
    const int y = rows.begin + static_cast<int>(row);
    for (int x = 0; x < camera.width; ++x) {
      const ViewRay ray = view_ray(camera, x + 0.5, y + 0.5);
      Beam beam = kernels.beam(ray);
      beam.origin += camera.eye - cloud_.origin();
      worker.hits.clear();
      hierarchy_.for_each(beam, [&](std::uint32_t surfel) {
        const std::optional<RayHit> hit = kernels.meet(Disc(cloud_, surfel, camera), ray);
        if (hit) worker.hits.push_back(*hit);
      });
      const Rgba color = worker.surfaces.color(worker.hits, x + 0.5, y + 0.5);
      float* pixel = image.pixel(x, y);
      pixel[0] = color.red;
      pixel[1] = color.green;
      pixel[2] = color.blue;
      pixel[3] = color.alpha;
    }
    if (progress) progress(static_cast<double>(++rows_done) / count);
  });
  composite_over(image, rows, options_.background);
  return image;
}

}  // namespace surfel
