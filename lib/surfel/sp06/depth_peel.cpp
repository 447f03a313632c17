// Everitt, "Interactive Order-Independent Transparency", 2001, with the smooth interpolation of
// splats that Zhang, Pajarola, 2006, peel with.

#include <algorithm>
#include <array>

#include <surfel/sp06/depth_peel.h>
#include <surfel/sp06/tile_fragments.h>

namespace surfel {
namespace {

/// Depths in a pixel, of each side of the surface that may be seen.
using SideDepths = std::array<float, 2>;

float nearest(const SideDepths& sides) { return std::max(sides[0], sides[1]); }

class Peeler {
 public:
  Peeler(const TileJob& job, TileABuffer& tile) : job_(job), tile_(tile) {
    peeled_.fill({-kNoDepth, -kNoDepth});
  }

  PeelStatistics run() {
    PeelStatistics statistics;
    while (find_next()) {
      if (statistics.layers == tile_.layout.layers) {
        for (const SideDepths& sides : next_) {
          statistics.unpeeled_pixels += nearest(sides) > kNoDepth ? 1 : 0;
        }
        break;
      }
      add_layer(statistics.layers++);
    }
    statistics.passes = passes_;
    return statistics;
  }

 private:
  using Plane = std::array<SideDepths, kTilePixels>;

  /// Calls body(fragment, side) for all fragments that no layer has, in pixels that have a depth in
  /// the plane `open`.
  template <class Body>
  void for_each_left(const Plane& open, const Body& body) {
    ++passes_;
    std::array<float, kTilePixels> closed;
    for (std::size_t p = 0; p < kTilePixels; ++p) {
      closed[p] = nearest(open[p]) > kNoDepth ? kNoDepth : -kNoDepth;
    }
    for_each_fragment(job_, tile_, {0, job_.count}, closed.data(), [&](const SplatFragment& f) {
      const std::uint32_t side = side_of(job_, f.splat);
      if (f.reach() < peeled_[f.pixel][side]) body(f, side);
    });
  }

  /// Depth of the nearest fragment left in every pixel, of the side that is nearer; none of the
  /// other. Returns whether there are any.
  bool find_next() {
    next_.fill({kNoDepth, kNoDepth});
    for_each_left(peeled_, [&](const SplatFragment& f, std::uint32_t side) {
      float& next = next_[f.pixel][side];
      next = std::max(next, f.depth);
    });
    bool found = false;
    for (auto& [back, front] : next_) {
      found = found || std::max(back, front) > kNoDepth;
      (front >= back ? back : front) = kNoDepth;
    }
    return found;
  }

  void add_layer(int layer) {
    for_each_left(next_, [&](const SplatFragment& f, std::uint32_t side) {
      if (reaches(next_, f, side)) add(f, layer);
    });
    // With the nearest fragment alone as the measure, the far fragments of a steep or noisy surface
    // would fall off as another layer: a fragment that reaches the mean depth of the fragments that
    // joined belongs to them. Rounding must not move the mean in front of the depths that it is the
    // mean of.
    Plane mean = next_;
    for (std::size_t p = 0; p < kTilePixels; ++p) {
      const float* const sums = tile_.fragment(layer, p);
      const float depth = sums[kDepth * kPatchPixels] / sums[kWeight * kPatchPixels];
      for (float& side : mean[p]) side = side > kNoDepth ? std::min(side, depth) : side;
    }
    for_each_left(mean, [&](const SplatFragment& f, std::uint32_t side) {
      if (reaches(mean, f, side) && !reaches(next_, f, side)) add(f, layer);
    });
    for (std::size_t p = 0; p < kTilePixels; ++p) {
      for (std::size_t side = 0; side < 2; ++side) {
        if (mean[p][side] > kNoDepth) peeled_[p][side] = mean[p][side];
      }
      if (closes(layer, p)) peeled_[p] = {kNoDepth, kNoDepth};
    }
  }

  static bool reaches(const Plane& plane, const SplatFragment& f, std::uint32_t side) {
    const float depth = plane[f.pixel][side];
    return depth > kNoDepth && f.reach() >= depth;
  }

  void add(const SplatFragment& f, int layer) {
    if (f.rho > 0) add_to_layer(job_, f, tile_, layer);
  }

  /// Whether a pixel's layer hides everything behind it.
  bool closes(int layer, std::size_t pixel) const {
    const float* const sums = tile_.fragment(layer, pixel);
    const float weight = sums[kWeight * kPatchPixels];
    return weight >= tile_.edge_weight &&
           (job_.rules->opaque || sums[kAlpha * kPatchPixels] >= weight * kOpaqueAlpha);
  }

  const TileJob& job_;
  TileABuffer& tile_;
  Plane peeled_;  ///< Depth of the side's last layer; fragments that do not reach it are left.
  Plane next_;    ///< Depth of the nearest fragment left.
  int passes_ = 0;
};

}  // namespace

PeelStatistics peel_tile(const TileJob& job, TileABuffer& tile) { return Peeler(job, tile).run(); }

}  // namespace surfel
