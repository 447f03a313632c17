#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/base/process.h>
#include <surfel/base/shell_quote.h>
#include <surfel/chart/tool_run.h>
#include <surfel/io/image_io.h>
#include <surfel/io/named_file.h>

namespace surfel {
namespace {

using Json = nlohmann::json;

Json to_json(const ToolRun& run) {
  Json stages = Json::array();
  for (const auto& [name, ms] : run.stages) stages.push_back({name, ms});
  return {{"exit_code", run.exit_code}, {"message", run.message}, {"ms", run.ms},
          {"stages", stages},           {"memory", run.memory},   {"surfels", run.surfels},
          {"groups", run.groups}};
}

ToolRun from_json(const Json& json) {
  ToolRun run{json.at("exit_code"), json.at("message"), json.at("ms"),    {},
              json.at("memory"),    json.at("surfels"), json.at("groups")};
  for (const Json& stage : json.at("stages")) run.stages.emplace_back(stage.at(0), stage.at(1));
  return run;
}

/// From the report that a tool wrote (--stats).
ToolRun from_report(const Json& report) {
  ToolRun run;
  run.memory = report.at("peak_memory_bytes");
  run.surfels = report.value("surfels", std::size_t{0});
  const bool picture = report.contains("frames") && !report["frames"].empty();
  const Json& timed = picture ? report["frames"].front() : report;
  const std::string tool = report.at("tool");
  const Json stages = timed.value("stages", Json::object());
  for (const auto& [name, ms] : stages.items()) {
    run.stages.emplace_back(tool + " " + name, ms);
    run.ms += ms.get<double>();
  }
  if (picture) {
    run.ms = timed.at("ms");
    run.groups = timed.at("groups");
  }
  return run;
}

bool reads_images(const std::string& tool) {
  return tool == "surfel-from-mesh" || tool == "surfel-texture" || tool == "surfel-render";
}

/// "surfel-x: error: what is wrong" without the tool; other lines are left out.
std::string error_message(const std::string& errors) {
  std::istringstream lines(errors);
  const std::string mark = "error: ";
  for (std::string line; std::getline(lines, line);) {
    const std::size_t at = line.find(mark);
    if (at != std::string::npos) return line.substr(at + mark.size());
  }
  return errors;
}

}  // namespace

void ToolRun::require_success() const {
  if (wrong_usage()) throw_usage(message);
  if (exit_code != 0) throw_input("", message);
}

ToolRun ToolRunner::run(const std::vector<std::string>& words, const std::string& output,
                        const std::string& occasion) {
  const std::string key = shell_command(words) + " # " + occasion;
  if (const std::string* known = journal_.find(key)) {
    const ToolRun before = from_json(Json::parse(*known));
    const bool there = output.empty() || std::filesystem::exists(folder_ + "/" + output);
    if (before.exit_code != 0 || there) return before;
  }
  std::vector<std::string> command = words;
  command[0] = tools_ + "/" + words[0];
  command.insert(command.end(), {"--stats", "stats.json", "--quiet"});
  const std::string limit = "--max-pixels";
  if (reads_images(words[0]) && std::count(words.begin(), words.end(), limit) == 0) {
    command.insert(command.end(), {limit, std::to_string(most_image_pixels())});
  }
  if (reads_images(words[0]) && outside_allowed()) command.emplace_back("--allow-outside");
  const ProcessResult process = run_process(command, folder_);
  ToolRun result;
  if (process.exit_code == 0) {
    std::ifstream stats(folder_ + "/stats.json");
    result = from_report(Json::parse(stats));
  } else {
    result.message = words[0] + ": " + error_message(process.errors);
  }
  result.exit_code = process.exit_code;
  // Other failures may have come from outside, like an interrupt.
  if (result.exit_code == 0 || result.wrong_usage()) {
    journal_.add(key, to_json(result).dump(-1, ' ', false, Json::error_handler_t::replace));
  }
  return result;
}

}  // namespace surfel
