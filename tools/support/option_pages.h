#pragma once

#include <string>
#include <vector>

#include "tools/support/command_line.h"

namespace surfel::tool {

/// What a page about a tool tells beside the options.
struct ToolPage {
  std::string name;
  std::string version;
  std::vector<std::string> examples;  ///< Commands as they are typed.
};

enum class Shell { kBash, kZsh, kFish };

/// The manual page of a tool in roff's man macros, from the table of its options.
std::string manual_page(const CommandLine& app, const ToolPage& page);

/// The script that lets a shell complete the names of a tool's options, and the values of those
/// that are one of a set; all other values are completed as names of files.
std::string completion_script(const CommandLine& app, const std::string& name, Shell shell);

/// The values that an option of add_choice() takes; empty for other options.
std::vector<std::string> choices_of(const Option& option);

}  // namespace surfel::tool
