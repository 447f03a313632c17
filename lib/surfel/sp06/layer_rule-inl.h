// SP06 (6) for a vector of fragments at a time. Included once for each target, see Highway's
// documentation.

#if defined(SURFEL_SP06_LAYER_RULE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_SP06_LAYER_RULE_INL_H_
#undef SURFEL_SP06_LAYER_RULE_INL_H_
#else
#define SURFEL_SP06_LAYER_RULE_INL_H_
#endif

#include <hwy/highway.h>
#include <surfel/render/kernel_raster-inl.h>
#include <surfel/sp06/layer_rule.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {

/// Number of the step of SP06 (6) that a depth is in, counted from the nearest.
HWY_INLINE V depth_step(const LayerRule& rule, V depth) {
  const D d;
  const V z = rule.orthographic ? hn::Neg(depth) : hn::Div(hn::Set(d, 1.0F), depth);
  return hn::Floor(hn::Mul(hn::Sub(z, hn::Set(d, rule.nearest)), hn::Set(d, rule.steps_per_unit)));
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#endif
