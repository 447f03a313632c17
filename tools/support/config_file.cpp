#include "tools/support/config_file.h"

#include <charconv>
#include <cmath>
#include <optional>
#include <sstream>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "tools/support/options.h"

namespace surfel::tool {
namespace {

/// A scalar as the command line would have it; nullopt for tables, dates and arrays.
std::optional<std::string> as_argument(const toml::node& node) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
  return std::nullopt;
}

/// The values for one option. An array fills an option of many values, or is joined by commas for
/// one that takes a vector as text (`eye = [0, 0, 3]`).
std::optional<std::vector<std::string>> as_arguments(const toml::node& node, bool many) {
  const toml::array* array = node.as_array();
  if (!array) {
    const auto value = as_argument(node);
    if (!value) return std::nullopt;
    return std::vector{*value};
  }
  std::vector<std::string> values;
  for (const toml::node& element : *array) {
    const auto value = as_argument(element);
    if (!value) return std::nullopt;
    values.push_back(*value);
  }
  if (many) return values;
  return std::vector{fmt::format("{}", fmt::join(values, ","))};
}

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
  const auto fail = [&](const toml::source_region& where, const std::string& message) {
    throw OptionError(fmt::format("{}: line {}: {}", file, where.begin.line, message));
  };
  toml::table table;
  try {
    table = toml::parse(in);
  } catch (const toml::parse_error& error) {
    fail(error.source(), std::string(error.description()));
  }
  for (const auto& [toml_key, node] : table) {
    const std::string key(toml_key.str());
    Option* option = app.find_option("--" + key);
    if (!option || !option->configurable()) {
      std::vector<std::string> known;
      for (const Option* other : app.options()) {
        if (other->configurable() && !other->long_names().empty()) {
          known.push_back(plain_name(*other));
        }
      }
      fail(toml_key.source(), fmt::format("unknown option '{}'{}", key, did_you_mean(key, known)));
    }
    const auto values = as_arguments(node, option->takes_many());
    if (!values) fail(node.source(), fmt::format("'{}' is not a value or a list of values", key));
    if (option->count() > 0) continue;  // Given on the command line.
    // Said again, a default says nothing: not even that the option was given, so that all settings
    // as --print-config prints them can be read although some exclude or need others.
    const bool is_default = option->is_flag() ? values->front() == "false"
                                              : typed(*option, *values) == value_in_force(*option);
    if (is_default) continue;
    try {
      option->give(*values);
    } catch (const OptionError& error) {
      fail(node.source(), error.what());
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
