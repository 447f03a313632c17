#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06), section
// 5.2.3: the layers of a picture's pixels merged, with an environment around them.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/render/a_buffer.h>

namespace surfel {

/// Averages the groups' images. Where there is an environment, the normals and the numbers of
/// layers that pixels mirror and refract it with are filtered over the pixels around them, across
/// the borders of tiles: a pixel at a border is merged when all tiles have been drawn.
///
/// The filter: mirrors and lenses turn rays steeply, while the normals and the layers of pixels
/// have steps of single groups and pixels. The methods that interpolate all surfaces have the pixel
/// filter instead.
///
/// A tile's pixels are written by the thread that draws the tile. Pixels of other tiles are read
/// when no thread draws.
class PictureLayers {
 public:
  /// Sums over the fragments of a pixel's nearest surface, weighted.
  struct Surface {
    float weight;  ///< 0 without a surface.
    Vec3f normal;
  };
  /// A group's pixel: the nearest layer, which is not shaded yet, over the colour of the others.
  struct GroupPixel {
    Fragment nearest;
    Rgba beneath;    ///< The others' colour in the share of the pixel that the nearest covers ...
    Rgba beside;     ///< ... and in the rest of the pixel, each times its share.
    float coverage;  ///< Share of the pixel that the nearest layer covers.
    float touched;   ///< Share of the pixel that any layer covers.
  };

  /// Begins a picture of `groups` groups.
  /// \param interpolated  The nearest surface is interpolated and no layer, as in SP06's
  ///     Algorithm 3.
  void begin(int width, int height, int groups, bool interpolated);

  int groups() const { return groups_; }
  /// Whether the filter reaches another tile from the pixel (x, y).
  bool at_border(int x, int y) const;
  /// The interpolated surface of a pixel.
  Surface& surface(int x, int y) { return surfaces_[index(x, y)]; }
  /// The sum over the groups' nearest layers.
  Surface& nearest(int x, int y) { return nearest_[index(x, y)]; }
  /// SP06's l: the number of layers.
  float& layers(int x, int y) { return layers_[index(x, y)]; }

  /// Keeps the groups that have a layer in a pixel at_border().
  void keep(int x, int y, std::span<const GroupPixel> groups);
  std::span<const GroupPixel> kept(int x, int y) const;

  /// The filtered normal of an interpolated surface, times the weight of its pixel. Where few
  /// groups have a splat in a pixel, their mean is not smooth enough to mirror an environment.
  /// Pixels without a surface, or with another one, count nothing.
  Vec3f filtered_normal(int x, int y) const;
  /// A pixel's layers as a merged fragment, as Compositor::Worker::behind() returns it; of weight 0
  /// if `groups`, which have a layer there, are none.
  Fragment merged(const Shader& shader, int x, int y, std::span<const GroupPixel> groups) const;

 private:
  /// The groups of a tile's outermost pixels.
  struct Border {
    struct Range {
      std::uint32_t begin, count;
    };
    std::array<Range, std::size_t{4} * kTileSize> pixels;
    std::vector<GroupPixel> groups;
  };

  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width_ + x; }
  std::size_t tile(int x, int y) const;
  template <class Visit>
  void for_each_around(int x, int y, const Visit& visit) const;
  Surface filtered_nearest(int x, int y) const;
  float filtered_layers(int x, int y) const;

  int width_ = 0, height_ = 0;
  int groups_ = 1;
  bool interpolated_ = false;
  // By pixel; left untouched, and so without memory, where there is no environment.
  Array<Surface> surfaces_;
  Array<Surface> nearest_;
  Array<float> layers_;
  std::vector<Border> borders_;  ///< By tile.
};

/// Hands the normals of a tile's interpolated surfaces to the picture, and filters them as far as
/// pixels are not at_border(). The A-buffer is unmerged and has normals.
void filter_surfaces(TileABuffer& tile, PictureLayers& picture);

}  // namespace surfel
