#pragma once

#include <optional>
#include <string>

namespace surfel {

/// "NAME" or "NAME:FREQUENCY", as users name textures that are given by a formula.
struct NamedFrequency {
  std::string name;
  std::optional<double> frequency{};
};

/// Takes the text apart. Throws Error(kUsage) with a message about `field` where a colon is not
/// followed by a number from `least` to `most`.
NamedFrequency parse_named_frequency(const char* field, const std::string& text, double least,
                                     double most);

}  // namespace surfel
