#pragma once

// SS01 sections 3.3 and 4, for a cluster of surfels at a time.

#include <cstdint>

#include <surfel/render/splat.h>

namespace surfel {

/// Most surfels that one call takes.
inline constexpr int kSetupSurfels = 256;

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
};

/// The surfels of which set-up made splats. Room for one vector past the end.
struct SetUpSplats {
  static constexpr int kSize = kSetupSurfels + 16;
  alignas(64) std::int32_t visible[kSize];  ///< Indices, ascending.
  /// Indices of the surfels that need an exact kernel, ascending: set-up makes nothing else of
  /// them.
  alignas(64) std::int32_t exact[kSize];
  int visible_count, exact_count;
  /// The number of visible splats whose box's first pixel in the picture lies in this rectangle:
  /// over all rectangles of a picture every splat is counted once.
  int first_count;
};

/// Projects `count` (<= kSetupSurfels) surfels and makes their resampling kernels (6); SIMD, chosen
/// at run time. Arrays may be read up to the next multiple of the vector length past `count`, so
/// columns carry padding (RenderCloud::kPadding). `visible` are those in front of the near plane as
/// a whole disc, with pixel centres of the clip rectangle in their box. `exact` are those for which
/// the affine approximation (4) is off by more than the tolerance somewhere on the disc, and those
/// that reach through the near plane (neither, where the tolerance is infinite).
/// `next` are those of the next call, or null: they are fetched from memory meanwhile, as clusters
/// follow one another in depth, not in memory.
/// \param splats  those of the visible ones, but for their materials and what these change
void set_up_splats(const SplatView& view, const SurfelColumns& surfels, int count,
                   const SurfelColumns* next, Splat* splats, SetUpSplats& out);

}  // namespace surfel
