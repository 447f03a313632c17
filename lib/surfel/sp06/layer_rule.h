#pragma once

// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006 (SP06): which
// fragments of a group are of one layer.

#include <cmath>
#include <cstdint>

#include <surfel/render/render_options.h>
#include <surfel/scene/camera.h>
#include <surfel/store/render_cloud.h>

namespace surfel {

/// The rule by which fragments of a group are of one layer, and by which one of them stays: see
/// group_raster.h and group_layers.h.
enum class Voronoi : std::uint8_t {
  kOff,        ///< Each is a layer; Algorithm 1 keeps the nearest, Algorithm 2 blends all.
  kQuantised,  ///< Fragments in one step of the depth, SP06 (6) and (10), with seams between steps.
  kWindowed,   ///< Fragments within epsilon of one another. The fragment nearest to its splat's
               ///< centre stays.
};

/// The rule with its figures for one picture.
struct LayerRule {
  Voronoi voronoi = Voronoi::kWindowed;
  bool orthographic = false;
  float nearest = 0;         ///< d_min of SP06 (6): least z of the scene.
  float steps_per_unit = 1;  ///< n / (d_max - d_min) there.

  /// Number of the step of SP06 (6) that a Splat::depth is in, counted from the nearest.
  float step(float depth) const {
    const float z = orthographic ? -depth : 1 / depth;
    return std::floor((z - nearest) * steps_per_unit);
  }
  /// Whether fragments of a group and of one side are of one layer.
  bool one_layer(float depth, float other, float epsilon) const {
    if (voronoi == Voronoi::kOff) return false;
    if (voronoi == Voronoi::kQuantised) return step(depth) == step(other);
    return std::abs(depth - other) < epsilon;
  }
};

/// The rule of a picture. SP06 (6): n is the least that its text allows, (d_max - d_min) / epsilon,
/// with the footprint of the mean surfel at the scene's centre for the epsilon that the paper takes
/// as given.
LayerRule layer_rule(const RenderCloud& cloud, const RenderOptions& options, Voronoi voronoi,
                     const Camera& camera);

}  // namespace surfel
