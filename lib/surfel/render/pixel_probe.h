#pragma once

// Follows the splats of one pixel while a picture is drawn, to explain it (pixel_explanation.h).

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/compositor.h>
#include <surfel/render/edge_search.h>
#include <surfel/render/pixel_explanation.h>
#include <surfel/render/shading.h>
#include <surfel/render/splat_lists.h>
#include <surfel/render/tile_raster.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/image.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// Draws the splats of one pixel once more, beside the picture, and tells what becomes of each.
///
/// Nothing is computed by rules of its own. Where the A-buffer takes splats as they arrive, the
/// tile's splats that reach the pixel are handed to the rasteriser one at a time, and what it
/// changes in the pixel's layers tells where they went. Colours enter all of a picture's steps
/// linearly unless surfaces are lit: a unit of colour in one layer, or in one splat, and none in
/// all others, resolves to that one's share of the pixel.
class PixelProbe {
 public:
  /// Keeps a reference to the cloud.
  /// \param replays  The A-buffer takes splats as they arrive; else a method composites all of a
  ///                 tile's at once.
  PixelProbe(const Camera& camera, const RenderCloud& cloud, int x, int y, bool replays);

  int x() const { return result_.x; }
  int y() const { return result_.y; }
  /// Whether the pixel is in the tile of these first pixels.
  bool meets(int x0, int y0) const;
  /// Before splats of the pixel's tile are drawn.
  /// \param lists  what the jobs are of, as loaded by the worker.
  void draw(const TileABuffer& tile, std::span<const TileJob> jobs, std::span<SplatLists> lists,
            int worker, Compositor::Worker& compositor);
  /// When all splats of the pixel's tile are drawn.
  /// \param plain  Its plain pixels are resolved by resolve_plain_pixels().
  void keep(const TileABuffer& tile, bool plain);
  /// When the tiles around are drawn as well.
  void resolve(const TileRims& rims, const Shader& shader);
  /// The pixel's colours, over nothing, before edges are filtered, before relief, and at last.
  void note(const Image& image, int stage);
  /// \param background  premultiplied.
  PixelExplanation finish(const Rgba& background, bool lit, bool environment);

 private:
  /// A part of a layer's sums: of each channel of colour a splat's, times `part`.
  struct Member {
    std::size_t splat;  ///< Place in result_.splats.
    double part;
  };
  /// A splat, with all that belongs to it.
  struct One {
    Splat splat;
    SplatNormal normal;
    ExactSplat exact;
    SplatClip clip;
  };
  /// What is added to the pixel at a time: a splat, or a sheet.
  struct Event {
    TileJob job;  ///< Draws it alone.
    std::vector<Member> members;
    Fragment fresh;  ///< What it makes of the pixel alone.
    float depth, epsilon;
    float rho() const { return fresh.channel[kWeight]; }
  };
  /// The splats of a tile, on their way through the pixel's layers.
  struct Replay {
    const TileJob& job;
    SplatLists& list;
    int worker;
    TileABuffer state;  ///< Of it the pixel alone is as it is in the picture.
    RasterReplay how;
    float least_to_merge = 0;
  };
  /// Adds an event to a tile, with the colours of another fragment.
  using AddAgain = std::function<void(TileABuffer& tile, const Fragment& fresh)>;
  /// A pixel's patch of the A-buffer, and what lies behind it, with units of colour in three
  /// splats.
  struct Response {
    std::vector<float> patch;
    Fragment behind;
  };
  using Layers = std::vector<Fragment>;

  float* patch_of(const TileABuffer& tile) const {
    return tile.fragment(0, pixel_) - pixel_ % kPatchPixels;
  }
  bool in_box(const TileJob& job, const PixelBox& box) const;
  bool patch_in_box(const TileJob& job, const PixelBox& box) const;
  TileJob single(const TileJob& job, std::uint32_t index);
  TileJob single_sheet(const TileJob& job, const SheetPatch& sheet, bool normals);
  Fragment alone(const TileABuffer& tile, TileJob job);
  std::size_t add_splat(const TileJob& job, std::uint32_t row, const Fragment& fragment);
  float hidden(const TileABuffer& state) const;
  float least_hidden(const TileABuffer& state) const;
  static Layers layers_of(const TileABuffer& tile, int pixel);
  static float least_to_merge(const TileABuffer& tile, const TileJob& job, std::size_t begin,
                              std::size_t end);
  std::vector<std::uint32_t> listed_splats(const TileJob& job, std::size_t begin, std::size_t end,
                                           float hidden) const;
  void draw_part(const TileJob& job, std::size_t begin, std::size_t end, std::uint32_t first_sheet,
                 std::uint32_t end_sheet, TileABuffer& tile);
  Event event_of(const TileABuffer& tile, const TileJob& job, std::uint32_t index);
  void replay(const TileABuffer& tile, const TileJob& job, SplatLists& list, int worker);
  void replay_together(Replay& r, std::span<const std::uint32_t> splats);
  bool offer(Replay& r, Event& event);
  bool add_without_layer(Replay& r, const Event& event);
  void replay_sheet(Replay& r, const SheetPatch& sheet);
  static SplatFate why_dropped(const Replay& r, const Layers& layers, const Event& event);
  void set_fate(const std::vector<Member>& members, SplatFate fate);
  std::vector<float> patch_copy(const TileABuffer& tile) const;
  bool settle(Replay& r, const Event& event, std::span<const float> patch, Layers before,
              const AddAgain& again);
  std::array<double, 3> parts_of(const Replay& r, const Event& event, std::span<const float> patch,
                                 const AddAgain& again, int first, int second);
  void respond(const TileABuffer& tile, std::span<const TileJob> jobs, std::span<SplatLists> lists,
               int worker, Compositor::Worker& compositor);
  Rgba resolved(std::span<const float> patch, const Fragment& behind, const TileRims& rims);
  void resolve_layers(const TileRims& rims, const Shader& shader);

  const RenderCloud& cloud_;
  const bool replays_;
  const Shader unlit_;
  PixelExplanation result_;
  int pixel_ = 0;                             ///< In its tile.
  std::vector<std::vector<Member>> members_;  ///< By layer, as stored.
  std::vector<Response> responses_;           ///< Of three splats each.
  TileABuffer kept_tile_;
  bool plain_ = false;  ///< Of keep().
  Array<float> kept_;   ///< kept_tile_'s fragments.
  std::array<std::array<float, 4>, 3> stages_{};
  // Scratch.
  Array<float> state_, blank_;  ///< Aligned as rasterisers want it.
  One one_{};
  std::array<std::uint32_t, 1 + kTileSize> order_{};  ///< The first splat.
  std::array<float, kTilePixels> epsilon_{};          ///< Of the splat drawn last by alone().
  Array<float> sheet_sums_;
  SheetPatch sheet_{};
  std::array<std::uint32_t, kTilePixels / kPatchPixels + 1> sheet_begin_{};
  std::uint64_t fragments_ = 0;
};

}  // namespace surfel
