#pragma once

#include <array>
#include <optional>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>

namespace surfel {

/// How a camera bends the straight lines that a pinhole shows.
struct Lens {
  enum class Model {
    kPolynomial,      ///< OpenCV's: x -> x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 +
                      ///< k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), y alike with p1 and p2 exchanged;
                      ///< x = X / Z, y = Y / Z, r their length.
    kFisheye,         ///< OpenCV's: theta -> theta (1 + k1 theta^2 + ... + k4 theta^8), theta the
                      ///< angle from the axis.
    kEquirectangular  ///< All directions, the camera's axis in the middle: x is the longitude, y
                      ///< the latitude. Focal lengths and principal point have no effect.
  };
  Model model = Model::kPolynomial;
  std::array<double, 6> k{};  ///< k1, k2, ...
  std::array<double, 2> p{};  ///< p1, p2.
};

/// The rays that the places of a picture stand for.
class SURFEL_API LensRays {
 public:
  LensRays(const Camera& camera, const Lens& lens);

  /// The unit vector in camera axes that is seen at a place of the picture, pixels; nullopt where
  /// the lens shows nothing, as beyond the angle up to which its distortion grows.
  std::optional<Vec3d> operator()(double x, double y) const;

  /// Where the lens shows a vector in camera axes; nullopt where it does not.
  std::optional<Eigen::Vector2d> place(const Vec3d& direction) const;

 private:
  Eigen::Vector2d distorted(const Eigen::Vector2d& p) const;
  double radial(double r) const;
  std::optional<Vec3d> polynomial_ray(const Eigen::Vector2d& seen) const;
  std::optional<Vec3d> fisheye_ray(const Eigen::Vector2d& seen) const;

  Camera camera_;
  Lens lens_;
  double most_;  ///< Largest r, or theta, up to which radial() grows.
};

}  // namespace surfel
