#include <surfel/base/version.h>

namespace surfel {

const char* version() noexcept { return SURFEL_VERSION; }

}  // namespace surfel
