#pragma once

#include <algorithm>
#include <array>
#include <optional>
#include <string>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/support/options.h"

namespace surfel::tool {

/// A colour as linear R G B and straight alpha. Understood are names (the sixteen of HTML, and
/// `transparent`), #rgb, #rrggbb and #rrggbbaa, which are encoded as sRGB, and linear numbers
/// R,G,B or R,G,B,A; alpha is 1 where it is left out. Throws OptionError naming the
/// option, the text and what is understood.
std::array<float, 4> parse_color(const std::string& option, const std::string& text);

/// The same without alpha: a colour that has some is refused.
std::array<float, 3> parse_opaque_color(const std::string& option, const std::string& text);

/// Option for a colour with alpha, whose text is handed to parse_color(); `value` is the default.
Option* add_color(CommandLine& app, const std::string& names, std::array<float, 4>& value,
                  const std::string& description);

/// Option for an opaque colour that may be left out, a vector of three floats.
template <class Vector>
Option* add_color(CommandLine& app, const std::string& names, std::optional<Vector>& value,
                  const std::string& description) {
  return add_text(app, names, "COLOR", "", description,
                  [&value, name = long_name(names)](const std::string& text) {
                    const std::array<float, 3> color = parse_opaque_color(name, text);
                    std::copy(color.begin(), color.end(), value.emplace().begin());
                  });
}

}  // namespace surfel::tool
