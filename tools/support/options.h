#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <surfel/base/nearest_name.h>
#include <surfel/io/picture_part.h>
#include <surfel/measure/view_guess.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/framing.h>

#include "tools/support/command_line.h"

namespace surfel::tool {

/// `count` numbers parted by commas ("0,1.5,-2"). Throws OptionError naming the option,
/// the text and what was expected.
std::vector<double> parse_numbers(const std::string& option, const std::string& text, int count);

/// The digits of a whole number, however it is written: "100000", "1e5", "1.5e3", "100k", "2M",
/// "1G" (powers of 1000). Nullopt for all else, such as 1.5.
std::optional<std::string> whole_number(const std::string& text);

/// "WxH", or "N" for NxN, both 1..65536. Throws OptionError.
std::pair<int, int> parse_size(const std::string& option, const std::string& text);

/// Bytes: "64M", "2G", "1.5G" (powers of 1024), or a plain number. Throws OptionError.
std::uint64_t parse_bytes(const std::string& option, const std::string& text);

/// Option --memory: bytes, or auto, for which `value` is not set.
Option* add_memory(CommandLine& app, std::optional<std::uint64_t>& value,
                   const std::string& description);

/// "A-B", whole numbers with A <= B. Throws OptionError.
std::array<std::size_t, 2> parse_range(const std::string& option, const std::string& text);

/// "X,Y", column and row of a pixel, >= 0. Throws OptionError.
std::array<int, 2> parse_pixel(const std::string& option, const std::string& text);

/// "I/N", the I-th of N parts, I from 1 on. Throws OptionError.
PartNumber parse_part(const std::string& option, const std::string& text);

/// Names of options by the fields that they set, where an option's name is not its field's.
using FieldNames = std::map<std::string, std::string>;

/// A message of the library for the user of a tool. The library puts names of fields into
/// backquotes: each becomes the option that sets the field, which is the one in `names`, else
/// "--the-field", or "-f" for a field f of one letter. Where the tool has no such option, the
/// quotes go.
std::string with_option_names(const std::string& message, const CommandLine& app,
                              const FieldNames& names);

/// Names of the options of the command line as they are typed: "--output", "-o".
std::vector<std::string> typed_names(const CommandLine& app);

/// "OPTION has no effect WHERE; leave it out" for each of the options that was given, in the order
/// in which they were.
std::vector<std::string> without_effect(const CommandLine& app,
                                        const std::vector<std::string>& options,
                                        const std::string& where);

/// Declares an option whose value is one text, handed to `assign`; `value` is the default, for the
/// help.
Option* add_text(CommandLine& app, const std::string& names, const std::string& type,
                 const std::string& value, const std::string& description,
                 const std::function<void(const std::string&)>& assign);

/// Declares an option that may be given several times; `assign` gets all of its texts.
Option* add_texts(CommandLine& app, const std::string& names, const std::string& type,
                  const std::string& description,
                  const std::function<void(const std::vector<std::string>&)>& assign);

/// ASCII letters in lower case.
std::string lower_case(std::string text);

/// The parts of a text between separators; no empty one at its end.
std::vector<std::string> split(const std::string& text, char separator);

/// The long name of "-o,--output": "--output".
std::string long_name(const std::string& names);

/// Declares an option whose value is `count` numbers parted by commas, handed to `assign`; `value`
/// is the default, for the help.
Option* add_numbers(CommandLine& app, const std::string& names, int count, const std::string& value,
                    const std::string& description,
                    const std::function<void(const std::vector<double>&)>& assign);

/// Option for a vector of fixed size, Eigen's or std::array.
template <class Vector>
Option* add_vector(CommandLine& app, const std::string& names, Vector& value,
                   const std::string& description) {
  return add_numbers(app, names, static_cast<int>(value.size()),
                     fmt::format("{}", fmt::join(value.begin(), value.end(), ",")), description,
                     [&value](const std::vector<double>& numbers) {
                       std::copy(numbers.begin(), numbers.end(), value.begin());
                     });
}

/// Option for a vector of fixed size that may be left out.
template <class Vector>
Option* add_vector(CommandLine& app, const std::string& names, std::optional<Vector>& value,
                   const std::string& description) {
  return add_numbers(app, names, static_cast<int>(Vector().size()), "", description,
                     [&value](const std::vector<double>& numbers) {
                       std::copy(numbers.begin(), numbers.end(), value.emplace().begin());
                     });
}

/// Option for a picture's size, "WxH" or "N".
Option* add_size(CommandLine& app, const std::string& names, int& width, int& height,
                 const std::string& description);

/// "x", "-z" or "1,0.5,-2". Throws OptionError.
Vec3d parse_direction(const std::string& option, const std::string& text);

/// The options that place a camera: --eye, --from, --view, --target, --up, --fov, --ortho, --size,
/// --zoom, --frame-all. What `camera` holds are the defaults.
void add_view(CommandLine& app, CameraOptions& camera, ViewChoice& choice);

/// Lets the values of all options of whole numbers and of numbers be written as whole_number() and
/// C do, and names the option, the text and what was expected where they are something else.
void check_numbers(CommandLine& app);

/// Option for one of a set of named values; the error quotes the text and the set.
template <class T>
Option* add_choice(CommandLine& app, const std::string& names, T& value,
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
                    std::vector<std::string> known;
                    for (const auto& [name, choice] : choices) known.push_back(name);
                    throw OptionError(option, fmt::format("'{}' is not one of {}{}", text, set,
                                                          did_you_mean(text, known)));
                  });
}

}  // namespace surfel::tool
