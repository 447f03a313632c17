// Vectors of surfels on their way to becoming splats, for all SIMD parts of splat_setup.cpp;
// included once for each target, see Highway's documentation.

#if defined(SURFEL_RENDER_PROJECTED_SPLATS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_RENDER_PROJECTED_SPLATS_INL_H_
#undef SURFEL_RENDER_PROJECTED_SPLATS_INL_H_
#else
#define SURFEL_RENDER_PROJECTED_SPLATS_INL_H_
#endif

#include <hwy/highway.h>
#include <surfel/base/float_lanes-inl.h>
#include <surfel/base/fused-inl.h>
#include <surfel/base/vec3-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Vec3V = Vec3<V>;

HWY_INLINE Vec3V rotate(const float* r, const Vec3V& v) {
  const D d;
  const auto row = [&](int i) {
    return mul_add(hn::Set(d, r[i]), v.x,
                   mul_add(hn::Set(d, r[i + 1]), v.y, hn::Mul(hn::Set(d, r[i + 2]), v.z)));
  };
  return {row(0), row(3), row(6)};
}

/// Centres of surfels in camera space and in the picture, and their extents.
struct Discs {
  Vec3V p;                     ///< Camera space.
  V inv_z;                     ///< 1 / p.z; orthographic: 1.
  V slope_x, slope_y;          ///< p.x / p.z and p.y / p.z; orthographic: 0.
  V x, y;                      ///< Pixels.
  V deviation_u, deviation_v;  ///< Standard deviations, scene units.
  V deviation;                 ///< The larger deviation.
  V radius;                    ///< The disc's radius, sqrt(2 c) times `deviation`.
};

/// Tangent frames of surfels in camera space, and the columns of J V^(1/2), pixels.
struct Axes {
  Vec3V tangent, bitangent;
  V tx, ty, bx, by;
};

/// What kernels are made of.
struct Shape {
  Axes axes;
  V share;    ///< Factor on the kernels' volumes.
  V stretch;  ///< The area that the axes span over the one of the whole surfels' axes.
};

/// Resampling kernels (6) of surfels, as Splat has them.
struct Kernels {
  V m, k, q, amplitude;
  V half_x, half_y;  ///< Half the sides of the box around beta < c, pixels.
  V size2;           ///< Sum of the squared half sides of the box without the pixel filter.
  V n_ray;           ///< Normal . (slope_x, slope_y, 1).
};

/// Half-planes that cut surfels.
struct HalfPlanes {
  M exists;
  Vec3V direction;  ///< Camera space.
  V distance;
  V w_u, w_v;  ///< The direction times the deviations, V^(1/2) n.
};

/// Gaussians that have the volume, the mean and the variance of cut ones.
struct CutGaussians {
  M made;              ///< Surfels that have one. The other lanes mean nothing.
  M gone;              ///< Less than kLeastClipShare of the volume is left.
  V share;             ///< Of the volume.
  V mean_u, mean_v;    ///< In standard deviations of the whole Gaussian along its axes.
  V l_uu, l_uv, l_vv;  ///< Cholesky factor of the variance, in the same units.
};

/// What half-planes leave of kernels, as SplatClip has it.
struct Cuts {
  V line[2][3], outward[2][2], joint, beyond;
  M clipped;  ///< Some of what is seen is cut off ...
  M gone;     ///< ... or all of it.
  /// How far what is left reaches, as shares of Kernels::half_x and half_y.
  V left, right, up, down;
};

/// Depth planes of surfels, as Splat has them.
struct DepthPlanes {
  V depth, depth_dx, depth_dy, depth_range;
  V epsilon_share;  ///< What the surface's planes differ by at most, as a part of `depth_range`.
  M front;          ///< The surfel's front faces the eye.
  M grazing;        ///< It is seen at a grazing angle.
};

/// The range of the rectangle's pixels whose centres lie between two places, both included;
/// `unclipped` is the first one where the rectangle had no left end.
struct Pixels {
  V unclipped, first, last;
};

/// Which surfels become splats.
struct Classes {
  M visible, exact;
};

/// Everything about a vector of surfels that a Splat keeps.
struct Projected {
  Discs discs;
  Axes axes;
  Kernels kernels;
  DepthPlanes planes;
  Pixels columns, rows;
  Classes classes;
  Cuts cuts;  ///< Of surfels that half-planes cut.
};

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
