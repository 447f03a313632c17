#pragma once

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace CLI {
class Option;
}

namespace surfel::tool {

/// A command line or a configuration file that cannot be understood, told for the user.
class OptionError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
  /// "--option: message".
  OptionError(const std::string& option, const std::string& message)
      : std::runtime_error(option + ": " + message) {}
};

/// An option, a flag or a positional argument. What changes it returns it, so that calls can be
/// chained.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}

  Option* required(bool value = true);
  /// How many values may follow.
  Option* expected(int count);
  Option* expected(int least, int most);
  /// An option given again adds a value instead of being refused.
  Option* take_all();
  Option* excludes(const Option* other);
  /// Its group in the help instead of the one that CommandLine::group() named.
  Option* group(const std::string& name);
  /// What the help calls its value. By INT, UINT and FLOAT, which numbers have by themselves,
  /// configuration files and reports know numbers from text.
  Option* type_name(const std::string& name);
  /// What the help says of its default.
  Option* default_str(const std::string& text);
  Option* description(const std::string& text);
  /// May it stand in a configuration file?
  Option* configurable(bool value);
  /// Refuses numbers outside.
  Option* range(int least, int most);
  Option* range(std::uint64_t least, std::uint64_t most);
  Option* range(double least, double most);
  /// Changes a text before it is read; a message that is returned refuses it.
  Option* transform(const std::function<std::string(std::string&)>& change);

  /// "--output" of -o,--output.
  std::string name() const;
  /// "input" of the positional argument `input`, empty of an option.
  std::string positional_name() const;
  /// "output", without dashes.
  const std::vector<std::string>& long_names() const;
  const std::vector<std::string>& short_names() const;
  bool is_positional() const;
  /// It has no value.
  bool is_flag() const;
  /// It may have several values.
  bool takes_many() const;
  const std::string& group() const;
  std::string type_name() const;
  std::string default_str() const;
  const std::string& description() const;
  bool configurable() const;
  bool excluded_by(const Option* other) const;

  /// How often it was given.
  std::size_t count() const;
  /// Its values as they were given.
  const std::vector<std::string>& results() const;
  /// Whether a flag was given, and not as false.
  bool is_set() const;
  /// Gives it the values, as if they stood on the command line: of a flag, "true" or "false".
  void give(const std::vector<std::string>& values);

 private:
  friend class CommandLine;
  CLI::Option* option_;
};

/// What a parsed command line asks for.
enum class Asked { kRun, kHelp, kAllHelp, kVersion };

/// The command line of a program: its options, bound to variables whose values are the defaults.
/// The one source that knows CLI11, which takes longer to compile than most programs that use it.
class CommandLine {
 public:
  explicit CommandLine(const std::string& description = {}, const std::string& name = {});
  ~CommandLine();
  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;

  /// Names are "--spacing", "-o,--output", or "surfels" for a positional argument.
  Option* add_option(const std::string& names, std::string& value,
                     const std::string& description = {});
  Option* add_option(const std::string& names, int& value, const std::string& description = {});
  Option* add_option(const std::string& names, std::uint64_t& value,
                     const std::string& description = {});
  Option* add_option(const std::string& names, float& value, const std::string& description = {});
  Option* add_option(const std::string& names, double& value, const std::string& description = {});
  Option* add_option(const std::string& names, std::vector<std::string>& value,
                     const std::string& description = {});
  Option* add_option(const std::string& names, std::vector<double>& value,
                     const std::string& description = {});
  Option* add_option(const std::string& names, std::optional<int>& value,
                     const std::string& description = {});
  Option* add_option(const std::string& names, std::optional<std::uint64_t>& value,
                     const std::string& description = {});
  Option* add_option(const std::string& names, std::optional<double>& value,
                     const std::string& description = {});
  /// An option whose values are handed to `assign`.
  Option* add_option(const std::string& names,
                     const std::function<void(const std::vector<std::string>&)>& assign,
                     const std::string& description);
  /// "!--no-charts" sets `value` to false.
  Option* add_flag(const std::string& names, bool& value, const std::string& description = {});
  /// --help, --help-all and --version, which parse() tells of.
  void add_standard_flags();
  /// Declares the option that names a configuration file, which `read` gives to the options.
  Option* add_config(const std::string& name, const std::string& description,
                     std::function<void(std::istream&)> read);
  /// The group in the help of the options declared from here on.
  void group(const std::string& name);

  /// Throws OptionError, and Error(kUsage) for a configuration file that cannot be read.
  /// \param words  the last word first.
  Asked parse(std::vector<std::string> words);
  /// Reads a configuration file as parse() does. Throws OptionError.
  void parse_config(std::istream& in);
  /// Forgets what was given.
  void clear();

  /// In the order of their declaration.
  std::vector<Option*> options() const;
  /// In the order in which they were given; an option stands as often as it was given, and what
  /// configuration files gave comes last.
  std::vector<Option*> parse_order() const;
  /// The option of a name as it is typed, which must exist.
  Option* get_option(const std::string& name) const;
  /// Null where there is none.
  Option* find_option(const std::string& name) const;
  /// Name of the configuration file; empty where none was given.
  std::string config_file() const;
  /// Is it --help or --help-all?
  bool is_help(const Option* option) const;
  /// Words that are neither options nor their values.
  std::vector<std::string> remaining() const;
  std::string description() const;
  std::string help() const;
  /// Text below the help.
  void footer(const std::string& text);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace surfel::tool
