#pragma once

#include <string>
#include <string_view>

namespace surfel::tool {

/// Writes to standard error. Where it cannot be written, nothing is left to tell that by: the run
/// goes on, and its exit code says how it ended.
void tell(std::string_view text) noexcept;

/// Text for a terminal: control characters but line feeds and tabs, which names of files and
/// columns may hold, as \u001b.
std::string printable(std::string_view text);

}  // namespace surfel::tool
