#include "tools/support/option_pages.h"

#include <algorithm>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace surfel::tool {
namespace {

/// Text of a line of roff: no word of it is taken for a request, no minus for a hyphen.
std::string roff(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
  }
  if (!out.empty() && (out[0] == '.' || out[0] == '\'')) out.insert(0, "\\&");
  return out;
}

/// "-o", "--output".
std::vector<std::string> names_of(const Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.short_names()) names.push_back("-" + name);
  for (const std::string& name : option.long_names()) names.push_back("--" + name);
  return names;
}

std::vector<const Option*> options_of(const CommandLine& app) {
  std::vector<const Option*> options;
  for (const Option* option : app.options()) {
    if (!option->is_positional()) options.push_back(option);
  }
  return options;
}

void append_option(const Option& option, std::string& out) {
  std::vector<std::string> names;
  for (const std::string& name : names_of(option)) {
    names.push_back(fmt::format("\\fB{}\\fR", roff(name)));
  }
  if (names.empty()) names.push_back(fmt::format("\\fI{}\\fR", roff(option.positional_name())));
  out += fmt::format(".TP\n{}", fmt::join(names, ", "));
  if (!option.is_flag() && !option.is_positional()) {
    out += fmt::format(" \\fI{}\\fR", roff(option.type_name()));
  }
  out += fmt::format("\n{}", roff(option.description()));
  if (!option.default_str().empty()) {
    out += fmt::format(" (default: {})", roff(option.default_str()));
  }
  out += '\n';
}

/// In single quotes for all three shells.
std::string in_quotes(std::string_view text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'') {
      out += "'\\''";
    } else {
      out += c;
    }
  }
  return out + "'";
}

/// What stands before the first of these marks, to be read beside a name.
std::string in_short(const Option& option) {
  const std::string& text = option.description();
  return text.substr(0, text.find_first_of(":;(\n"));
}

std::string bash_script(const CommandLine& app, const std::string& name) {
  std::string function = "_" + name;
  std::replace(function.begin(), function.end(), '-', '_');
  std::vector<std::string> all;
  std::vector<std::string> with_value;
  std::string cases;
  for (const Option* option : options_of(app)) {
    const std::vector<std::string> names = names_of(*option);
    all.insert(all.end(), names.begin(), names.end());
    const std::vector<std::string> choices = choices_of(*option);
    if (!choices.empty()) {
      cases += fmt::format("    {}) COMPREPLY=($(compgen -W '{}' -- \"$cur\")); return ;;\n",
                           fmt::join(names, "|"), fmt::join(choices, " "));
    } else if (!option->is_flag()) {
      with_value.insert(with_value.end(), names.begin(), names.end());
    }
  }
  return fmt::format(
      "{0}() {{\n"
      "  local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD - 1]}}\n"
      "  COMPREPLY=()\n"
      "  case $prev in\n{1}    {2}) return ;;\n  esac\n"
      "  if [[ $cur == -* ]]; then\n"
      "    COMPREPLY=($(compgen -W '{3}' -- \"$cur\"))\n"
      "  fi\n"
      "}}\n"
      "complete -o default -F {0} {4}\n",
      function, cases, fmt::join(with_value, "|"), fmt::join(all, " "), name);
}

/// Text of a specification of _arguments, in which brackets and colons have a meaning.
std::string zsh_text(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

std::string zsh_script(const CommandLine& app, const std::string& name) {
  std::string out = fmt::format("#compdef {}\n_arguments -S \\\n", name);
  for (const Option* option : options_of(app)) {
    const std::vector<std::string> choices = choices_of(*option);
    std::string value;
    if (!choices.empty()) {
      value = fmt::format(":{}:({})", option->type_name(), fmt::join(choices, " "));
    } else if (!option->is_flag()) {
      value = fmt::format(":{}:_files", zsh_text(option->type_name()));
    }
    for (const std::string& typed : names_of(*option)) {
      out += fmt::format("  {} \\\n", in_quotes(fmt::format("{}[{}]{}", typed,
                                                            zsh_text(in_short(*option)), value)));
    }
  }
  return out + "  '*:file:_files'\n";
}

std::string fish_script(const CommandLine& app, const std::string& name) {
  std::string out;
  for (const Option* option : options_of(app)) {
    out += "complete -c " + name;
    for (const std::string& typed : option->short_names()) out += " -s " + typed;
    for (const std::string& typed : option->long_names()) out += " -l " + typed;
    const std::vector<std::string> choices = choices_of(*option);
    if (!choices.empty()) {
      out += " -x -a " + in_quotes(fmt::format("{}", fmt::join(choices, " ")));
    } else if (!option->is_flag()) {
      out += " -r";
    }
    out += " -d " + in_quotes(in_short(*option)) + "\n";
  }
  return out;
}

}  // namespace

std::vector<std::string> choices_of(const Option& option) {
  std::vector<std::string> choices;
  const std::string& text = option.description();
  const std::size_t open = text.rfind('(');
  if (option.type_name() != "NAME" || open == std::string::npos || text.back() != ')') {
    return choices;
  }
  for (std::size_t begin = open + 1; begin < text.size();) {
    const std::size_t end = std::min(text.find(", ", begin), text.size() - 1);
    choices.push_back(text.substr(begin, end - begin));
    begin = end + 2;
  }
  return choices;
}

std::string manual_page(const CommandLine& app, const ToolPage& page) {
  std::string out = fmt::format(
      ".TH {0} 1 \"\" \"Surfelkit {1}\" \"Surfelkit\"\n.SH NAME\n{2} \\- {3}\n.SH SYNOPSIS\n.B "
      "{2}\n"
      "[\\fIOPTIONS\\fR]",
      roff(page.name), page.version, roff(page.name), roff(app.description()));
  std::string positionals;
  std::vector<std::string> groups;
  for (const Option* option : app.options()) {
    if (option->is_positional()) {
      out += fmt::format(" \\fI{}\\fR{}", roff(option->positional_name()),
                         option->takes_many() ? "..." : "");
      append_option(*option, positionals);
      continue;
    }
    if (std::find(groups.begin(), groups.end(), option->group()) == groups.end()) {
      groups.push_back(option->group());
    }
  }
  out += "\n.SH OPTIONS\n" + positionals;
  for (const std::string& group : groups) {
    out += fmt::format(".SS \"{}\"\n", roff(group));
    for (const Option* option : options_of(app)) {
      if (option->group() == group) append_option(*option, out);
    }
  }
  out += ".SH EXAMPLES\n";
  for (const std::string& example : page.examples) {
    out += fmt::format(".PP\n.nf\n{}\n.fi\n", roff(example));
  }
  out +=
      ".SH EXIT STATUS\n"
      "0: done; 1: the input or the machine does not allow what was asked for; 2: wrong usage.\n"
      ".SH ENVIRONMENT\n"
      ".TP\n\\fBSURFEL_INSTRUCTIONS\\fR\nThe set of vector instructions to use; results do not "
      "depend on it.\n"
      ".TP\n\\fBNO_COLOR\\fR\nNo colours in messages.\n";
  return out;
}

std::string completion_script(const CommandLine& app, const std::string& name, Shell shell) {
  switch (shell) {
    case Shell::kBash:
      return bash_script(app, name);
    case Shell::kZsh:
      return zsh_script(app, name);
    case Shell::kFish:
      break;
  }
  return fish_script(app, name);
}

}  // namespace surfel::tool
