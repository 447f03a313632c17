#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/lod/curve_blocks.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/scene/clips.h>
#include <surfel/scene/usable_surfels.h>
#include <surfel/simplify/shown_surface.h>
#include <surfel/simplify/simplify_block.h>
#include <surfel/simplify/simplify_blocks.h>

namespace surfel {
namespace {

/// Share of the squared error asked for that every block may have: a block without any detail could
/// keep no error at all only by keeping its surfels.
constexpr double kEvenShare = 0.25;

/// A block of the curve that has surfels to be simplified.
struct Stretch {
  std::size_t begin, end;
  BlockDetail detail;
};

class BlockSimplifier {
 public:
  BlockSimplifier(const SurfelRanges& cloud, const SimplifyOptions& options, SimplifyReport& report,
                  const std::string& name)
      : cloud_(cloud), options_(options), report_(report), name_(name) {}

  void run(const std::vector<CurveBlock>& blocks, FunctionRef<void(SurfelCloud)> visit) {
    measure(blocks);
    if (stretches_.empty()) throw_input(name_, "holds no surfel that can be drawn");
    if (!(whole_.total_area > 0)) throw_input(name_, "the surfels have no area");
    ProgressStage stage("comparing blocks", stretches_.size(), "blocks");
    for (Stretch& stretch : stretches_) {
      const SurfelCloud block = cloud_.read(stretch.begin, stretch.end);
      stretch.detail = block_detail(block, options_, whole_, name_);
      report_.surfels += stretch.detail.surfels;
      stage.add(1);
    }
    simplify(visit);
  }

 private:
  /// Sums up what holds for the whole cloud.
  void measure(const std::vector<CurveBlock>& blocks) {
    ProgressStage stage("measuring surfels", cloud_.size(), "surfels");
    double brightness = 0;
    Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
    Vec3f high = -low;
    for (const CurveBlock& block : blocks) {
      low = low.cwiseMin(block.min);
      high = high.cwiseMax(block.max);
      SurfelCloud surfels = cloud_.read(block.begin, block.end);
      Array<std::uint32_t> usable(surfels.size());
      std::iota(usable.begin(), usable.end(), 0U);
      report_.dropped.add(remove_unusable(surfels, false, usable));
      std::erase_if(usable, [&](std::uint32_t i) { return is_cut_off(surfels, i); });
      stage.add(block.end - block.begin);
      if (usable.empty()) continue;
      stretches_.push_back({block.begin, block.end, {}});
      for (const std::uint32_t i : usable) {
        const double area = merge_surfel(surfels, i).area;
        whole_.total_area += area;
        brightness += area * std::abs(shown_color(surfels, i).head<3>().mean());
      }
    }
    if (whole_.total_area > 0) whole_.brightness = brightness / whole_.total_area;
    const double diagonal = stretches_.empty() ? 0 : (high - low).cast<double>().norm();
    if (!options_.unit_deviation) options_.unit_deviation = diagonal > 0 ? diagonal / 30 : 1;
    report_.unit_deviation = *options_.unit_deviation;
  }

  void simplify(FunctionRef<void(SurfelCloud)> visit) {
    const std::vector<std::size_t> counts =
        options_.count ? shared_count() : std::vector<std::size_t>();
    const std::vector<double> errors = options_.count ? std::vector<double>() : shared_error();
    ProgressStage stage("simplifying", cloud_.size(), "surfels");
    double color = 0;
    double shading = 0;
    double shape = 0;
    for (std::size_t b = 0; b < stretches_.size(); ++b) {
      const Stretch& stretch = stretches_[b];
      SimplifyOptions options = options_;
      options.progress = {};
      if (options.count) options.count = counts[b];
      if (options.max_error) options.max_error = errors[b];
      SimplifyReport r;
      SurfelCloud out =
          simplify_block(cloud_.read(stretch.begin, stretch.end), options, whole_, r, name_);
      out.double_positions = out.double_positions || !out.origin.isZero(0);
      visit(std::move(out));
      report_.merged += r.merged;
      report_.result += r.result;
      report_.mirrored += r.mirrored;
      report_.no_normal += r.no_normal;
      report_.uncovered += r.uncovered;
      report_.rounds += r.rounds;
      report_.left_out = r.left_out;
      report_.error.max_distance = std::max(report_.error.max_distance, r.error.max_distance);
      for (const auto& [name, milliseconds] : r.times.stages()) {
        report_.times.add(name, milliseconds);
      }
      const double area = stretch.detail.area / whole_.total_area;
      color += area * r.error.color * r.error.color;
      shading += area * r.error.shading * r.error.shading;
      shape += area * r.error.shape * r.error.shape;
      stage.add(stretch.end - stretch.begin);
    }
    report_.error.color = std::sqrt(color);
    report_.error.shading = std::sqrt(shading);
    report_.error.shape = std::sqrt(shape);
    report_.reached =
        options_.count ? report_.result == *options_.count : report_.result < report_.surfels;
  }

