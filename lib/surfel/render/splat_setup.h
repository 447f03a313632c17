#pragma once

// SS01 sections 3.3 and 4, for a cluster of surfels at a time.

#include <cstdint>
#include <limits>

#include <surfel/render/splat.h>

namespace surfel {

/// Most surfels that one call takes.
inline constexpr int kSetupSurfels = 256;

/// Half-planes that cut surfels, RenderCloud::ClipColumns, from a cluster's first surfel on.
struct HalfPlaneColumns {
  const float* x;
  const float* y;
  const float* z;
  const float* distance;
};

/// By how much the tangent planes of a surface's surfels are off each other: that far along their
/// normals, `bend` times half the square of the distance between surfels plus `rough`. Infinity: it
/// is not known.
struct Unevenness {
  float bend = std::numeric_limits<float>::infinity();
  float rough = 0;
};

/// Columns of a RenderCloud from a cluster's first surfel on. Null: the scene does not have it.
struct SurfelColumns {
  const float* x;
  const float* y;
  const float* z;
  const float* normal_x;
  const float* normal_y;
  const float* normal_z;
  const float* deviation_u;
  const float* deviation_v;
  const float* tangent_x;
  const float* tangent_y;
  const float* tangent_z;
  const float* area;
  const float* red;
  const float* green;
  const float* blue;
  const float* alpha;
  HalfPlaneColumns clip[2];
  Unevenness uneven = {};
};

/// Indices of the surfels that one call selected, in the order of the columns. Arrays have room for
/// one vector past their end.
struct SetUpSplats {
  static constexpr int kSize = kSetupSurfels + 16;
  alignas(64) std::int32_t visible[kSize];  ///< Surfels that became splats.
  /// Surfels that need an exact kernel, for which the call makes no splat.
  alignas(64) std::int32_t exact[kSize];
  int visible_count, exact_count;
  /// Number of visible splats whose box has its first pixel in the clip rectangle: over all
  /// rectangles of a picture every splat is counted once.
  int first_count;
};

/// Projects `count` (<= kSetupSurfels) surfels and makes their resampling kernels (6); SIMD, chosen
/// at run time. Arrays may be read up to the next multiple of the vector length past `count`, so
/// columns carry padding (RenderCloud::kPadding). A surfel is put into out.visible if its whole
/// disc lies in front of the near plane and its box holds a pixel's centre of the clip rectangle. A
/// surfel is put into out.exact instead if its disc reaches through the near plane, or if the
/// affine approximation (4) is off by more than the tolerance somewhere on the disc; with an
/// infinite tolerance out.exact stays empty. Of surfels that half-planes cut, no splats are made
/// where less than kLeastClipShare of the kernel is left everywhere.
/// \param next    columns of the next call's surfels, or null: they are fetched from memory
///                meanwhile, since clusters follow one another in depth, not in memory.
/// \param splats  gets a splat for each surfel of out.visible; materials and their effects on
///                colour and opacity are left to the caller.
/// \param clips   parallel to `splats`, with room for one vector past their end: gets what
///                half-planes leave of them, see kClippedTag. Not touched where the surfels have no
///                half-planes.
void set_up_splats(const SplatView& view, const SurfelColumns& surfels, int count,
                   const SurfelColumns* next, Splat* splats, SplatClip* clips, SetUpSplats& out);

}  // namespace surfel
