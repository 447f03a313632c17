#pragma once

// The fragments of a tile's splats, one after the other, as the rasters of SP06's methods take
// them: plain loops, since these methods are there to be compared with.

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include <surfel/render/a_buffer.h>
#include <surfel/render/patch_sample.h>
#include <surfel/render/tile_raster.h>

namespace surfel {

/// A depth behind everything.
inline constexpr float kNoDepth = -std::numeric_limits<float>::infinity();

/// A splat's fragment in a pixel.
struct SplatFragment {
  std::size_t pixel;    ///< Place in the tile.
  std::uint32_t splat;  ///< Index into TileJob::splats.
  float beta, depth, epsilon, rho;

  /// The depth from which on fragments are of another surface.
  float reach() const { return depth + epsilon; }
};

/// A part of a job's order.
struct SplatSpan {
  std::size_t begin, end;
};

inline bool in_picture(const TileABuffer& tile, std::size_t pixel) {
  const auto at = static_cast<int>(pixel);
  return tile_pixel_x(at) < tile.width && tile_pixel_y(at) < tile.height;
}

inline std::uint32_t side_of(const TileJob& job, std::uint32_t splat) {
  return job.splats[splat].tag & kFrontTag;
}

/// Calls visit(part) for all splats, so many at a time that splats behind what has been drawn can
/// be left out.
template <class Visit>
void for_each_part(const TileJob& job, const Visit& visit) {
  for (std::size_t begin = 0; begin < job.count; begin += kHiddenEvery) {
    visit(SplatSpan{begin, std::min(begin + kHiddenEvery, job.count)});
  }
}

/// Calls visit(splat, first pixel, PatchSample) for the splats of a part and the patches that their
/// boxes meet.
/// \param hidden  null, or a depth for every pixel. A splat is left out of a patch where all depths
///     within the splat's epsilon lie behind the depths of all the patch's pixels.
template <class Visit>
void for_each_patch(const TileJob& job, const TileABuffer& tile, SplatSpan part,
                    const float* hidden, const Visit& visit) {
  std::array<float, kTilePixels / kPatchPixels> least;
  least.fill(hidden ? -kNoDepth : kNoDepth);
  for (std::size_t pixel = 0; hidden && pixel < kTilePixels; ++pixel) {
    float& of_patch = least[pixel / kPatchPixels];
    if (in_picture(tile, pixel)) of_patch = std::min(of_patch, hidden[pixel]);
  }
  const auto patch_at = [](int pixel, int origin) {
    return std::clamp(pixel - origin, 0, kTileSize - 1) / kStripWidth;
  };
  PatchSample sample;
  for (std::size_t i = part.begin; i < part.end; ++i) {
    const std::uint32_t index = job.order[i];
    const Splat& splat = job.splats[index];
    const float reach = (1 + job.rules->depth_epsilon) * splat.depth_range + splat.depth;
    const int bottom = patch_at(splat.box.y1, job.box_y);
    const int right = patch_at(splat.box.x1, job.box_x);
    for (int x = patch_at(splat.box.x0, job.box_x); x <= right; ++x) {
      for (int y = patch_at(splat.box.y0, job.box_y); y <= bottom; ++y) {
        const auto patch = static_cast<std::size_t>(x * (kTileSize / kStripWidth) + y);
        if (!(reach >= least[patch])) continue;
        const PatchPlace place{tile.x0, tile.y0, patch * kPatchPixels};
        sample_patch(job, index, place, sample);
        visit(index, place.pixel, sample);
      }
    }
  }
}

/// Calls visit(SplatFragment) for the fragments of a part's splats, in the order's sequence for
/// every pixel, and counts them. See for_each_patch().
template <class Visit>
void for_each_fragment(const TileJob& job, const TileABuffer& tile, SplatSpan part,
                       const float* hidden, const Visit& visit) {
  for_each_patch(
      job, tile, part, hidden, [&](std::uint32_t splat, std::size_t first, const PatchSample& s) {
        for (std::size_t i = 0; i < kPatchPixels; ++i) {
          if (!(s.beta[i] < job.rules->cutoff) || !in_picture(tile, first + i)) continue;
          ++*job.fragments;
          visit(SplatFragment{first + i, splat, s.beta[i], s.depth[i], s.epsilon[i], s.rho[i]});
        }
      });
}

/// Adds a contribution to an unmerged fragment; the first one sets its tag.
inline void add_contribution(const TileJob& job, const SplatFragment& f, Fragment& sum) {
  const Fragment fresh = unmerged(
      {f.rho, f.depth, job.splats[f.splat], job.normals ? job.normals + f.splat : nullptr, {}});
  if (sum.channel[kWeight] == 0) sum.channel[kTag] = fresh.channel[kTag];
  for (int c = 0; c < kFragmentChannels; ++c) {
    if (c != kTag && c != kBack) sum.channel[c] += fresh.channel[c];
  }
}

/// Stores an unmerged fragment as a pixel's layer.
inline void put_fragment(TileABuffer& tile, int layer, std::size_t pixel,
                         const Fragment& fragment) {
  for (int c = 0; c < tile.layout.channels(); ++c) {
    tile.at(layer, c, static_cast<int>(pixel)) = fragment.channel[c];
  }
}

/// Adds a contribution to a pixel's layer in place.
inline void add_to_layer(const TileJob& job, const SplatFragment& f, TileABuffer& tile, int layer) {
  Fragment sum{};
  load_fragment(tile, layer, static_cast<int>(f.pixel), sum);
  add_contribution(job, f, sum);
  put_fragment(tile, layer, f.pixel, sum);
}

}  // namespace surfel