  /// The value of a figure of a block between two of the compared prices.
  static double between(const std::vector<double>& values, double at) {
    const auto last = static_cast<double>(values.size() - 1);
    const double place = std::clamp(at, 0.0, last);
    const auto k = std::min(static_cast<std::size_t>(place), values.size() - 2);
    const double t = place - static_cast<double>(k);
    return values[k] + t * (values[k + 1] - values[k]);
  }
  /// The first place among the compared prices where enough(place) holds, which then holds for all
  /// lower prices.
  template <class Enough>
  double first_price(const Enough& enough) const {
    constexpr int kHalvings = 50;
    double low = 0;
    double high = static_cast<double>(stretches_.front().detail.samples.size() - 1);
    if (enough(low)) return low;
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = (low + high) / 2;
      (enough(middle) ? high : low) = middle;
    }
    return high;
  }

  /// The surfels that each block keeps.
  std::vector<std::size_t> shared_count() const {
    const std::size_t wanted = std::min(*options_.count, report_.surfels);
    const auto kept = [](const Stretch& s, double at) {
      return std::min(between(s.detail.samples, at), static_cast<double>(s.detail.surfels));
    };
    const double at = first_price([&](double place) {
      double sum = 0;
      for (const Stretch& s : stretches_) sum += kept(s, place);
      return sum >= static_cast<double>(wanted);
    });
    double sum = 0;
    for (const Stretch& s : stretches_) sum += kept(s, at);
    const double scale = static_cast<double>(wanted) / sum;
    std::vector<std::size_t> counts;
    std::vector<std::pair<double, std::size_t>> rests;  // What rounding has taken, and from which.
    for (std::size_t b = 0; b < stretches_.size(); ++b) {
      const double share = scale * kept(stretches_[b], at);
      counts.push_back(std::clamp<std::size_t>(static_cast<std::size_t>(share), 1,
                                               stretches_[b].detail.surfels));
      rests.emplace_back(static_cast<double>(counts.back()) - share, b);
    }
    std::sort(rests.begin(), rests.end());
    std::size_t total = std::accumulate(counts.begin(), counts.end(), std::size_t{0});
    for (bool some = true; total < wanted && some;) {
      some = false;
      for (std::size_t i = 0; i < rests.size() && total < wanted; ++i) {
        const std::size_t b = rests[i].second;
        if (counts[b] == stretches_[b].detail.surfels) continue;
        ++counts[b];
        ++total;
        some = true;
      }
    }
    return counts;
  }

  /// The error that each block may have.
  std::vector<double> shared_error() const {
    const double wanted2 = *options_.max_error * *options_.max_error;
    const auto mean2 = [&](double place) {
      double sum = 0;
      for (const Stretch& s : stretches_) sum += s.detail.area * between(s.detail.error2, place);
      return sum / whole_.total_area;
    };
    const double at = first_price([&](double place) { return mean2(place) <= wanted2; });
    const double mean = mean2(at);
    std::vector<double> errors;
    for (const Stretch& s : stretches_) {
      const double share = mean > 0 ? between(s.detail.error2, at) / mean : 1;
      errors.push_back(std::sqrt(wanted2 * (kEvenShare + (1 - kEvenShare) * share)));
    }
    return errors;
  }

  const SurfelRanges& cloud_;
  SimplifyOptions options_;
  SimplifyReport& report_;
  const std::string& name_;
  SimplifiedWhole whole_;
  std::vector<Stretch> stretches_;
};

}  // namespace

std::uint64_t simplify_bytes(std::size_t surfels, std::size_t row_bytes) {
  // The look of the surfels, and the system of equations of the result.
  constexpr std::uint64_t kSystem = 900;
  return surfels * (kSystem + 3 * std::uint64_t{row_bytes});
}

std::uint64_t simplify_block_bytes(std::size_t row_bytes) {
  return simplify_bytes(SimplifyBlockOptions().most, row_bytes);
}

bool simplify_by_blocks(const SurfelRanges& cloud, const SimplifyOptions& options,
                        FunctionRef<void(SurfelCloud simplified)> visit, SimplifyReport* report,
                        const std::string& name, const SimplifyBlockOptions& blocks) {
  require_usable(options);
  SimplifyReport own;
  SimplifyReport& r = report ? *report : own;
  r = {};
  require_simplifiable(cloud.read(0, std::min<std::size_t>(1, cloud.size())), name);
  const CurveBlocks cut = curve_blocks(cloud, blocks.most);
  if (!cut.in_order) return false;
  BlockSimplifier(cloud, options, r, name).run(cut.blocks, visit);
  return true;
}

}  // namespace surfel
