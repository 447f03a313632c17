#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <type_traits>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/option_check.h>
#include <surfel/base/progress.h>
#include <surfel/scene/curve_blocks.h>
#include <surfel/scene/surfel_halo.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/texture/fit_blocks.h>
#include <surfel/texture/surface_lookup.h>

namespace surfel {
namespace {

/// Widths of halos, in reaches of kernels.
constexpr double kRenderHalo = 12;
constexpr double kGramHalo = 18;
/// A kernel's weights depend on what lies so many reaches around it.
constexpr double kMeasuredHalo = 6;
/// Stretches of the curve that tell the weights of the whole, and surfels of each.
constexpr std::size_t kStretches = 64;
constexpr std::size_t kStretch = 512;
/// A kernel that is this many times as large as the mean of those beside it along the curve counts
/// as that large: a few giants must not draw in the whole cloud.
constexpr double kMostUneven = 4;
/// A lambda that is too low by this share of the least eigenvalue changes no coefficient by more
/// than as much.
constexpr double kLambdaSlack = 1e-3;
/// Where the stretches need a smaller lambda than this, their Gram matrices are definite, and
/// lambda has to bound nothing but the condition. The blocks then get this many times that lambda:
/// their estimates of eigenvalues differ a little, and would ask for slightly more.
constexpr double kDefiniteLambda = 1e-3;
constexpr double kLambdaMargin = 1.25;

/// The larger standard deviation of a surfel; 0 where it is not usable.
double larger_deviation(const SurfelCloud& cloud, std::size_t k) {
  if (!cloud.position[k].allFinite()) return 0;
  const double variance = cloud.anisotropic() ? std::max(static_cast<double>(cloud.variance_u[k]),
                                                         static_cast<double>(cloud.variance_v[k]))
                                              : static_cast<double>(cloud.variance[k]);
  return usable_variance(variance) ? std::sqrt(variance) : 0;
}

/// \param width  of the halo between two equal kernels, by their standard deviation
SurfelHaloOptions halo_options(double width) {
  return {
      .reach = [width](const SurfelCloud& cloud, std::size_t begin, std::size_t end, float* reach) {
        double sum = 0;
        std::size_t usable = 0;
        for (std::size_t k = begin; k < end; ++k) {
          const double sigma = larger_deviation(cloud, k);
          reach[k - begin] = sigma > 0 ? static_cast<float>(width / 2 * sigma) : -1.0F;
          sum += sigma;
          usable += sigma > 0 ? 1 : 0;
        }
        if (usable == 0) return;
        const auto most =
            static_cast<float>(kMostUneven * width / 2 * sum / static_cast<double>(usable));
        for (std::size_t k = begin; k < end; ++k)
          reach[k - begin] = std::min(reach[k - begin], most);
      }};
}

/// What a later run has to know of a block that has been fitted, beside its system and the charts
/// that are too large.
struct KeptFit {
  std::uint64_t surfels, without_uv, without_kernel, widened, charts, outside_charts, too_large;
  std::int32_t levels;
  std::int32_t alpha;
  std::array<float, 3> coefficient_min, coefficient_max;
};
static_assert(std::is_trivially_copyable_v<std::optional<SystemReport>>);

template <class T>
void append_bytes(const T& value, std::string& out) {
  out.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

class BlockFitter {
 public:
  BlockFitter(const SurfelRanges& cloud, const FitSource& source, const TextureFitOptions& options,
              const std::string& name, const FitBlockOptions& blocks)
      : cloud_(cloud),
        source_(source),
        options_(options),
        name_(name),
        checkpoints_(blocks.checkpoints),
        render_(options.kind == TextureFitKind::kRender),
        reach_(std::sqrt(2 * (render_ ? options.cutoff : 1))),
        width_(blocks.halo > 0 ? blocks.halo
               : render_       ? kRenderHalo
                               : kGramHalo),
        halo_(cloud, halo_options(width_ * reach_)) {
    options_.progress = {};
  }

  TextureFitReport run(const std::vector<CurveBlock>& blocks, SurfelSink& sink) {
    if (source_.textures) load(blocks);
    if (render_) {
      measure();
    } else if (!options_.lambda) {
      least_lambda_ = lambda_of_stretches();
    }
    for (std::uint64_t round = 0;; ++round) {
      if (void_round(round)) continue;
      TextureFitReport report;
      if (fit(round, blocks, sink, report)) return report;
      if (checkpoints_) checkpoints_->finish(kRound + round, {}, lambda_state());
    }
  }

 private:
  /// Parts from here on are rounds of fitting that have turned out to be void.
  static constexpr std::uint64_t kRound = std::uint64_t{1} << 63;

  /// Surfels [begin, end) with the surfels around them, and which of these they are.
  struct Piece {
    SurfelCloud cloud;
    FittedPart part;
  };

  Piece piece(std::size_t begin, std::size_t end, float scale = 1) const {
    SurfelHalo::Around around = halo_.around(cloud_.read(begin, end), begin, scale);
    return located(
        {std::move(around.cloud), {.begin = around.before, .end = around.before + (end - begin)}});
  }
  /// The first surfel alone.
  Piece first() const { return located({cloud_.read(0, 1), {.begin = 0, .end = 1}}); }
  Piece located(Piece piece) const {
    piece.cloud.tree = {};
    if (source_.mesh && piece.cloud.uv.empty()) {
      locate_on_mesh(piece.cloud, *source_.mesh, name_);
    }
    return piece;
  }

  TextureFitReport fit(Piece& piece) const {
    TextureFitOptions options = options_;
    options.part = piece.part;
    return fit_coefficients(piece.cloud, source_, options, name_);
  }

  double lambda_of(const Piece& piece) const {
    TextureFitOptions options = options_;
    options.part = piece.part;
    return gram_lambda(piece.cloud, source_.textures != nullptr, options, name_);
  }

  /// Calls visit(begin, end) for the stretches that tell the weights of the whole.
  template <class Visit>
  void for_stretches(const Visit& visit) const {
    const std::size_t length = std::min(kStretch, cloud_.size());
    for (std::size_t s = 0; s < kStretches; ++s) {
      const std::size_t begin = (cloud_.size() - length) * s / (kStretches - 1);
      visit(begin, begin + length);
    }
  }
  float measured_scale() const { return static_cast<float>(std::min(1.0, kMeasuredHalo / width_)); }

  /// Loads what all pieces need of the textures.
  void load(const std::vector<CurveBlock>& blocks) {
    TextureSet& textures = *source_.textures;
    if (textures.loaded) return;
    const auto request = [&](Piece piece, std::size_t begin) {
      TextureFitOptions options = options_;
      options.part = piece.part;
      request_kernels(piece.cloud, textures, options, name_, begin);
    };
    ProgressStage stage("looking for texels", cloud_.size(), "surfels");
    request(first(), 0);
    for (const CurveBlock& block : blocks) {
      request(piece(block.begin, block.end), block.begin);
      stage.add(block.end - block.begin);
    }
    if (render_) {
      for_stretches([&](std::size_t begin, std::size_t end) {
        request(piece(begin, end, measured_scale()), begin);
      });
    }
    load_requested(textures);
  }

  void measure() {
    RenderMeasure sum;
    for_stretches([&](std::size_t begin, std::size_t end) {
      Piece stretch = piece(begin, end, measured_scale());
      stretch.part.measured = &sum;
      fit(stretch);
    });
    whole_ = sum;
  }

  /// The largest lambda that a stretch needs: what most clouds need, so that few are fitted twice.
  double lambda_of_stretches() {
    double lambda = 0;
    for_stretches([&](std::size_t begin, std::size_t end) {
      lambda = std::max(lambda, lambda_of(piece(begin, end, measured_scale())));
    });
    return lambda < kDefiniteLambda ? kLambdaMargin * lambda : lambda;
  }

  std::string lambda_state() const {
    std::string state;
    append_bytes(least_lambda_, state);
    return state;
  }
  /// Has an earlier run found this round to be void?
  bool void_round(std::uint64_t round) {
    if (!checkpoints_) return false;
    const std::optional<std::string> state = checkpoints_->finished(kRound + round);
    if (!state || state->size() != sizeof(least_lambda_)) return false;
    std::memcpy(&least_lambda_, state->data(), sizeof(least_lambda_));
    return true;
  }

  /// False if a block has needed a larger lambda than the blocks before it had.
  bool fit(std::uint64_t round, const std::vector<CurveBlock>& blocks, SurfelSink& sink,
           TextureFitReport& report) {
    begin(sink);
    // What lambda may rise to without a need to fit the blocks before again.
    double most_lambda = std::numeric_limits<double>::infinity();
    double lambda = least_lambda_;
    ProgressStage stage("fitting", cloud_.size(), "surfels");
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const CurveBlock& block = blocks[b];
      if (lambda > most_lambda) {  // The round is void: what is left tells the next one's lambda.
        lambda = std::max(lambda, lambda_of(piece(block.begin, block.end)));
      } else {
        const TextureFitReport fitted = fit(round * blocks.size() + b, block, lambda, sink);
        if (!render_ && !options_.lambda) {
          const SystemReport& system = *fitted.system;
          lambda = std::max(lambda, system.lambda);
          most_lambda = std::min(most_lambda, system.lambda + kLambdaSlack * system.eigen_min);
        }
        report.add(fitted);
      }
      stage.add(block.end - block.begin);
    }
    least_lambda_ = lambda;
    return lambda <= most_lambda;
  }

  /// Fits a block with at least that lambda, or takes what an earlier run has kept of it.
  TextureFitReport fit(std::uint64_t part, const CurveBlock& block, double least_lambda,
                       SurfelSink& sink) const {
    if (checkpoints_) {
      const std::optional<std::string> state = checkpoints_->finished(part);
      if (std::optional<TextureFitReport> kept = state ? kept_report(*state) : std::nullopt) {
        return *std::move(kept);
      }
    }
    Piece of = piece(block.begin, block.end);
    of.part.whole = whole_;
    of.part.least_lambda = least_lambda;
    TextureFitReport fitted = fit(of);
    keep(part, block, of, fitted, sink);
    return fitted;
  }

  void begin(SurfelSink& sink) const {
    Piece one = first();
    one.part.whole = whole_;
    fit(one);
    sink.begin(one.cloud, cloud_.size());
  }

  void keep(std::uint64_t part, const CurveBlock& block, const Piece& fitted,
            const TextureFitReport& report, SurfelSink& sink) const {
    Array<std::uint32_t> own(block.end - block.begin);
    std::iota(own.begin(), own.end(), static_cast<std::uint32_t>(fitted.part.begin));
    sink.put(fitted.cloud.gathered(own), block.begin);
    if (!checkpoints_) return;
    const RowSpan rows{block.begin, block.end};
    checkpoints_->finish(part, {&rows, 1}, state_of(report));
  }

  const SurfelRanges& cloud_;
  const FitSource& source_;
  TextureFitOptions options_;
  const std::string& name_;
  Checkpoints* checkpoints_;
  bool render_;
  double reach_;  ///< Of a kernel, by its standard deviation.
  double width_;  ///< Of halos, in reaches.
  SurfelHalo halo_;
  RenderMeasure whole_;
  double least_lambda_ = 0;
};

/// Gathers the coefficients of a cloud in memory, which blocks to come must find as it is.
class CoefficientSink final : public SurfelSink {
 public:
  explicit CoefficientSink(const SurfelCloud& cloud) : order_(morton_order(cloud.position)) {}

