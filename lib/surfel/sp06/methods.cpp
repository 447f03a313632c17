#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/edge_search.h>
#include <surfel/render/shading.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/depth_peel.h>
#include <surfel/sp06/group_layers.h>
#include <surfel/sp06/group_raster.h>
#include <surfel/sp06/layer_blend.h>
#include <surfel/sp06/methods.h>
#include <surfel/sp06/two_pass.h>

namespace surfel {
namespace {

/// How far the discs of layers that are not interpolated reach beyond their rim, pixels: the least
/// reach with which every disc meets a pixel's centre.
constexpr double kLayerReach = 0.5;

/// Layers of the A-buffer of methods for opaque surfaces. At rims a pixel has more surfaces than a
/// group, or than it has elsewhere: the far fragments of a steep surface count as another.
int layers_of_rims(const RenderOptions& options) {
  return options.layers == 1 ? 1 : std::min(kMostLayers, 2 * options.layers);
}

/// The common part of SP06's three algorithms.
class GroupCompositor : public Compositor {
 public:
  GroupCompositor(const RenderCloud& cloud, const RenderOptions& options, Voronoi voronoi)
      : cloud_(cloud), options_(options), voronoi_(voronoi) {
    if (cloud.size() > 0 && cloud.groups() == 0) {
      throw_input("", "the surfels have no groups; run surfel-group on them");
    }
    if (!cloud.tree().empty()) {
      throw_usage("levels of detail have no groups; leave them out for methods that need groups");
    }
  }

  void begin(const Camera& camera) override {
    rule_ = layer_rule(cloud_, options_, voronoi_, camera);
  }

 protected:
  /// Splats that are interpolated.
  SplatListOptions surfaces(ListedSurfels surfels = ListedSurfels::kAll) const {
    return {.surfels = surfels, .groups = true, .lowpass = options_.filter_deviation()};
  }
  /// Splats of layers that are blended.
  SplatListOptions layers_behind(ListedSurfels surfels = ListedSurfels::kAll) const {
    return {.surfels = surfels,
            .groups = true,
            .enlarged = true,
            .lowpass = kLayerReach / std::sqrt(2 * options_.cutoff),
            .margin = kLayerMargin};
  }
  bool has_additions() const { return !cloud_.group_radius.empty() || cloud_.has_copies(); }
  int groups() const { return cloud_.groups(); }
  const RenderOptions& options() const { return options_; }
  const LayerRule& rule() const { return rule_; }
  /// Algorithm 1 for one tile.
  void draw_nearest(const TileJob& job, int layers, GroupImages& images, TileABuffer& tile) const {
    images.reset(groups(), layers);
    rasterize_groups(job, rule_, tile, images);
    composite_groups(job, images, tile);
  }

 private:
  const RenderCloud& cloud_;
  const RenderOptions& options_;
  Voronoi voronoi_;
  LayerRule rule_;
};

/// SP06's Algorithm 1.
class DeferredCompositor final : public GroupCompositor {
 public:
  using GroupCompositor::GroupCompositor;
  std::vector<SplatListOptions> lists() const override { return {surfaces()}; }
  int layers() const override { return layers_of_rims(options()); }
  std::unique_ptr<Worker> make_worker() const override {
    return std::make_unique<TileWorker>(*this);
  }

 private:
  struct TileWorker final : Worker {
    explicit TileWorker(const DeferredCompositor& c) : compositor(c) {}
    void draw(std::span<const TileJob> jobs, TileABuffer& tile) override {
      compositor.draw_nearest(jobs.front(), compositor.options().layers, images, tile);
    }
    const DeferredCompositor& compositor;
    GroupImages images;
  };
};

/// SP06's Algorithm 2, and Algorithm 3, which draws the nearest layer by Algorithm 1.
class LayerCompositor final : public GroupCompositor {
 public:
  LayerCompositor(const RenderCloud& cloud, const RenderOptions& options,
                  const MethodOptions& method, bool nearest)
      : GroupCompositor(cloud, options, method.voronoi),
        nearest_(nearest),
        joint_(method.layers_by == LayersBy::kSurface) {}
  std::vector<SplatListOptions> lists() const override {
    if (!joint_) {
      return nearest_ ? std::vector{surfaces(), layers_behind()} : std::vector{layers_behind()};
    }
    // Copies would count twice in sums of kernels.
    std::vector lists{surfaces(ListedSurfels::kOriginals)};
    if (has_additions()) lists.push_back(layers_behind(ListedSurfels::kAdditions));
    return lists;
  }
  int layers() const override { return 1; }
  bool has_background() const override { return true; }
  void begin(const Camera& camera) override {
    GroupCompositor::begin(camera);
    picture_->begin(camera.width, camera.height, groups(), nearest_);
  }
  std::unique_ptr<Worker> make_worker() const override {
    return std::make_unique<TileWorker>(*this);
  }
  void complete(const Shader& shader, int x, int y, std::span<Fragment> fragments) const override {
    if (!shader.has_environment() || !picture_->at_border(x, y)) return;
    for (Fragment& fragment : fragments.first(fragments.size() - 1)) {
      const Vec3f normal = picture_->filtered_normal(x, y);
      std::copy_n(normal.data(), 3, fragment.channel + kNormalX);
    }
    fragments.back() = picture_->merged(shader, x, y, picture_->kept(x, y));
  }

