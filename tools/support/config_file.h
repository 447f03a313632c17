#pragma once

#include <iosfwd>
#include <string>

#include "tools/support/command_line.h"
#include "tools/support/json.h"

namespace surfel::tool {

/// Gives the options the values of a --config file: TOML, where every option stands under its own
/// long name without the dashes. Options given on the command line win. Errors (OptionError) name
/// file, line and key: bad TOML, an unknown key, a table, a value that the option refuses.
void read_config(CommandLine& app, std::istream& in);

/// The settings in force as TOML that read_config() reads.
std::string config_text(const CommandLine& app);

/// Value in force of an option, given or default: truth value, number, text or array of these; null
/// where it is not set and has no default.
Json value_in_force(const Option& option);

/// Name of an option without dashes, as it stands in configuration files and reports.
std::string plain_name(const Option& option);

}  // namespace surfel::tool
