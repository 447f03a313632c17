#pragma once

#include <bit>
#include <cstdint>

// Plain structures that the SIMD files share with the rest: raw numbers only, no Eigen type (its
// alignment depends on compiler flags, which differ from target to target there).

namespace surfel {

/// Pictures are rendered in square tiles, so that a tile's A-buffer stays in the first-level cache.
inline constexpr int kTileSize = 16;
inline constexpr int kTilePixels = kTileSize * kTileSize;
/// A tile's pixels are stored in vertical strips of this width, so that a vector of 16 holds 4 x 4
/// pixels, from any row on: most splats need one or two of them.
inline constexpr int kStripWidth = 4;
/// Square patches of a tile whose pixels follow one another.
inline constexpr int kPatchPixels = kStripWidth * kStripWidth;

/// Splats are set up for square blocks of tiles, 32, 64 or 128 pixels a side.
inline constexpr int kMostBlockSize = 128;

/// Place of a tile's pixel among its kTilePixels.
constexpr int tile_pixel(int x, int y) {
  return (x / kStripWidth * kTileSize + y) * kStripWidth + x % kStripWidth;
}
constexpr int tile_pixel_x(int pixel) {
  return pixel / (kTileSize * kStripWidth) * kStripWidth + pixel % kStripWidth;
}
constexpr int tile_pixel_y(int pixel) { return pixel / kStripWidth % kTileSize; }

/// Pixels of a block that the box of a splat holds, last ones included; counted from the block's
/// first pixel.
struct PixelBox {
  std::uint8_t x0, y0, x1, y1;

  bool operator==(const PixelBox&) const = default;
};

/// A surfel's resampling kernel, ready to be rasterised. With dx, dy from the centre in pixels:
/// beta = k (dx - m dy)^2 + q dy^2, the square completed along rows: unlike the conic's three
/// coefficients it does not cancel when the ellipse is a long diagonal sliver.
/// Depth is "nearness": 1 / z in perspective, -z in orthographic projection; larger is nearer.
/// A splat with k < 0 (kExactKernel) has an ExactSplat instead, at the same place of a parallel
/// array: of the fields before `box` it keeps only the place that the ExactSplat's functions are
/// centred at, and a depth to sort by.
struct alignas(64) Splat {
  float x, y;                ///< Centre, pixels.
  float m, k, q;             ///< Sigma_xy / Sigma_yy, Sigma_yy / (2 |Sigma|), 1 / (2 Sigma_yy).
  float amplitude;           ///< rho_k at the centre.
  float depth;               ///< At the centre ...
  float depth_dx, depth_dy;  ///< ... and per pixel, on the tangent plane.
  float depth_range;         ///< The plane's depth is clamped to depth +- depth_range.
  PixelBox box;              ///< Bounds beta < c, and SplatView::margin around it.
  float red, green, blue;    ///< Times alpha.
  float alpha;
  std::uint32_t tag;  ///< kFrontTag and the like; from kMaterialShift on: material.
};
static_assert(sizeof(Splat) == 64);

/// How much the depth of a splat's plane changes from pixel to pixel, as Splat::depth_dx and
/// depth_dy: in two halves of a number's bits, each the more significant half of a float.
struct DepthSlope {
  float x = 0, y = 0;

