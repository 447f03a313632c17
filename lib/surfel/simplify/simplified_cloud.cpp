#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/simplify/covering_gaussian.h>
#include <surfel/simplify/simplified_cloud.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/surface/coverage_threshold.h>
#include <surfel/texture/render_system.h>

namespace surfel {
namespace {

constexpr std::size_t kMergeGrain = 1 << 12;
/// Largest factor by which close_gaps() raises the area of a surfel. A place that would need more
/// is hardly reached by the surfel's kernel; a higher weight would only drown the neighbours'
/// colours.
constexpr double kMostWeight = 4;
/// Regularization of the fit: the middle of the range 0.03 to 0.3, within which pictures hardly
/// differ (0.2 dB).
constexpr double kRegularization = 0.1;
/// Relative residual of the fit: a quarter of a tenth of a step of 8-bit colours.
constexpr double kTolerance = 1e-4;

/// The clusters' surfels, with all columns except variances and coefficients.
SurfelCloud merge(const OriginalCloud& original, const SheetClusters& clusters) {
  Array<MergeSurfel> merged_surfel(clusters.size());
  parallel_for(clusters.size(), kMergeGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<MergeSurfel> surfels;
    std::vector<std::uint32_t> all;
    for (std::size_t c = begin; c < end; ++c) {
      surfels.clear();
      all.clear();
      for (const std::uint32_t i : clusters.members(c)) {
        all.push_back(static_cast<std::uint32_t>(surfels.size()));
        surfels.push_back(merge_surfel(original.cloud, i));
      }
      merged_surfel[c] = merged(surfels, all);
    }
  });
  Array<std::uint32_t> source(clusters.size());
  for (std::size_t c = 0; c < source.size(); ++c) source[c] = merged_surfel[c].source;
  SurfelCloud out = original.cloud.gathered(source);
  // Merged surfels write their areas below; size() sets the areas of all other surfels.
  if (out.area.empty()) out.area.assign(out.size(), 0.0F);
  for (std::size_t c = 0; c < source.size(); ++c) {
    if (clusters.members(c).size() == 1) continue;
    const MergeSurfel& s = merged_surfel[c];
    if (!out.uv.empty() && !out.dpdu.empty() && !out.dpdv.empty()) {
      // The shift along the surface by its derivatives, least squares.
      Eigen::Matrix<double, 3, 2> D;
      D << out.dpdu[c].cast<double>(), out.dpdv[c].cast<double>();
      const Eigen::Matrix2d normal_matrix = D.transpose() * D;
      const Vec3d shift = (s.position - out.position[c]).cast<double>();
      const Vec2d moved = normal_matrix.inverse() * (D.transpose() * shift);
      if (moved.allFinite()) out.uv[c] += moved.cast<float>();
    }
    write_attributes(out, c, s);
  }
  return out;
}

/// Sets variances and areas; surfels that were not merged keep their own. Gaussians are of the kind
/// that the cloud has: ellipses for pieces of even surfaces gain too little for their columns.
void size(const OriginalCloud& original, const SheetClusters& clusters, double cutoff,
          SurfelCloud& out) {
  parallel_for(out.size(), kMergeGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<CoveredPlace> places;
    for (std::size_t k = begin; k < end; ++k) {
      const std::span<const std::uint32_t> members = clusters.members(k);
      if (members.size() == 1) {
        out.area[k] = original.area[members[0]];
        continue;
      }
      places.clear();
      for (const std::uint32_t i : members)
        places.push_back({original.cloud.position[i], original.area[i]});
      const TangentGaussian g =
          covering_gaussian(out.position[k], out.normal[k], places, out.anisotropic(), cutoff);
      // Coincident surfels without an area keep the size of one of them.
      if (!(g.variance_v > 0)) continue;
      if (out.anisotropic()) {
        out.tangent[k] = g.tangent;
        out.variance_u[k] = g.variance_u;
        out.variance_v[k] = g.variance_v;
      } else {
        out.variance[k] = g.variance_u;
      }
    }
  });
}

/// The original's surfels as points on the surfels that stand for them.
struct Places {
  SurfelBasis basis;  ///< Basis of the simplified cloud.
  Quadrature quadrature;
  Array<std::uint32_t> place;  ///< For each point, its surfel of the original.
};

Places places_on(const OriginalCloud& original, const SimplifiedCloud& a) {
  Places out{make_basis(a.cloud), {}, {}};
  Quadrature& quadrature = out.quadrature;
  quadrature.variance.assign(out.basis.size(), 0.0F);
  for (std::size_t k = 0; k < out.basis.size(); ++k) {
    const SurfelBasis::Function& f = out.basis.function[k];
    quadrature.begin.push_back(out.place.size());
    if (out.basis.surfel[k] >= a.clusters.size()) continue;  // An image stands for no places.
    for (const std::uint32_t i : a.clusters.members(out.basis.surfel[k])) {
      const Vec3d d = original.cloud.position[i].cast<double>() - f.position;
      quadrature.offset.emplace_back(Vec2d(d.dot(f.tangent), d.dot(f.bitangent)).cast<float>());
      out.place.push_back(i);
    }
  }
  quadrature.begin.push_back(out.place.size());
  return out;
}

