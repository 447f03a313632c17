// Vectors of three SIMD coordinates; included once for each target, see Highway's documentation.

#if defined(SURFEL_BASE_VEC3_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_BASE_VEC3_INL_H_
#undef SURFEL_BASE_VEC3_INL_H_
#else
#define SURFEL_BASE_VEC3_INL_H_
#endif

#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

template <class V>
struct Vec3 {
  V x, y, z;
};

template <class V>
HWY_INLINE V dot(const Vec3<V>& a, const Vec3<V>& b) {
  return mul_add(a.x, b.x, mul_add(a.y, b.y, hn::Mul(a.z, b.z)));
}

template <class V>
HWY_INLINE Vec3<V> cross(const Vec3<V>& a, const Vec3<V>& b) {
  return {mul_sub(a.y, b.z, hn::Mul(a.z, b.y)), mul_sub(a.z, b.x, hn::Mul(a.x, b.z)),
          mul_sub(a.x, b.y, hn::Mul(a.y, b.x))};
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
