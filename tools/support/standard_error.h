#pragma once

#include <string_view>

namespace surfel::tool {

/// Writes to standard error. Where it cannot be written, nothing is left to tell that by: the run
/// goes on, and its exit code says how it ended.
void tell(std::string_view text) noexcept;

}  // namespace surfel::tool
