#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/lod/surfel_merge.h>
#include <surfel/scene/clips.h>
#include <surfel/scene/curve_blocks.h>
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

/// What a later run has to know of a block: what it needs ...
struct KeptDetail {
  std::uint64_t surfels;
  double area;
  // `samples` and `error2` follow.
};
/// ... and what has been made of it.
struct KeptBlock {
  std::uint64_t merged, result, mirrored, no_normal, uncovered;
  std::int64_t rounds;
  SimplifyError error;
};
static_assert(std::is_trivially_copyable_v<SimplifyError>);

std::string state_of(const BlockDetail& detail) {
  const KeptDetail head{detail.surfels, detail.area};
  std::string out(reinterpret_cast<const char*>(&head), sizeof(head));
  for (const std::vector<double>* values : {&detail.samples, &detail.error2}) {
    out.append(reinterpret_cast<const char*>(values->data()), values->size() * sizeof(double));
  }
  return out;
}

/// None where the state is of something else.
std::optional<BlockDetail> detail_of(const std::string& state) {
  const std::size_t prices = compared_prices().size();
  KeptDetail head;
  if (state.size() != sizeof(head) + 2 * prices * sizeof(double)) return std::nullopt;
  std::memcpy(&head, state.data(), sizeof(head));
  BlockDetail detail{head.surfels, head.area, std::vector<double>(prices),
                     std::vector<double>(prices)};
  const char* const values = state.data() + sizeof(head);
  std::memcpy(detail.samples.data(), values, prices * sizeof(double));
  std::memcpy(detail.error2.data(), values + prices * sizeof(double), prices * sizeof(double));
  return detail;
}

class BlockSimplifier {
 public:
  BlockSimplifier(const SurfelRanges& cloud, const SimplifyOptions& options, SimplifyReport& report,
                  const std::string& name, Checkpoints* checkpoints)
      : cloud_(cloud), options_(options), report_(report), name_(name), checkpoints_(checkpoints) {}

  void run(const std::vector<CurveBlock>& blocks, SurfelSink& sink) {
    measure(blocks);
    if (stretches_.empty()) throw_input(name_, "holds no surfel that can be drawn");
    if (!(whole_.total_area > 0)) throw_input(name_, "the surfels have no area");
    ProgressStage stage("comparing blocks", stretches_.size(), "blocks");
    for (Stretch& stretch : stretches_) {
      compare(stretch);
      report_.surfels += stretch.detail.surfels;
      stage.add(1);
    }
    simplify(sink);
  }

 private:
  /// Parts from here on are what blocks need, by their first surfels.
  static constexpr std::uint64_t kDetail = std::uint64_t{1} << 63;

  std::optional<std::string> kept(std::uint64_t part) {
    return checkpoints_ ? checkpoints_->finished(part) : std::nullopt;
  }

  void compare(Stretch& stretch) {
    if (const std::optional<std::string> state = kept(kDetail + stretch.begin)) {
      if (std::optional<BlockDetail> detail = detail_of(*state)) {
        stretch.detail = std::move(*detail);
        return;
      }
    }
    const SurfelCloud block = cloud_.read(stretch.begin, stretch.end);
    stretch.detail = block_detail(block, options_, whole_, name_);
    if (checkpoints_) {
      checkpoints_->finish(kDetail + stretch.begin, {}, state_of(stretch.detail));
    }
  }

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

  void simplify(SurfelSink& sink) {
    const std::vector<std::size_t> counts =
        options_.count ? shared_count() : std::vector<std::size_t>();
    const std::vector<double> errors = options_.count ? std::vector<double>() : shared_error();
    ProgressStage stage("simplifying", cloud_.size(), "surfels");
    double color = 0;
    double shading = 0;
    double shape = 0;
    std::size_t at = 0;
    for (std::size_t b = 0; b < stretches_.size(); ++b) {
      const Stretch& stretch = stretches_[b];
      SimplifyOptions options = options_;
      options.progress = {};
      if (options.count) options.count = counts[b];
      if (options.max_error) options.max_error = errors[b];
      SurfelCloud out;
      KeptBlock r{};
      const auto make = [&] {
        SimplifyReport made;
        out = simplify_block(cloud_.read(stretch.begin, stretch.end), options, whole_, made, name_);
        out.double_positions = out.double_positions || !out.origin.isZero(0);
        r = {made.merged,    made.result, made.mirrored, made.no_normal,
             made.uncovered, made.rounds, made.error};
        report_.left_out = made.left_out;
        for (const auto& [name, milliseconds] : made.times.stages()) {
          report_.times.add(name, milliseconds);
        }
      };
      // The first block tells the columns of all.
      if (b == 0) {
        make();
        sink.begin(out.gathered({0}), 0);
      }
      const std::optional<std::string> state = kept(stretch.begin);
      if (state && state->size() == sizeof(r)) {
        std::memcpy(&r, state->data(), sizeof(r));
      } else {
        if (b > 0) make();
        const RowSpan rows{at, at + out.size()};
        sink.put(std::move(out), at);
        if (checkpoints_) {
          checkpoints_->finish(stretch.begin, {&rows, 1},
                               std::string(reinterpret_cast<const char*>(&r), sizeof(r)));
        }
      }
      at += r.result + r.mirrored;
      report_.merged += r.merged;
      report_.result += r.result;
      report_.mirrored += r.mirrored;
      report_.no_normal += r.no_normal;
      report_.uncovered += r.uncovered;
      report_.rounds += static_cast<int>(r.rounds);
      report_.error.max_distance = std::max(report_.error.max_distance, r.error.max_distance);
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
  Checkpoints* checkpoints_;
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

bool simplify_by_blocks(const SurfelRanges& cloud, const SimplifyOptions& options, SurfelSink& sink,
                        SimplifyReport* report, const std::string& name,
                        const SimplifyBlockOptions& blocks) {
  require_usable(options);
  SimplifyReport own;
  SimplifyReport& r = report ? *report : own;
  r = {};
  require_simplifiable(cloud.read(0, std::min<std::size_t>(1, cloud.size())), name);
  const CurveBlocks cut = curve_blocks(cloud, blocks.most);
  if (!cut.in_order) return false;
  BlockSimplifier(cloud, options, r, name, blocks.checkpoints).run(cut.blocks, sink);
  return true;
}

}  // namespace surfel
