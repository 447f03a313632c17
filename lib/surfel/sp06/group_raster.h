#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): sections 3.2
// and 5.1, a tile at a time.

#include <cstddef>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>
#include <surfel/render/splat.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/layer_rule.h>

namespace surfel {

/// The images I_k of a tile, one for each group; every pixel has the fragment that won it (SP06
/// (4)). As nothing is interpolated, a fragment names its splat instead of keeping its attributes.
/// SP06 keeps the nearest layer; with more than one, each group keeps its layers behind, too, which
/// show at the edges of nearer surfaces.
class GroupImages {
 public:
  /// Planes of kTilePixels floats.
  enum Channel : int {
    kSum,       ///< Sum of rho of the layer, culled fragments included; 0: no fragment.
    kRho,       ///< Weight w_i.
    kNearness,  ///< c_d, as Splat::depth.
    kReach,     ///< kNearness plus epsilon: fragments that reach this depth are of one surface.
    kKey,       ///< The value that Voronoi rasterisation compares.
    kEntry,     ///< Index of the splat, times 2, plus 1 if its front is seen; bits.
    kChannels
  };

  /// Makes empty images of `layers` layers for each of `groups` groups. Keeps its memory.
  void reset(int groups, int layers);
  int groups() const { return groups_; }
  int layers() const { return layers_; }
  /// Number of a group's image; the nearest layers of all groups come first.
  int image(int group, int layer) const { return layer * groups_ + group; }
  float* plane(int image, int channel) {
    return data_.data() + (static_cast<std::size_t>(image) * kChannels + channel) * kTilePixels;
  }

 private:
  int groups_ = 0;
  int layers_ = 0;
  Array<float> data_;
};

/// Geometry pass of SP06's Algorithm 1: rasterises splats into the images of their groups, where
/// the nearest fragment of a pixel wins. Among fragments of one layer (`rule`) the fragment that
/// lies nearer to its splat's centre does, in units of the splat's size, sqrt(beta / cutoff): the
/// splats of a group that overlap are cut where they meet instead of lapping over one another
/// (Voronoi rasterisation). kQuantised: SP06 (10), the least of floor((z - d_min) / (d_max - d_min)
/// n) + sqrt(beta / cutoff). It cuts a surface wherever it crosses a step of the depth. kWindowed:
/// layers are told apart by |difference of depth| < epsilon and the side seen. kOff: the nearest.
/// The kernels of fragments that lose to one of their surface still count for its coverage (SS01
/// section 7), which SP06 has not: a sum is kept for it. Splats behind a surface that already
/// covers the tile are skipped, where no part of them would be seen: in opaque pictures, and where
/// a single layer is kept.
/// \param weights  a tile's weights that cover a pixel, see TileABuffer.
void rasterize_groups(const TileJob& job, const LayerRule& rule, const TileABuffer& weights,
                      GroupImages& images);

/// Compositing pass, SP06 figure 5: of every pixel the fragments of all images within epsilon of
/// the nearest one, and of its side, are averaged by their weights to the surface's fragment in the
/// A-buffer, which must be empty. Where the surface does not cover its pixel, at its edge, the
/// fragments left over are averaged in the same way, up to the A-buffer's number of layers. Uses up
/// the images.
void composite_groups(const TileJob& job, GroupImages& images, TileABuffer& tile);

}  // namespace surfel
