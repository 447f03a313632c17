#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <surfel/base/elementary.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/sample/cut_search.h>
#include <surfel/sample/poisson_disk.h>
#include <surfel/scene/clips.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/simplify/simplified_cloud.h>
#include <surfel/simplify/simplify.h>
#include <surfel/simplify/simplify_block.h>
#include <surfel/simplify/simplify_blocks.h>
#include <surfel/surface/neighbor_search.h>
#include <surfel/texture/kernel_overlap.h>
#include <surfel/texture/reach_tree.h>

namespace surfel {
namespace {

constexpr std::size_t kRadiusGrain = 1 << 12;
/// Distance that seeds keep from each other, in units of the spacing asked for: with this one a
/// seed has a spacing squared of surface.
constexpr double kSeedRadius = PoissonDisk::kConflictRadius;
/// Standard deviation of the finest cells' kernels by the surfels' mean spacing: a cell, which is
/// DetailTree::kCellSigmas of them wide, holds about 8 surfels then, few enough to be kept as they
/// are and enough for an affine function of the place.
constexpr double kFinestSigma = 0.7;
/// Standard deviation of fitted kernels by their spacing: a fit sharpens what kernels of the width
/// that covers would blur.
constexpr double kVarianceScale = 0.5;
/// Precision of the logarithm of a cut's price: 1 % of the number of surfels, which the number of
/// clusters differs by anyway.
constexpr double kPricePrecision = 0.02;
/// An error this close below the one asked for is not improved upon.
constexpr double kCloseEnough = 0.93;
/// Most rounds towards an error, and most clusterings towards a count; the best result is taken
/// then. Each round comes closer by a factor of two or more, so that these are bounds, not goals.
constexpr int kMostRounds = 8;
constexpr int kMostCounts = 12;
/// Counts this close below the one asked for are filled up.
constexpr double kFillShare = 0.96;

/// Takes out the columns of half-planes that cut no surfel.
void drop_unused_lines(SurfelCloud& cloud) {
  const auto unused = [](const Array<Vec3f>& direction) {
    return std::all_of(direction.begin(), direction.end(),
                       [](const Vec3f& d) { return d.isZero(0); });
  };
  if (!unused(cloud.clip2)) return;
  cloud.clip2 = {};
  cloud.clip2_distance = {};
  if (!unused(cloud.clip1)) return;
  cloud.clip1 = {};
  cloud.clip1_distance = {};
}

class Simplifier {
 public:
  /// \param whole  null unless the cloud is a block of it
  Simplifier(const SurfelCloud& cloud, const SimplifyOptions& options, SimplifyReport& report,
             const std::string& name, const SimplifiedWhole* whole = nullptr)
      : options_(options), report_(report), of_(whole) {
    take_usable(cloud, name);
  }

  SurfelCloud run(const std::string& name) {
    look(name);
    const DetailTree tree = make_tree();
    SimplifiedCloud best = options_.count ? with_count(tree) : with_error(tree);
    report_.mirrored = best.image_of.size();
    report_.result = best.cloud.size() - report_.mirrored;
    if (!of_) drop_unused_lines(best.cloud);
    for (std::size_t c = 0; c < best.clusters.size(); ++c) {
      const std::size_t members = best.clusters.members(c).size();
      if (members > 1) report_.merged += members;
    }
    report_.error = best.error;
    report_.uncovered = best.uncovered;
    return std::move(best.cloud);
  }

