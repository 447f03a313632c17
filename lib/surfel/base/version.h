#pragma once

#include <surfel/base/export.h>

namespace surfel {

/// "major.minor.patch" of the library in use.
SURFEL_API const char* version() noexcept;

}  // namespace surfel
