#include "tools/support/command_line.h"

#include <map>
#include <utility>

#include <CLI/CLI.hpp>
#include <surfel/base/error.h>

namespace surfel::tool {
namespace {

/// Lets another read configuration files; nothing is left for CLI11 to do with them.
class Config : public CLI::Config {
 public:
  explicit Config(std::function<void(std::istream&)> read) : read_(std::move(read)) {}

  std::vector<CLI::ConfigItem> from_config(std::istream& in) const override {
    read_(in);
    return {};
  }
  std::string to_config(const CLI::App*, bool, bool, std::string) const override { return {}; }

 private:
  std::function<void(std::istream&)> read_;
};

template <class Number>
CLI::Validator range_of(Number least, Number most) {
  return CLI::Range(least, most).description("");
}

}  // namespace

Option* Option::required(bool value) {
  option_->required(value);
  return this;
}

Option* Option::expected(int count) {
  option_->expected(count);
  return this;
}

Option* Option::expected(int least, int most) {
  option_->expected(least, most);
  return this;
}

Option* Option::take_all() {
  option_->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  return this;
}

Option* Option::excludes(const Option* other) {
  option_->excludes(other->option_);
  return this;
}

Option* Option::group(const std::string& name) {
  option_->group(name);
  return this;
}

Option* Option::type_name(const std::string& name) {
  option_->type_name(name);
  return this;
}

Option* Option::default_str(const std::string& text) {
  option_->default_str(text);
  return this;
}

Option* Option::description(const std::string& text) {
  option_->description(text);
  return this;
}

Option* Option::configurable(bool value) {
  option_->configurable(value);
  return this;
}

Option* Option::range(int least, int most) {
  option_->check(range_of(least, most));
  return this;
}

Option* Option::range(std::uint64_t least, std::uint64_t most) {
  option_->check(range_of(least, most));
  return this;
}

Option* Option::range(double least, double most) {
  option_->check(range_of(least, most));
  return this;
}

Option* Option::transform(const std::function<std::string(std::string&)>& change) {
  option_->transform(CLI::Validator(change, ""));
  return this;
}

std::string Option::name() const { return option_->get_name(); }
std::string Option::positional_name() const { return option_->get_name(true); }
const std::vector<std::string>& Option::long_names() const { return option_->get_lnames(); }
const std::vector<std::string>& Option::short_names() const { return option_->get_snames(); }
bool Option::is_positional() const { return !option_->nonpositional(); }
bool Option::is_flag() const { return option_->get_expected_max() == 0; }
bool Option::takes_many() const { return option_->get_items_expected_max() > 1; }
const std::string& Option::group() const { return option_->get_group(); }
std::string Option::type_name() const { return option_->get_type_name(); }
std::string Option::default_str() const { return option_->get_default_str(); }
const std::string& Option::description() const { return option_->get_description(); }
bool Option::configurable() const { return option_->get_configurable(); }

bool Option::excluded_by(const Option* other) const {
  return option_->get_excludes().count(other->option_) > 0 ||
         other->option_->get_excludes().count(option_) > 0;
}

std::size_t Option::count() const { return option_->count(); }
const std::vector<std::string>& Option::results() const { return option_->results(); }
bool Option::is_set() const { return count() > 0 && option_->as<bool>(); }

void Option::give(const std::vector<std::string>& values) {
  try {
    if (is_flag()) {
      option_->add_result(option_->get_flag_value(long_names().front(), values.front()));
    } else {
      option_->add_result(values);
    }
    option_->run_callback();
  } catch (const CLI::Error& error) {
    throw OptionError(error.what());
  }
}

struct CommandLine::Impl {
  Impl(const std::string& description, const std::string& name) : app(description, name) {}

  CLI::App app;
  std::map<const CLI::Option*, Option> handles;

