// Zwicker, Pfister, van Baar, Gross 2001, "Surface Splatting", section 5.

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>
#include <utility>

#include <surfel/base/group_by_key.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/texture/ewa_fit.h>

namespace surfel {
namespace {

constexpr std::uint32_t kUnmasked = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint32_t kNoFunction = std::numeric_limits<std::uint32_t>::max();
constexpr std::size_t kSurfelGrain = 1 << 12;

/// A chart whose box has more texels than this many images is not masked: where an image is
/// repeated so often, the image lies beyond the border again.
constexpr double kMaxRepetitions = 4;
/// Boxes of so few texels are masked whatever the image: they take 1 MB.
constexpr double kMinBox = 1 << 16;
/// Boxes of more texels are never masked: they take 4 GB.
constexpr double kMaxBox = 1 << 28;

/// Charts with more texels are worked on by all threads together, smaller ones by one thread each.
constexpr std::size_t kSharedTexels = 1 << 18;

/// A chart in use: its box of texels and its surfels, order[begin] ... order[end - 1].
struct ChartTask {
  std::uint32_t chart;
  CoverageRaster raster;
  std::size_t begin;
  std::size_t end;
  bool shared() const {
    return static_cast<std::size_t>(raster.width) * raster.height > kSharedTexels;
  }
};

/// The reconstruction kernel alone, about a place.
TexelKernel reconstruction_at(const Vec2d& center, const TextureFitOptions& options) {
  const std::optional<double>& deviation = options.reconstruction;
  return {center, (deviation ? *deviation * *deviation : kBilinearVariance) * Mat2d::Identity(),
          !deviation};
}

/// Adds the texels beyond the borders of a chart as wide or as high as its image, which bilinear
/// lookup repeats from the other side.
void add_lookups(const TextureMap& map, CoverageRaster& box) {
  if (box.width >= map.width()) {
    --box.first_x;
    box.width += 2;
  }
  if (box.height >= map.height()) {
    --box.first_y;
    box.height += 2;
  }
}

/// Least squares from few points take detail that is finer than a surfel of this variance for
/// noise: texels are reconstructed as softly as the surfel is wide, up to the published texel.
void soften(Mat2d& variance, const Mat2d& of_surfel, const TextureFitOptions& options) {
  if (options.reconstruction || options.kind == TextureFitKind::kEwa) return;
  const double wide = std::min(1.0, principal_variances(of_surfel).minor);
  variance.diagonal().array() += std::max(0.0, wide - kBilinearVariance);
}

class EwaFit {
 public:
  EwaFit(SurfelCloud& cloud, TextureSet& textures, const TextureFitOptions& options,
         TextureFitReport& report, PointColors* points)
      : cloud_(cloud), textures_(textures), options_(options), report_(report), points_(points) {
    if (!points) return;
    function_.assign(cloud.size(), kNoFunction);
    for (std::size_t i = 0; i < points->basis.size(); ++i) {
      function_[points->basis.surfel[i]] = static_cast<std::uint32_t>(i);
    }
    points->color.resize(points->quadrature.size());
    points->known.assign(points->quadrature.size(), 1);
  }

  void run() {
    StageTimer timer(report_.times);
    survey();
    const std::vector<ChartTask> tasks = plan_charts();
    timer.end("charts");

    if (!level_.empty()) report_.levels = *std::max_element(level_.begin(), level_.end()) + 1;
    if (!textures_.loaded) {
      request_maps(tasks);
      for (TextureMap& map : textures_.maps) map.load();
    }
    report_.alpha = std::any_of(textures_.maps.begin(), textures_.maps.end(),
                                [](const TextureMap& map) { return map.has_alpha(); });
    timer.end("pyramid");

    cloud_.coefficient.resize(cloud_.size());
    if (report_.alpha) cloud_.alpha.resize(cloud_.size());
    fit_unmasked();
    fit_charts(tasks);
    cloud_.basis_cutoff.reset();
    timer.end("filter");
  }

  void request() {
    survey();
    request_maps(plan_charts());
  }

