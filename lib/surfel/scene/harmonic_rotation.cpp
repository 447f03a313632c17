// Real spherical harmonics as the code of 3D Gaussian splatting (Kerbl et al. 2023) has them for
// degrees 0 to 3, and gsplat (Ye et al. 2024) for degree 4.

#include <cmath>
#include <numbers>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/scene/harmonic_rotation.h>

namespace surfel {
namespace {

struct WeightedDirection {
  Vec3d direction;
  double weight;
};

/// Directions whose weighted sum is the integral over the sphere of each product of two harmonics
/// up to degree 4: the Gauss-Legendre rule of five heights, with nine directions at each.
std::vector<WeightedDirection> quadrature() {
  static_assert(GaussianCloud::kMostDegree == 4);
  constexpr int kAround = 9;
  const double root = 2 * std::sqrt(10.0 / 7);
  const double near_height = std::sqrt(5 - root) / 3;
  const double far_height = std::sqrt(5 + root) / 3;
  const double near_weight = (322 + 13 * std::sqrt(70.0)) / 900;
  const double far_weight = (322 - 13 * std::sqrt(70.0)) / 900;
  std::vector<WeightedDirection> directions;
  const auto add = [&](double z, double weight) {
    const double radius = std::sqrt(1 - z * z);
    for (int k = 0; k < kAround; ++k) {
      const double angle = 2 * std::numbers::pi * k / kAround;
      directions.push_back({{radius * portable::cos(angle), radius * portable::sin(angle), z},
                            weight * 2 * std::numbers::pi / kAround});
    }
  };
  add(0, 128.0 / 225);
  for (const double sign : {-1.0, 1.0}) {
    add(sign * near_height, near_weight);
    add(sign * far_height, far_weight);
  }
  return directions;
}

/// Calls function(i, j) with the places of any two harmonics of the same degree, from degree 1 on.
template <class Function>
void for_each_pair(std::size_t degree, const Function& function) {
  for (std::size_t l = 1; l <= degree; ++l) {
    for (std::size_t i = l * l; i < (l + 1) * (l + 1); ++i) {
      for (std::size_t j = l * l; j < (l + 1) * (l + 1); ++j) function(i, j);
    }
  }
}

}  // namespace

std::array<double, kMostHarmonics> harmonics_of(const Vec3d& direction) {
  const double x = direction.x();
  const double y = direction.y();
  const double z = direction.z();
  const double xx = x * x;
  const double yy = y * y;
  const double zz = z * z;
  return {GaussianCloud::kHarmonic0,
          -0.4886025119029199 * y,
          0.4886025119029199 * z,
          -0.4886025119029199 * x,
          1.0925484305920792 * x * y,
          -1.0925484305920792 * y * z,
          0.31539156525252005 * (2 * zz - xx - yy),
          -1.0925484305920792 * x * z,
          0.5462742152960396 * (xx - yy),
          -0.5900435899266435 * y * (3 * xx - yy),
          2.890611442640554 * x * y * z,
          -0.4570457994644658 * y * (4 * zz - xx - yy),
          0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
          -0.4570457994644658 * x * (4 * zz - xx - yy),
          1.445305721320277 * z * (xx - yy),
          -0.5900435899266435 * x * (xx - 3 * yy),
          2.5033429417967046 * x * y * (xx - yy),
          -1.7701307697799304 * y * z * (3 * xx - yy),
          0.9461746957575601 * x * y * (7 * zz - 1),
          -0.6690465435572892 * y * z * (7 * zz - 3),
          0.10578554691520431 * (zz * (35 * zz - 30) + 3),
          -0.6690465435572892 * x * z * (7 * zz - 3),
          0.47308734787878004 * (xx - yy) * (7 * zz - 1),
          -1.7701307697799304 * x * z * (xx - 3 * yy),
          0.6258357354491761 * (xx * (xx - 3 * yy) - yy * (3 * xx - yy))};
}

HarmonicRotation::HarmonicRotation(const Eigen::Matrix3d& rotation, int degree)
    : degree_(static_cast<std::size_t>(degree)) {
  // The turned function's value in a direction is the function's in the direction turned back, and
  // the harmonics are orthonormal.
  for (const auto& [direction, weight] : quadrature()) {
    const auto values = harmonics_of(direction);
    const auto turned = harmonics_of(rotation.transpose() * direction);
    for_each_pair(degree_, [&, w = weight](std::size_t i, std::size_t j) {
      matrix_[i][j] += w * values[i] * turned[j];
    });
  }
}

void HarmonicRotation::turn(float* harmonics) const {
  std::array<Vec3d, kMostHarmonics> turned;
  turned.fill(Vec3d::Zero());
  for_each_pair(degree_, [&](std::size_t i, std::size_t j) {
    turned[i] += matrix_[i][j] * Eigen::Map<const Vec3f>(harmonics + 3 * j).cast<double>();
  });
  for (std::size_t i = 1; i < (degree_ + 1) * (degree_ + 1); ++i) {
    Eigen::Map<Vec3f>(harmonics + 3 * i) = turned[i].cast<float>();
  }
}

}  // namespace surfel
