#include "tools/support/options.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <regex>
#include <sstream>
#include <tuple>

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

std::string trimmed(const std::string& text) {
  static constexpr const char* kBlanks = " \t\n\v\f\r";
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

[[noreturn]] void throw_conversion(const std::string& option, const std::string& text,
                                   const std::string& expected) {
  throw OptionError(fmt::format("{}: '{}' is not {}", option, text, expected));
}

/// The option that sets a field; the field itself if there is none.
std::string option_of(const std::string& field, const CommandLine& app, const FieldNames& names) {
  if (const auto named = names.find(field); named != names.end()) return named->second;
  std::string option = (field.size() == 1 ? "-" : "--") + field;
  std::replace(option.begin(), option.end(), '_', '-');
  return app.find_option(option) ? option : field;
}

}  // namespace

std::string with_option_names(const std::string& message, const CommandLine& app,
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

std::vector<std::string> typed_names(const CommandLine& app) {
  std::vector<std::string> names;
  for (const Option* option : app.options()) {
    for (const std::string& name : option->long_names()) names.push_back("--" + name);
    for (const std::string& name : option->short_names()) names.push_back("-" + name);
  }
  return names;
}

std::vector<std::string> without_effect(const CommandLine& app,
                                        const std::vector<std::string>& options,
                                        const std::string& where) {
  std::vector<std::string> given;
  for (const std::string& option : options) {
    if (app.get_option(option)->count() > 0) given.push_back(option);
  }
  // Those of configuration files come last.
  const std::vector<Option*> order = app.parse_order();
  const auto place = [&](const std::string& option) {
    return std::find(order.begin(), order.end(), app.get_option(option));
  };
  std::stable_sort(given.begin(), given.end(),
                   [&](const std::string& a, const std::string& b) { return place(a) < place(b); });
  std::vector<std::string> problems;
  for (const std::string& option : given) {
    problems.push_back(fmt::format("{} has no effect {}; leave it out", option, where));
  }
  return problems;
}

std::string long_name(const std::string& names) {
  const std::size_t dashes = names.find("--");
  if (dashes == std::string::npos) return names;
  return names.substr(dashes, names.find(',', dashes) - dashes);
}

std::string lower_case(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
  return parts;
}

std::vector<double> parse_numbers(const std::string& option, const std::string& text, int count) {
  std::vector<double> numbers;
  for (const std::string& part : split(text, ',')) {
    const std::string digits = trimmed(part);
    const auto number = parse_number<double>(digits.data(), digits.data() + digits.size());
    if (!number || !std::isfinite(*number)) break;
    numbers.push_back(*number);
  }
  const bool rest = std::count(text.begin(), text.end(), ',') + 1 != count;
  if (rest || static_cast<int>(numbers.size()) != count) {
    throw_conversion(option, text, fmt::format("{} numbers parted by commas", count));
  }
  return numbers;
}

std::optional<std::string> whole_number(const std::string& text) {
  static const std::regex kForm(R"(([-+]?)(\d*)\.?(\d*)(?:[eE]([-+]?\d{1,2})|([kKMG]))?)");
  constexpr std::size_t kLongest = 64;
  std::smatch parts;
  if (text.size() > kLongest || !std::regex_match(text, parts, kForm)) return std::nullopt;
  std::string digits = parts[2].str() + parts[3].str();
  if (digits.empty()) return std::nullopt;
  int power = -static_cast<int>(parts[3].length());
  if (parts[4].matched) power += std::stoi(parts[4]);
  if (parts[5].matched) power += parts[5] == "M" ? 6 : parts[5] == "G" ? 9 : 3;
  for (; power > 0; --power) digits += '0';
  for (; power < 0; ++power) {
    if (digits.back() != '0') return std::nullopt;
    if (digits.size() > 1) digits.pop_back();
  }
  digits.erase(0, std::min(digits.find_first_not_of('0'), digits.size() - 1));
  return digits == "0" || parts[1] != "-" ? digits : "-" + digits;
}

std::pair<int, int> parse_size(const std::string& option, const std::string& text) {
  constexpr int kLargest = 65536;  // A picture of this width and height takes 64 GB.
  const std::size_t x = std::min(text.find('x'), text.size());
  const char* const end = text.data() + text.size();
  const auto width = parse_number<int>(text.data(), text.data() + x);
  const auto height = x == text.size() ? width : parse_number<int>(text.data() + x + 1, end);
  if (width && height && std::min(*width, *height) >= 1 && std::max(*width, *height) <= kLargest) {
    return {*width, *height};
  }
  throw_conversion(option, text,
                   fmt::format("a size in pixels, WxH or N for NxN, 1x1 to {0}x{0}", kLargest));
}

std::uint64_t parse_bytes(const std::string& option, const std::string& text) {
  static const std::string kUnits = "KMGT";
  const std::size_t unit =
      text.empty() ? std::string::npos : kUnits.find(static_cast<char>(std::toupper(text.back())));
  const std::size_t digits = text.size() - (unit == std::string::npos ? 0 : 1);
  const auto number = parse_number<double>(text.data(), text.data() + digits);
  const double bytes =
      number.value_or(-1) *
      (unit == std::string::npos ? 1 : std::ldexp(1, 10 * static_cast<int>(unit + 1)));
  constexpr double kMost = 0x1p60;  ///< More than any machine has, and exact.
  if (!(bytes >= 1 && bytes <= kMost)) {
    throw_conversion(option, text, "a number of bytes such as 512M or 2G");
  }
  return static_cast<std::uint64_t>(bytes);
}

std::array<std::size_t, 2> parse_range(const std::string& option, const std::string& text) {
  const std::size_t dash = text.find('-');
  if (dash != std::string::npos) {
    const char* end = text.data() + text.size();
    const auto first = parse_number<std::size_t>(text.data(), text.data() + dash);
    const auto last = parse_number<std::size_t>(text.data() + dash + 1, end);
    if (first && last && *first <= *last) return {*first, *last};
  }
  throw_conversion(option, text, "two whole numbers such as 0-99, the smaller one first");
}

std::array<int, 2> parse_pixel(const std::string& option, const std::string& text) {
  const std::size_t comma = text.find(',');
  if (comma != std::string::npos) {
    const auto x = parse_number<int>(text.data(), text.data() + comma);
    const auto y = parse_number<int>(text.data() + comma + 1, text.data() + text.size());
    if (x && y && *x >= 0 && *y >= 0) return {*x, *y};
  }
  throw_conversion(option, text, "column and row of a pixel such as 320,240, from 0,0 on");
}

PartNumber parse_part(const std::string& option, const std::string& text) {
  const std::optional<PartNumber> part = PartNumber::parse(text);
  if (!part) throw_conversion(option, text, "a part of several such as 3/8, from 1/8 to 8/8");
  return *part;
}

Option* add_text(CommandLine& app, const std::string& names, const std::string& type,
                 const std::string& value, const std::string& description,
                 const std::function<void(const std::string&)>& assign) {
  Option* option = app.add_option(
      names, [assign](const std::vector<std::string>& results) { assign(results.at(0)); },
      description);
  return option->type_name(type)->default_str(value)->expected(1);
}

Option* add_texts(CommandLine& app, const std::string& names, const std::string& type,
                  const std::string& description,
                  const std::function<void(const std::vector<std::string>&)>& assign) {
  return app.add_option(names, assign, description)->type_name(type)->expected(1)->take_all();
}

Option* add_memory(CommandLine& app, std::optional<std::uint64_t>& value,
                   const std::string& description) {
  return add_text(app, "--memory", "BYTES", "auto",
                  description + ", such as 512M or 2G; auto = three quarters of what is free",
                  [&value](const std::string& text) {
                    value.reset();
                    if (text != "auto") value = parse_bytes("--memory", text);
                  });
}

Option* add_numbers(CommandLine& app, const std::string& names, int count, const std::string& value,
                    const std::string& description,
                    const std::function<void(const std::vector<double>&)>& assign) {
  std::string type = "N";
  for (int i = 1; i < count; ++i) type += ",N";
  return add_text(app, names, type, value, description,
                  [assign, count, name = long_name(names)](const std::string& text) {
                    assign(parse_numbers(name, text, count));
                  });
}

void check_numbers(CommandLine& app) {
  const auto whole = [](const auto least, const auto most) {
    return [least, most](std::string& text) -> std::string {
      const auto digits = whole_number(text);
      if (!digits) {
        return fmt::format("'{}' is not a whole number, such as 1500, 1.5k, 2M or 1e6", text);
      }
      const bool negative = digits->starts_with('-');
      const auto number = parse_number<std::decay_t<decltype(most)>>(
          digits->data(), digits->data() + digits->size());
      if (!number) {
        return fmt::format("{} is {} {}", text, negative ? "below" : "above",
                           negative ? fmt::to_string(least) : fmt::to_string(most));
      }
      text = *digits;
      return {};
    };
  };
  const auto number = [](std::string& text) -> std::string {
    char* end = nullptr;
    std::strtod(text.c_str(), &end);
    const bool all = !text.empty() && end == text.c_str() + text.size();
    return all ? std::string() : fmt::format("'{}' is not a number", text);
  };
  using Int = std::numeric_limits<int>;
  using Unsigned = std::numeric_limits<std::uint64_t>;
  for (Option* option : app.options()) {
    const std::string type = option->type_name();
    if (type.starts_with("INT")) option->transform(whole(Int::min(), Int::max()));
    if (type.starts_with("UINT")) option->transform(whole(Unsigned::min(), Unsigned::max()));
    if (type.starts_with("FLOAT")) option->transform(number);
  }
}

Option* add_size(CommandLine& app, const std::string& names, int& width, int& height,
                 const std::string& description) {
  return add_text(app, names, "WxH", fmt::format("{}x{}", width, height),
                  description + "; one number: a square",
                  [&width, &height, name = long_name(names)](const std::string& text) {
                    std::tie(width, height) = parse_size(name, text);
                  });
}

Vec3d parse_direction(const std::string& option, const std::string& text) {
  const bool negative = text.starts_with('-');
  const std::string axis = text.substr(negative ? 1 : 0);
  if (axis.size() == 1 && axis[0] >= 'x' && axis[0] <= 'z') {
    return (negative ? -1 : 1) * Vec3d::Unit(axis[0] - 'x');
  }
  const std::vector<double> numbers = parse_numbers(option, text, 3);
  return {numbers[0], numbers[1], numbers[2]};
}

void add_view(CommandLine& app, CameraOptions& camera, ViewChoice& choice) {
  add_vector(app, "--eye", camera.eye,
             "Eye, world coordinates; default: everything but stray points is seen");
  add_vector(app, "--from", camera.from, "Instead of --eye: direction from the target to the eye");
  add_vector(app, "--target", camera.target, "Point looked at; default: the scene's centre");
  add_text(app, "--up", "DIRECTION", "",
           "Direction that is up in the picture: x, y, z, -x, -y, -z, X,Y,Z, or auto, a guess that "
           "is said; default: auto, but y with --eye and --from",
           [&camera, &choice](const std::string& text) {
             camera.up.reset();
             choice.guess_up = text == "auto";
             if (text != "auto") camera.up = parse_direction("--up", text);
           });
  static const std::map<std::string, NamedView> kViews{
      {"front", NamedView::kFront}, {"back", NamedView::kBack},     {"left", NamedView::kLeft},
      {"right", NamedView::kRight}, {"top", NamedView::kTop},       {"bottom", NamedView::kBottom},
      {"iso", NamedView::kIso},     {"sensor", NamedView::kSensor},
  };
  add_text(app, "--view", "NAME", "",
           "Instead of --eye and --from: front, back, left, right, top, bottom or iso, by what up "
           "and front are guessed to be, or sensor, from where a scan was taken; default: from the "
           "front right, a little above, or as a scan was taken",
           [&choice](const std::string& text) {
             const auto known = kViews.find(text);
             if (known == kViews.end()) {
               throw OptionError("--view",
                                 fmt::format("'{}' is not one of front, back, left, right, top, "
                                             "bottom, iso, sensor",
                                             text));
             }
             choice.view = known->second;
           });
  app.add_option("--fov", camera.fov, "Vertical field of view, degrees, in (0, 180)");
  app.add_option("--ortho", camera.ortho,
                 "Orthographic projection of this visible height, scene units, > 0");
  add_size(app, "--size", camera.width, camera.height, "Size of the picture, pixels");
  app.add_option("--zoom", camera.zoom, "Enlarges the picture about its centre, once framed, > 0");
  app.add_flag("--frame-all", camera.frame_all,
               "Move the eye along its line of sight until the whole scene is just seen, with "
               "stray points");
}

}  // namespace surfel::tool
