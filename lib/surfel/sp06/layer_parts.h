#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06), sections 3.3
// and 5.2: the parts that both ways of telling layers share (layer_blend.h, joint_blend.h).

#include <array>
#include <cstdint>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/picture_layers.h>

namespace surfel {

/// What hides layers in a tile: planes of kTilePixels with a depth, and with the side (kFrontTag or
/// 0) that the depth's surface shows.
struct HiddenLayers {
  Array<float> planes;

  /// \param masked  the nearest layer of every pixel, which is hidden with all in front of it;
  ///     pixels without one are hidden whole. Null: nothing is hidden but pixels outside of the
  ///     picture.
  void set(const TileABuffer& tile, const NearestLayer* masked);
};

/// Colours of splats that reflect an environment.
struct ShadedSplats {
  std::vector<Rgba> colors;          ///< By the splats' indices ...
  std::vector<std::uint64_t> loads;  ///< ... and the TileJob::load of each.

  /// Makes room for the job's splats.
  void reserve(const TileJob& job);
};

/// The fragment of a lit splat that covers its pixel.
Fragment layer_fragment(const TileJob& job, std::uint32_t index, float depth);

/// Weight of a nearest fragment in its pixel's mean, by sqrt(beta / cutoff). Fragments count most
/// near their splat's centre and next to nothing at its rim: the groups' splats are flat, and the
/// mean normal and the refracted light are to have no steps there.
float nearest_weight(float key);

/// The groups that have a layer, pixel by pixel of a tile.
struct TileGroups {
  std::vector<PictureLayers::GroupPixel> groups;
  std::array<std::uint32_t, kTilePixels + 1> begin{};

  void clear() { groups.clear(); }
  /// Ends the pixel whose groups have been added. Pixels come in the tile's order.
  void end_pixel(std::size_t pixel) {
    begin[pixel + 1] = static_cast<std::uint32_t>(groups.size());
  }
};

/// Merges the pixels of a tile, whose PictureLayers::nearest() and layers() are set, with an
/// environment around. Pixels at_border() are kept for later.
void merge_groups(const TileGroups& groups, const TileABuffer& tile, PictureLayers& picture,
                  std::vector<Fragment>& merged);

}  // namespace surfel