  static std::uint32_t pack(const Splat& splat) {
    return std::bit_cast<std::uint32_t>(splat.depth_dx) >> 16 |
           (std::bit_cast<std::uint32_t>(splat.depth_dy) & 0xFFFF0000U);
  }
  static DepthSlope unpack(std::uint32_t packed) {
    return {std::bit_cast<float>(packed << 16), std::bit_cast<float>(packed & 0xFFFF0000U)};
  }
};

/// Bits of Splat::tag.
inline constexpr std::uint32_t kFrontTag = 1;     ///< The surfel's front faces the eye.
inline constexpr std::uint32_t kFilteredTag = 2;  ///< Its shape is the pixel filter's, not its own.
inline constexpr std::uint32_t kGrazingTag = 4;   ///< It is seen at a grazing angle, see kGrazing.
inline constexpr std::uint32_t kClippedTag = 8;   ///< It has a SplatClip.
/// From this bit on, kEvenBits bits hold how many times the usual epsilon, which tells the splat
/// apart from others, is halved.
inline constexpr int kEvenShift = 4;
inline constexpr int kEvenBits = 3;
inline constexpr int kMostEven = (1 << kEvenBits) - 1;
inline constexpr std::uint32_t kEvenTag = std::uint32_t{kMostEven} << kEvenShift;  ///< All of them.
/// From this bit on, kSpacingBits bits tell how far the surfels are apart, see kSpacingSteps.
inline constexpr int kSpacingShift = kEvenShift + kEvenBits;
inline constexpr int kSpacingBits = 3;
/// The bits above hold the material.
inline constexpr int kMaterialShift = kSpacingShift + kSpacingBits;

/// Steps of the deviation of splats without the pixel filter, of which each is kSpacingStep of the
/// filter's deviation; the last one holds all that are larger: they are so coarse that pictures
/// cannot even their sums out at edges.
inline constexpr int kSpacingSteps = 1 << kSpacingBits;
inline constexpr float kSpacingStep = 3.0F / 7;
inline constexpr int kCoarseStep = kSpacingSteps - 1;
inline constexpr std::uint32_t kStepMask = kSpacingSteps - 1;
/// The step that a tag holds.
constexpr int spacing_step(std::uint32_t tag) {
  return static_cast<int>(tag >> kSpacingShift & kStepMask);
}

/// Of a curved or rough surface the tangent planes within a footprint differ in depth by up to its
/// radius; planes of a flat one agree, however large the footprint is. Of transparent surfaces half
/// of it leaves room for samples that are off by a little.
inline constexpr float kFlatEpsilon = 0.5F;
inline constexpr std::uint32_t kFlatTag = 1U << kEvenShift;

/// The cosine to the normal below which a surfel is seen at a grazing angle, as at the silhouette
/// of a body: on a sphere of 500 surfels a disc reaches from there to the silhouette.
inline constexpr float kGrazing = 0.25F;

/// Kernels with a smaller peak, as of surfels seen edge-on, are dropped: fragments would be left
/// without weight, or with one whose square is no number of single precision.
inline constexpr float kLeastAmplitude = 1e-15F;

/// Value of Splat::k that marks splats whose kernel is exact.
inline constexpr float kExactKernel = -1.0F;

/// The meeting point of a pixel's ray and the surfel's tangent plane (exact_kernel.h): affine
/// functions f[0] + f[1] dx + f[2] dy of the offset from (Splat::x, Splat::y), pixels.
struct alignas(64) ExactSplat {
  float u[3], v[3];          ///< Plane coordinates in standard deviations, times 1 / z.
  float depth[3];            ///< 1 / z.
  float amplitude;           ///< r_k at the surfel's centre.
  float depth_lo, depth_hi;  ///< 1 / z is clamped to these.
  float depth_most;          ///< At the near plane; infinity where that is the eye's.
  float deviation2;          ///< Largest variance of the surfel times 2 c, unit^2.
  float pixel2;  ///< Variance of the pixel filter on the plane at z = 1, times 2 c, unit^2.
};
static_assert(sizeof(ExactSplat) == 64);

/// The half-planes that a splat is cut by (clip_kernel.h): each leaves the share Phi(z) of its
/// kernel.
struct alignas(64) SplatClip {
  /// z = line[0] + line[1] dx + line[2] dy, pixels from the centre. Of an exact kernel: distance of
  /// the line from the surfel's centre, and the direction times the deviations along u and v, scene
  /// units. The first line is always there; where the second is not its z, or distance, is kNoClip.
  float line[2][3];
  /// Unit vector on the screen across the line, away from the part of the surfel that stays; zero
  /// where there is no line.
  float outward[2][2];
  float joint;   ///< joint_share() of two lines.
  float beyond;  ///< What lines cut off counts so many times, see beyond_growth().
};
static_assert(sizeof(SplatClip) == 64);

/// See SplatClip::line: far beyond all kernels.
inline constexpr float kNoClip = 1e18F;

/// Kernels are left out where a half-plane leaves a smaller share of them than this, Phi of
/// kLeastClip: nothing of it is seen in 8 bits.
inline constexpr float kLeastClipShare = 1e-3F;
inline constexpr float kLeastClip = -3.09023F;

/// From this argument on Phi is 1 within 4e-5, and lines cut nothing off.
inline constexpr float kWholeClip = 4;

/// See beyond_growth() in clip_kernel.h.
inline constexpr float kBeyondSmall = 1.4F;

/// World-space normal of a splat, in a record of its own as unshaded pictures do not need it.
struct SplatNormal {
  float x, y, z;
};

/// Camera and filter, in single precision, for one frame (or one horizontal band of it).
struct SplatView {
  float rotation[9];     ///< Row-major camera_from_world.
  float translation[3];  ///< Cloud's origin in camera space: p_camera = rotation p + translation.
  float focal_x, focal_y, center_x, center_y;
  float near;
  bool orthographic;
  bool cull_back;  ///< Drop surfels that face away from the eye.
  bool circular;   ///< Kernels as wide as their longer axis in all directions.
  /// Kernels whose affine approximation may be off by more than this are exact, pixels; < 0: all,
  /// infinity: none. Perspective projection only.
  float tolerance;
  float cutoff;         ///< c of beta < c.
  float lowpass2;       ///< Variance of the low-pass filter, pixels^2.
  float margin;         ///< Kernels' boxes reach so many pixels further.
  bool edges_filtered;  ///< See SplatListOptions.
  float beyond_growth;  ///< See beyond_growth().
  /// Splats outside of this rectangle of at most kMostBlockSize pixels a side are dropped.
  float clip_x0, clip_y0, clip_x1, clip_y1;
  bool first_column, first_row;  ///< The rectangle begins at the first column or row of the
                                 ///< picture's part that is drawn.
};

}  // namespace surfel
