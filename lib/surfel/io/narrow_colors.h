#pragma once

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Some writers store colours of 8 bits as they are in fields of 16, and zeros where there are no
/// colours. Makes 8-bit colours of 16-bit ones where `brightest`, the largest of all codes, is 255
/// at most, and drops them where it is 0. Internal to the io module.
void narrow_colors(SurfelCloud& cloud, int brightest);

}  // namespace surfel