 private:
  std::size_t map_index(std::size_t k) const { return textures_.map_index(cloud_, k); }
  const TextureMap& map_of(std::size_t k) const { return textures_.maps[map_index(k)]; }

  int max_level() const { return options_.exact ? 0 : GaussianPyramid::kMaxLevel; }

  EwaFootprint footprint(std::size_t k) const {
    return ewa_footprint(cloud_, k, map_of(k), options_);
  }

  /// The kernels of a surfel's points, which have one shape, and their centres.
  struct PointKernels {
    TexelKernel own;                    ///< About the centre of the surfel.
    Eigen::Matrix<double, 2, 2> along;  ///< Texels a unit along tangent and bitangent.
    std::size_t begin = 0, end = 0;     ///< Range of its points.
    const Quadrature* quadrature = nullptr;

    TexelKernel kernel(std::size_t q) const {
      TexelKernel kernel = own;
      kernel.center += along * quadrature->offset[q].cast<double>();
      return kernel;
    }
  };

  /// Empty where the surfel has no points. Without derivatives they have the surfel's own place.
  PointKernels point_kernels(std::size_t k) const {
    PointKernels result;
    if (!points_ || function_[k] == kNoFunction) return result;
    const TextureMap& map = map_of(k);
    const std::uint32_t i = function_[k];
    result.quadrature = &points_->quadrature;
    result.begin = points_->quadrature.begin[i];
    result.end = points_->quadrature.begin[i + 1];
    result.own = reconstruction_at(map.texel(cloud_.uv[k]), options_);
    result.along.setZero();
    if (const auto L = texels_per_unit(cloud_, k, map.width(), map.height())) {
      const SurfelBasis::Function& f = points_->basis.function[i];
      result.along << *L * f.tangent, *L * f.bitangent;
      result.own.variance +=
          static_cast<double>(points_->quadrature.variance[i]) * (*L * L->transpose());
      if (const auto own = texture_space_variance(cloud_, k, map.width(), map.height())) {
        soften(result.own.variance, *own, options_);
      }
      limit_kernel(result.own.variance, options_.max_aspect);
    }
    return result;
  }

  void store_point(std::size_t q, const std::optional<TextureSample>& sample) {
    if (!sample) {
      points_->known[q] = 0;
      points_->color[q].setZero();
      return;
    }
    points_->color[q] << sample->color.cast<double>().array(), sample->alpha;
  }

  /// Counts a surfel in a number of the report, on any thread.
  void count(std::size_t k, std::size_t& number) const {
    if (options_.part && !options_.part->owns(k)) return;
    std::atomic_ref(number).fetch_add(1, std::memory_order_relaxed);
  }

  /// Finds the chart and the pyramid level of every surfel, and counts what is unusual.
  void survey() {
    level_.resize(cloud_.size());
    if (textures_.charts) chart_.assign(cloud_.size(), kUnmasked);
    parallel_for(cloud_.size(), kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t k = begin; k < end; ++k) {
        level_[k] = 0;
        if (!cloud_.uv[k].allFinite()) {
          count(k, report_.without_uv);
          continue;
        }
        const EwaFootprint place = footprint(k);
        if (place.point) count(k, report_.without_kernel);
        if (place.widened) count(k, report_.widened);
        if (!options_.exact) level_[k] = level_for(place.kernel);
        if (textures_.charts && !find_chart(k)) count(k, report_.outside_charts);
      }
    });
  }

  static std::uint8_t level_for(const TexelKernel& kernel) {
    return static_cast<std::uint8_t>(
        GaussianPyramid::level_for(principal_variances(kernel.variance).minor));
  }

  /// A surfel at the border of its face may have been rounded out of it by a little.
  bool find_chart(std::size_t k) {
    const TextureMap& map = map_of(k);
    const Vec2f texel(1.0F / static_cast<float>(map.width()),
                      1.0F / static_cast<float>(map.height()));
    const std::optional<std::uint16_t> material =
        cloud_.material.empty() ? std::nullopt : std::optional(cloud_.material[k]);
    const Vec3d position = cloud_.world(k);
    auto chart = textures_.charts->find(cloud_.uv[k], position, material, texel / 4);
    if (!chart) chart = textures_.charts->find(cloud_.uv[k], position, material, 2 * texel);
    chart_[k] = chart.value_or(kUnmasked);
    return chart.has_value();
  }

