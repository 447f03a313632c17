// All tools, or the library in one process, on inputs that change from round to round: sound ones,
// adversarial ones, damaged ones.
//
//   soak TOOLS|library MINUTES [SEED]
//
// TOOLS is the folder with the tools; the same SEED makes the same inputs. A tool may end with 0,
// or, where its input is not sound, with 1 and a message that names the file; it leaves its output
// and nothing else. Prints what was run, or what the process of the library held after every tenth
// of the time. Exits with 1 where a run ended otherwise, or where memory, threads or open files
// grew.

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <support/adversarial_clouds.h>
#include <support/measured_run.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/estimate.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/render/renderer.h>
#include <surfel/scene/framing.h>
#include <surfel/store/render_cloud.h>
#include <unistd.h>

namespace {

namespace fs = std::filesystem;
using namespace surfel::test;

/// Random numbers of a round, the same for the same seed.
class Dice {
 public:
  Dice(std::uint64_t seed, std::uint64_t round) : seed_(seed), round_(round) {}
  double uniform() { return surfel::random_uniform(seed_, round_, throws_++); }
  /// A number in [0, count).
  std::size_t below(std::size_t count) {
    return std::min(count - 1, static_cast<std::size_t>(uniform() * static_cast<double>(count)));
  }

 private:
  std::uint64_t seed_, round_;
  std::uint32_t throws_ = 0;
};

struct Tool {
  std::string words;
  bool mesh = false;
  std::string output;  ///< Name; empty: none.
};

std::vector<Tool> tools() {
  return {
      {"surfel-info", false, ""},
      {"surfel-info", true, ""},
      {"surfel-convert --scale 2", false, "out.ply"},
      {"surfel-convert", false, "out.pcd"},
      {"surfel-estimate", false, "out.ply"},
      {"surfel-estimate -k auto --remove-outliers", false, "out.ply"},
      {"surfel-texture --solid marble", false, "out.ply"},
      {"surfel-texture --from colors --fit gram", false, "out.ply"},
      {"surfel-texture --from colors --fit render", false, "out.ply"},
      {"surfel-group", false, "out.ply"},
      {"surfel-group --groups 4 --cover enlarge-each", false, "out.ply"},
      {"surfel-lod", false, "out.ply"},
      {"surfel-simplify --count 200", false, "out.ply"},
      {"surfel-simplify --max-error 0.05", false, "out.ply"},
      {"surfel-render --size 120x80", false, "out.png"},
      {"surfel-render --size 60x90 --layers 8 --kernel perspective", false, "out.exr"},
      {"surfel-render --size 60x90 --memory 1M", false, "out.png"},
      {"surfel-render --size 60x90 --method transparent", false, "out.png"},
      {"surfel-render --size 60x90", true, "out.png"},
      {"surfel-from-mesh --count 2000", true, "out.ply"},
      {"surfel-from-mesh --count 1000 --adaptive", true, "out.ply"},
  };
}

struct Input {
  std::string name;
  std::string bytes;
  bool sound = false;
};

/// An input of a kind and size that the dice choose.
Input make_input(bool mesh, Dice& dice) {
  const std::vector<AdversarialCase> cases = mesh ? adversarial_meshes() : adversarial_clouds();
  const double kind = dice.uniform();
  const std::size_t which = kind < 0.4 ? 0 : dice.below(cases.size());
  const std::size_t count = 100 + dice.below(4000);
  Input input{cases[which].name, "", which == 0};
  input.bytes =
      mesh ? adversarial_mesh(input.name, count) : adversarial_cloud(input.name, count, true);
  if (kind < 0.75) return input;
  input.sound = false;
  input.name += ", damaged";
  if (dice.uniform() < 0.3) input.bytes.resize(dice.below(input.bytes.size()));
  const std::size_t damages = input.bytes.empty() ? 0 : 1 + dice.below(20);
  for (std::size_t i = 0; i < damages; ++i) {
    // Half of the damages are done to the header, or to the first lines.
    const std::size_t reach = i % 2 == 0 ? input.bytes.size() : input.bytes.size() / 100 + 1;
    input.bytes[dice.below(reach)] = static_cast<char>(dice.below(256));
  }
  return input;
}

/// What the process holds.
struct Held {
  double megabytes = 0;
  std::size_t files = 0, threads = 0;

