#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <surfel/base/elementary.h>
#include <surfel/base/option_check.h>
#include <surfel/base/shell_quote.h>
#include <surfel/measure/cloud_needs.h>
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
  Needs(const SurfelCloud& cloud, const CloudStatistics& statistics,
        const CloudStatisticsOptions& options, const std::string& file)
      : cloud_(cloud), s_(statistics), options_(options), file_(shell_file(file)) {}

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
    if (cloud_.normal.empty()) {
      add("normals", "none: surfels look at the eye, and are not shaded", estimate());
    } else if (share(s_.zero_normals) > kFew) {
      add("normals", fmt::format("{:.2g} % are unknown", 100 * share(s_.zero_normals)), estimate());
    }
    if (!has_variance(cloud_)) {
      add("variance", "none: surfels have no size, and cannot be drawn", estimate());
    }
    if (cloud_.render_color() != nullptr) return;
    if (!cloud_.uv.empty()) {
      add("colors", "none, but u, v: drawn in light grey until an image is put on",
          fmt::format("surfel-texture {} --image IMAGE -o OUT", file_));
    } else if (cloud_.color.empty()) {
      add("colors", "none: drawn in light grey",
          fmt::format("surfel-texture {} --mesh MESH --image IMAGE -o OUT", file_));
    }
  }

  double holes_at(double cutoff) const {
    CloudStatisticsOptions at = options_;
    at.cutoff = cutoff;
    // Whether a hundredth is open needs fewer cells than how much is.
    at.samples = std::max<std::size_t>(1, at.samples / 4);
    const CloudStatistics s = cloud_statistics(cloud_, at);
    return s.coverage ? s.coverage->hole_share : 1;
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
    if (!s_.coverage || cloud_.area.empty()) return;
    double sum = 0;
    for (const float area : cloud_.area) sum += area;
    const double mean = sum / static_cast<double>(cloud_.size());
    const double factor = mean / s_.coverage->cell_area_mean;
    if (!std::isfinite(factor) || (factor < kAreaFactor && factor > 1 / kAreaFactor)) return;
    add("area",
        fmt::format("{:.3g} times that of the surfels' cells: so is the sum of kernels, which "
                    "should be about one",
                    factor),
        estimate());
  }

  /// Would discs of the same area do?
  void ellipses() {
    if (!cloud_.anisotropic() || cloud_.empty()) return;
    std::vector<double> error;
    std::size_t long_ones = 0;
    for (std::size_t i = 0; i < cloud_.size(); ++i) {
      const double u = cloud_.variance_u[i];
      const double v = cloud_.variance_v[i];
      if (!(u > 0 && v > 0)) continue;
      // Half axes are as the roots of the variances; the disc's is their geometric mean.
      const double off = portable::pow(std::max(u, v) / std::min(u, v), 0.25) - 1;
      if (!std::isfinite(off)) continue;
      error.push_back(off);
      long_ones += off > kRound ? 1 : 0;
    }
    if (error.empty() ||
        static_cast<double>(long_ones) > kFewEllipses * static_cast<double>(error.size())) {
      return;
    }
    const Distribution d = distribution(std::move(error));
    add("anisotropy",
        fmt::format("not needed: half axes are within {:.2g} % of a disc's for 95 % of the "
                    "surfels, {:.2g} % for the longest",
                    100 * d.percentile_95, 100 * d.max),
        fmt::format("surfel-estimate {} --anisotropy off -o OUT", file_));
  }

  void drawing() {
    if (cloud_.basis_cutoff && *cloud_.basis_cutoff != options_.cutoff) {
      add("cutoff", fmt::format("coefficients were fitted for {:g}", *cloud_.basis_cutoff),
          fmt::format("surfel-render {} --cutoff {:g}", file_, *cloud_.basis_cutoff));
    }
    const auto see_through = static_cast<std::size_t>(
        std::count_if(cloud_.alpha.begin(), cloud_.alpha.end(), [](float a) { return a < 0.99F; }));
    if (share(see_through) > kFew) {
      add("layers",
          fmt::format("{:.2g} % of the surfels are see-through: surfaces behind each other need a "
                      "layer each",
                      100 * share(see_through)),
          fmt::format("surfel-render {} --layers 8", file_));
    }
    const double per_pixel = static_cast<double>(s_.count) / kPicturePixels;
    if (per_pixel > 1 && cloud_.coarser_skipped == 0 && has_variance(cloud_)) {
      add("lod",
          fmt::format("{:.2g} surfels a pixel of 512x512, and one level of detail", per_pixel),
          fmt::format("surfel-lod {} -o OUT", file_));
    }
  }

  const SurfelCloud& cloud_;
  const CloudStatistics& s_;
  const CloudStatisticsOptions& options_;
  const std::string file_;  ///< As a word for a shell.
  std::vector<CloudNeed> found_;
};

}  // namespace

std::vector<CloudNeed> cloud_needs(const SurfelCloud& cloud, const CloudStatistics& statistics,
                                   const CloudStatisticsOptions& options, const std::string& file) {
  require_usable(options);
  return Needs(cloud, statistics, options, file).find();
}

}  // namespace surfel
