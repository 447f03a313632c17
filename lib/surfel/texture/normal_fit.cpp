#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/texture/ewa_fit.h>
#include <surfel/texture/normal_fit.h>

namespace surfel {
namespace {

constexpr std::size_t kNormalGrain = 1 << 12;

/// Means of a set's values under the surfels' kernels: ewa's coefficients, which the cloud keeps as
/// they were. The variance of the normals that a mean's length tells is the variance under the
/// whole kernel, so that `prefilter` does not count.
Array<Vec3f> kernel_means(SurfelCloud& cloud, TextureSet& set, TextureFitOptions options) {
  options.prefilter = 1;
  Array<Vec3f> coefficient = std::exchange(cloud.coefficient, {});
  const std::optional<double> basis_cutoff = cloud.basis_cutoff;
  TextureFitReport unused;
  fit_ewa(cloud, set, options, unused);
  cloud.coefficient.swap(coefficient);
  cloud.basis_cutoff = basis_cutoff;
  return coefficient;
}

HeightSlopes slopes_of(const Vec3f& first, const Vec3f& second) {
  const Vec3d a = first.cast<double>();
  const Vec3d b = second.cast<double>();
  HeightSlopes out;
  out.mean = a.head<2>();
  out.covariance << a.z(), b.y(), b.y(), b.x();
  out.covariance -= out.mean * out.mean.transpose();
  return out;
}

/// Sums of the figures of some surfels.
struct NormalSums {
  std::size_t mapped = 0, unmapped = 0, without_frame = 0;
  double tilt = 0, variance = 0;

  void add(const NormalSums& other) {
    mapped += other.mapped;
    unmapped += other.unmapped;
    without_frame += other.without_frame;
    tilt += other.tilt;
    variance += other.variance;
  }
};

}  // namespace

NormalFitReport fit_normals(SurfelCloud& cloud, NormalMaps& maps, const TextureFitOptions& options,
                            const std::string& name) {
  require_usable(options);
  check_textured(cloud, maps.first, name);
  if (!cloud.empty() && cloud.normal.empty()) {
    throw_input(name, "the surfels have no normals; sample them with surfel-from-mesh");
  }
  NormalFitReport report;
  StageTimer timer(report.times);
  const Array<Vec3f> first = kernel_means(cloud, maps.first, options);
  const bool heights =
      std::find(maps.kind.begin(), maps.kind.end(), ReliefKind::kHeights) != maps.kind.end();
  Array<Vec3f> second;
  if (heights) {
    maps.second.charts = std::exchange(maps.first.charts, std::nullopt);
    second = kernel_means(cloud, maps.second, options);
    maps.first.charts = std::exchange(maps.second.charts, std::nullopt);
  }
  timer.end("filter");

  const Array<Vec3f> smooth = std::exchange(cloud.shading_normal, {});
  const auto smooth_normal = [&](std::size_t k) {
    const bool bent = !smooth.empty() && !smooth[k].isZero();
    return bent ? Vec3f(smooth[k].normalized()) : cloud.normal[k];
  };
  const auto mean_normal = [&](std::size_t k, std::size_t map) -> std::optional<Vec3d> {
    const ReliefBase base{smooth_normal(k).cast<double>(), cloud.dpdu[k].cast<double>(),
                          cloud.dpdv[k].cast<double>()};
    if (!cloud.uv[k].allFinite() || base.normal.isZero()) return std::nullopt;
    if (maps.kind[map] == ReliefKind::kNormals) {
      return normal_in_scene(base, first[k].cast<double>());
    }
    const TextureMap& image = maps.first.maps[map];
    return raised_normal(base, slopes_of(first[k], second[k]), image.width(), image.height());
  };
  cloud.shading_normal = smooth;
  cloud.shading_normal.resize(cloud.size(), Vec3f(0, 0, 0));
  std::vector<NormalSums> partial(cloud.size() / kNormalGrain + 1);
  parallel_for(cloud.size(), kNormalGrain, [&](std::size_t begin, std::size_t end, int) {
    NormalSums& sums = partial[begin / kNormalGrain];
    for (std::size_t k = begin; k < end; ++k) {
      const std::size_t map = maps.first.map_index(cloud, k);
      if (maps.kind[map] == ReliefKind::kNone) {
        ++sums.unmapped;
        continue;
      }
      const std::optional<Vec3d> mean = mean_normal(k, map);
      const double length = mean ? mean->norm() : 0;
      if (!(length > 0) || !std::isfinite(length)) {
        ++sums.without_frame;
        continue;
      }
      cloud.shading_normal[k] = (*mean / std::max(1.0, length)).cast<float>();
      ++sums.mapped;
      const double cosine = mean->dot(smooth_normal(k).cast<double>()) / length;
      sums.tilt += portable::acos(std::clamp(cosine, -1.0, 1.0));
      sums.variance -= portable::log(std::min(1.0, length));
    }
  });
  NormalSums all;
  for (const NormalSums& sums : partial) all.add(sums);
  if (all.mapped == 0) cloud.shading_normal = smooth;
  report.mapped = all.mapped;
  report.unmapped = all.unmapped;
  report.without_frame = all.without_frame;
  if (all.mapped > 0) {
    report.mean_tilt = all.tilt / static_cast<double>(all.mapped);
    report.mean_variance = all.variance / static_cast<double>(all.mapped);
  }
  timer.end("normals");
  return report;
}

}  // namespace surfel
