#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/texture/surfel_basis.h>

namespace surfel {

/// Mean number of functions that reach the centre of a function, itself included, or whose centres
/// lie in reach of its cell on the surface, whatever is more; of a sample of 256 functions, which
/// is all where there are no more. The time and memory that a fit takes are the number of functions
/// times as much. 0 without functions.
/// \param cutoff  functions end where beta >= cutoff.
SURFEL_API double kernel_overlap(const SurfelBasis& basis, double cutoff);

/// Throws Error(kInput), starting with `name`, if kernel_overlap() exceeds 512: surfels by the
/// thousand at one place, or far larger than their spacing. Surfels that just close a surface at a
/// cutoff of 1 have 10, at a cutoff of 16 up to 200.
SURFEL_API void require_bounded_overlap(const SurfelBasis& basis, double cutoff,
                                        const std::string& name);

}  // namespace surfel
