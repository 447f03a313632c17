#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/camera.h>

namespace surfel {

/// What became of a splat at a pixel.
enum class SplatFate : std::uint8_t {
  kBlended,    ///< It is part of a layer, or of what the method blends.
  kFilledUp,   ///< It came after its surface had been merged, and fills what the merged ones leave.
  kOutside,    ///< Its box holds the pixel, but its kernel, or what lines leave of it, ends before.
  kHidden,     ///< It lies behind a surface that covers the pixel, beyond the depth tolerance.
  kTooLate,    ///< It came after its surface had been merged, and its place among them is unknown.
  kTooLittle,  ///< No layer is free, and it is too little of the pixel to merge others for.
  kReplaced,   ///< The pixel has one layer, and a nearer surface came.
  kUnused,     ///< The method of compositing made nothing of it: another fragment is its layer's.
};

/// A splat whose box holds a pixel. Of Gaussians in space `kernel` is alpha by opacity, and
/// `weight` is alpha at the pixel.
struct ExplainedSplat {
  std::uint64_t surfel = 0;  ///< Its place in the cloud or file, 0 first.
  SplatFate fate = SplatFate::kUnused;
  /// Number of the layer that it is part of, 0 the nearest; -1: none, or the method has no layers.
  int layer = -1;
  bool exact = false;  ///< Its kernel is exact in perspective; else affine.
  bool front = true;   ///< The surfel's front faces the eye.
  /// It is summed up with others of a smooth surface before it meets the layers (render/sheet.h).
  bool in_sheet = false;
  std::optional<int> group;  ///< SP06's group, where the method has groups.
  double depth = 0;          ///< z along the view, scene units.
  double coefficient = 0;    ///< rho at the surfel's centre (of an exact kernel r_k there).
  double kernel = 0;         ///< Value of the Gaussian; of an exact kernel weight by coefficient.
  double clip = 1;           ///< Share of the kernel that half-planes leave, 0..1.
  double weight = 0;         ///< rho at the pixel: coefficient * kernel * clip.
  Vec3f color{0, 0, 0};      ///< Linear, not lit.
  double alpha = 1;
  /// The pixel has so much of the colour; of an opaque and unlit picture that is its part of the
  /// layer's weight times the layer's share. In lit pictures a layer is shaded as one, and has so
  /// much of its share from the splat.
  double share = 0;
};

/// Fragments of a pixel that have been resolved together.
struct ExplainedLayer {
  double depth = 0;        ///< z of it, or of the nearest surface in it, scene units.
  bool merged = false;     ///< Several surfaces, which were merged for want of layers.
  bool front = true;       ///< The side that is seen.
  double weight = 0;       ///< Sum of rho; 0 where surfaces are merged.
  std::size_t splats = 0;  ///< Number of splats in it.
  Vec3f color{0, 0, 0};    ///< Linear, as shaded; where it has no share, as far as known.
  double share = 0;        ///< The pixel has so much of the colour.
};

/// How a pixel of a picture came about. Without an environment,
///
///   pixel = relief * sum(layer's share * colour) + (1 - alpha) * background,
///
/// with alpha the sum of the layers' shares, and of unlit pictures the same sum over the splats.
struct PixelExplanation {
  int x = 0, y = 0;
  std::vector<ExplainedSplat> splats;  ///< In the order in which they were drawn.
  /// Nearest first. Methods without layers that tell their fragments have one, which is all of
  /// them, with the mean of the colours.
  std::vector<ExplainedLayer> layers;
  /// Colours are as displays take them (sRGB), and are blended so; `pixel` alone is linear.
  bool display = false;
  bool splats_add_up = true;  ///< The picture is not lit, so that splats, too, add up to the pixel.
  /// Factor that the filtered coverage of the pixels around put on opacity, and on all shares.
  double edge = 1;
  /// No kernel reaches the pixel: its colour is the mean of pixels around it at the edge.
  bool filled = false;
  double relief = 1;  ///< Factor on the colour, see relief.h.
  /// Light of the environment, mirrored and seen through surfaces or beside them.
  Vec3f environment{0, 0, 0};
  Vec3f surfaces{0, 0, 0};  ///< All of the above, premultiplied ...
  double alpha = 0;         ///< ... and its opacity.
  /// What lies behind, premultiplied R G B A.
  std::array<float, 4> background{0, 0, 0, 0};
  std::array<float, 4> pixel{0, 0, 0, 0};  ///< Premultiplied linear R G B A.
};

/// Throws Error(kUsage) unless the camera's picture, or the part of it that is drawn, has the
/// pixel.
SURFEL_API void require_in_picture(const Camera& camera, int x, int y);

}  // namespace surfel