  /// Groups surfels by chart. Surfels of a chart that is too large lose it.
  std::vector<ChartTask> plan_charts() {
    std::vector<ChartTask> tasks;
    if (!textures_.charts) return tasks;
    report_.charts = textures_.charts->count();
    const Grouped<std::uint32_t> surfels =
        group_by_key<std::uint32_t>(textures_.charts->count(), [&](const auto& add) {
          for (std::uint32_t k = 0; k < chart_.size(); ++k) {
            if (chart_[k] != kUnmasked) add(chart_[k], k);
          }
        });
    const Array<std::uint64_t>& begin = surfels.begin;
    order_ = surfels.item;
    for (std::uint32_t chart = 0; chart + 1 < begin.size(); ++chart) {
      if (begin[chart] == begin[chart + 1]) continue;
      const TextureMap& map = map_of(order_[begin[chart]]);
      const double limit =
          std::min(kMaxBox, std::max(kMinBox, kMaxRepetitions * map.width() * map.height()));
      auto box = coverage_box(textures_.charts->triangles(chart), map.width(), map.height(), limit);
      if (box && map.pyramid().wrap() == WrapMode::kRepeat) add_lookups(map, *box);
      if (box) {
        tasks.push_back({chart, std::move(*box), begin[chart], begin[chart + 1]});
        continue;
      }
      ++report_.charts_too_large;
      report_.too_large.push_back(chart);
      for (std::size_t i = begin[chart]; i < begin[chart + 1]; ++i) chart_[order_[i]] = kUnmasked;
    }
    return tasks;
  }

  bool unmasked(std::size_t k) const { return chart_.empty() || chart_[k] == kUnmasked; }

