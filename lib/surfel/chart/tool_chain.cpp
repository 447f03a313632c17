#include <algorithm>
#include <functional>
#include <sstream>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/nearest_name.h>
#include <surfel/base/shell_quote.h>
#include <surfel/chart/tool_chain.h>

namespace surfel {
namespace {

constexpr std::array<const char*, kStageCount> kTools = {"surfel-from-mesh", "surfel-estimate",
                                                         "surfel-texture",   "surfel-group",
                                                         "surfel-lod",       "surfel-render"};

std::size_t find_tool(const std::string& name) {
  const auto found = std::find(kTools.begin(), kTools.end(), name);
  if (found == kTools.end()) {
    throw_usage(fmt::format("`with`: '{}' is not one of {}{}", name, fmt::join(kTools, ", "),
                            did_you_mean(name, {kTools.begin(), kTools.end()})));
  }
  return static_cast<std::size_t>(found - kTools.begin());
}

/// "TOOL --option value --flag": the tool, and its options.
std::pair<std::size_t, std::vector<ToolOption>> parse_clause(const std::string& clause) {
  std::istringstream words(clause);
  std::string word;
  words >> word;
  const std::size_t tool = find_tool(word);
  std::vector<ToolOption> options;
  while (words >> word) {
    const std::size_t equals = word.find('=');
    if (word.starts_with('-')) {
      options.push_back(
          {word.substr(0, equals), equals == std::string::npos ? "" : word.substr(equals + 1)});
    } else if (!options.empty() && options.back().value.empty()) {
      options.back().value = word;
    } else {
      throw_usage(fmt::format("'{}' in '{}' is no option, nor the value of one", word, clause));
    }
  }
  return {tool, options};
}

/// Calls visit(tool, options) for every clause.
void for_each_clause(
    const std::string& changes,
    const std::function<void(std::size_t, const std::vector<ToolOption>&)>& visit) {
  std::istringstream clauses(changes);
  for (std::string clause; std::getline(clauses, clause, ';');) {
    if (clause.find_first_not_of(' ') == std::string::npos) continue;
    const auto [tool, options] = parse_clause(clause);
    visit(tool, options);
  }
}

auto find_option(std::vector<ToolOption>& options, const std::string& name) {
  return std::find_if(options.begin(), options.end(),
                      [&](const ToolOption& o) { return o.name == name; });
}

}  // namespace

const char* tool_name(Stage stage) { return kTools[static_cast<std::size_t>(stage)]; }

void ToolChain::set(Stage stage, const ToolOption& option) {
  run(stage);
  std::vector<ToolOption>& all = tools_[static_cast<std::size_t>(stage)].options;
  const auto old = find_option(all, option.name);
  if (old == all.end()) {
    all.push_back(option);
  } else {
    *old = option;
  }
}

void ToolChain::apply(const std::string& changes) {
  for_each_clause(changes, [&](std::size_t i, const std::vector<ToolOption>& options) {
    run(static_cast<Stage>(i));
    for (const ToolOption& option : options) set(static_cast<Stage>(i), option);
  });
}

void ToolChain::remove_options(const std::string& changes) {
  for_each_clause(changes, [&](std::size_t stage, const std::vector<ToolOption>& options) {
    for (const ToolOption& option : options) {
      std::vector<ToolOption>& all = tools_[stage].options;
      const auto old = find_option(all, option.name);
      if (old != all.end()) all.erase(old);
    }
  });
}

const std::string* ToolChain::value(Stage stage, const std::string& name) const {
  for (const ToolOption& option : options(stage)) {
    if (option.name == name) return &option.value;
  }
  return nullptr;
}

std::vector<std::string> words_of(const std::vector<ToolOption>& options) {
  std::vector<std::string> words;
  for (const ToolOption& option : options) {
    if (option.value.starts_with('-')) {
      words.push_back(option.name + "=" + option.value);
      continue;
    }
    words.push_back(option.name);
    if (!option.value.empty()) words.push_back(option.value);
  }
  return words;
}

std::vector<ChainCommand> preparing_commands(const ToolChain& chain, const std::string& input) {
  std::vector<ChainCommand> commands;
  std::string last = input;
  std::string history;
  for (std::size_t i = 0; i < kStageCount; ++i) {
    const auto stage = static_cast<Stage>(i);
    if (stage == Stage::kRender || !chain.runs(stage)) continue;
    ChainCommand command{stage, {tool_name(stage), last}, ""};
    for (std::string& word : words_of(chain.options(stage))) {
      command.words.push_back(std::move(word));
    }
    history += shell_command(command.words) + "\n";
    command.output = "surfels-" + text_hash(history).substr(0, 8) + ".ply";
    last = command.output;
    command.words.insert(command.words.end(), {"-o", command.output});
    commands.push_back(std::move(command));
  }
  return commands;
}

std::string text_hash(const std::string& text) {
  std::uint64_t hash = 0xcbf29ce484222325U;
  for (const char c : text) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001b3U;
  }
  return fmt::format("{:016x}", hash);
}

}  // namespace surfel
