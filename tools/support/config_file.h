#pragma once

#include <string>

#include <CLI/CLI.hpp>
#include <nlohmann/json_fwd.hpp>

namespace surfel::tool {

/// Reads --config files for CLI11: TOML, where every option stands under its own long name without
/// the dashes. Options given on the command line win. Errors (CLI::ConversionError) name file, line
/// and key: bad TOML, an unknown key, a table, a value that the option refuses.
class ConfigFile : public CLI::Config {
 public:
  explicit ConfigFile(CLI::App& app) : app_(app) {}

  std::vector<CLI::ConfigItem> from_config(std::istream& in) const override;

  /// The settings in force as TOML that from_config() reads.
  std::string to_config(const CLI::App* app, bool, bool, std::string) const override;

 private:
  CLI::App& app_;
};

/// Value in force of an option, given or default: truth value, number, text or array of these; null
/// where it is not set and has no default.
nlohmann::json value_in_force(const CLI::Option& option);

/// Name of an option without dashes, as it stands in configuration files and reports.
std::string plain_name(const CLI::Option& option);

}  // namespace surfel::tool
