#include "tools/support/options.h"

#include <sstream>
#include <string>
#include <vector>

#include <surfel/base/error.h>

#include "fuzz/checks.h"
#include "tools/support/color.h"
#include "tools/support/config_file.h"

namespace surfel::fuzz {
namespace {

/// Options of every kind, which configuration files may give.
struct Settings {
  tool::CommandLine app{"fuzz"};
  double number = 0;
  int count = 0;
  std::string word;
  std::vector<std::string> words;
  bool flag = false;

  Settings() {
    app.add_config("--config", "", [this](std::istream& in) { tool::read_config(app, in); });
    app.add_option("--number", number);
    app.add_option("--count", count)->range(0, 100);
    app.add_option("--word", word);
    app.add_option("--words", words);
    app.add_flag("--flag", flag);
  }
};

/// Calls parse(), which must end well or as wrong usage.
template <class Parse>
void parse_or_refuse(const Parse& parse) {
  try {
    parse();
  } catch (const Error& error) {
    require(error.kind() == ErrorKind::kUsage, "a wrong value is not wrong usage");
  } catch (const tool::OptionError&) {
  }
}

}  // namespace

/// Parses the bytes as values of options, and as a configuration file.
void options(Bytes bytes) {
  const std::string text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  parse_or_refuse([&] { tool::parse_numbers("--numbers", text, 3); });
  parse_or_refuse([&] { tool::parse_size("--size", text); });
  parse_or_refuse([&] { tool::parse_bytes("--bytes", text); });
  parse_or_refuse([&] { tool::parse_direction("--direction", text); });
  parse_or_refuse([&] { tool::parse_color("--color", text); });

  static Settings settings;
  parse_or_refuse([&] {
    std::istringstream in(text);
    settings.app.clear();
    settings.app.parse_config(in);
  });
}

}  // namespace surfel::fuzz
