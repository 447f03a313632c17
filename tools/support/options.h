#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>

namespace surfel::tool {

/// `count` numbers parted by commas ("0,1.5,-2"). Throws CLI::ConversionError naming the option,
/// the text and what was expected.
std::vector<double> parse_numbers(const std::string& option, const std::string& text, int count);

/// "WxH", both 1..65536. Throws CLI::ConversionError.
std::pair<int, int> parse_size(const std::string& option, const std::string& text);

/// Bytes: "64M", "2G", "1.5G" (powers of 1024), or a plain number. Throws CLI::ConversionError.
std::uint64_t parse_bytes(const std::string& option, const std::string& text);

/// Options that set fields of the library's options structs under a name of their own.
using FieldNames = std::map<std::string, std::string>;

/// A message of the library for the user of a tool. The library puts names of fields into
/// backquotes: each becomes the option that sets the field, which is the one in `names`, else
/// "--the-field", or "-f" for a field f of one letter. Where the tool has no such option, the
/// quotes go.
std::string with_option_names(const std::string& message, const CLI::App& app,
                              const FieldNames& names);

/// "OPTION has no effect WHERE; leave it out" for each of the options that was given.
std::vector<std::string> without_effect(const CLI::App& app,
                                        const std::vector<std::string>& options,
                                        const std::string& where);

/// Declares an option whose value is one text, handed to `assign`; `value` is the default, for the
/// help.
CLI::Option* add_text(CLI::App& app, const std::string& names, const std::string& type,
                      const std::string& value, const std::string& description,
                      const std::function<void(const std::string&)>& assign);

/// The long name of "-o,--output": "--output".
std::string long_name(const std::string& names);

/// Option for a vector of fixed size, given as numbers parted by commas.
template <class Scalar, int N>
CLI::Option* add_vector(CLI::App& app, const std::string& names, Eigen::Matrix<Scalar, N, 1>& value,
                        const std::string& description) {
  std::string type = "N";
  for (int i = 1; i < N; ++i) type += ",N";
  return add_text(app, names, type, fmt::format("{}", fmt::join(value.begin(), value.end(), ",")),
                  description, [&value, name = long_name(names)](const std::string& text) {
                    const std::vector<double> numbers = parse_numbers(name, text, N);
                    for (int i = 0; i < N; ++i) value[i] = static_cast<Scalar>(numbers[i]);
                  });
}

/// The same where leaving it out has a meaning of its own.
template <class Scalar, int N>
CLI::Option* add_vector(CLI::App& app, const std::string& names,
                        std::optional<Eigen::Matrix<Scalar, N, 1>>& value,
                        const std::string& description) {
  std::string type = "N";
  for (int i = 1; i < N; ++i) type += ",N";
  return add_text(app, names, type, "", description,
                  [&value, name = long_name(names)](const std::string& text) {
                    const std::vector<double> numbers = parse_numbers(name, text, N);
                    value.emplace();
                    for (int i = 0; i < N; ++i) (*value)[i] = static_cast<Scalar>(numbers[i]);
                  });
}

/// Option for a picture's size, "WxH".
CLI::Option* add_size(CLI::App& app, const std::string& names, int& width, int& height,
                      const std::string& description);

/// The options that place a camera: --eye, --from, --target, --up, --fov, --ortho, --size, --zoom,
/// --frame-all. What `camera` holds are the defaults.
void add_view(CLI::App& app, CameraOptions& camera);

/// Option for one of a set of named values; the error quotes the text and the set.
template <class T>
CLI::Option* add_choice(CLI::App& app, const std::string& names, T& value,
                        const std::vector<std::pair<std::string, T>>& choices,
                        const std::string& description) {
  std::string set;
  std::string chosen;
  for (const auto& [name, choice] : choices) {
    set += (set.empty() ? "" : ", ") + name;
    if (choice == value) chosen = name;
  }
  return add_text(app, names, "NAME", chosen, description + " (" + set + ")",
                  [&value, choices, set, option = long_name(names)](const std::string& text) {
                    for (const auto& [name, choice] : choices) {
                      if (name != text) continue;
                      value = choice;
                      return;
                    }
                    throw CLI::ValidationError(option,
                                               fmt::format("'{}' is not one of {}", text, set));
                  });
}

}  // namespace surfel::tool
