#include "tools/support/standard_error.h"

#include <cstdio>

namespace surfel::tool {

void tell(std::string_view text) noexcept {
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
}

}  // namespace surfel::tool