  void request_maps(const std::vector<ChartTask>& tasks) {
    parallel_for(cloud_.size(), kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t k = begin; k < end; ++k) {
        if (!cloud_.uv[k].allFinite()) continue;
        TexelKernel kernel = footprint(k).kernel;
        // Of a surfel that has a chart: the kernel where its own does not reach the chart.
        if (!unmasked(k)) kernel = reconstruction_at(kernel.center, options_);
        textures_.maps[map_index(k)].request(kernel, max_level());
        if (!unmasked(k)) continue;
        const PointKernels points = point_kernels(k);
        for (std::size_t q = points.begin; q < points.end; ++q) {
          textures_.maps[map_index(k)].request(points.kernel(q), max_level());
        }
      }
    });
    for (const ChartTask& task : tasks) {
      const CoverageRaster& box = task.raster;
      textures_.maps[map_index(order_[task.begin])].request(
          {box.first_x, box.first_x + box.width, box.first_y, box.first_y + box.height});
    }
  }

  void store(std::size_t k, const TextureSample& sample) {
    cloud_.coefficient[k] = sample.color;
    if (report_.alpha) cloud_.alpha[k] = sample.alpha;
  }

  void fit_unmasked() {
    std::vector<TextureSample> means;
    if (std::any_of(cloud_.uv.begin(), cloud_.uv.end(),
                    [](const Vec2f& uv) { return !uv.allFinite(); })) {
      for (const TextureMap& map : textures_.maps) means.push_back(map.mean());
    }
    ProgressStage stage("filtering the texture", cloud_.size(), "surfels");
    parallel_for(cloud_.size(), kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
      stage.add(end - begin);
      for (std::size_t k = begin; k < end; ++k) {
        if (!unmasked(k)) continue;
        const auto sample = [&](const TexelKernel& kernel) {
          return means.empty() || cloud_.uv[k].allFinite() ? map_of(k).sample(kernel, max_level())
                                                           : means[map_index(k)];
        };
        store(k, sample(footprint(k).kernel));
        const PointKernels points = point_kernels(k);
        for (std::size_t q = points.begin; q < points.end; ++q) {
          store_point(q, sample(points.kernel(q)));
        }
      }
    });
  }

  void fit_charts(const std::vector<ChartTask>& tasks) {
    std::size_t surfels = 0;
    for (const ChartTask& task : tasks) surfels += task.end - task.begin;
    ProgressStage stage("filtering the texture in charts", surfels, "surfels");
    std::vector<const ChartTask*> alone;
    for (const ChartTask& task : tasks) {
      if (task.shared()) {
        fit_chart(task);
        stage.add(task.end - task.begin);
      } else {
        alone.push_back(&task);
      }
    }
    parallel_for(alone.size(), 4, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = begin; i < end; ++i) {
        fit_chart(*alone[i]);
        stage.add(alone[i]->end - alone[i]->begin);
      }
    });
  }

  void fit_chart(const ChartTask& task) {
    const TextureMap& map = map_of(order_[task.begin]);
    LevelRange levels{GaussianPyramid::kMaxLevel, 0};
    for (std::size_t i = task.begin; i < task.end; ++i) {
      levels.finest = std::min<int>(levels.finest, level_[order_[i]]);
      levels.coarsest = std::max<int>(levels.coarsest, level_[order_[i]]);
      if (!points_ || options_.exact) continue;
      const PointKernels points = point_kernels(order_[i]);
      if (points.begin == points.end) continue;
      const int level = level_for(points.own);
      levels.finest = std::min(levels.finest, level);
      levels.coarsest = std::max(levels.coarsest, level);
    }
    const ChartTexture texture(map, textures_.charts->triangles(task.chart), task.raster, levels);
    parallel_for(task.end - task.begin, kSurfelGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t i = task.begin + begin; i < task.begin + end; ++i) {
        const std::size_t k = order_[i];
        const TexelKernel kernel = footprint(k).kernel;
        std::optional<TextureSample> sample = texture.sample(kernel, max_level());
        if (!sample) {
          count(k, report_.outside_charts);
          sample = map.sample(reconstruction_at(kernel.center, options_), max_level());
        }
        store(k, *sample);
        const PointKernels points = point_kernels(k);
        for (std::size_t q = points.begin; q < points.end; ++q) {
          store_point(q, texture.sample(points.kernel(q), max_level()));
        }
      }
    });
  }

  SurfelCloud& cloud_;
  TextureSet& textures_;
  const TextureFitOptions& options_;
  TextureFitReport& report_;
  PointColors* points_;
  /// Function of the points' basis by surfel; empty without points.
  Array<std::uint32_t> function_;
  Array<std::uint8_t> level_;   ///< Pyramid level per surfel.
  Array<std::uint32_t> chart_;  ///< Chart per surfel, or empty.
  Array<std::uint32_t> order_;  ///< Surfels that have a chart, by chart.
};

}  // namespace

EwaFootprint ewa_footprint(const SurfelCloud& cloud, std::size_t surfel, const TextureMap& map,
                           const TextureFitOptions& options) {
  EwaFootprint result;
  result.kernel = reconstruction_at(map.texel(cloud.uv[surfel]), options);
  if (auto variance = texture_space_variance(cloud, surfel, map.width(), map.height())) {
    result.kernel.variance += options.prefilter * *variance;
    soften(result.kernel.variance, *variance, options);
    result.widened = limit_kernel(result.kernel.variance, options.max_aspect);
  } else {
    result.point = true;
  }
  return result;
}

void fit_ewa(SurfelCloud& cloud, TextureSet& textures, const TextureFitOptions& options,
             TextureFitReport& report, PointColors* points) {
  EwaFit(cloud, textures, options, report, points).run();
}

void request_ewa(SurfelCloud& cloud, TextureSet& textures, const TextureFitOptions& options,
                 PointColors* points) {
  TextureFitReport unused;
  EwaFit(cloud, textures, options, unused, points).request();
}

}  // namespace surfel