/// Gives more weight to surfels that stand for places that were covered and are not any more.
/// Larger variances would be of no use: they spread the same area more thinly.
void close_gaps(const OriginalCloud& original, double cutoff, Places& places, SimplifiedCloud& a) {
  const auto threshold = static_cast<float>(coverage_threshold(cutoff));
  const EvaluatedBasis evaluated = evaluate_basis(places.basis, places.quadrature, cutoff);
  for (std::size_t k = 0; k < places.basis.size(); ++k) {
    float least = threshold;
    for (std::size_t q = places.quadrature.begin[k]; q < places.quadrature.begin[k + 1]; ++q) {
      if (original.shown.coverage[places.place[q]] < threshold ||
          evaluated.coverage[q] >= threshold) {
        continue;
      }
      ++a.uncovered;
      least = std::min(least, evaluated.coverage[q]);
    }
    if (least >= threshold) continue;
    const double factor = std::min<double>(kMostWeight, threshold / least);
    places.basis.function[k].area *= factor;
    float& area = a.cloud.area[places.basis.surfel[k]];
    area = static_cast<float>(factor * area);
  }
  for (std::size_t k = 0; k < places.basis.size(); ++k) {
    const std::size_t i = places.basis.surfel[k];
    if (i < a.clusters.size()) continue;
    a.cloud.area[i] = a.cloud.area[a.image_of[i - a.clusters.size()]];
    places.basis.function[k].area = a.cloud.area[i];
  }
}

SimplifyError measure(const OriginalCloud& original, double light, const ShownSurface& shown) {
  double color = 0;
  double shading = 0;
  double shape = 0;
  SimplifyError out;
  for (std::size_t i = 0; i < original.cloud.size(); ++i) {
    const double weight = original.area[i] / original.total_area;
    Channels d = shown.color[i] - original.shown.color[i];
    d.head<3>() *= original.shown.color[i][3];
    color += weight * d.square().sum() / 3;
    shading += weight *
               static_cast<double>((shown.normal[i] - original.shown.normal[i]).squaredNorm()) / 3;
    const double distance = shown.height[i] - original.shown.height[i];
    shape += weight * distance * distance;
    out.max_distance = std::max(out.max_distance, std::abs(distance));
  }
  out.color = std::sqrt(color);
  out.shading = light * original.brightness * std::sqrt(shading);
  out.shape = std::sqrt(shape) / original.unit_deviation;
  return out;
}

/// Fits the coefficients, and measures the errors.
void fit(const OriginalCloud& original, const SimplifyOptions& options, SimplifiedCloud& a) {
  SurfelCloud& cloud = a.cloud;
  Places places = places_on(original, a);
  close_gaps(original, options.cutoff, places, a);
  const SurfelBasis& basis = places.basis;
  Array<Channels> w(basis.size());
  for (std::size_t k = 0; k < basis.size(); ++k) w[k] = shown_color(cloud, basis.surfel[k]);
  if (cloud.render_color() == nullptr) {
    const EvaluatedBasis evaluated = evaluate_basis(basis, places.quadrature, options.cutoff);
    a.error = measure(original, options.light,
                      shown_surface(original.cloud, basis, w, evaluated, places.place));
    return;
  }
  Array<Channels> target(places.place.size());
  for (std::size_t q = 0; q < target.size(); ++q) target[q] = original.shown.color[places.place[q]];
  RenderSystemOptions render;
  render.cutoff = options.cutoff;
  // The target colours are no finer than kernels: nothing is minified (render_system.h).
  render.minified = 0;
  render.regularization = kRegularization;
  const RenderSystem system = assemble_render_system(basis, places.quadrature, render);
  const InverseFactor factor(system.normal_matrix);
  SolveOptions solve;
  solve.tolerance = kTolerance;
  conjugate_gradients(system.normal_matrix, system.right_side(target, w), factor, w, solve);
  if (cloud.coefficient.empty()) cloud.coefficient = cloud.color;
  for (std::size_t k = 0; k < basis.size(); ++k) {
    const std::uint32_t i = basis.surfel[k];
    cloud.coefficient[i] = w[k].head<3>().matrix().cast<float>();
    if (cloud.alpha.empty()) continue;
    w[k][3] = std::clamp(w[k][3], 0.0, 1.0);
    cloud.alpha[i] = static_cast<float>(w[k][3]);
  }
  cloud.basis_cutoff = options.cutoff;
  a.error = measure(original, options.light,
                    shown_surface(original.cloud, basis, w, system.near, places.place));
}

}  // namespace

SimplifiedCloud simplified_cloud(const OriginalCloud& original, SheetClusters clusters,
                                 const SimplifyOptions& options, StageTimes& times) {
  SimplifiedCloud out;
  out.clusters = std::move(clusters);
  StageTimer stage(times);
  out.cloud = merge(original, out.clusters);
  stage.end("merge");
  size(original, out.clusters, options.cutoff, out.cloud);
  end_at_lines(original.edges, original.cloud, out.clusters, options.sheets, out.cloud);
  out.image_of = add_images(original.edges, out.clusters, out.cloud);
  stage.end("size");
  fit(original, options, out);
  stage.end("fit");
  return out;
}

}  // namespace surfel