 private:
  struct TileWorker final : Worker {
    explicit TileWorker(const LayerCompositor& c) : compositor(c) {}
    void draw(std::span<const TileJob> jobs, TileABuffer& tile) override {
      PictureLayers& picture = *compositor.picture_;
      if (compositor.nearest_) {
        compositor.draw_nearest(jobs.front(), 1, images, tile);
        if (tile.shader->has_environment()) filter_surfaces(tile, picture);
        nearest.resize(kTilePixels);
        for (int pixel = 0; pixel < kTilePixels; ++pixel) {
          nearest[pixel] = nearest_layer(tile, pixel);
        }
      }
      const NearestLayer* masked = compositor.nearest_ ? nearest.data() : nullptr;
      const LayerSplats joint{&jobs.front(), jobs.size() > 1 ? &jobs.back() : nullptr};
      culled += compositor.joint_ ? blend_layers(joint, nullptr, picture, masked, tile, scratch)
                                  : blend_layers({.discs = &jobs.back()}, &compositor.rule(),
                                                 picture, masked, tile, scratch);
    }
    Fragment behind(int pixel) const override { return scratch.merged[pixel]; }
    bool waits(const TileABuffer& tile, int pixel) const override {
      const int x = tile.x0 + tile_pixel_x(pixel);
      const int y = tile.y0 + tile_pixel_y(pixel);
      PictureLayers& picture = *compositor.picture_;
      if (!tile.shader->has_environment() || !picture.at_border(x, y)) return false;
      return tile.fragment(0, pixel)[kWeight * kPatchPixels] > 0 || !picture.kept(x, y).empty();
    }
    void take_statistics(FrameStatistics& statistics) override {
      statistics.culled += std::exchange(culled, 0);
    }
    const LayerCompositor& compositor;
    GroupImages images;
    LayerScratch scratch;
    std::vector<NearestLayer> nearest;  ///< Nearest layer of each pixel, drawn by Algorithm 1.
    std::uint64_t culled = 0;
  };
  bool nearest_;
  bool joint_;  ///< LayersBy::kSurface.
  /// Workers write the pixels of their tiles.
  std::unique_ptr<PictureLayers> picture_ = std::make_unique<PictureLayers>();
};

class PeelCompositor final : public Compositor {
 public:
  PeelCompositor(const RenderOptions& options, int peel) : options_(options), peel_(peel) {}
  std::vector<SplatListOptions> lists() const override {
    // Each layer takes three passes over the splats.
    return {{.lowpass = options_.filter_deviation(), .large_splats = 56}};
  }
  int layers() const override { return peel_; }
  std::unique_ptr<Worker> make_worker() const override { return std::make_unique<TileWorker>(); }

 private:
  struct TileWorker final : Worker {
    void draw(std::span<const TileJob> jobs, TileABuffer& tile) override {
      peeled.add(peel_tile(jobs.front(), tile));
    }
    void take_statistics(FrameStatistics& statistics) override {
      statistics.peeled_layers = std::max(statistics.peeled_layers, peeled.layers);
      statistics.unpeeled_pixels += peeled.unpeeled_pixels;
      statistics.geometry_passes = std::max(statistics.geometry_passes, peeled.passes);
      peeled = {};
    }
    PeelStatistics peeled;
  };
  const RenderOptions& options_;
  int peel_;
};

/// SP06's baseline of 2+1 passes.
class TwoPassCompositor final : public Compositor {
 public:
  explicit TwoPassCompositor(const RenderOptions& options) : options_(options) {}
  std::vector<SplatListOptions> lists() const override {
    // Splats are sorted for the layers behind the first alone, and gone over twice.
    return {{.order = DepthOrder::kCoarse,
             .lowpass = options_.filter_deviation(),
             .large_splats = 176}};
  }
  int layers() const override { return layers_of_rims(options_); }
  std::unique_ptr<Worker> make_worker() const override { return std::make_unique<TileWorker>(); }

