#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/render/clip_kernel.h>

namespace surfel {
namespace {

/// The direction of a line times the deviations along the surfel's axes.
Eigen::Vector2d weighed(const SurfelInCamera& surfel, const ClipLine& line) {
  return {line.direction.dot(surfel.tangent) * std::sqrt(surfel.variance_u),
          line.direction.dot(surfel.normal.cross(surfel.tangent)) * std::sqrt(surfel.variance_v)};
}

/// The covariance of the place on a surfel of what is seen at a pixel, for an affine kernel.
class SeenPlace {
 public:
  SeenPlace(const SurfelInCamera& surfel, const Camera& camera, double lowpass)
      : A(screen_from_tangent_jacobian(surfel, camera)) {
    A.col(0) *= std::sqrt(surfel.variance_u);
    A.col(1) *= std::sqrt(surfel.variance_v);
    // Of a Gaussian a part of at least this share of its width is blurred, so that shares are
    // finite without a filter, too.
    constexpr double kLeastBlur = 1e-4;
    const double size2 = A.squaredNorm();
    h2 = std::max(lowpass * lowpass, kLeastBlur * kLeastBlur * size2);
    const double det_A = A.determinant();
    determinant = det_A * det_A + h2 * size2 + h2 * h2;
  }

  /// h^2 (h^2 v . w + (v_u b - v_v t) . (w_u b - w_v t)) / |Sigma|: with v = w a sum of positive
  /// terms. Directions are weighed().
  double covariance(const Eigen::Vector2d& v, const Eigen::Vector2d& w) const {
    const auto across = [&](const Eigen::Vector2d& d) -> Eigen::Vector2d {
      return d.x() * A.col(1) - d.y() * A.col(0);
    };
    return h2 * (h2 * v.dot(w) + across(v).dot(across(w))) / determinant;
  }

  Eigen::Matrix2d A;   ///< J V^(1/2).
  double h2;           ///< Variance of the pixel filter.
  double determinant;  ///< |Sigma|, as a sum of positive terms.
};

/// w of joint_share().
double weight_of_correlation(double r) {
  return 2 / std::numbers::pi * portable::asin(std::clamp(r, -1.0, 1.0));
}

}  // namespace

double ClipShare::at(const Eigen::Vector2d& x, const Eigen::Vector2d& center) const {
  const double z = at_center + gradient.dot(x - center);
  return portable::erfc(-z / std::numbers::sqrt2) / 2;
}

ClipShare clip_share(const SurfelInCamera& surfel, const Camera& camera, double lowpass,
                     const ClipLine& line) {
  const SeenPlace seen(surfel, camera, lowpass);
  const Eigen::Vector2d w = weighed(surfel, line);
  const double s = std::sqrt(seen.covariance(w, w));
  const Eigen::Vector2d a = seen.A * w;
  const Eigen::Matrix2d Sigma = seen.A * seen.A.transpose() + seen.h2 * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d mean(Sigma(1, 1) * a.x() - Sigma(0, 1) * a.y(),
                             Sigma(0, 0) * a.y() - Sigma(0, 1) * a.x());
  return {line.distance / s, -mean / (seen.determinant * s)};
}

double joint_share(const SurfelInCamera& surfel, const Camera& camera, double lowpass) {
  const SeenPlace seen(surfel, camera, lowpass);
  const Eigen::Vector2d v = weighed(surfel, surfel.clip[0]);
  const Eigen::Vector2d w = weighed(surfel, surfel.clip[1]);
  return weight_of_correlation(seen.covariance(v, w) /
                               std::sqrt(seen.covariance(v, v) * seen.covariance(w, w)));
}

double joined(double a, double b, double w) {
  const double bound = w > 0 ? std::min(a, b) : std::max(0.0, a + b - 1);
  return a * b + std::abs(w) * (bound - a * b);
}

Eigen::Vector2d outward_on_screen(const SurfelInCamera& surfel, const Camera& camera,
                                  const ClipLine& line) {
  const Eigen::Vector3d along = surfel.normal.cross(line.direction);
  const Eigen::Vector3d place = surfel.position + line.distance * line.direction;
  // The normal of the plane that holds the line and the eye: it is across the line on the screen.
  const Eigen::Vector3d plane =
      camera.orthographic ? Eigen::Vector3d(along.y(), -along.x(), 0) : along.cross(place);
  Eigen::Vector2d outward(plane.x() / camera.focal_x, plane.y() / camera.focal_y);
  const double length = outward.norm();
  if (!(length > 0)) return {0, 0};
  outward /= length;
  // A point beyond the line is on the plane's side that the direction is on.
  return plane.dot(line.direction) < 0 ? Eigen::Vector2d(-outward) : outward;
}

float beyond_growth(double cutoff) {
  return static_cast<float>(std::max(0.0, 0.1 + 0.3 / std::numbers::ln2 * portable::log(cutoff)));
}

SplatClip make_exact_clip(const SurfelInCamera& surfel, const Camera& camera) {
  SplatClip clip{};
  clip.line[0][0] = clip.line[1][0] = kNoClip;
  clip.beyond = 1;
  int count = 0;
  for (const ClipLine& line : surfel.clip) {
    if (!line.cuts()) continue;
    const Eigen::Vector2d w = weighed(surfel, line);
    const Eigen::Vector2d outward = outward_on_screen(surfel, camera, line);
    clip.line[count][0] = static_cast<float>(line.distance);
    for (int k = 0; k < 2; ++k) {
      clip.line[count][k + 1] = static_cast<float>(w[k]);
      clip.outward[count][k] = static_cast<float>(outward[k]);
    }
    ++count;
  }
  // A surfel with an exact kernel is much larger than the filter, which alone blurs its lines.
  if (count == 2) {
    clip.joint = static_cast<float>(weight_of_correlation(clip.outward[0][0] * clip.outward[1][0] +
                                                          clip.outward[0][1] * clip.outward[1][1]));
  }
  return clip;
}

}  // namespace surfel
