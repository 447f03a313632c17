#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): sections 3.2
// and 5.1, a tile at a time.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/render/a_buffer.h>
#include <surfel/render/tile_raster.h>
#include <surfel/sp06/layer_rule.h>

namespace surfel {

/// A group's fragment in a pixel. As nothing is interpolated, it names its splat instead of keeping
/// the splat's attributes.
struct GroupFragment {
  float sum = 0;            ///< Sum of rho of the layer, culled fragments included; 0: no fragment.
  float rho = 0;            ///< Weight w_i.
  float depth = 0;          ///< c_d, as Splat::depth.
  float reach = 0;          ///< The depth plus epsilon: fragments that reach it are of one surface.
  float key = 0;            ///< The value that Voronoi rasterisation compares.
  std::uint32_t splat = 0;  ///< Index into TileJob::splats.
};

/// The images I_k of a tile, one for each group; every pixel has the fragment that won it (SP06
/// (4)). SP06 keeps the nearest layer; with more than one, each group keeps its layers behind, too,
/// which show at the edges of nearer surfaces.
class GroupImages {
 public:
  /// Makes empty images of `layers` layers for each of `groups` groups. Keeps its memory.
  void reset(int groups, int layers) {
    groups_ = groups;
    layers_ = layers;
    data_.assign(static_cast<std::size_t>(groups) * layers * kTilePixels, {});
  }
  int layers() const { return layers_; }
  GroupFragment& at(std::size_t pixel, int group, int layer) {
    return data_[first(pixel) + static_cast<std::size_t>(layer) * groups_ + group];
  }
  /// The groups' fragments in a pixel: the nearest layer's of all groups, or of all layers.
  std::span<GroupFragment> nearest(std::size_t pixel) {
    return std::span(data_).subspan(first(pixel), groups_);
  }
  std::span<GroupFragment> all(std::size_t pixel) {
    return std::span(data_).subspan(first(pixel), static_cast<std::size_t>(groups_) * layers_);
  }

 private:
  std::size_t first(std::size_t pixel) const { return pixel * groups_ * layers_; }

  int groups_ = 0;
  int layers_ = 0;
  std::vector<GroupFragment> data_;
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
