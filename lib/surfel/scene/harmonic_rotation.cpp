// Real spherical harmonics as the code of 3D Gaussian splatting (Kerbl et al. 2023) has them for
// degrees 0 to 3, and gsplat (Ye et al. 2024) for degree 4.

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include <surfel/base/elementary.h>
#include <surfel/scene/harmonic_rotation.h>

namespace surfel {
namespace {

/// Directions that are spread over the sphere, more than the harmonics of any degree, so that these
/// are told apart by their values there: a spiral by the golden angle.
std::vector<Vec3d> spread_directions() {
  constexpr int kCount = 32;
  std::vector<Vec3d> directions;
  for (int k = 0; k < kCount; ++k) {
    const double z = 1 - (2 * k + 1.0) / kCount;
    const double angle = k * std::numbers::pi * (3 - std::sqrt(5.0));
    const double radius = std::sqrt(1 - z * z);
    directions.emplace_back(radius * portable::cos(angle), radius * portable::sin(angle), z);
  }
  return directions;
}

/// The harmonics of degree `degree` alone.
auto band(const std::array<double, kMostHarmonics>& all, int degree) {
  return Eigen::Map<const Eigen::RowVectorXd>(all.data() + degree * degree, 2 * degree + 1);
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

HarmonicRotation::HarmonicRotation(const Eigen::Matrix3d& rotation, int degree) {
  // The turned function's value in a direction is the function's in the direction turned back. The
  // harmonics of a degree stay among themselves: the coefficients are those that give the values in
  // enough directions.
  const std::vector<Vec3d> directions = spread_directions();
  const auto rows = static_cast<Eigen::Index>(directions.size());
  for (int l = 1; l <= degree; ++l) {
    Eigen::MatrixXd values(rows, 2 * l + 1);
    Eigen::MatrixXd turned(rows, 2 * l + 1);
    for (Eigen::Index i = 0; i < rows; ++i) {
      const Vec3d& direction = directions[static_cast<std::size_t>(i)];
      values.row(i) = band(harmonics_of(direction), l);
      turned.row(i) = band(harmonics_of(rotation.transpose() * direction), l);
    }
    const Eigen::MatrixXd gram = values.transpose() * values;
    bands_.emplace_back(gram.ldlt().solve(values.transpose() * turned));
  }
}

void HarmonicRotation::turn(float* harmonics) const {
  for (std::size_t k = 0; k < bands_.size(); ++k) {
    const auto l = static_cast<Eigen::Index>(k + 1);
    using Colors = Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>;
    Eigen::Map<Colors> colors(harmonics + 3 * l * l, 2 * l + 1, 3);
    colors = (bands_[k] * colors.cast<double>()).cast<float>().eval();
  }
}

}  // namespace surfel