  Option* handle(CLI::Option* option) {
    return option ? &handles.try_emplace(option, option).first->second : nullptr;
  }
  std::vector<Option*> handles_of(const std::vector<CLI::Option*>& options) {
    std::vector<Option*> all;
    for (CLI::Option* option : options) all.push_back(handle(option));
    return all;
  }
};

CommandLine::CommandLine(const std::string& description, const std::string& name)
    : impl_(std::make_unique<Impl>(description, name)) {
  impl_->app.option_defaults()->always_capture_default();
  impl_->app.get_formatter()->column_width(34);
}

CommandLine::~CommandLine() = default;

Option* CommandLine::add_option(const std::string& names, std::string& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, int& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, std::uint64_t& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, float& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, double& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, std::vector<std::string>& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, std::vector<double>& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, std::optional<int>& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, std::optional<std::uint64_t>& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names, std::optional<double>& value,
                                const std::string& description) {
  return impl_->handle(impl_->app.add_option(names, value, description));
}

Option* CommandLine::add_option(const std::string& names,
                                const std::function<void(const std::vector<std::string>&)>& assign,
                                const std::string& description) {
  const auto callback = [assign](const CLI::results_t& results) {
    assign(results);
    return true;
  };
  return impl_->handle(impl_->app.add_option(names, callback, description));
}

Option* CommandLine::add_flag(const std::string& names, bool& value,
                              const std::string& description) {
  return impl_->handle(impl_->app.add_flag(names, value, description));
}

void CommandLine::add_standard_flags() {
  impl_->handles.clear();  // CLI11 makes its --help anew.
  impl_->app.set_help_flag("-h,--help", "Print the everyday options and examples, and exit")
      ->configurable(false);
  impl_->app.set_help_all_flag("--help-all", "Print all options and exit");
  impl_->app.set_version_flag("--version", "", "Print the version and exit")->configurable(false);
}

Option* CommandLine::add_config(const std::string& name, const std::string& description,
                                std::function<void(std::istream&)> read) {
  impl_->app.config_formatter(std::make_shared<Config>(std::move(read)));
  return impl_->handle(impl_->app.set_config(name, "", description));
}

void CommandLine::group(const std::string& name) { impl_->app.option_defaults()->group(name); }

Asked CommandLine::parse(std::vector<std::string> words) {
  try {
    impl_->app.parse(std::move(words));
  } catch (const CLI::CallForHelp&) {
    return Asked::kHelp;
  } catch (const CLI::CallForAllHelp&) {
    return Asked::kAllHelp;
  } catch (const CLI::CallForVersion&) {
    return Asked::kVersion;
  } catch (const CLI::FileError&) {
    throw_usage(config_file() + ": cannot be read");
  } catch (const CLI::Error& error) {
    throw OptionError(error.what());
  }
  return Asked::kRun;
}

void CommandLine::parse_config(std::istream& in) {
  try {
    impl_->app.parse_from_stream(in);
  } catch (const CLI::Error& error) {
    throw OptionError(error.what());
  }
}

void CommandLine::clear() { impl_->app.clear(); }

std::vector<Option*> CommandLine::options() const {
  return impl_->handles_of(impl_->app.get_options(nullptr));
}

std::vector<Option*> CommandLine::parse_order() const {
  return impl_->handles_of(impl_->app.parse_order());
}

Option* CommandLine::get_option(const std::string& name) const {
  return impl_->handle(impl_->app.get_option(name));
}

Option* CommandLine::find_option(const std::string& name) const {
  return impl_->handle(impl_->app.get_option_no_throw(name));
}

std::string CommandLine::config_file() const {
  return impl_->app.get_config_ptr()->as<std::string>();
}

bool CommandLine::is_help(const Option* option) const {
  return option->option_ == impl_->app.get_help_ptr() ||
         option->option_ == impl_->app.get_help_all_ptr();
}

std::vector<std::string> CommandLine::remaining() const { return impl_->app.remaining(); }
std::string CommandLine::description() const { return impl_->app.get_description(); }
std::string CommandLine::help() const { return impl_->app.help(); }
void CommandLine::footer(const std::string& text) { impl_->app.footer(text); }

}  // namespace surfel::tool
