#pragma once

// How options structs tell which of their rules are violated, and how functions refuse such
// options.

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/error.h>

namespace surfel {

/// Adds `message` to the problems of options, unless the rule that it tells is `kept`.
inline void check_rule(std::vector<std::string>& problems, bool kept, const std::string& message) {
  if (!kept) problems.push_back(message);
}

/// Adds "`field` is VALUE; it must be RULE" to the problems of options, unless the rule is `kept`.
template <class T>
void check_option(std::vector<std::string>& problems, bool kept, const char* field, const T& value,
                  const std::string& rule) {
  if (!kept) problems.push_back(fmt::format("`{}` is {}; it must be {}", field, value, rule));
}

/// check_option() for a number that has to be positive and finite.
inline void check_positive(std::vector<std::string>& problems, const char* field, double value) {
  check_option(problems, value > 0 && std::isfinite(value), field, value, "positive");
}

/// check_rule() for the background of a picture, linear R G B and straight alpha.
inline void check_background(std::vector<std::string>& problems,
                             const std::array<float, 4>& background) {
  const bool usable = std::all_of(background.begin(), background.end(),
                                  [](float v) { return std::isfinite(v) && v >= 0; });
  check_rule(problems, usable && background[3] <= 1,
             "`background` must be four numbers >= 0, alpha at most 1");
}

/// Throws Error(kUsage) with the first problem of the options, if there is one.
template <class Options>
void require_usable(const Options& options) {
  for (const std::string& problem : options.problems()) throw_usage(problem);
}

}  // namespace surfel