  void begin(const SurfelCloud& like, std::size_t count) override {
    like_ = like;
    coefficient_.resize(count);
    alpha_.resize(like.alpha.empty() ? 0 : count);
  }
  void put(SurfelCloud surfels, std::size_t at) override {
    for (std::size_t i = 0; i < surfels.size(); ++i) {
      coefficient_[order_[at + i]] = surfels.coefficient[i];
      if (!alpha_.empty()) alpha_[order_[at + i]] = surfels.alpha[i];
    }
  }
  void move_to(SurfelCloud& cloud) {
    cloud.coefficient = std::move(coefficient_);
    cloud.alpha = std::move(alpha_);
    cloud.basis_cutoff = like_.basis_cutoff;
    cloud.color_light = like_.color_light;
  }

 private:
  Array<std::uint32_t> order_;
  SurfelCloud like_;
  Array<Vec3f> coefficient_;
  Array<float> alpha_;
};

TextureFitReport fit_blocks_in_memory(SurfelCloud& cloud, const FitSource& source,
                                      const TextureFitOptions& options, const std::string& name) {
  TextureFitReport report;
  CoefficientSink sink(cloud);
  fit_by_blocks(OrderedCloud(cloud), source, options, sink, &report, name);
  sink.move_to(cloud);
  return report;
}

}  // namespace

TextureFitReport fit_coefficients(SurfelCloud& cloud, const FitSource& source,
                                  const TextureFitOptions& options, const std::string& name) {
  if (!options.part && fitted_by_blocks(cloud.size(), options)) {
    return fit_blocks_in_memory(cloud, source, options, name);
  }
  if (source.textures) return fit_texture(cloud, *source.textures, options, name);
  if (source.solid) return fit_solid(cloud, *source.solid, options, name);
  return fit_colors(cloud, options, name);
}

std::string state_of(const TextureFitReport& r) {
  const auto channels = [](const Vec3f& v) { return std::array{v.x(), v.y(), v.z()}; };
  std::string out;
  append_bytes(KeptFit{r.surfels, r.without_uv, r.without_kernel, r.widened, r.charts,
                       r.outside_charts, r.too_large.size(), r.levels, r.alpha ? 1 : 0,
                       channels(r.coefficient_min), channels(r.coefficient_max)},
               out);
  append_bytes(r.system, out);
  for (const std::uint32_t chart : r.too_large) append_bytes(chart, out);
  return out;
}

std::optional<TextureFitReport> kept_report(const std::string& state) {
  KeptFit kept;
  TextureFitReport r;
  if (state.size() < sizeof(kept) + sizeof(r.system)) return std::nullopt;
  std::memcpy(&kept, state.data(), sizeof(kept));
  std::memcpy(&r.system, state.data() + sizeof(kept), sizeof(r.system));
  const std::size_t charts = sizeof(kept) + sizeof(r.system);
  if ((state.size() - charts) / sizeof(std::uint32_t) != kept.too_large) return std::nullopt;
  r.too_large.resize(kept.too_large);
  if (kept.too_large > 0) {
    std::memcpy(r.too_large.data(), state.data() + charts, state.size() - charts);
  }
  r.surfels = kept.surfels;
  r.without_uv = kept.without_uv;
  r.without_kernel = kept.without_kernel;
  r.widened = kept.widened;
  r.charts = kept.charts;
  r.charts_too_large = kept.too_large;
  r.outside_charts = kept.outside_charts;
  r.levels = kept.levels;
  r.alpha = kept.alpha != 0;
  r.coefficient_min = Vec3f(kept.coefficient_min.data());
  r.coefficient_max = Vec3f(kept.coefficient_max.data());
  return r;
}

std::vector<std::string> fit_block_problems(const TextureFitOptions& options) {
  std::vector<std::string> found;
  const auto refuse = [&](bool asked_for, const char* what) {
    if (asked_for) found.push_back(std::string(what) + " needs all surfels at once");
  };
  refuse(options.robust, "the `robust` fit");
  refuse(options.refine_variance, "`refine_variance`");
  refuse(options.solver != FitSolver::kConjugateGradients, "a `solver` other than cg");
  refuse(options.bounds && options.kind == TextureFitKind::kGram, "the gram fit with `bounds`");
  return found;
}

std::uint64_t fit_bytes(std::size_t surfels, std::size_t row_bytes) {
  constexpr std::uint64_t kSystem = 2500;
  return surfels * (kSystem + std::uint64_t{row_bytes});
}

std::uint64_t fit_block_bytes(std::size_t surfels, std::size_t row_bytes) {
  // A block and the surfels around it.
  constexpr std::size_t kTogether = FitBlockOptions().most * 3 / 2;
  return fit_bytes(kTogether, row_bytes) + surfels / kHaloRun * sizeof(ReachBox);
}

bool fit_by_blocks(const SurfelRanges& cloud, const FitSource& source,
                   const TextureFitOptions& options, SurfelSink& sink, TextureFitReport* report,
                   const std::string& name, const FitBlockOptions& blocks) {
  require_usable(options);
  if (const std::vector<std::string> problems = fit_block_problems(options); !problems.empty()) {
    throw_usage(fmt::format("{}", fmt::join(problems, "; ")));
  }
  const SurfelCloud first = cloud.read(0, std::min<std::size_t>(1, cloud.size()));
  if (!has_variance(first)) {
    throw_input(name,
                "the surfels have no variance; surfel-from-mesh and surfel-estimate write one");
  }
  CurveBlocks cut = curve_blocks(cloud, blocks.most);
  if (!cut.in_order) return false;
  // Surfels that cannot be drawn, without any that can, are in no block.
  if (cut.blocks.empty()) {
    for (std::size_t begin = 0; begin < cloud.size(); begin += blocks.most) {
      cut.blocks.push_back({begin, std::min(begin + blocks.most, cloud.size())});
    }
  }
  TextureFitReport r = BlockFitter(cloud, source, options, name, blocks).run(cut.blocks, sink);
  if (report) *report = std::move(r);
  return true;
}

}  // namespace surfel
