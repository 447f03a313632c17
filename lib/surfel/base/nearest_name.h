#pragma once

#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// The name that somebody who wrote `text` most likely meant: the fewest slips of the pen
/// away (a letter missing, added, wrong, or swapped with its neighbour), if that is no more
/// than a third of the letters, else the only one that `text` begins. Case and leading dashes do
/// not count. Empty if there is none.
SURFEL_API std::string nearest_name(const std::string& text, const std::vector<std::string>& names);

/// "; did you mean NAME?" for the nearest name, to end a message with; nothing if there is none.
SURFEL_API std::string did_you_mean(const std::string& text, const std::vector<std::string>& names);

}  // namespace surfel
