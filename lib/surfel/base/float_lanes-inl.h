// Vectors of the pixels in a row of a tile, or of as many surfels; included once for each target,
// see Highway's documentation.

#if defined(SURFEL_BASE_FLOAT_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SURFEL_BASE_FLOAT_LANES_INL_H_
#undef SURFEL_BASE_FLOAT_LANES_INL_H_
#else
#define SURFEL_BASE_FLOAT_LANES_INL_H_
#endif

#include <hwy/highway.h>

// Types alone need no attribute of the target, which clang would call unused.
namespace surfel {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Sixteen floats, or as many as a register holds if it holds fewer.
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
using Ints = hn::RebindToSigned<D>;
using Tags = hn::RebindToUnsigned<D>;

}  // namespace HWY_NAMESPACE
}  // namespace surfel

#endif
