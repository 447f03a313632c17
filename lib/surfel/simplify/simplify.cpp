#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/sample/detail_tree.h>
#include <surfel/simplify/covering_gaussian.h>
#include <surfel/simplify/shown_surface.h>
#include <surfel/simplify/simplify.h>
#include <surfel/solve/conjugate_gradients.h>
#include <surfel/surface/coverage_threshold.h>
#include <surfel/surface/neighbor_search.h>
#include <surfel/texture/render_system.h>

namespace surfel {
namespace {

constexpr std::size_t kGrain = 1 << 12;
/// Distance that seeds keep from each other, in units of the spacing asked for: PoissonDisk says
/// why this gives one a spacing squared.
constexpr double kSeedRadius = 0.82;
/// Change of the spacing by distance. (As in adaptive_spacing.cpp.)
constexpr double kGradient = 0.35;
/// The finest cells of the octrees hold 16 times the square of this many surfels.
constexpr double kFinestSigma = 0.7;
/// Standard deviation of fitted kernels by their spacing.
constexpr double kVarianceScale = 0.5;
/// Surfels at which those that a field makes are counted.
constexpr std::size_t kCountProbes = 50000;
/// An error this close below the one asked for is not improved upon.
constexpr double kCloseEnough = 0.93;
constexpr int kMostRounds = 8;
constexpr int kMostCounts = 12;
/// Counts this close below the one asked for are filled up.
constexpr double kFillShare = 0.96;
/// Most factor of the area of what leaves a place uncovered.
constexpr double kMostWeight = 4;
/// Of the fit: between 0.03 and 0.3 pictures differ by 0.2 dB; this is the best or next to it.
constexpr double kRegularization = 0.1;
constexpr double kTolerance = 1e-4;

/// A simplified cloud.
struct Attempt {
  SheetClusters clusters;
  SurfelCloud cloud;
  SimplifyError error;
  std::size_t uncovered = 0;
};

class Simplifier {
 public:
  Simplifier(const SurfelCloud& cloud, const SimplifyOptions& options, SimplifyReport& report,
             const std::string& name)
      : options_(options), report_(report) {
    take_usable(cloud, name);
  }

  SurfelCloud run() {
    look();
    const DetailTree tree = make_tree();
    Attempt best = options_.count ? with_count(tree) : with_error(tree);
    report_.result = best.cloud.size();
    for (std::size_t c = 0; c < best.clusters.size(); ++c) {
      const std::size_t members = best.clusters.members(c).size();
      if (members > 1) report_.merged += members;
    }
    report_.error = best.error;
    report_.uncovered = best.uncovered;
    return std::move(best.cloud);
  }

 private:
  void stage(const char* done) {
    report_.times.add(done, timer_.milliseconds());
    timer_.restart();
  }
  void tell(double done) const {
    if (options_.progress) options_.progress(done);
  }

  void take_usable(const SurfelCloud& cloud, const std::string& name);
  void look();
  DetailTree make_tree();
  /// The surfels of cloud_ as points on the surfels of a simplified one.
  struct Places {
    SurfelBasis basis;
    Quadrature quadrature;
    Array<std::uint32_t> place;  ///< Of every point, its surfel of cloud_.
  };

  Array<float> radii(const DetailTree& tree, const DetailTree::Cut& cut) const;
  double estimated_count(const SizingField& field) const;
  Attempt with_count(const DetailTree& tree);
  Attempt with_error(const DetailTree& tree);
  Attempt as_it_is() const;

  Attempt attempt(SheetClusters clusters);
  SurfelCloud merge(const SheetClusters& clusters) const;
  void size(const SheetClusters& clusters, SurfelCloud& out) const;
  Places places_on(const Attempt& attempt) const;
  void close_gaps(Places& places, Attempt& attempt) const;
  void fit(Attempt& attempt);
  SimplifyError measure(const ShownSurface& shown) const;