  BlockDetail detail(const std::string& name) {
    look(name);
    const DetailTree tree = make_tree();
    BlockDetail out{original_.cloud.size(), original_.total_area, {}, {}};
    // A tree's price is of the squared error of its own surface.
    const double to_own = of_->total_area / original_.total_area;
    const std::vector<double> prices = compared_prices();
    for (const double price : prices) {
      const double own = price * to_own;
      const bool all_kept =
          !out.samples.empty() && out.samples.back() >= static_cast<double>(out.surfels);
      if (all_kept || (own > tree.highest_price() && !out.samples.empty())) {
        // Prices beyond those that tell choices apart change nothing.
        out.samples.push_back(out.samples.back());
        out.error2.push_back(out.error2.back());
      } else {
        const DetailTree::Cut cut = tree.cut(own);
        out.samples.push_back(cut.samples);
        out.error2.push_back(cut.error() * cut.error());
      }
    }
    return out;
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
  void separate_images();
  void look(const std::string& name);
  DetailTree make_tree();
  Array<float> radii(const DetailTree& tree, const DetailTree::Cut& cut) const;
  double estimated_count(const SizingField& field) const;
  SimplifiedCloud with_count(const DetailTree& tree);
  SimplifiedCloud with_error(const DetailTree& tree);
  SimplifiedCloud as_it_is() const;

  SimplifiedCloud attempt(SheetClusters clusters);

  const SimplifyOptions& options_;
  SimplifyReport& report_;
  const SimplifiedWhole* of_;
  Timer timer_;
  OriginalCloud original_;
  SurfelCloud whole_;  ///< The original and its mirror images; empty where it has none.
  std::unique_ptr<NeighborSearch> search_;  ///< Over the original's positions.
};

void Simplifier::take_usable(const SurfelCloud& cloud, const std::string& name) {
  Array<std::uint32_t> order = morton_order(cloud.position);
  report_.dropped = remove_unusable(cloud, false, order);
  const auto images = std::stable_partition(order.begin(), order.end(),
                                            [&](std::uint32_t i) { return !is_cut_off(cloud, i); });
  report_.surfels = static_cast<std::size_t>(images - order.begin());
  if (report_.surfels == 0) throw_input(name, "holds no surfel that can be drawn");
  original_.cloud = cloud.gathered(order);
  SurfelCloud& kept = original_.cloud;
  const auto leave_out = [&](auto& column, const char* column_name) {
    if (column.empty()) return;
    column = {};
    report_.left_out.emplace_back(column_name);
  };
  leave_out(kept.group, "group");
  leave_out(kept.group_radius, "group_radius");
  leave_out(kept.source, "source");
  for (Vec3f& n : kept.normal) {
    const float length = n.norm();
    if (length > 0 && std::isfinite(length)) {
      n /= length;
    } else {
      n.setZero();
      ++report_.no_normal;
    }
  }
  separate_images();
  original_.area.resize(kept.size());
  for (std::size_t i = 0; i < kept.size(); ++i) {
    original_.area[i] = merge_surfel(kept, static_cast<std::uint32_t>(i)).area;
    original_.total_area += original_.area[i];
  }
  if (!(original_.total_area > 0)) throw_input(name, "the surfels have no area");
  const double diagonal = kept.bounds().diagonal();
  original_.unit_deviation = options_.unit_deviation.value_or(diagonal > 0 ? diagonal / 30 : 1);
  report_.unit_deviation = original_.unit_deviation;
  search_ = make_neighbor_search(kept.position);
}

/// Takes the mirror images, which are last, out of the original.
void Simplifier::separate_images() {
  SurfelCloud& kept = original_.cloud;
  if (kept.clip1.empty() && kept.clip2.empty()) return;
  const auto add = [&](Array<Vec3f>& direction, Array<float>& distance) {
    if (!direction.empty()) return;
    direction.assign(kept.size(), Vec3f(0, 0, 0));
    distance.assign(kept.size(), 0.0F);
  };
  // Merged surfels may end at two lines where each member ends at one.
  add(kept.clip1, kept.clip1_distance);
  add(kept.clip2, kept.clip2_distance);
  SurfelCloud images;
  if (report_.surfels < kept.size()) {
    whole_ = std::move(kept);
    Array<std::uint32_t> order(whole_.size());
    std::iota(order.begin(), order.end(), 0U);
    const auto middle = order.begin() + static_cast<std::ptrdiff_t>(report_.surfels);
    kept = whole_.gathered({order.begin(), middle});
    images = whole_.gathered({middle, order.end()});
  }
  original_.edges = find_edges(kept, std::move(images));
}

/// Finds the look of the cloud at its own surfels, which is to be kept.
void Simplifier::look(const std::string& name) {
  timer_.restart();
  // Mirror images take part in the look, and are no places of the surface.
  const SurfelCloud& whole = whole_.empty() ? original_.cloud : whole_;
  const SurfelBasis basis = make_basis(whole);
  require_bounded_overlap(basis, kPlanarReach2 * options_.cutoff, name);
  const Quadrature quadrature = at_functions(basis);
  const EvaluatedBasis evaluated = evaluate_basis(basis, quadrature, options_.cutoff);
  Array<Channels> w(basis.size());
  for (std::size_t i = 0; i < basis.size(); ++i) w[i] = shown_color(whole, basis.surfel[i]);
  original_.shown = shown_surface(whole, basis, w, evaluated, basis.surfel);
  original_.shown.resize(original_.cloud.size());
  double sum = 0;
  for (std::size_t i = 0; i < original_.cloud.size(); ++i) {
    sum += original_.area[i] * std::abs(original_.shown.color[i].head<3>().mean());
  }
  original_.brightness = of_ ? of_->brightness : sum / original_.total_area;
  stage("look");
}

DetailTree Simplifier::make_tree() {
  std::vector<SurfaceProbe> probes(original_.cloud.size());
  const auto weight = static_cast<float>(options_.light * original_.brightness);
  for (std::size_t i = 0; i < probes.size(); ++i) {
    const auto alpha = static_cast<float>(original_.shown.color[i][3]);
    probes[i] = {original_.cloud.position[i],
                 original_.cloud.normal[i],
                 alpha * original_.shown.color[i].head<3>().matrix().cast<float>(),
                 alpha,
                 weight * original_.shown.normal[i],
                 original_.area[i]};
  }
  const double spacing = std::sqrt(original_.total_area / static_cast<double>(probes.size()));
  DetailTree tree(probes, {},
                  {original_.total_area, kFinestSigma * spacing, original_.unit_deviation,
                   kVarianceScale, true});
  stage("tree");
  return tree;
}

Array<float> Simplifier::radii(const DetailTree& tree, const DetailTree::Cut& cut) const {
  const SizingField field = tree.field(cut);
  Array<float> radius(original_.cloud.size());
  parallel_each(radius.size(), kRadiusGrain, [&](std::size_t i) {
    radius[i] = static_cast<float>(kSeedRadius * field.at(original_.cloud.position[i]));
  });
  return radius;
}

/// Surfels that are left where the field has room for them.
double Simplifier::estimated_count(const SizingField& field) const {
  const double share = mean_of_probes(original_.cloud.size(), [&](std::size_t i) {
    const double h = field.at(original_.cloud.position[i]);
    return std::min(1.0, original_.area[i] / (h * h));
  });
  return share * static_cast<double>(original_.cloud.size());
}

SimplifiedCloud Simplifier::as_it_is() const {
  SimplifiedCloud all;
  all.cloud = whole_.empty() ? original_.cloud : whole_;
  all.image_of = original_.edges.image_of;
  if (!of_) return all;
  // The columns that blocks get which are merged.
  if (all.cloud.area.empty()) {
    all.cloud.area = original_.area;
    for (const std::uint32_t i : all.image_of) all.cloud.area.push_back(original_.area[i]);
  }
  if (all.cloud.render_color() != nullptr) {
    if (all.cloud.coefficient.empty()) all.cloud.coefficient = all.cloud.color;
    all.cloud.basis_cutoff = options_.cutoff;
  }
  return all;
}

SimplifiedCloud Simplifier::with_count(const DetailTree& tree) {
  const std::size_t wanted = *options_.count;
  report_.reached = wanted <= original_.cloud.size();
  if (wanted >= original_.cloud.size()) return as_it_is();
  const auto fine_enough = [&](const DetailTree::Cut& tried) {
    return estimated_count(tree.field(tried)) >= static_cast<double>(wanted);
  };
  const Array<float> radius = radii(tree, bracket_cuts(tree, kPricePrecision, fine_enough).coarse);
  stage("choose");
  tell(0.2);
  // Radii that leave room for almost as many as wanted; the rest is filled in.
  const auto scaled = [&](double factor, std::size_t fill_to) {
    Array<float> r(radius.size());
    for (std::size_t i = 0; i < r.size(); ++i) {
      // Where the coarsest cells are too fine, surfels that were to be kept are merged, too.
      r[i] = static_cast<float>(
          std::max(factor * radius[i], (factor - 1) * std::sqrt(original_.area[i])));
    }
    return cluster_sheets(original_.cloud, *search_, r, options_.sheets, options_.seed, fill_to,
                          original_.edges.surfel);
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

SimplifiedCloud Simplifier::with_error(const DetailTree& tree) {
  const double wanted = *options_.max_error;
  double expected = wanted;
  double largest = kSeedRadius * tree.largest_spacing();
  std::optional<SimplifiedCloud> best;
  for (int round = 0; round < kMostRounds; ++round) {
    const auto fine_enough = [&](const DetailTree::Cut& tried) {
      return tried.error() <= expected;
    };
    const DetailTree::Cut cut = bracket_cuts(tree, kPricePrecision, fine_enough).fine;
    Array<float> radius = radii(tree, cut);
    const double coarsest = *std::max_element(radius.begin(), radius.end());
    for (float& r : radius) r = std::min(r, static_cast<float>(largest));
    stage("choose");
    SheetClusters clusters = cluster_sheets(original_.cloud, *search_, radius, options_.sheets,
                                            options_.seed, 0, original_.edges.surfel);
    stage("cluster");
    if (clusters.size() == original_.cloud.size()) break;
    SimplifiedCloud tried = attempt(std::move(clusters));
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

SimplifiedCloud Simplifier::attempt(SheetClusters clusters) {
  ++report_.rounds;
  SimplifiedCloud made = simplified_cloud(original_, std::move(clusters), options_, report_.times);
  timer_.restart();
  return made;
}

/// Gathers blocks in memory.
class SimplifiedBlocks final : public SurfelSink {
 public:
  void begin(const SurfelCloud& /*like*/, std::size_t /*count*/) override { blocks_.clear(); }
  void put(SurfelCloud surfels, std::size_t /*at*/) override {
    blocks_.push_back(std::move(surfels));
  }
  SurfelCloud join() const {
    std::size_t surfels = 0;
    for (const SurfelCloud& block : blocks_) surfels += block.size();
    SurfelCloud out = cloud_of_rows(blocks_.front(), surfels);
    std::size_t at = 0;
    for (const SurfelCloud& block : blocks_) {
      copy_rows(block, 0, block.size(), out, at);
      at += block.size();
    }
    return out;
  }

 private:
  std::vector<SurfelCloud> blocks_;
};

}  // namespace

double SimplifyError::total() const {
  return std::sqrt(color * color + shading * shading + shape * shape);
}

std::vector<std::string> SimplifyOptions::problems() const {
  std::vector<std::string> found = sheets.problems();
  if (max_error.has_value() == count.has_value()) {
    found.emplace_back("either `max_error` or `count` must be given, and not both");
  }
  if (max_error) check_positive(found, "max_error", *max_error);
  if (count) check_option(found, *count >= 1, "count", *count, "at least 1");
  if (unit_deviation) check_positive(found, "unit_deviation", *unit_deviation);
  check_option(found, light >= 0 && light <= 100, "light", light, "in 0..100");
  check_option(found, cutoff >= 0.1 && cutoff <= 16, "cutoff", cutoff, "in 0.1..16");
  return found;
}

void require_simplifiable(const SurfelCloud& cloud, const std::string& name) {
  cloud.check_columns(name);
  if (cloud.empty()) throw_input(name, "holds no surfel");
  if (cloud.normal.empty()) {
    throw_input(name, "the surfels have no normals (nx, ny, nz); run surfel-estimate on it first");
  }
  if (!has_variance(cloud)) {
    throw_input(name,
                "the surfels have no variance (nor radius); make it with surfel-from-mesh or "
                "surfel-estimate");
  }
}

std::vector<double> compared_prices() {
  constexpr double kHighest = 6;  // Natural logarithms: of 400, and of 1e-20.
  constexpr double kLowest = -46;
  constexpr double kStep = 0.5;
  std::vector<double> prices;
  for (double price = kHighest; price >= kLowest; price -= kStep) {
    prices.push_back(portable::exp(price));
  }
  return prices;
}

BlockDetail block_detail(const SurfelCloud& block, const SimplifyOptions& options,
                         const SimplifiedWhole& whole, const std::string& name) {
  SimplifyReport unused;
  return Simplifier(block, options, unused, name, &whole).detail(name);
}

SurfelCloud simplify_block(const SurfelCloud& block, const SimplifyOptions& options,
                           const SimplifiedWhole& whole, SimplifyReport& report,
                           const std::string& name) {
  return Simplifier(block, options, report, name, &whole).run(name);
}

SurfelCloud simplify_surfels(const SurfelCloud& cloud, const SimplifyOptions& options,
                             SimplifyReport* report, const std::string& name) {
  require_usable(options);
  require_simplifiable(cloud, name);
  SimplifyReport own;
  SimplifyReport& r = report ? *report : own;
  r = {};
  if (cloud.size() <= kMostAtOnce) return Simplifier(cloud, options, r, name).run(name);
  SimplifiedBlocks blocks;
  simplify_by_blocks(OrderedCloud(cloud), options, blocks, &r, name);
  return blocks.join();
}

}  // namespace surfel