 private:
  struct TileWorker final : Worker {
    void draw(std::span<const TileJob> jobs, TileABuffer& tile) override {
      draw_two_pass(jobs.front(), tile);
    }
    void take_statistics(FrameStatistics& statistics) override {
      statistics.geometry_passes = kTwoPassGeometryPasses;
    }
  };
  const RenderOptions& options_;
};

class DeferredMethod final : public CompositingMethod {
 public:
  explicit DeferredMethod(Voronoi voronoi) : voronoi_(voronoi) {}
  RenderColumns columns() const override { return {.groups = true}; }
  std::unique_ptr<Compositor> make(const RenderCloud& cloud, const RenderOptions& options,
                                   bool opaque) const override {
    auto compositor = std::make_unique<DeferredCompositor>(cloud, options, voronoi_);
    if (!opaque) {
      throw_usage(
          "the deferred method draws the nearest surface alone, and the surfels or their materials "
          "are transparent; use the method transparent-high");
    }
    return compositor;
  }

 private:
  Voronoi voronoi_;
};

class LayerMethod final : public CompositingMethod {
 public:
  LayerMethod(const MethodOptions& method, bool nearest) : method_(method), nearest_(nearest) {}
  std::vector<std::string> problems(const RenderOptions& options) const override {
    std::vector<std::string> found;
    check_rule(found, !options.aovs,
               "depth and normals are not made by the transparent methods; leave them out");
    check_rule(found, options.relief == Relief::kNone,
               "relief needs depth, which is not made by the transparent methods; choose none");
    check_rule(found,
               method_.layers_by == LayersBy::kGroup || method_.voronoi == Voronoi::kWindowed,
               "other `voronoi` rules than windowed go with `layers_by` group alone");
    return found;
  }
  RenderColumns columns() const override {
    return {.groups = true, .group_radius = true, .copies = true};
  }
  std::unique_ptr<Compositor> make(const RenderCloud& cloud, const RenderOptions& options,
                                   bool /*opaque*/) const override {
    return std::make_unique<LayerCompositor>(cloud, options, method_, nearest_);
  }

 private:
  MethodOptions method_;
  bool nearest_;  ///< The nearest layer is interpolated: Algorithm 3.
};

class PeelMethod final : public CompositingMethod {
 public:
  explicit PeelMethod(int peel) : peel_(peel) {}
  std::vector<std::string> problems(const RenderOptions& /*options*/) const override {
    if (peel_ >= 1 && peel_ <= kMostLayers) return {};
    return {fmt::format("`peel` is {}; it must be in 1..{}", peel_, kMostLayers)};
  }
  std::unique_ptr<Compositor> make(const RenderCloud& /*cloud*/, const RenderOptions& options,
                                   bool /*opaque*/) const override {
    return std::make_unique<PeelCompositor>(options, peel_);
  }

 private:
  int peel_;
};

class TwoPassMethod final : public CompositingMethod {
 public:
  std::unique_ptr<Compositor> make(const RenderCloud& /*cloud*/, const RenderOptions& options,
                                   bool opaque) const override {
    if (!opaque) {
      throw_usage(
          "the two-pass method draws the nearest surface alone, and the surfels or their materials "
          "are transparent; use the A-buffer");
    }
    return std::make_unique<TwoPassCompositor>(options);
  }
};

}  // namespace

std::shared_ptr<const CompositingMethod> compositing_method(Method method,
                                                            const MethodOptions& options) {
  switch (method) {
    case Method::kABuffer:
      break;
    case Method::kDeferred:
      return std::make_shared<DeferredMethod>(options.voronoi);
    case Method::kTransparent:
      return std::make_shared<LayerMethod>(options, false);
    case Method::kTransparentHigh:
      return std::make_shared<LayerMethod>(options, true);
    case Method::kDepthPeel:
      return std::make_shared<PeelMethod>(options.peel);
    case Method::kTwoPass:
      return std::make_shared<TwoPassMethod>();
  }
  return nullptr;
}

RenderColumns columns_of(Method method) {
  const auto chosen = compositing_method(method);
  return chosen ? chosen->columns() : a_buffer_method().columns();
}

}  // namespace surfel