  const SimplifyOptions& options_;
  SimplifyReport& report_;
  Timer timer_;
  SurfelCloud cloud_;  ///< The usable surfels along a Morton curve.
  std::unique_ptr<NeighborSearch> search_;
  double total_area_ = 0;
  Array<float> area_;  ///< Of every surfel: its weight.
  double unit_deviation_ = 0;
  double brightness_ = 0;
  ShownSurface target_;
};

void Simplifier::take_usable(const SurfelCloud& cloud, const std::string& name) {
  Array<std::uint32_t> order = morton_order(cloud.position);
  report_.dropped = remove_unusable(cloud, false, order);
  if (order.empty()) throw_input(name, "holds no surfel that can be drawn");
  cloud_ = cloud.gathered(order);
  report_.surfels = cloud_.size();
  const auto leave_out = [&](auto& column, const char* column_name) {
    if (column.empty()) return;
    column = {};
    report_.left_out.emplace_back(column_name);
  };
  leave_out(cloud_.group, "group");
  leave_out(cloud_.group_radius, "group_radius");
  leave_out(cloud_.source, "source");
  for (Vec3f& n : cloud_.normal) {
    const float length = n.norm();
    if (length > 0 && std::isfinite(length)) {
      n /= length;
    } else {
      n.setZero();
      ++report_.no_normal;
    }
  }
  area_.resize(cloud_.size());
  for (std::size_t i = 0; i < cloud_.size(); ++i) {
    area_[i] = merge_surfel(cloud_, static_cast<std::uint32_t>(i)).area;
    total_area_ += area_[i];
  }
  if (!(total_area_ > 0)) throw_input(name, "the surfels have no area");
  const double diagonal = cloud_.bounds().diagonal();
  unit_deviation_ = options_.unit_deviation.value_or(diagonal > 0 ? diagonal / 30 : 1);
  report_.unit_deviation = unit_deviation_;
  search_ = make_neighbor_search(cloud_.position);
}

/// What the cloud shows at its own surfels: that is to be kept.
void Simplifier::look() {
  timer_.restart();
  const SurfelBasis basis = make_basis(cloud_);
  const Quadrature quadrature = at_functions(basis);
  const EvaluatedBasis evaluated = evaluate_basis(basis, quadrature, options_.cutoff);
  Array<Channels> w(basis.size());
  for (std::size_t i = 0; i < basis.size(); ++i) w[i] = shown_color(cloud_, basis.surfel[i]);
  target_ = shown_surface(cloud_, basis, w, evaluated, basis.surfel);
  double sum = 0;
  for (std::size_t i = 0; i < cloud_.size(); ++i) {
    sum += area_[i] * std::abs(target_.color[i].head<3>().mean());
  }
  brightness_ = sum / total_area_;
  stage("look");
}

DetailTree Simplifier::make_tree() {
  std::vector<SurfaceProbe> probes(cloud_.size());
  const auto weight = static_cast<float>(options_.light * brightness_);
  for (std::size_t i = 0; i < probes.size(); ++i) {
    const auto alpha = static_cast<float>(target_.color[i][3]);
    probes[i] = {cloud_.position[i],
                 cloud_.normal[i],
                 alpha * target_.color[i].head<3>().matrix().cast<float>(),
                 alpha,
                 weight * target_.normal[i],
                 area_[i]};
  }
  const double spacing = std::sqrt(total_area_ / static_cast<double>(probes.size()));
  DetailTree tree(probes, {},
                  {total_area_, kFinestSigma * spacing, unit_deviation_, kVarianceScale, true});
  stage("tree");
  return tree;
}

Array<float> Simplifier::radii(const DetailTree& tree, const DetailTree::Cut& cut) const {
  const SizingField field(cut.cells, kGradient, tree.largest_spacing());
  Array<float> radius(cloud_.size());
  parallel_for(radius.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      radius[i] = static_cast<float>(kSeedRadius * field.at(cloud_.position[i]));
    }
  });
  return radius;
}

/// Surfels that are left where the field has room for them.
double Simplifier::estimated_count(const SizingField& field) const {
  const std::size_t stride = cloud_.size() / kCountProbes + 1;
  const std::size_t n = (cloud_.size() + stride - 1) / stride;
  Array<double> share(n);
  parallel_for(n, 1 << 10, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) {
      const double h = field.at(cloud_.position[i * stride]);
      share[i] = std::min(1.0, area_[i * stride] / (h * h));
    }
  });
  double sum = 0;
  for (const double x : share) sum += x;
  return sum / static_cast<double>(n) * static_cast<double>(cloud_.size());
}

/// Two choices of cells next to each other.
struct Bracket {
  DetailTree::Cut coarse;  ///< At the highest price of all, or not fine enough ...
  DetailTree::Cut fine;    ///< ... where this is, or is at the lowest price of all.
};

