#pragma once

#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/sp06/disc_tree.h>

namespace surfel {

/// Share of the samples of a surface that no disc covers, 0..1; 0 without samples. A disc covers
/// what lies no further from its centre than its radius and faces the same way. Counted without the
/// cells by which coverage is made, so that it can check them.
/// \param places   scene units, relative to the same origin as the discs.
/// \param normals  parallel to `places`.
SURFEL_API double missed_share(const Discs& discs, std::span<const Vec3f> places,
                               std::span<const Vec3f> normals);

}  // namespace surfel
