// Time and memory that the tools take of adversarial geometry, beside a sphere of the same size.
//
//   adversarial_table TOOLS COUNT [COMMAND [CASE]]
//
// TOOLS is the folder with the tools, COUNT the surfels or faces. With COMMAND only what begins so
// is run, with CASE only that case beside the benign one; every run is reported to standard error,
// the table goes to standard output. Exits with 1 where a run takes more than it may.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <support/adversarial_clouds.h>
#include <support/measured_run.h>
#include <unistd.h>

namespace {

constexpr double kMostTime = 5;         ///< Times the benign case's.
constexpr double kMostRefusal = 1;      ///< Seconds until the input is refused.
constexpr double kMostMemory = 2;       ///< Times the benign case's, or ...
constexpr double kMostMegabytes = 100;  ///< ... this.

struct Command {
  std::string name;  ///< What is typed, without the files.
  /// kTwice: a cloud, named twice.
  enum class Input { kCloud, kTwice, kGrouped, kPoints, kMesh } input = Input::kCloud;
  std::string output;  ///< Extension; empty: none.
};

/// Whether hardly any tool reads a cloud, for its scale: the table leaves it out.
bool refused_by_all(const std::string& name) {
  static const std::set<std::string> names{"denormal",    "denormal-spacing", "scale-1e-30",
                                           "scale-1e-20", "scale-1e20",       "scale-1e30"};
  return names.count(name) > 0;
}

std::vector<Command> commands() {
  using enum Command::Input;
  return {
      {"surfel-info", kCloud, ""},
      {"surfel-convert", kCloud, "ply"},
      {"surfel-convert --align", kTwice, "ply"},
      {"surfel-estimate", kCloud, "ply"},
      {"surfel-estimate -k auto --remove-outliers", kCloud, "ply"},
      {"surfel-texture --solid noise", kCloud, "ply"},
      {"surfel-texture --from colors --fit gram", kCloud, "ply"},
      {"surfel-texture --from colors --fit render", kCloud, "ply"},
      {"surfel-group", kCloud, "ply"},
      {"surfel-group --order dsatur", kCloud, "ply"},
      {"surfel-group --groups 4", kCloud, "ply"},
      {"surfel-group --groups 4 --cover enlarge", kCloud, "ply"},
      {"surfel-group --groups 4 --cover enlarge-each", kCloud, "ply"},
      {"surfel-group --groups 4 --cover duplicate", kCloud, "ply"},
      {"surfel-lod", kCloud, "ply"},
      {"surfel-simplify --count 2000", kCloud, "ply"},
      {"surfel-simplify --max-error 0.05", kCloud, "ply"},
      {"surfel-render", kCloud, "png"},
      {"surfel-render", kPoints, "png"},
      {"surfel-render --layers 16", kCloud, "png"},
      {"surfel-render --kernel perspective", kCloud, "png"},
      {"surfel-render --memory 1M", kCloud, "png"},
      {"surfel-render --filter ewa-source --size 64x64", kCloud, "png"},
      {"surfel-render --reference --samples 2 --size 64x64", kCloud, "png"},
      {"surfel-render --method deferred", kGrouped, "png"},
      {"surfel-render --method transparent", kGrouped, "png"},
      {"surfel-render --method transparent-high", kGrouped, "png"},
      {"surfel-render --method two-pass", kGrouped, "png"},
      {"surfel-render --method depth-peel", kGrouped, "png"},
      {"surfel-from-mesh --count 20000", kMesh, "ply"},
      {"surfel-from-mesh --count 20000 --adaptive", kMesh, "ply"},
      {"surfel-info", kMesh, ""},
      {"surfel-render", kMesh, "png"},
  };
}

/// The file that a command runs on.
std::string input_of(const Command& command, const std::string& name, std::size_t count) {
  using namespace surfel::test;
  if (command.input == Command::Input::kMesh) return adversarial_mesh(name, count);
  if (command.input == Command::Input::kPoints) return adversarial_points(name, count);
  return adversarial_cloud(name, count, command.input == Command::Input::kGrouped);
}

/// The words of a command line on a file.
std::vector<std::string> command_line(const Command& command, const std::string& tools,
                                      const std::string& input, const std::string& output) {
  std::vector<std::string> words = surfel::test::words_of(command.name);
  words[0] = tools + "/" + words[0];
  words.insert(words.begin() + 1, input);
  if (command.input == Command::Input::kTwice) words.insert(words.begin() + 1, input);
  words.insert(words.end(), {"--threads", "1", "--quiet"});
  if (!command.output.empty()) words.insert(words.end(), {"-o", output});
  return words;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace surfel::test;
  if (argc < 3) {
    std::fputs("adversarial_table TOOLS COUNT [COMMAND [CASE]]\n", stderr);
    return 2;
  }
  const std::string tools = argv[1];
  const std::size_t count = std::stoul(argv[2]);
  const std::string only_command = argc > 3 ? argv[3] : "";
  const std::string only_case = argc > 4 ? argv[4] : "";
  std::string folder = (std::filesystem::temp_directory_path() / "adversarial-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) return 1;

  bool within = true;
  for (const Command& command : commands()) {
    if (command.name.rfind(only_command, 0) != 0) continue;
    const bool mesh = command.input == Command::Input::kMesh;
    MeasuredRun benign;
    double longest = 0, most = 0;
    std::string longest_case, most_case, all_huge, refused;
    for (const AdversarialCase& at : mesh ? adversarial_meshes() : adversarial_clouds()) {
      if (!only_case.empty() && at.name != only_case && at.name != "benign") continue;
      const std::string input = folder + "/" + at.name + (mesh ? ".obj" : ".ply");
      const std::string output = folder + "/out." + command.output;
      std::ofstream(input, std::ios::binary) << input_of(command, at.name, count);
      const MeasuredRun run = measured_run(command_line(command, tools, input, output), folder);
      std::filesystem::remove(input);
      std::filesystem::remove(output);
      if (at.name == "benign") benign = run;
      const double time = run.seconds / benign.seconds;
      const double memory = run.megabytes / benign.megabytes;
      const bool refusal = run.exit_code == 1 && run.message.find(input) != std::string::npos;
      const bool in_time = time <= kMostTime || (refusal && run.seconds <= kMostRefusal);
      const bool in_memory = memory <= kMostMemory || run.megabytes <= kMostMegabytes;
      const bool good = (run.exit_code == 0 || refusal) && in_time && in_memory;
      within = within && good;
      fmt::print(stderr, "{:4} {:46} {:18} {:6.2f} s {:6.1f} {:6.0f} MB {:5.2f} exit {:2} {}\n",
                 good ? "" : "BAD", command.name, at.name, run.seconds, time, run.megabytes, memory,
                 run.exit_code, run.message);
      if (refusal) {
        if (!refused_by_all(at.name))
          refused += fmt::format("{}`{}`", refused.empty() ? "" : ", ", at.name);
        continue;
      }
      if (at.name == "all-huge") {
        all_huge = fmt::format("{:.1f}", time);
      } else if (at.name != "benign") {
        if (time > longest) longest = time, longest_case = at.name;
        if (memory > most) most = memory, most_case = at.name;
      }
    }
    fmt::print("| `{}`{} | {} | {:.0f} ms, {:.0f} MB | {:.1f} `{}` | {:.1f} `{}` | {} | {} |\n",
               command.name,
               mesh                                       ? " of a mesh"
               : command.input == Command::Input::kPoints ? " of points, x y z alone"
                                                          : "",
               count, 1e3 * benign.seconds, benign.megabytes, longest, longest_case, most,
               most_case, all_huge, refused);
    std::fflush(stdout);
  }
  std::filesystem::remove_all(folder);
  return within ? 0 : 1;
}