template <class Test>
Bracket bracket(const DetailTree& tree, const Test& fine_enough) {
  constexpr double kClose = 0.02;
  double low = std::log(tree.lowest_price());
  double high = std::log(tree.highest_price());
  Bracket out{tree.cut(std::exp(high)), {}};
  if (fine_enough(out.coarse)) return {out.coarse, out.coarse};
  out.fine = tree.cut(std::exp(low));
  while (high - low > kClose) {
    const double middle = (low + high) / 2;
    DetailTree::Cut cut = tree.cut(std::exp(middle));
    if (fine_enough(cut)) {
      low = middle;
      out.fine = std::move(cut);
    } else {
      high = middle;
      out.coarse = std::move(cut);
    }
  }
  return out;
}

Attempt Simplifier::as_it_is() const {
  Attempt all;
  all.cloud = cloud_;
  return all;
}

Attempt Simplifier::with_count(const DetailTree& tree) {
  const std::size_t wanted = *options_.count;
  report_.reached = wanted <= cloud_.size();
  if (wanted >= cloud_.size()) return as_it_is();
  const Bracket cuts = bracket(tree, [&](const DetailTree::Cut& tried) {
    const auto count = static_cast<double>(wanted);
    return estimated_count({tried.cells, kGradient, tree.largest_spacing()}) >= count;
  });
  const Array<float> radius = radii(tree, cuts.coarse);
  stage("choose");
  tell(0.2);
  // Radii that leave room for almost as many as wanted; the rest is filled in.
  const auto scaled = [&](double factor, std::size_t fill_to) {
    Array<float> r(radius.size());
    for (std::size_t i = 0; i < r.size(); ++i) {
      // Where the coarsest cells are too fine, surfels that were to be kept are merged, too.
      r[i] = static_cast<float>(std::max(factor * radius[i], (factor - 1) * std::sqrt(area_[i])));
    }
    return cluster_sheets(cloud_, *search_, r, options_.sheets, options_.seed, fill_to);
  };
  double factor = 1;
  double largest_small = 0;
  double smallest_large = 0;
  for (int i = 0; i < kMostCounts; ++i) {
    const std::size_t found = scaled(factor, 0).size();
    const double ratio = static_cast<double>(found) / static_cast<double>(wanted);
    if (ratio <= 1) {
      if (smallest_large == 0 || factor < smallest_large) smallest_large = factor;
      if (ratio >= kFillShare) break;
    } else {
      largest_small = std::max(largest_small, factor);
    }
    double next = factor * std::sqrt(ratio) * (ratio > 1 ? 1.01 : 1.005);
    const bool inside = next > largest_small && (smallest_large == 0 || next < smallest_large);
    if (!inside && smallest_large > 0) next = (largest_small + smallest_large) / 2;
    factor = next;
  }
  if (smallest_large == 0) smallest_large = factor;
  SheetClusters clusters = scaled(smallest_large, wanted);
  report_.reached = clusters.size() == wanted;
  stage("cluster");
  tell(0.5);
  return attempt(std::move(clusters));
}

Attempt Simplifier::with_error(const DetailTree& tree) {
  const double wanted = *options_.max_error;
  double expected = wanted;
  double largest = kSeedRadius * tree.largest_spacing();
  std::optional<Attempt> best;
  for (int round = 0; round < kMostRounds; ++round) {
    const DetailTree::Cut cut =
        bracket(tree, [&](const DetailTree::Cut& tried) { return tried.error() <= expected; }).fine;
    Array<float> radius = radii(tree, cut);
    const double coarsest = *std::max_element(radius.begin(), radius.end());
    for (float& r : radius) r = std::min(r, static_cast<float>(largest));
    stage("choose");
    SheetClusters clusters =
        cluster_sheets(cloud_, *search_, radius, options_.sheets, options_.seed);
    stage("cluster");
    if (clusters.size() == cloud_.size()) break;
    Attempt tried = attempt(std::move(clusters));
    tell((round + 1.0) / kMostRounds);
    const double error = tried.error.total();
    if (error <= wanted && (!best || tried.cloud.size() < best->cloud.size())) {
      best = std::move(tried);
      if (error >= kCloseEnough * wanted) break;
    }
    const double step =
        std::clamp(error > 0 ? (1 + kCloseEnough) / 2 * wanted / error : 4, 0.25, 4.0);
    if (cut.error() < error / 2) {
      // Cells know nothing of what happens at borders, and where colours change evenly over the
      // whole surface: all surfels are limited instead.
      if (step > 1 && largest >= coarsest) break;
      largest = std::min(largest, coarsest) * step;
    } else {
      expected *= step;
    }
  }
  report_.reached = best.has_value();
  return best ? std::move(*best) : as_it_is();
}

