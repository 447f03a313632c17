// Zhang, Pajarola, "Single-Pass Point Rendering and Transparent Shading", 2006: Algorithm 1.

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <surfel/sp06/group_raster.h>
#include <surfel/sp06/tile_fragments.h>

namespace surfel {
namespace {

/// The nearest of some fragments; null if there are none.
const GroupFragment* nearest_of(std::span<const GroupFragment> fragments) {
  const GroupFragment* nearest = nullptr;
  for (const GroupFragment& f : fragments) {
    if (f.sum > 0 && (!nearest || f.depth > nearest->depth)) nearest = &f;
  }
  return nearest;
}

/// Does a fragment show the same side as the nearest one, and lie within its epsilon of a depth?
bool joins(const TileJob& job, const GroupFragment& f, const GroupFragment& nearest, float depth) {
  return f.sum > 0 && f.reach >= depth && side_of(job, f.splat) == side_of(job, nearest.splat);
}

/// The depth that a splat must reach to be seen: the nearest surface's, where it covers the pixel.
float hidden_depth(const TileJob& job, std::span<const GroupFragment> fragments,
                   float edge_weight) {
  const GroupFragment* nearest = nearest_of(fragments);
  if (!nearest) return kNoDepth;
  float weight = 0;
  for (const GroupFragment& f : fragments) {
    if (joins(job, f, *nearest, nearest->depth)) weight += f.sum;
  }
  return weight >= edge_weight ? nearest->depth : kNoDepth;
}

/// Puts a fragment where it belongs among the layers of its group.
void insert(const TileJob& job, const LayerRule& rule, GroupImages& images, std::size_t pixel,
            GroupFragment f) {
  for (int layer = 0; layer < images.layers(); ++layer) {
    GroupFragment& old = images.at(pixel, job.groups[f.splat], layer);
    if (!(old.sum > 0)) {
      old = f;
      return;
    }
    const bool nearer = f.depth > old.depth;
    const bool closer = f.key < old.key;
    if (std::abs(f.depth - old.depth) < f.reach - f.depth &&
        side_of(job, f.splat) == side_of(job, old.splat)) {
      const float sum = old.sum + f.sum;
      if (rule.voronoi == Voronoi::kOff ? nearer : closer) old = f;
      old.sum = sum;
      return;
    }
    // The fragment that is pushed out goes on to the next layer.
    if (rule.voronoi == Voronoi::kQuantised ? closer : nearer) std::swap(old, f);
  }
}

/// Figure 5 goes by the nearest fragment, which lets the far fragments of a steep or noisy surface
/// fall off as another layer; the mean depth of the fragments that the nearest one joins does not.
float anchor(const TileJob& job, std::span<const GroupFragment> fragments,
             const GroupFragment& nearest) {
  float weight = 0;
  float depth = 0;
  for (const GroupFragment& f : fragments) {
    if (!joins(job, f, nearest, nearest.depth)) continue;
    weight += f.rho;
    depth += f.rho * f.depth;
  }
  return std::min(nearest.depth, depth / weight);
}

/// Sums up the fragments of the nearest surface and takes them out of their images. The sum's
/// weight is the sum of all kernels, and its other channels are scaled to it.
Fragment take_surface(const TileJob& job, std::span<GroupFragment> fragments, std::size_t pixel,
                      GroupFragment nearest) {
  const float depth = anchor(job, fragments, nearest);
  Fragment sum{};
  float weight = 0;
  MaterialShares materials;
  for (GroupFragment& f : fragments) {
    if (!joins(job, f, nearest, depth)) continue;
    add_contribution(job, {pixel, f.splat, 0, f.depth, 0, f.rho}, sum);
    materials.add(std::bit_cast<float>(job.splats[f.splat].tag), f.rho);
    weight += f.sum;
    f.sum = 0;
  }
  const float scale = weight / sum.channel[kWeight];
  for (float& channel : sum.channel) channel *= scale;
  sum.channel[kTag] = std::bit_cast<float>(job.splats[nearest.splat].tag);
  if (job.normals && !job.rules->opaque) materials.store(sum);
  return sum;
}

}  // namespace

void rasterize_groups(const TileJob& job, const LayerRule& rule, const TileABuffer& weights,
                      GroupImages& images) {
  const bool skips_hidden = job.rules->opaque || images.layers() == 1;
  std::array<float, kTilePixels> hidden;
  hidden.fill(kNoDepth);
  for_each_part(job, [&](SplatSpan part) {
    for (std::size_t pixel = 0; skips_hidden && pixel < kTilePixels; ++pixel) {
      hidden[pixel] = hidden_depth(job, images.nearest(pixel), weights.edge_weight);
    }
    for_each_fragment(job, weights, part, hidden.data(), [&](const SplatFragment& f) {
      if (f.reach() < hidden[f.pixel]) return;
      float key = f.beta;  // Its root orders fragments alike.
      if (rule.voronoi == Voronoi::kQuantised) {
        key = rule.step(f.depth) + std::sqrt(f.beta / job.rules->cutoff);
      }
      insert(job, rule, images, f.pixel, {f.rho, f.rho, f.depth, f.reach(), key, f.splat});
    });
  });
}

void composite_groups(const TileJob& job, GroupImages& images, TileABuffer& tile) {
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
    for (int layer = 0; layer < tile.layout.layers; ++layer) {
      // The fragment in front of all is among the nearest of each group.
      const auto fragments = layer == 0 ? images.nearest(pixel) : images.all(pixel);
      const GroupFragment* nearest = nearest_of(fragments);
      if (!nearest) break;
      const Fragment surface = take_surface(job, fragments, pixel, *nearest);
      put_fragment(tile, layer, pixel, surface);
      if (surface.channel[kWeight] >= tile.edge_weight) break;
    }
  }
}

}  // namespace surfel
