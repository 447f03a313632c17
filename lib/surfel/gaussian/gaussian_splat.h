#pragma once

#include <cstdint>

namespace surfel {

/// Side of the tiles of a picture of Gaussians, pixels: what the profiles' bounds are rounded to.
inline constexpr int kGaussianTile = 16;

/// Binary logarithm of the least alpha that trained renderers blend, 1/255.
inline constexpr float kLeastLogAlpha = -7.99435343685886F;

/// A Gaussian in the picture. With (dx, dy) from its centre to a pixel's, in pixels, alpha is
///     2^(log_opacity - (xx dx^2 + xy dx dy + yy dy^2) / den),
/// where den is 1 for affine kernels, else GaussianPerspective's. One cache line.
struct alignas(64) GaussianSplat {
  float x, y;        ///< Centre, pixels.
  float xx, xy, yy;  ///< Exponent, base 2.
  float
      log_opacity;  ///< Binary logarithm of alpha at the centre; of the optical depth, of density.
  float z;          ///< Depth of the centre.
  float cut;        ///< kExact, kSurfel: the exponent, base 2, at which the kernel ends.
  float red, green, blue;
  std::uint16_t x0, y0;  ///< First and ...
  std::uint16_t x1, y1;  ///< ... last pixel in which it may be seen.
  union {
    float low_x;    ///< k2dgs: from the centre to the one of the disc's box, pixels ...
    float epsilon;  ///< kSurfel: surfaces whose depths differ by less are one.
  };
  float low_y;    ///< ... along y.
  float nearest;  ///< kExact, kSurfel: no contribution is nearer than this depth.
};
static_assert(sizeof(GaussianSplat) == 64);

/// What perspective adds to a kernel: den = d + dx x + dy y + dxx x^2 + dxy x y + dyy y^2 with
/// (x, y) from the centre to the pixel's. The depth of a pixel's largest contribution is
/// (z d + tx x + ty y) / den.
struct GaussianPerspective {
  float d, dx, dy, dxx;
  float dxy, dyy;
  float tx, ty;
};
static_assert(sizeof(GaussianPerspective) == 32);

}  // namespace surfel
