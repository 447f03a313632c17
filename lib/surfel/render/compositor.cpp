#include <algorithm>

#include <surfel/render/a_buffer.h>
#include <surfel/render/compositor.h>
#include <surfel/render/tile_raster.h>

namespace surfel {
namespace {

class ABufferCompositor final : public Compositor {
 public:
  ABufferCompositor(const RenderOptions& options, bool opaque)
      : options_(options), opaque_(opaque) {}

  std::vector<SplatListOptions> lists() const override {
    return {
        {.order = DepthOrder::kCoarse, .lowpass = options_.filter_deviation(), .sheets = !opaque_}};
  }
  int layers() const override { return options_.layers; }
  /// A single layer has the side alone that is nearer, or that is not culled.
  bool sums_are_whole() const override { return options_.layers > 1 || options_.cull_back; }
  std::unique_ptr<Worker> make_worker() const override { return std::make_unique<TileWorker>(); }

 private:
  struct TileWorker final : Worker {
    void draw(std::span<const TileJob> jobs, TileABuffer& tile) override {
      rasterize_tile(jobs.front(), tile);
    }
    /// The rasteriser reads nothing else where there is no weight.
    void clear(const TileABuffer& tile) override {
      for (std::size_t pixel = 0; pixel < kTilePixels; pixel += kPatchPixels) {
        for (int layer = 0; layer < tile.layout.layers; ++layer) {
          std::fill_n(tile.fragment(layer, pixel), kPatchPixels, 0.0F);
        }
      }
    }
    void finish(TileABuffer& tile) override { drop_hidden(tile); }
  };
  const RenderOptions& options_;
  bool opaque_;
};

class ABufferMethod final : public CompositingMethod {
 public:
  bool needs_whole_tiles() const override { return false; }
  std::unique_ptr<Compositor> make(const RenderCloud& /*cloud*/, const RenderOptions& options,
                                   bool opaque) const override {
    return std::make_unique<ABufferCompositor>(options, opaque);
  }
};

}  // namespace

void FrameStatistics::add(const FrameStatistics& other) {
  milliseconds += other.milliseconds;
  for (const auto& [stage, time] : other.stages.stages()) stages.add(stage, time);
  clusters += other.clusters;
  splats += other.splats;
  exact_splats += other.exact_splats;
  thinned_splats += other.thinned_splats;
  geometry_passes = std::max(geometry_passes, other.geometry_passes);
  fragments += other.fragments;
  merged += other.merged;
  late_weight_share = std::max(late_weight_share, other.late_weight_share);
  groups = other.groups;
  culled += other.culled;
  peeled_layers = std::max(peeled_layers, other.peeled_layers);
  unpeeled_pixels += other.unpeeled_pixels;
}

void Compositor::Worker::clear(const TileABuffer& tile) {
  std::fill_n(tile.data, tile.layout.size(), 0.0F);
}

Fragment Compositor::Worker::behind(int /*pixel*/) const { return {}; }

const CompositingMethod& a_buffer_method() {
  static const ABufferMethod method;
  return method;
}

}  // namespace surfel
