#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/base/shell_quote.h>
#include <surfel/measure/cloud_needs.h>
#include <surfel/measure/rank_selection.h>
#include <surfel/scene/surfel_variance.h>

namespace surfel {
namespace {

/// Share of the surfels up to which unknown normals and see-through surfels count as none.
constexpr double kFew = 1e-3;
/// Share of coincident surfels from which on merging them is worth a command.
constexpr double kManyCoincident = 0.01;
/// Share of ellipses that are not round up to which they are exceptions.
constexpr double kFewEllipses = 0.01;
/// Cutoffs that are tried where there are holes.
constexpr double kCutoffs[] = {1, 1.5, 2, 3, 4};

class Needs {
 public:
  Needs(const MeasuredFacts& facts, const CloudStatistics& statistics,
        const CloudStatisticsOptions& options, const std::string& file,
        FunctionRef<double(const CloudStatisticsOptions& options)> holes)
      : facts_(facts), s_(statistics), options_(options), file_(shell_file(file)), holes_(holes) {}

  std::vector<CloudNeed> find() {
    flaws();
    columns();
    coverage();
    areas();
    ellipses();
    drawing();
    return std::move(found_);
  }

 private:
  void add(const char* topic, std::string measure, std::string command) {
    found_.push_back({topic, std::move(measure), std::move(command)});
  }
  std::string estimate() const { return fmt::format("surfel-estimate {} -o OUT", file_); }
  double share(std::size_t surfels) const {
    return s_.count > 0 ? static_cast<double>(surfels) / static_cast<double>(s_.count) : 0;
  }

  void flaws() {
    const std::size_t unusable =
        s_.nonfinite_positions + s_.nonfinite_normals + s_.nonfinite_values + s_.negative_variances;
    if (unusable > 0) {
      add("flaws",
          fmt::format("{} values of positions, normals, variances or colours are not usable: such "
                      "surfels are not drawn",
                      unusable),
          estimate());
    }
    if (s_.coincident_share >= kManyCoincident) {
      add("coincident",
          fmt::format("{:.2g} % of the surfels are at the place of another",
                      100 * s_.coincident_share),
          fmt::format("surfel-simplify {} --max-error 0.01 -o OUT", file_));
    }
  }

  void columns() {
    if (!facts_.normals) {
      add("normals", "none: surfels look at the eye, and are not shaded", estimate());
    } else if (share(s_.zero_normals) > kFew) {
      add("normals", fmt::format("{:.2g} % are unknown", 100 * share(s_.zero_normals)), estimate());
    }
    if (!facts_.variances) {
      add("variance", "none: surfels have no size, and cannot be drawn", estimate());
    }
    if (facts_.render_colors) return;
    if (facts_.uv) {
      add("colors", "none, but u, v: drawn in light grey until an image is put on",
          fmt::format("surfel-texture {} --image IMAGE -o OUT", file_));
    } else if (!facts_.colors) {
      add("colors", "none: drawn in light grey",
          fmt::format("surfel-texture {} --mesh MESH --image IMAGE -o OUT", file_));
    }
  }

  double holes_at(double cutoff) const {
    CloudStatisticsOptions at = options_;
    at.cutoff = cutoff;
    // Whether a hundredth is open needs fewer cells than how much is.
    at.samples = std::max<std::size_t>(1, at.samples / 4);
    return holes_(at);
  }

  void coverage() {
    if (!s_.coverage) return;
    const Coverage& c = *s_.coverage;
    if (c.hole_share > kFewHoles) {
      const std::string measure =
          fmt::format("{:.2g} % of the surface is under no disc at cutoff {:g}", 100 * c.hole_share,
                      options_.cutoff);
      // Larger cutoffs leave fewer holes: the least that leaves few is found by halving.
      const double* low =
          std::upper_bound(std::begin(kCutoffs), std::end(kCutoffs), options_.cutoff);
      const double* high = std::end(kCutoffs);
      double left = 0;
      while (low < high) {
        const double* middle = low + (high - low - 1) / 2;
        const double holes = holes_at(*middle);
        if (holes > kFewHoles) {
          low = middle + 1;
        } else {
          high = middle;
          left = holes;
        }
      }
      if (high == std::end(kCutoffs)) {
        add("holes", measure, estimate());
      } else {
        add("holes", fmt::format("{}, {:.2g} % at {:g}", measure, 100 * left, *high),
            fmt::format("surfel-render {} --cutoff {:g}, or {}", file_, *high, estimate()));
      }
    } else if (c.overlap > kMuchOverlap) {
      add("overlap",
          fmt::format("{:.2g} discs over a point at cutoff {:g}, where 2 to 3 close a surface: "
                      "blurred and slow",
                      c.overlap, options_.cutoff),
          estimate());
    }
  }

  void areas() {
    if (!s_.coverage || !facts_.area_mean) return;
    const double factor = *facts_.area_mean / s_.coverage->cell_area_mean;
    if (!std::isfinite(factor) || (factor < kAreaFactor && factor > 1 / kAreaFactor)) return;
    add("area",
        fmt::format("{:.3g} times that of the surfels' cells: so is the sum of kernels, which "
                    "should be about one",
                    factor),
        estimate());
  }