Attempt Simplifier::attempt(SheetClusters clusters) {
  ++report_.rounds;
  Attempt out;
  out.clusters = std::move(clusters);
  out.cloud = merge(out.clusters);
  stage("merge");
  size(out.clusters, out.cloud);
  stage("size");
  fit(out);
  stage("fit");
  return out;
}

/// All but variances and coefficients.
SurfelCloud Simplifier::merge(const SheetClusters& clusters) const {
  Array<MergeSurfel> merged_surfel(clusters.size());
  parallel_for(clusters.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<MergeSurfel> surfels;
    std::vector<std::uint32_t> all;
    for (std::size_t c = begin; c < end; ++c) {
      surfels.clear();
      all.clear();
      for (const std::uint32_t i : clusters.members(c)) {
        all.push_back(static_cast<std::uint32_t>(surfels.size()));
        surfels.push_back(merge_surfel(cloud_, i));
      }
      merged_surfel[c] = merged(surfels, all);
    }
  });
  Array<std::uint32_t> source(clusters.size());
  for (std::size_t c = 0; c < source.size(); ++c) source[c] = merged_surfel[c].source;
  SurfelCloud out = cloud_.gathered(source);
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
    out.position[c] = s.position;
    out.normal[c] = s.normal;
    if (!out.area.empty()) out.area[c] = s.area;
    if (!out.color.empty()) out.color[c] = s.color;
    if (!out.coefficient.empty()) out.coefficient[c] = s.coefficient;
    if (!out.alpha.empty()) out.alpha[c] = s.alpha;
    if (!out.material.empty()) out.material[c] = s.material;
  }
  return out;
}

