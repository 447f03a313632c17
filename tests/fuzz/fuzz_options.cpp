// Parses the bytes as values of options, and as a configuration file.

#include <sstream>

#include "fuzz/fuzz_file.h"
#include "tools/support/color.h"
#include "tools/support/config_file.h"
#include "tools/support/options.h"

using namespace surfel;

namespace {

/// Calls parse(), which must end well or as wrong usage.
template <class Parse>
void parse_or_refuse(const Parse& parse) {
  try {
    parse();
  } catch (const Error& error) {
    fuzz::require(error.kind() == ErrorKind::kUsage, "a wrong value is not wrong usage");
  } catch (const CLI::ParseError&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  parse_or_refuse([&] { tool::parse_numbers("--numbers", text, 3); });
  parse_or_refuse([&] { tool::parse_size("--size", text); });
  parse_or_refuse([&] { tool::parse_bytes("--bytes", text); });
  parse_or_refuse([&] { tool::parse_direction("--direction", text); });
  parse_or_refuse([&] { tool::parse_color("--color", text); });

  CLI::App app("fuzz");
  app.set_config("--config");
  double number = 0;
  std::string word;
  bool flag = false;
  app.add_option("--number", number);
  app.add_option("--word", word);
  app.add_flag("--flag", flag);
  parse_or_refuse([&] {
    std::istringstream in(text);
    tool::ConfigFile(app).from_config(in);
  });
  return 0;
}