  /// Would discs of the same area do?
  void ellipses() {
    const auto most = kFewEllipses * static_cast<double>(facts_.ellipses);
    if (facts_.ellipses == 0 || static_cast<double>(facts_.long_ellipses) > most) return;
    add("anisotropy",
        fmt::format("not needed: half axes are within {:.2g} % of a disc's for 95 % of the "
                    "surfels, {:.2g} % for the longest",
                    100 * facts_.ellipse_percentile_95, 100 * facts_.ellipse_most),
        fmt::format("surfel-estimate {} --anisotropy off -o OUT", file_));
  }

  void drawing() {
    if (facts_.basis_cutoff && *facts_.basis_cutoff != options_.cutoff) {
      add("cutoff", fmt::format("coefficients were fitted for {:g}", *facts_.basis_cutoff),
          fmt::format("surfel-render {} --cutoff {:g}", file_, *facts_.basis_cutoff));
    }
    if (share(facts_.see_through) > kFew) {
      add("layers",
          fmt::format("{:.2g} % of the surfels are see-through: surfaces behind each other need a "
                      "layer each",
                      100 * share(facts_.see_through)),
          fmt::format("surfel-render {} --layers 8", file_));
    }
    const double per_pixel = static_cast<double>(s_.count) / kPicturePixels;
    if (per_pixel > 1 && facts_.coarser_skipped == 0 && facts_.variances) {
      add("lod",
          fmt::format("{:.2g} surfels a pixel of 512x512, and one level of detail", per_pixel),
          fmt::format("surfel-lod {} -o OUT", file_));
    }
  }

  const MeasuredFacts& facts_;
  const CloudStatistics& s_;
  const CloudStatisticsOptions& options_;
  const std::string file_;  ///< As a word for a shell.
  FunctionRef<double(const CloudStatisticsOptions& options)> holes_;
  std::vector<CloudNeed> found_;
};

/// How far the half axes of an ellipse are from the disc's of the same area, relative; NaN where it
/// is none.
double elongation(const SurfelCloud& cloud, std::size_t i) {
  const double u = cloud.variance_u[i];
  const double v = cloud.variance_v[i];
  if (!(u > 0 && v > 0)) return std::nan("");
  // Half axes are as the roots of the variances; the disc's is their geometric mean.
  const double off = portable::pow(std::max(u, v) / std::min(u, v), 0.25) - 1;
  return std::isfinite(off) ? off : std::nan("");
}

}  // namespace

struct CloudFactCounter::Impl {
  MeasuredFacts facts;
  std::size_t surfels = 0;
  double area = 0;
  bool areas = false;
  bool chosen = false;
  RankSelection elongations;
};

CloudFactCounter::CloudFactCounter() : impl_(std::make_unique<Impl>()) {}
CloudFactCounter::~CloudFactCounter() = default;

void CloudFactCounter::add(const SurfelCloud& piece) {
  MeasuredFacts& facts = impl_->facts;
  facts.normals = !piece.normal.empty();
  facts.variances = has_variance(piece);
  facts.render_colors = piece.render_color() != nullptr;
  facts.colors = !piece.color.empty();
  facts.uv = !piece.uv.empty();
  facts.basis_cutoff = piece.basis_cutoff;
  facts.coarser_skipped = piece.coarser_skipped;
  impl_->surfels += piece.size();
  impl_->areas = !piece.area.empty();
  for (const float area : piece.area) impl_->area += area;
  facts.see_through += static_cast<std::size_t>(
      std::count_if(piece.alpha.begin(), piece.alpha.end(), [](float a) { return a < 0.99F; }));
  if (!piece.anisotropic()) return;
  for (std::size_t i = 0; i < piece.size(); ++i) {
    const double off = elongation(piece, i);
    if (std::isnan(off)) continue;
    facts.ellipse_most = std::max(facts.ellipse_most, static_cast<float>(off));
    facts.long_ellipses += off > kRound ? 1 : 0;
    impl_->elongations.count(static_cast<float>(off));
  }
}

void CloudFactCounter::look(const SurfelCloud& piece) {
  if (impl_->elongations.size() == 0) return;
  if (!impl_->chosen) impl_->elongations.choose({rank_of(0.95, impl_->elongations.size())});
  impl_->chosen = true;
  for (std::size_t i = 0; i < piece.size(); ++i) {
    const double off = elongation(piece, i);
    if (!std::isnan(off)) impl_->elongations.look(static_cast<float>(off));
  }
}

MeasuredFacts CloudFactCounter::facts() {
  MeasuredFacts out = impl_->facts;
  if (impl_->areas) out.area_mean = impl_->area / static_cast<double>(impl_->surfels);
  out.ellipses = impl_->elongations.size();
  if (out.ellipses > 0) out.ellipse_percentile_95 = impl_->elongations.value(0);
  return out;
}

std::vector<CloudNeed> cloud_needs(
    const MeasuredFacts& facts, const CloudStatistics& statistics,
    const CloudStatisticsOptions& options, const std::string& file,
    FunctionRef<double(const CloudStatisticsOptions& options)> holes) {
  require_usable(options);
  return Needs(facts, statistics, options, file, holes).find();
}

std::vector<CloudNeed> cloud_needs(const SurfelCloud& cloud, const CloudStatistics& statistics,
                                   const CloudStatisticsOptions& options, const std::string& file) {
  CloudFactCounter counter;
  counter.add(cloud);
  counter.look(cloud);
  return cloud_needs(counter.facts(), statistics, options, file,
                     [&](const CloudStatisticsOptions& at) {
                       const CloudStatistics s = cloud_statistics(cloud, at);
                       return s.coverage ? s.coverage->hole_share : 1;
                     });
}

}  // namespace surfel
