#pragma once

// The compositing methods by name. Zwicker, Pfister, van Baar, Gross, "Surface Splatting", SIGGRAPH
// 2001 (SS01); Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06).

#include <cstdint>
#include <memory>

#include <surfel/base/export.h>
#include <surfel/render/compositor.h>
#include <surfel/sp06/layer_rule.h>

namespace surfel {

/// The way in which a pixel's splats are composited.
enum class Method : std::uint8_t {
  kABuffer,      ///< SS01 section 6: surfaces separated and interpolated as splats arrive.
  kDeferred,     ///< SP06's Algorithm 1, for opaque surfaces: an image for each group, composited.
  kTransparent,  ///< SP06's Algorithm 2: layers blended in each group's image, images averaged.
  kTransparentHigh,  ///< SP06's Algorithm 3: the nearest layer by Algorithm 1, the others by 2.
  kDepthPeel,        ///< One surface after another: the reference that SP06 compares with.
  kTwoPass,          ///< Visibility first, attributes then: SP06's baseline for opaque surfaces.
};

/// How the methods kTransparent and kTransparentHigh tell the layers of a pixel.
enum class LayersBy : std::uint8_t {
  /// By the discs of all groups together (joint_layers.h): enlarged and added splats close holes
  /// and
  /// make no layers of their own, and rims are antialiased as the A-buffer's are. Goes with
  /// Voronoi::kWindowed.
  kSurface,
  /// As published: by each group's splats alone (group_layers.h). Nearer by 2 to 5 dB to depth
  /// peeling is kSurface.
  kGroup,
};

/// Options of the methods that draw by groups, or layer by layer.
struct MethodOptions {
  Voronoi voronoi = Voronoi::kWindowed;  ///< Rule of the methods with groups.
  LayersBy layers_by = LayersBy::kSurface;
  int peel = 8;  ///< Most layers that kDepthPeel peels, 1..64.
};

/// The method for RenderOptions::method. Its problems() include those of `options`.
SURFEL_API std::shared_ptr<const CompositingMethod> compositing_method(
    Method method, const MethodOptions& options = {});

/// The columns of a RenderCloud that a method needs.
SURFEL_API RenderColumns columns_of(Method method);

}  // namespace surfel
