#pragma once

#include <vector>

#include <surfel/base/export.h>
#include <surfel/scene/image.h>

namespace surfel {

/// How much a sequence of pictures flickers beside the truth's: the root of the mean square, over
/// pixels, channels R G B and pairs of consecutive frames, of the difference between the change
/// from frame to frame and the truth's change. Of premultiplied pictures, clamped and sRGB-encoded,
/// full scale is 1: an error that stays, or moves with the surface, counts little, one that comes
/// and goes counts in full. Throws Error(kInput) unless there are two frames at least, as many of
/// the truth, all of one size with R G B.
SURFEL_API double flicker(const std::vector<Image>& tested, const std::vector<Image>& truth);

}  // namespace surfel
