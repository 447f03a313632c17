#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// The sets of vector instructions that this processor and this build of the library both have,
/// fastest first, of: avx512, avx2, scalar (no vectors).
SURFEL_API std::vector<std::string> available_instructions();

/// The set that is in use: the fastest, unless set_instructions() chose another.
SURFEL_API std::string instructions();

/// Makes the whole process use one of available_instructions(). Results do not depend on it, so
/// that it serves comparisons and measurements. Call it while no other function of the library
/// runs. Throws Error(kUsage) for other names.
SURFEL_API void set_instructions(const std::string& name);

}  // namespace surfel
