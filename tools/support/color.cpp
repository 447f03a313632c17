#include "tools/support/color.h"

#include <cctype>
#include <charconv>
#include <cstdint>
#include <map>

#include <surfel/base/color.h>

namespace surfel::tool {
namespace {

/// Names of colours, 0xrrggbbaa in sRGB.
const std::map<std::string, std::uint32_t>& names() {
  static const std::map<std::string, std::uint32_t> kNames = {
      {"black", 0x000000ff},  {"silver", 0xc0c0c0ff}, {"gray", 0x808080ff},
      {"grey", 0x808080ff},   {"white", 0xffffffff},  {"maroon", 0x800000ff},
      {"red", 0xff0000ff},    {"purple", 0x800080ff}, {"fuchsia", 0xff00ffff},
      {"green", 0x008000ff},  {"lime", 0x00ff00ff},   {"olive", 0x808000ff},
      {"yellow", 0xffff00ff}, {"navy", 0x000080ff},   {"blue", 0x0000ffff},
      {"teal", 0x008080ff},   {"aqua", 0x00ffffff},   {"transparent", 0x00000000}};
  return kNames;
}

/// The digits behind "#" as 0xrrggbbaa.
std::optional<std::uint32_t> parse_hexadecimal(std::string digits) {
  if (digits.size() == 3) {
    for (std::size_t i = 0; i < 6; i += 2) digits.insert(i, 1, digits[i]);
  }
  if (digits.size() == 6) digits += "ff";
  std::uint32_t code = 0;
  const char* end = digits.data() + digits.size();
  const auto [stop, error] = std::from_chars(digits.data(), end, code, 16);
  if (digits.size() != 8 || error != std::errc{} || stop != end) return std::nullopt;
  return code;
}

std::array<float, 4> decoded(std::uint32_t code) {
  const auto byte = [&](int shift) { return static_cast<std::uint8_t>(code >> shift & 0xff); };
  return {srgb8_to_linear(byte(24)), srgb8_to_linear(byte(16)), srgb8_to_linear(byte(8)),
          static_cast<float>(byte(0)) / 255};
}

[[noreturn]] void refuse(const std::string& option, const std::string& text,
                         const std::string& numbers) {
  throw OptionError(
      fmt::format("{}: '{}' is not a colour; give a name such as white or navy, #rrggbb, or linear "
                  "numbers {}",
                  option, text, numbers));
}

/// Nullopt where the text is no colour.
std::optional<std::array<float, 4>> read_color(const std::string& option, const std::string& text) {
  if (text.starts_with('#')) {
    const auto code = parse_hexadecimal(text.substr(1));
    if (!code) return std::nullopt;
    return decoded(*code);
  }
  if (const auto named = names().find(lower_case(text)); named != names().end()) {
    return decoded(named->second);
  }
  const auto commas = std::count(text.begin(), text.end(), ',');
  if (commas != 2 && commas != 3) return std::nullopt;
  std::array<float, 4> color{0, 0, 0, 1};
  const std::vector<double> numbers = parse_numbers(option, text, static_cast<int>(commas) + 1);
  std::transform(numbers.begin(), numbers.end(), color.begin(),
                 [](double number) { return static_cast<float>(number); });
  return color;
}

}  // namespace

std::array<float, 4> parse_color(const std::string& option, const std::string& text) {
  const auto color = read_color(option, text);
  if (!color) refuse(option, text, "R,G,B or R,G,B,A");
  return *color;
}

std::array<float, 3> parse_opaque_color(const std::string& option, const std::string& text) {
  const auto color = read_color(option, text);
  if (!color || (*color)[3] != 1) refuse(option, text, "R,G,B");
  return {(*color)[0], (*color)[1], (*color)[2]};
}

Option* add_color(CommandLine& app, const std::string& names, std::array<float, 4>& value,
                  const std::string& description) {
  return add_text(app, names, "COLOR", fmt::format("{}", fmt::join(value, ",")), description,
                  [&value, name = long_name(names)](const std::string& text) {
                    value = parse_color(name, text);
                  });
}

}  // namespace surfel::tool
