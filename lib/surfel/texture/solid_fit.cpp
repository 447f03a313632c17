#include <algorithm>
#include <cmath>
#include <cstdint>

#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/texture/solid_fit.h>

namespace surfel {
namespace {

constexpr std::size_t kSolidGrain = 1 << 8;

KernelAxes kernel_axes(const SurfelBasis::Function& f, double variance_u, double variance_v) {
  KernelAxes axes;
  axes << std::sqrt(variance_u) * f.tangent, std::sqrt(variance_v) * f.bitangent;
  return axes;
}

void color_points(const Vec3d& origin, const SolidTexture& texture, PointColors& points) {
  const Quadrature& quadrature = points.quadrature;
  points.color.resize(quadrature.size());
  points.known.assign(quadrature.size(), 1);
  parallel_each(points.basis.size(), kSolidGrain, [&](std::size_t i) {
    const SurfelBasis::Function& f = points.basis.function[i];
    const auto variance = static_cast<double>(quadrature.variance[i]);
    const KernelAxes axes = kernel_axes(f, variance, variance);
    for (std::size_t q = quadrature.begin[i]; q < quadrature.begin[i + 1]; ++q) {
      const Vec2d offset = quadrature.offset[q].cast<double>();
      const Vec3d place = origin + f.position + offset.x() * f.tangent + offset.y() * f.bitangent;
      points.color[q] << texture.filtered(place, axes).cast<double>().array(), 1;
    }
  });
}

std::size_t unusable_surfels(const SurfelBasis& basis, const TextureFitOptions& options) {
  if (!options.part) return basis.unusable;
  const auto usable = std::count_if(basis.surfel.begin(), basis.surfel.end(),
                                    [&](std::uint32_t k) { return options.part->owns(k); });
  return options.part->end - options.part->begin - static_cast<std::size_t>(usable);
}

}  // namespace

void fit_solid_ewa(SurfelCloud& cloud, const SolidTexture& texture, const SurfelBasis& basis,
                   const TextureFitOptions& options, TextureFitReport& report,
                   PointColors* points) {
  StageTimer timer(report.times);
  report.without_kernel = unusable_surfels(basis, options);
  cloud.coefficient.resize(cloud.size());
  if (basis.unusable > 0) {
    parallel_each(cloud.size(), kSolidGrain,
                  [&](std::size_t k) { cloud.coefficient[k] = texture.evaluate(cloud.world(k)); });
  }
  parallel_each(basis.size(), kSolidGrain, [&](std::size_t i) {
    const SurfelBasis::Function& f = basis.function[i];
    cloud.coefficient[basis.surfel[i]] =
        texture.filtered(cloud.origin + f.position, kernel_axes(f, f.variance_u, f.variance_v));
  });
  if (points) color_points(cloud.origin, texture, *points);
  cloud.basis_cutoff.reset();
  timer.end("filter");
}

}  // namespace surfel