  static Held now() {
    Held held;
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
      if (line.rfind("VmRSS:", 0) == 0) held.megabytes = std::atof(line.c_str() + 6) / 1024;
    }
    const auto count = [](const char* folder) {
      return static_cast<std::size_t>(
          std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
    };
    held.files = count("/proc/self/fd");
    held.threads = count("/proc/self/task");
    return held;
  }
};

/// Reads, estimates, draws and writes in this process. Throws Error for what is not sound.
void use_library(const std::string& input, const std::string& folder, Dice& dice) {
  surfel::set_thread_count(1 + static_cast<int>(dice.below(4)));
  const surfel::SurfelCloud cloud = surfel::read_cloud(input);
  surfel::write_cloud(surfel::estimate_surfels(cloud, {}, nullptr, input), folder + "/own.ply");
  surfel::RenderCloud store(surfel::read_cloud(folder + "/own.ply"), {}, input);
  const surfel::Scene scene;
  surfel::RenderOptions options;
  options.layers = 1 + static_cast<int>(dice.below(8));
  surfel::Renderer renderer(store, scene, options);
  surfel::CameraOptions view;
  view.width = 32 + static_cast<int>(dice.below(100));
  view.height = 32 + static_cast<int>(dice.below(100));
  for (int frame = 0; frame < 3; ++frame) {
    view.from = surfel::Vec3d(dice.uniform() - 0.5, dice.uniform() - 0.5, 1);
    const surfel::Image image = renderer.render(surfel::make_camera(view, store.extent()));
    surfel::write_image(image, folder + (frame == 0 ? "/own.exr" : "/own.png"));
  }
  surfel::read_image(folder + "/own.exr");
}

/// Calls round(number) until the time is over, and tenth(rounds) after every tenth of it.
template <class Round, class Tenth>
void for_minutes(double minutes, const Round& round, const Tenth& tenth) {
  const auto start = std::chrono::steady_clock::now();
  int tenths = 0;
  for (std::uint64_t number = 0; tenths < 10; ++number) {
    round(number);
    const std::chrono::duration<double> past = std::chrono::steady_clock::now() - start;
    if (past.count() * 10 < 60 * minutes * (tenths + 1)) continue;
    ++tenths;
    tenth(number + 1);
  }
}

/// Prints what the process holds after every tenth of the time. Returns whether that does not grow.
bool soak_library(const std::string& folder, double minutes, std::uint64_t seed) {
  std::vector<Held> held;
  std::uint64_t refused = 0;
  fmt::print("| rounds | refused | MB | open files | threads |\n|---|---|---|---|---|\n");
  for_minutes(
      minutes,
      [&](std::uint64_t round) {
        Dice dice(seed, round);
        const Input made = make_input(false, dice);
        const std::string input = folder + "/input.ply";
        std::ofstream(input, std::ios::binary) << made.bytes;
        try {
          use_library(input, folder, dice);
        } catch (const surfel::Error&) {
          ++refused;
        }
      },
      [&](std::uint64_t rounds) {
        held.push_back(Held::now());
        fmt::print("| {} | {} | {:.0f} | {} | {} |\n", rounds, refused, held.back().megabytes,
                   held.back().files, held.back().threads);
        std::fflush(stdout);
      });
  // By the third tenth all sizes have been there. How many threads oneTBB keeps for loops of
  // changing width varies by a few.
  const Held& before = held[2];
  const Held& after = held.back();
  return after.megabytes <= 1.2 * before.megabytes + 16 && after.files <= before.files &&
         after.threads <= before.threads + 4;
}

struct Counts {
  std::size_t done = 0, refused = 0;
  double megabytes = 0;  ///< Most memory of a run.
};

/// Prints what was run. Returns whether all runs ended as they may.
bool soak_tools(const std::string& bin, const std::string& folder, double minutes,
                std::uint64_t seed) {
  std::map<std::string, Counts> counts;
  bool good = true;
  const auto run_tool = [&](const Tool& tool, const std::string& input, const Input& made,
                            Dice& dice) {
    std::vector<std::string> words = words_of(bin + "/" + tool.words);
    words.insert(words.begin() + 1, input);
    words.insert(words.end(), {"--quiet", "--threads", std::to_string(1 + dice.below(4))});
    if (!tool.output.empty()) words.insert(words.end(), {"-o", folder + "/" + tool.output});
    const MeasuredRun run = measured_run(words, folder, {.seconds = 60, .gigabytes = 0});
    const bool refused = run.exit_code == 1 && !made.sound &&
                         run.message.find(fs::path(input).filename()) != std::string::npos;
    const auto files = std::distance(fs::directory_iterator(folder), fs::directory_iterator());
    const bool output = run.exit_code == 0 && !tool.output.empty();
    if ((run.exit_code != 0 && !refused) || files != (output ? 2 : 1)) {
      good = false;
      fmt::print(stderr, "BAD: {} on {}: exit code {}, {} files, {}\n", tool.words, made.name,
                 run.exit_code, files, run.message);
      fs::copy_file(input, fmt::format("{}-bad{}", folder, fs::path(input).extension().string()),
                    fs::copy_options::overwrite_existing);
    }
    Counts& count = counts[tool.words + (tool.mesh ? " (mesh)" : "")];
    ++(refused ? count.refused : count.done);
    count.megabytes = std::max(count.megabytes, run.megabytes);
    if (output) fs::remove(folder + "/" + tool.output);
  };
  for_minutes(
      minutes,
      [&](std::uint64_t round) {
        Dice dice(seed, round);
        for (const bool mesh : {false, true}) {
          const Input made = make_input(mesh, dice);
          const std::string input = folder + (mesh ? "/input.obj" : "/input.ply");
          std::ofstream(input, std::ios::binary) << made.bytes;
          for (const Tool& tool : tools()) {
            if (tool.mesh == mesh && dice.uniform() < 0.5) run_tool(tool, input, made, dice);
          }
          fs::remove(input);
        }
      },
      [](std::uint64_t) {});
  fmt::print("| command | done | refused | most MB |\n|---|---|---|---|\n");
  for (const auto& [words, count] : counts) {
    fmt::print("| `{}` | {} | {} | {:.0f} |\n", words, count.done, count.refused, count.megabytes);
  }
  return good;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    fmt::print(stderr, "soak TOOLS|library MINUTES [SEED]\n");
    return 2;
  }
  const std::string what = argv[1];
  const double minutes = std::atof(argv[2]);
  const std::uint64_t seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1;
  std::string folder = (fs::temp_directory_path() / "soak-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) return 1;
  const bool good = what == "library" ? soak_library(folder, minutes, seed)
                                      : soak_tools(what, folder, minutes, seed);
  fs::remove_all(folder);
  return good ? 0 : 1;
}
