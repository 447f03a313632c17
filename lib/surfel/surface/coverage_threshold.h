#pragma once

#include <surfel/base/export.h>

namespace surfel {

/// Coverage threshold tau(cutoff) of SS01 section 7: the sum of the truncated kernels from which on
/// a pixel counts as covered. It is the least sum measured inside jittered grids with V = h^2 I, so
/// that no interior turns translucent, interpolated between cutoffs: 0.31 at 1, 0.61 at 2, 0.775
/// at 4. The paper's 0.4 at cutoff 1 leaves 1 pixel in 1,000 of a jittered grid uncovered; it
/// suits regular samples better, as silhouettes come out slimmer.
SURFEL_API double coverage_threshold(double cutoff);

}  // namespace surfel
