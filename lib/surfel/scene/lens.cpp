// Brown, "Decentering distortion of lenses", 1966; Kannala, Brandt, "A generic camera model and
// calibration method for conventional, wide-angle, and fish-eye lenses", 2006; both as OpenCV has
// them.

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/scene/lens.h>

namespace surfel {

LensRays::LensRays(const Camera& camera, const Lens& lens)
    : camera_(camera), lens_(lens), most_(0) {
  if (lens.model == Lens::Model::kEquirectangular) return;
  // Beyond its first maximum a polynomial shows again what it has shown; pinholes see far less than
  // r = 20, which are 87 degrees.
  const double end = lens.model == Lens::Model::kFisheye ? std::numbers::pi : 20;
  constexpr int kSteps = 4000;
  double before = 0;
  for (int i = 1; i <= kSteps; ++i) {
    const double r = end * i / kSteps;
    const double value = radial(r);
    if (!(value > before)) break;
    before = value;
    most_ = r;
  }
}

double LensRays::radial(double r) const {
  const auto& k = lens_.k;
  const double s = r * r;
  if (lens_.model == Lens::Model::kFisheye) {
    return r * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))));
  }
  return r * (1 + s * (k[0] + s * (k[1] + s * k[2]))) / (1 + s * (k[3] + s * (k[4] + s * k[5])));
}

Eigen::Vector2d LensRays::distorted(const Eigen::Vector2d& p) const {
  const double s = p.squaredNorm();
  const double r = std::sqrt(s);
  const double grown = r > 0 ? radial(r) / r : 1;
  const double xy = 2 * p.x() * p.y();
  return {p.x() * grown + lens_.p[0] * xy + lens_.p[1] * (s + 2 * p.x() * p.x()),
          p.y() * grown + lens_.p[1] * xy + lens_.p[0] * (s + 2 * p.y() * p.y())};
}

std::optional<Vec3d> LensRays::polynomial_ray(const Eigen::Vector2d& seen) const {
  // Newton's method; the derivatives by differences, as rounding is far below a pixel.
  constexpr double kStep = 1e-6;
  constexpr double kEnough = 1e-10;
  constexpr int kMostRounds = 30;
  Eigen::Vector2d p = seen;
  if (p.norm() > most_) p *= most_ / p.norm();
  for (int round = 0; round < kMostRounds; ++round) {
    const Eigen::Vector2d error = distorted(p) - seen;
    if (error.norm() < kEnough * (1 + seen.norm())) {
      if (!(p.norm() <= most_)) return std::nullopt;
      return Vec3d(p.x(), p.y(), 1).normalized();
    }
    Eigen::Matrix2d slope;
    for (int axis = 0; axis < 2; ++axis) {
      const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(axis);
      slope.col(axis) = (distorted(p + step) - distorted(p - step)) / (2 * kStep);
    }
    if (!(slope.determinant() > 0)) return std::nullopt;
    p -= slope.inverse() * error;
    // A step must not leave what the lens shows for another branch.
    if (p.norm() > 1.2 * most_) p *= 1.2 * most_ / p.norm();
    if (!p.allFinite()) return std::nullopt;
  }
  return std::nullopt;
}

std::optional<Vec3d> LensRays::fisheye_ray(const Eigen::Vector2d& seen) const {
  const double r = seen.norm();
  if (!(r <= radial(most_))) return std::nullopt;
  if (!(r > 0)) return Vec3d(0, 0, 1);
  double low = 0;
  double high = most_;
  // The polynomial grows from `low` to `high`; each round halves what is between them.
  constexpr int kRounds = 52;
  for (int round = 0; round < kRounds; ++round) {
    const double middle = (low + high) / 2;
    (radial(middle) < r ? low : high) = middle;
  }
  const double sine = portable::sin(low);
  return Vec3d(sine * seen.x() / r, sine * seen.y() / r, portable::cos(low));
}

std::optional<Vec3d> LensRays::operator()(double x, double y) const {
  if (lens_.model == Lens::Model::kEquirectangular) {
    const double longitude = 2 * std::numbers::pi * (x / camera_.width - 0.5);
    const double latitude = std::numbers::pi * (0.5 - y / camera_.height);
    const double across = portable::cos(latitude);
    return Vec3d(across * portable::sin(longitude), -portable::sin(latitude),
                 across * portable::cos(longitude));
  }
  const Eigen::Vector2d seen((x - camera_.center_x) / camera_.focal_x,
                             (y - camera_.center_y) / camera_.focal_y);
  return lens_.model == Lens::Model::kFisheye ? fisheye_ray(seen) : polynomial_ray(seen);
}

std::optional<Eigen::Vector2d> LensRays::place(const Vec3d& direction) const {
  const double across = portable::hypot(direction.x(), direction.y());
  if (lens_.model == Lens::Model::kEquirectangular) {
    const double longitude = portable::atan2(direction.x(), direction.z());
    const double latitude =
        portable::atan2(-direction.y(), portable::hypot(direction.x(), direction.z()));
    return Eigen::Vector2d(camera_.width * (longitude / (2 * std::numbers::pi) + 0.5),
                           camera_.height * (0.5 - latitude / std::numbers::pi));
  }
  Eigen::Vector2d seen;
  if (lens_.model == Lens::Model::kFisheye) {
    const double theta = portable::atan2(across, direction.z());
    if (theta > most_) return std::nullopt;
    seen = across > 0 ? Eigen::Vector2d(direction.head<2>() * (radial(theta) / across))
                      : Eigen::Vector2d(0, 0);
  } else {
    if (!(direction.z() > 0) || across > most_ * direction.z()) return std::nullopt;
    seen = distorted(direction.head<2>() / direction.z());
  }
  return Eigen::Vector2d(camera_.focal_x * seen.x() + camera_.center_x,
                         camera_.focal_y * seen.y() + camera_.center_y);
}

}  // namespace surfel
