#include "tools/support/config_file.h"

#include <charconv>
#include <cmath>
#include <istream>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <surfel/base/error.h>
#include <surfel/io/toml_settings.h>

#include "tools/support/options.h"

namespace surfel::tool {
namespace {

/// As a number where the option takes numbers and the text is one.
Json typed(const Option& option, const std::string& text) {
  const std::string type = option.type_name();
  const char* end = text.data() + text.size();
  if (type.starts_with("INT") || type.starts_with("UINT")) {
    const std::string digits = whole_number(text).value_or(text);
    end = digits.data() + digits.size();
    std::int64_t value = 0;
    const auto [stop, error] = std::from_chars(digits.data(), end, value);
    if (error == std::errc{} && stop == end) return value;
  } else if (type.starts_with("FLOAT")) {
    double value = 0;
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error == std::errc{} && stop == end && std::isfinite(value)) return value;
  }
  return text;
}

/// As a number, a text, or an array of them where the option takes many.
Json typed(const Option& option, const std::vector<std::string>& values) {
  if (!option.takes_many()) return typed(option, values.empty() ? "" : values.front());
  Json array = Json::array();
  for (const std::string& value : values) array.push_back(typed(option, value));
  return array;
}

/// The help shows the default of an option of many values as "[a,b]".
std::vector<std::string> default_values(const Option& option) {
  const std::string text = option.default_str();
  if (!option.takes_many()) return {text};
  if (text.size() <= 2) return {};
  return split(text.substr(1, text.size() - 2), ',');
}

}  // namespace

std::string plain_name(const Option& option) {
  const std::vector<std::string>& names = option.long_names();
  return names.empty() ? option.name() : names.front();
}

Json value_in_force(const Option& option) {
  if (option.is_flag()) return option.is_set();
  const bool given = option.count() > 0;
  if (!given && option.default_str().empty()) return nullptr;
  return typed(option, given ? option.results() : default_values(option));
}

void read_config(CommandLine& app, std::istream& in) {
  const std::string file = app.config_file();
  // A byte more than is read: what goes on for ever, such as a device, ends as too long.
  std::string text(kMostTomlBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  std::vector<TomlSetting> settings;
  try {
    settings = read_toml_settings(text, file);
  } catch (const Error& error) {
    throw OptionError(error.what());
  }
  for (const auto& [key, line, given] : settings) {
    const auto fail = [&, at = line](const std::string& message) {
      throw OptionError(fmt::format("{}: line {}: {}", file, at, message));
    };
    Option* option = app.find_option("--" + key);
    if (!option || !option->configurable()) {
      std::vector<std::string> known;
      for (const Option* other : app.options()) {
        if (other->configurable() && !other->long_names().empty()) {
          known.push_back(plain_name(*other));
        }
      }
      fail(fmt::format("unknown option '{}'{}", key, did_you_mean(key, known)));
    }
    if (!given) fail(fmt::format("'{}' is not a value or a list of values", key));
    // An option that takes a vector as text is given an array joined by commas (eye = [0, 0, 3]).
    const auto values =
        option->takes_many() ? *given : std::vector{fmt::format("{}", fmt::join(*given, ","))};
    if (option->count() > 0) continue;  // Given on the command line.
    // Said again, a default says nothing: not even that the option was given, so that all settings
    // as --print-config prints them can be read although some exclude or need others.
    const bool is_default = option->is_flag() ? values.front() == "false"
                                              : typed(*option, values) == value_in_force(*option);
    if (is_default) continue;
    try {
      option->give(values);
    } catch (const OptionError& error) {
      fail(error.what());
    }
  }
}

std::string config_text(const CommandLine& app) {
  std::string text;
  for (const Option* option : app.options()) {
    if (!option->configurable() || option->long_names().empty()) continue;
    const Json value = value_in_force(*option);
    // note: JSON's strings, numbers, truth values and arrays of these are valid TOML.
    if (!value.is_null()) text += plain_name(*option) + " = " + value.dump() + "\n";
  }
  return text;
}

}  // namespace surfel::tool
