#include <algorithm>
#include <cmath>
#include <numeric>

#include <surfel/base/color.h>
#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/scene/clips.h>
#include <surfel/scene/gaussian_mass.h>
#include <surfel/scene/gaussians_of_surfels.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

/// Share of what lies behind an opaque surface that its splats hide.
constexpr double kHidden = 0.99;
/// Opacity that renderers of splats cap at.
constexpr double kMostOpacity = 0.99;

/// A rotation whose third axis is the unit vector `n`.
Eigen::Quaterniond rotation_onto(const Eigen::Vector3d& n) {
  // Half-way between z and n; no such direction opposite to z, where any half turn will do.
  if (n.z() < -1 + 1e-12) return {0, 1, 0, 0};
  return Eigen::Quaterniond(1 + n.z(), -n.y(), n.x(), 0).normalized();
}

/// A rotation whose first axis is about the unit vector `t`, whose third is `n`.
Eigen::Quaterniond rotation_onto(const Eigen::Vector3d& t, const Eigen::Vector3d& n) {
  const Eigen::Quaterniond upright = rotation_onto(n);
  const Eigen::Vector3d in_plane = upright.conjugate() * t;
  const double angle = portable::atan2(in_plane.y(), in_plane.x());
  return upright * Eigen::Quaterniond(portable::cos(angle / 2), 0, 0, portable::sin(angle / 2));
}

std::array<float, 4> components(const Eigen::Quaterniond& q) {
  return {static_cast<float>(q.w()), static_cast<float>(q.x()), static_cast<float>(q.y()),
          static_cast<float>(q.z())};
}

/// Sets shape and place of Gaussian `to` by surfel i.
void place(const SurfelCloud& cloud, std::size_t i, double thickness, GaussianCloud& out,
           std::size_t to) {
  const double u = cloud.anisotropic() ? cloud.variance_u[i] : cloud.variance[i];
  const double v = cloud.anisotropic() ? cloud.variance_v[i] : cloud.variance[i];
  const double deviation_u = std::sqrt(u);
  const double deviation_v = std::sqrt(v);
  const double least = std::min(deviation_u, deviation_v);
  out.position[to] = cloud.position[i];
  const bool sphere =
      cloud.normal.empty() || cloud.normal[i].isZero(0) || !cloud.normal[i].allFinite();
  if (sphere) {
    out.scale[to].setConstant(static_cast<float>(least));
    out.rotation[to] = {1, 0, 0, 0};
    return;
  }
  const Eigen::Vector3d normal = cloud.normal[i].cast<double>().normalized();
  out.scale[to] = Vec3d(deviation_u, deviation_v, thickness * least).cast<float>();
  const bool turned = cloud.anisotropic() && cloud.tangent[i].allFinite();
  out.rotation[to] = components(turned ? rotation_onto(cloud.tangent[i].cast<double>(), normal)
                                       : rotation_onto(normal));
}

}  // namespace

std::vector<std::string> GaussiansOfSurfelsOptions::problems() const {
  std::vector<std::string> found;
  check_positive(found, "overlap", overlap);
  check_option(found, thickness >= 0 && thickness <= 1, "thickness", thickness, "in 0..1");
  return found;
}

double opacity_for(double overlap, double hidden) {
  return opacity_of_dilogarithm(-portable::log(1 - hidden) / overlap, kMostOpacity);
}

GaussianCloud gaussians_of_surfels(const SurfelCloud& cloud, const std::string& name,
                                   const GaussiansOfSurfelsOptions& options,
                                   GaussiansOfSurfelsReport* report) {
  require_usable(options);
  cloud.check_columns(name);
  if (!has_variance(cloud)) {
    throw_input(name, "has no variances, which Gaussians need; run surfel-estimate on it first");
  }
  GaussiansOfSurfelsReport r;
  Array<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0U);
  r.left_out = remove_unusable(cloud, false, order);
  const auto is_mirrored = [&](std::uint32_t i) { return is_cut_off(cloud, i); };
  r.mirrored = std::erase_if(order, is_mirrored);
  r.clipped = static_cast<std::size_t>(std::count_if(
      order.begin(), order.end(), [&](std::uint32_t i) { return is_clipped(cloud, i); }));
  if (order.empty()) throw_input(name, "has no surfel that a Gaussian can be made of");

  r.opacity = opacity_for(options.overlap, kHidden);
  GaussianCloud out;
  out.origin = cloud.origin;
  out.up = cloud.up;
  out.resize(order.size());
  const Array<Vec3f>* const color = cloud.render_color();
  constexpr std::size_t kGrain = std::size_t{1} << 10;
  parallel_each(order.size(), kGrain, [&](std::size_t to) {
    const std::uint32_t i = order[to];
    place(cloud, i, options.thickness, out, to);
    const bool opaque = cloud.alpha.empty() || cloud.alpha[i] >= 1;
    out.amplitude[to] = static_cast<float>(
        opaque ? r.opacity
               : opacity_for(options.overlap, kHidden * std::max(0.0F, cloud.alpha[i])));
    const Vec3f linear = color ? (*color)[i] : SurfelCloud::colorless();
    for (int k = 0; k < 3; ++k) {
      const double shown = linear_to_srgb(linear[k]);
      out.harmonics[3 * to + static_cast<std::size_t>(k)] =
          static_cast<float>((shown - 0.5) / GaussianCloud::kHarmonic0);
    }
  });
  if (report) *report = r;
  return out;
}

}  // namespace surfel