/// Variances and areas; what was not merged keeps its own. Gaussians are of the kind that the cloud
/// has: ellipses for pieces of even surfaces gain nothing that would be worth the columns. (Cow, 3
/// % and 10 % of its surfels: PSNR within 0.2 dB of discs'.)
void Simplifier::size(const SheetClusters& clusters, SurfelCloud& out) const {
  if (out.area.empty()) out.area.resize(out.size());
  parallel_for(out.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<CoveredPlace> places;
    for (std::size_t k = begin; k < end; ++k) {
      const std::span<const std::uint32_t> members = clusters.members(k);
      if (members.size() == 1) {
        out.area[k] = area_[members[0]];
        continue;
      }
      places.clear();
      for (const std::uint32_t i : members) places.push_back({cloud_.position[i], area_[i]});
      const TangentGaussian g = covering_gaussian(out.position[k], out.normal[k], places,
                                                  out.anisotropic(), options_.cutoff);
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

/// The surfels of cloud_ as points on the surfels that stand for them.
Simplifier::Places Simplifier::places_on(const Attempt& a) const {
  Places out{make_basis(a.cloud), {}, {}};
  Quadrature& quadrature = out.quadrature;
  quadrature.variance.assign(out.basis.size(), 0.0F);
  for (std::size_t k = 0; k < out.basis.size(); ++k) {
    const SurfelBasis::Function& f = out.basis.function[k];
    quadrature.begin.push_back(out.place.size());
    for (const std::uint32_t i : a.clusters.members(out.basis.surfel[k])) {
      const Vec3d d = cloud_.position[i].cast<double>() - f.position;
      quadrature.offset.emplace_back(Vec2d(d.dot(f.tangent), d.dot(f.bitangent)).cast<float>());
      out.place.push_back(i);
    }
  }
  quadrature.begin.push_back(out.place.size());
  return out;
}

/// Gives more weight to what stands for places that were covered and are not any more. (Larger
/// variances would be of no use: the same area is then spread more thinly.)
void Simplifier::close_gaps(Places& places, Attempt& a) const {
  const auto threshold = static_cast<float>(coverage_threshold(options_.cutoff));
  const EvaluatedBasis evaluated = evaluate_basis(places.basis, places.quadrature, options_.cutoff);
  for (std::size_t k = 0; k < places.basis.size(); ++k) {
    float least = threshold;
    for (std::size_t q = places.quadrature.begin[k]; q < places.quadrature.begin[k + 1]; ++q) {
      if (target_.coverage[places.place[q]] < threshold || evaluated.coverage[q] >= threshold) {
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
}

/// Coefficients, and the errors.
void Simplifier::fit(Attempt& a) {
  SurfelCloud& cloud = a.cloud;
  Places places = places_on(a);
  close_gaps(places, a);
  const SurfelBasis& basis = places.basis;
  Array<Channels> w(basis.size());
  for (std::size_t k = 0; k < basis.size(); ++k) w[k] = shown_color(cloud, basis.surfel[k]);
  if (cloud.render_color() == nullptr) {
    const EvaluatedBasis evaluated = evaluate_basis(basis, places.quadrature, options_.cutoff);
    a.error = measure(shown_surface(cloud_, basis, w, evaluated, places.place));
    return;
  }
  Array<Channels> target(places.place.size());
  for (std::size_t q = 0; q < target.size(); ++q) target[q] = target_.color[places.place[q]];
  RenderSystemOptions render;
  render.cutoff = options_.cutoff;
  // What is fitted to is no finer than kernels: there is nothing to minify to (render_system.h).
  render.minified = 0;
  render.regularization = kRegularization;
  const RenderSystem system = assemble_render_system(basis, places.quadrature, render);
  const InverseFactor factor(system.normal_matrix, Preconditioner::kSparseInverse);
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
  cloud.basis_cutoff = options_.cutoff;
  a.error = measure(shown_surface(cloud_, basis, w, system.near, places.place));
}

SimplifyError Simplifier::measure(const ShownSurface& shown) const {
  double color = 0;
  double shading = 0;
  double shape = 0;
  SimplifyError out;
  for (std::size_t i = 0; i < cloud_.size(); ++i) {
    const double weight = area_[i] / total_area_;
    Channels d = shown.color[i] - target_.color[i];
    d.head<3>() *= target_.color[i][3];
    color += weight * d.square().sum() / 3;
    shading +=
        weight * static_cast<double>((shown.normal[i] - target_.normal[i]).squaredNorm()) / 3;
    const double distance = shown.height[i] - target_.height[i];
    shape += weight * distance * distance;
    out.max_distance = std::max(out.max_distance, std::abs(distance));
  }
  out.color = std::sqrt(color);
  out.shading = options_.light * brightness_ * std::sqrt(shading);
  out.shape = std::sqrt(shape) / unit_deviation_;
  return out;
}

}  // namespace

double SimplifyError::total() const {
  return std::sqrt(color * color + shading * shading + shape * shape);
}

std::vector<std::string> SimplifyOptions::problems() const {
  std::vector<std::string> found;
  const auto check = [&](bool ok, const std::string& message) {
    if (!ok) found.push_back(message);
  };
  check(max_error.has_value() != count.has_value(),
        "either max-error or count must be given, and not both");
  check(!max_error || (*max_error > 0 && std::isfinite(*max_error)),
        fmt::format("max-error is {}; it must be positive", max_error.value_or(0)));
  check(!count || *count >= 1, "count is 0; it must be at least 1");
  check(!unit_deviation || (*unit_deviation > 0 && std::isfinite(*unit_deviation)),
        fmt::format("unit-deviation is {}; it must be positive", unit_deviation.value_or(0)));
  check(light >= 0 && light <= 100, fmt::format("light is {}; it must be in 0..100", light));
  check(sheets.normal_angle > 0 && sheets.normal_angle <= 90,
        fmt::format("normal-angle is {}; it must be in (0, 90] degrees", sheets.normal_angle));
  check(sheets.sheet_weight >= 1 && sheets.sheet_weight <= 1000,
        fmt::format("sheet-weight is {}; it must be in 1..1000", sheets.sheet_weight));
  check(cutoff >= 0.1 && cutoff <= 16, fmt::format("cutoff is {}; it must be in 0.1..16", cutoff));
  return found;
}

SurfelCloud simplify_surfels(const SurfelCloud& cloud, const SimplifyOptions& options,
                             SimplifyReport* report, const std::string& name) {
  for (const std::string& problem : options.problems()) throw_usage(problem);
  cloud.check_columns(name);
  if (cloud.empty()) throw_input(name, "holds no surfel");
  if (cloud.normal.empty()) {
    throw_input(name, "the surfels have no normals (nx, ny, nz); run surfel-estimate on it first");
  }
  if (cloud.variance.empty() && !cloud.anisotropic()) {
    throw_input(name,
                "the surfels have no variance (nor radius); make it with surfel-from-mesh or "
                "surfel-estimate");
  }
  SimplifyReport own;
  SimplifyReport& r = report ? *report : own;
  r = {};
  return Simplifier(cloud, options, r, name).run();
}

}  // namespace surfel
