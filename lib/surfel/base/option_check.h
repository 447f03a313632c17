#pragma once

#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>

namespace surfel {

/// Adds "`field` is VALUE; it must be RULE" to the problems of options, unless `kept`.
template <class T>
void check_option(std::vector<std::string>& problems, bool kept, const char* field, const T& value,
                  const std::string& rule) {
  if (!kept) problems.push_back(fmt::format("`{}` is {}; it must be {}", field, value, rule));
}

/// check_option() for a number that has to be positive and finite.
inline void check_positive(std::vector<std::string>& problems, const char* field, double value) {
  check_option(problems, value > 0 && std::isfinite(value), field, value, "positive");
}

}  // namespace surfel
