#include "tools/support/options.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include <surfel/scene/framing.h>

namespace surfel::tool {
namespace {

/// The whole of [begin, end) as a number; nullopt if it is none.
template <class Number>
std::optional<Number> parse_number(const char* begin, const char* end) {
  if (begin != end && *begin == '+') ++begin;
  Number value{};
  const auto [stop, error] = std::from_chars(begin, end, value);
  if (error != std::errc{} || stop != end) return std::nullopt;
  return value;
}

[[noreturn]] void throw_conversion(const std::string& option, const std::string& text,
                                   const std::string& expected) {
  throw CLI::ConversionError(fmt::format("{}: '{}' is not {}", option, text, expected));
}

/// The option that sets a field; the field itself if there is none.
std::string option_of(const std::string& field, const CLI::App& app, const FieldNames& names) {
  if (const auto named = names.find(field); named != names.end()) return named->second;
  std::string option = (field.size() == 1 ? "-" : "--") + field;
  std::replace(option.begin(), option.end(), '_', '-');
  return app.get_option_no_throw(option) ? option : field;
}

}  // namespace

std::string with_option_names(const std::string& message, const CLI::App& app,
                              const FieldNames& names) {
  static constexpr const char* kFieldLetters = "abcdefghijklmnopqrstuvwxyz0123456789_";
  std::string out;
  for (std::size_t at = 0; at < message.size();) {
    const std::size_t end =
        message[at] == '`' ? message.find_first_not_of(kFieldLetters, at + 1) : std::string::npos;
    if (end != std::string::npos && message[end] == '`' && end > at + 1) {
      out += option_of(message.substr(at + 1, end - at - 1), app, names);
      at = end + 1;
    } else {
      out += message[at++];
    }
  }
  return out;
}

std::vector<std::string> without_effect(const CLI::App& app,
                                        const std::vector<std::string>& options,
                                        const std::string& where) {
  std::vector<std::string> problems;
  for (const std::string& option : options) {
    if (app.get_option(option)->count() == 0) continue;
    problems.push_back(fmt::format("{} has no effect {}; leave it out", option, where));
  }
  return problems;
}

std::string long_name(const std::string& names) {
  const std::size_t dashes = names.find("--");
  if (dashes == std::string::npos) return names;
  return names.substr(dashes, names.find(',', dashes) - dashes);
}

std::vector<double> parse_numbers(const std::string& option, const std::string& text, int count) {
  std::vector<double> numbers;
  for (const std::string& part : CLI::detail::split(text, ',')) {
    const std::string trimmed = CLI::detail::trim_copy(part);
    const auto number = parse_number<double>(trimmed.data(), trimmed.data() + trimmed.size());
    if (!number || !std::isfinite(*number)) break;
    numbers.push_back(*number);
  }
  const bool rest = std::count(text.begin(), text.end(), ',') + 1 != count;
  if (rest || static_cast<int>(numbers.size()) != count) {
    throw_conversion(option, text, fmt::format("{} numbers parted by commas", count));
  }
  return numbers;
}

std::pair<int, int> parse_size(const std::string& option, const std::string& text) {
  constexpr int kLargest = 65536;  // A picture of this width and height takes 64 GB.
  const std::size_t x = text.find('x');
  if (x != std::string::npos) {
    const auto width = parse_number<int>(text.data(), text.data() + x);
    const auto height = parse_number<int>(text.data() + x + 1, text.data() + text.size());
    if (width && height && std::min(*width, *height) >= 1 &&
        std::max(*width, *height) <= kLargest) {
      return {*width, *height};
    }
  }
  throw_conversion(option, text, fmt::format("a size WxH in pixels, 1x1 to {0}x{0}", kLargest));
}

std::uint64_t parse_bytes(const std::string& option, const std::string& text) {
  static const std::string kUnits = "KMGT";
  const std::size_t unit =
      text.empty() ? std::string::npos : kUnits.find(static_cast<char>(std::toupper(text.back())));
  const std::size_t digits = text.size() - (unit == std::string::npos ? 0 : 1);
  const auto number = parse_number<double>(text.data(), text.data() + digits);
  const double bytes =
      number.value_or(-1) *
      (unit == std::string::npos ? 1 : std::exp2(10 * static_cast<double>(unit + 1)));
  constexpr double kMost = 0x1p60;  ///< More than any machine has, and exact.
  if (!(bytes >= 1 && bytes <= kMost)) {
    throw_conversion(option, text, "a number of bytes such as 512M or 2G");
  }
  return static_cast<std::uint64_t>(bytes);
}

CLI::Option* add_text(CLI::App& app, const std::string& names, const std::string& type,
                      const std::string& value, const std::string& description,
                      const std::function<void(const std::string&)>& assign) {
  CLI::Option* option = app.add_option(
      names,
      [assign](const CLI::results_t& results) {
        assign(results.at(0));
        return true;
      },
      description);
  return option->type_name(type)->default_str(value)->expected(1);
}

CLI::Option* add_numbers(CLI::App& app, const std::string& names, int count,
                         const std::string& value, const std::string& description,
                         const std::function<void(const std::vector<double>&)>& assign) {
  std::string type = "N";
  for (int i = 1; i < count; ++i) type += ",N";
  return add_text(app, names, type, value, description,
                  [assign, count, name = long_name(names)](const std::string& text) {
                    assign(parse_numbers(name, text, count));
                  });
}

CLI::Option* add_size(CLI::App& app, const std::string& names, int& width, int& height,
                      const std::string& description) {
  return add_text(app, names, "WxH", fmt::format("{}x{}", width, height), description,
                  [&width, &height, name = long_name(names)](const std::string& text) {
                    std::tie(width, height) = parse_size(name, text);
                  });
}

void add_view(CLI::App& app, CameraOptions& camera) {
  add_vector(app, "--eye", camera.eye, "Eye, world coordinates; default: everything is seen");
  add_vector(app, "--from", camera.from, "Instead of --eye: direction from the target to the eye");
  add_vector(app, "--target", camera.target, "Point looked at; default: the scene's centre");
  add_vector(app, "--up", camera.up, "Direction that is up in the picture");
  app.add_option("--fov", camera.fov, "Vertical field of view, degrees, in (0, 180)");
  app.add_option("--ortho", camera.ortho,
                 "Orthographic projection of this visible height, scene units, > 0");
  add_size(app, "--size", camera.width, camera.height, "Size of the picture, pixels");
  app.add_option("--zoom", camera.zoom, "Enlarges the picture about its centre, once framed, > 0");
  app.add_flag("--frame-all", camera.frame_all,
               "Move the eye along its line of sight until the whole scene is just seen");
}

}  // namespace surfel::tool
