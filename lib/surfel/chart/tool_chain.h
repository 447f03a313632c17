#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// The tools that lead from a file to a picture, in the order in which they run.
enum class Stage : std::uint8_t { kSample, kEstimate, kTexture, kGroup, kLod, kRender };
inline constexpr std::size_t kStageCount = 6;

/// Name of a stage's tool: "surfel-from-mesh".
SURFEL_API const char* tool_name(Stage stage);

/// An option as it stands on a command line; a flag has no value.
struct ToolOption {
  std::string name;  ///< Name with its dashes.
  std::string value;
  bool operator==(const ToolOption&) const = default;
};

/// The tools that run, with their options.
class SURFEL_API ToolChain {
 public:
  /// Makes the changes that a text tells: "TOOL option...; TOOL option...". A tool that is named
  /// runs from now on; an option replaces the one of that name. Words that begin with a dash are
  /// options, a value that does is joined by "=" (--from=-1,0,0). Throws Error(kUsage) for another
  /// text, or an unknown tool.
  void apply(const std::string& changes);

  /// Gives a tool an option, which replaces the one of its name; the tool runs from now on.
  void set(Stage stage, const ToolOption& option);
  /// Makes a tool run with the options that it has.
  void run(Stage stage) { tools_[static_cast<std::size_t>(stage)].runs = true; }

  /// Takes back the options, but not the tools, that `changes` names.
  void remove_options(const std::string& changes);

  bool runs(Stage stage) const { return tool(stage).runs; }
  const std::vector<ToolOption>& options(Stage stage) const { return tool(stage).options; }
  /// Value of an option; null if it is not given.
  const std::string* value(Stage stage, const std::string& name) const;
  bool operator==(const ToolChain&) const = default;

 private:
  struct Tool {
    bool runs = false;
    std::vector<ToolOption> options;
    bool operator==(const Tool&) const = default;
  };
  const Tool& tool(Stage stage) const { return tools_[static_cast<std::size_t>(stage)]; }

  std::array<Tool, kStageCount> tools_;
};

/// One process of a chain.
struct ChainCommand {
  Stage stage = Stage::kRender;
  std::vector<std::string> words;  ///< words[0] is the tool's name.
  std::string output;              ///< Name of the file that it writes, without a folder.
};

/// The commands of a chain up to the last stage before rendering. `input` is read by the first; the
/// outputs are named after the commands that lead to them, so that chains that begin alike share
/// files.
SURFEL_API std::vector<ChainCommand> preparing_commands(const ToolChain& chain,
                                                        const std::string& input);

/// The words of options as a command line has them.
SURFEL_API std::vector<std::string> words_of(const std::vector<ToolOption>& options);

/// Sixteen hexadecimal digits that stand for a text (FNV-1a, 64 bits).
SURFEL_API std::string text_hash(const std::string& text);

}  // namespace surfel
