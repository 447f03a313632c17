#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include <surfel/base/morton.h>
#include <surfel/scene/amplitude.h>
#include <surfel/scene/clips.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/texture/surfel_basis.h>

namespace surfel {
namespace {

std::optional<SurfelBasis::Function> make_function(const SurfelCloud& cloud, std::size_t k) {
  SurfelBasis::Function f;
  f.position = cloud.position[k].cast<double>();
  if (!f.position.allFinite() || cloud.normal.empty()) return std::nullopt;
  const Vec3d n = cloud.normal[k].cast<double>();
  const double length = n.norm();
  if (!(length > 0) || !std::isfinite(length)) return std::nullopt;
  f.normal = n / length;
  f.tangent = f.normal.unitOrthogonal();
  if (cloud.anisotropic()) {
    f.variance_u = static_cast<double>(cloud.variance_u[k]);
    f.variance_v = static_cast<double>(cloud.variance_v[k]);
    const Vec3d t = cloud.tangent[k].cast<double>();
    const Vec3d in_plane = t - f.normal * f.normal.dot(t);
    if (in_plane.allFinite() && in_plane.norm() > 0) f.tangent = in_plane.normalized();
  } else {
    f.variance_u = f.variance_v = static_cast<double>(cloud.variance[k]);
  }
  if (!usable_variance(f.variance_u) || !usable_variance(f.variance_v)) return std::nullopt;
  f.bitangent = f.normal.cross(f.tangent);
  f.area = amplitude<double>(cloud, k);
  if (!(f.area > 0) || !std::isfinite(f.area)) return std::nullopt;
  return f;
}

SurfelBasis::Cut make_cut(const SurfelBasis::Function& f, const HalfPlane& plane) {
  return {{plane.direction.dot(f.tangent), plane.direction.dot(f.bitangent)}, plane.distance};
}

}  // namespace

SurfelBasis make_basis(const SurfelCloud& cloud, bool along_curve) {
  SurfelBasis basis;
  Array<std::uint32_t> order;
  if (along_curve) {
    order.resize(cloud.size());
    std::iota(order.begin(), order.end(), 0U);
  } else {
    order = morton_order(cloud.position);
  }
  basis.function.reserve(order.size());
  basis.surfel.reserve(order.size());
  for (const std::uint32_t k : order) {
    if (const auto function = make_function(cloud, k)) {
      basis.function.push_back(*function);
      basis.surfel.push_back(k);
    }
  }
  const auto clipped = [&](std::uint32_t k) { return is_clipped(cloud, k); };
  if (std::any_of(basis.surfel.begin(), basis.surfel.end(), clipped)) {
    basis.cut.reserve(basis.size());
    for (std::size_t i = 0; i < basis.size(); ++i) {
      const SurfelBasis::Function& f = basis.function[i];
      const std::uint32_t k = basis.surfel[i];
      basis.cut.push_back(
          {make_cut(f, half_plane(cloud, k, 0)), make_cut(f, half_plane(cloud, k, 1))});
    }
  }
  basis.unusable = cloud.size() - basis.size();
  return basis;
}

}  // namespace surfel
