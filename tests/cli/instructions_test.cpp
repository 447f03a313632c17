// Every tool that computes gives the same bytes whatever instructions the processor has.

#include <filesystem>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/instructions.h>
#include <surfel/base/random.h>
#include <surfel/base/types.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

constexpr const char* kVariable = "SURFEL_INSTRUCTIONS";

/// A set that the library has code for, and variables of the environment that choose it.
struct Processor {
  std::string name;
  Words environment;
};

std::vector<Processor> processors() {
  std::vector<Processor> all;
  for (const std::string& name : available_instructions()) {
    all.push_back({name, {std::string(kVariable) + "=" + name}});
  }
  // With the last, the C library takes its functions for processors without these instructions.
  all.back().name += " and a plain C library";
  all.back().environment.emplace_back(
      "GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX,-AVX512F,-AVX512VL");
  return all;
}

/// Command lines without "surfel-", run one after the other in one folder. The clouds are a sphere
/// of smooth surfels, and a head with relief, colours and ellipses.
constexpr const char* kCommands = R"(
generate sphere -o a.ply --count 500 --mesh a.obj --resolution 10 --image tex.png --size 64
generate head -o b.ply --count 900 --texture noise
generate sky --image sky.exr --size 64x32
from-mesh a.obj -o mesh.ply --count 500
from-mesh a.obj -o adaptive.ply --adaptive --image tex.png --count 300
convert b.ply -o turned.ply --rotate 1,2,3,40 --scale 1.7 --ascii
estimate points.xyz -o estimated.ply
estimate points.xyz -o smooth.ply -k auto --remove-outliers --smooth mls --anisotropy on
estimate points.xyz -o noisy.ply --voxel auto --variance max-distance
texture a.ply -o ewa.ply --image tex.png
texture a.ply -o gram.ply --image tex.png --fit gram
texture a.ply -o fitted.ply --image tex.png --fit render
texture a.ply -o bounded.ply --image tex.png --fit render --bounds 0,1 --lambda 0.3
texture a.ply -o robust.ply --image tex.png --fit render --robust auto
texture a.ply -o variance.ply --image tex.png --fit render --refine-variance
texture b.ply -o marble.ply --solid marble
texture b.ply -o bump.ply --bump tex.png
lod b.ply -o levels.ply
simplify b.ply -o fewer.ply --count 200
simplify b.ply -o within.ply --max-error 0.05
group b.ply -o groups.ply --groups 4 --cover enlarge-each
group b.ply -o duplicated.ply --groups 4 --cover duplicate
group b.ply -o colored.ply --order dsatur --relax-coplanar --relax-opposite
render b.ply -o abuffer.exr --size 56x48 --method abuffer
render ewa.ply -o layers.exr --size 56x48 --method abuffer --layers 2
render groups.ply -o deferred.exr --size 56x48 --method deferred
render b.ply -o two-pass.exr --size 56x48 --method two-pass
render b.ply -o peeled.exr --size 56x48 --method depth-peel
render groups.ply -o transparent.exr --size 56x48 --method transparent
render groups.ply -o high.exr --size 56x48 --method transparent-high
render b.ply -o affine.exr --size 56x48 --kernel affine
render b.ply -o near.exr --size 56x48 --kernel perspective --eye 0.4,0.3,0.9
render b.ply -o source.exr --size 56x48 --filter ewa-source
render b.ply -o dome.png --size 56x48 --relief eye-dome
render b.ply -o occluded.png --size 56x48 --relief occlusion --shading none
render b.ply -o truth.exr --size 24 --reference --samples 2
render a.obj -o traced.exr --size 24 --mesh a.obj --samples 2
render levels.ply -o coarse.exr --size 56x48 --lod on --lod-error 3
render b.ply -o streamed.exr --size 56x48 --memory 1M
render bump.ply -o relief.exr --size 56x48
render b.ply -o colors.png --size 256 --color-by elevation
render points.xyz -o points.png --size 56x48
render b.ply -o sky.png --size 56x48 --scene sky.toml
render b.ply -o glass.exr --size 56x48 --scene glass.toml
info b.ply --json
info points.xyz --json
compare dome.png occluded.png --json -o difference.png
)";

Words words_of(const std::string& line) {
  std::istringstream in(line);
  Words words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

/// Points of a text file: a sphere with noise, for tools that begin with points.
std::string noisy_sphere() {
  std::string text;
  for (std::size_t i = 0; i < 500; ++i) {
    const auto number = [&](std::size_t stream) { return 2 * random_uniform(stream, i) - 1; };
    const Vec3d direction(number(1), number(2), number(3));
    const Vec3d p = (1 + 0.01 * number(4)) * direction.normalized();
    text += fmt::format("{:.6f} {:.6f} {:.6f}\n", p.x(), p.y(), p.z());
  }
  return text;
}

/// The bytes of all files that the commands write, and of what they print.
std::map<std::string, std::string> results_on(const Processor& processor) {
  const TemporaryFolder folder;
  write_text(folder / "sky.toml", "[environment]\nimage = \"sky.exr\"\n");
  write_text(folder / "glass.toml",
             "[[material]]\nior = 1.5\nopacity = 0.3\nspecular = [0.5, 0.5, 0.5]\n"
             "shininess = 40\n");
  write_text(folder / "points.xyz", noisy_sphere());
  std::map<std::string, std::string> results;
  std::istringstream commands(kCommands);
  for (std::string line; std::getline(commands, line);) {
    Words words = words_of(line);
    if (words.empty()) continue;
    words[0] = tool("surfel-" + words[0]);
    Words command = {"env", "-C", folder / ""};
    command.insert(command.end(), processor.environment.begin(), processor.environment.end());
    command.insert(command.end(), words.begin(), words.end());
    command.insert(command.end(), {"--quiet", "--threads", "2"});
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << processor.name << ": " << line << "\n" << result.errors;
    results[line] = result.output;
  }
  for (const std::string& name : entries(folder / "")) results[name] = read_text(folder / name);
  return results;
}

TEST(InstructionSets, GiveTheSameBytes) {
  const std::vector<Processor> all = processors();
  ASSERT_GT(all.size(), 1U) << "no instruction set beyond the baseline";
  const std::map<std::string, std::string> expected = results_on(all.front());
  for (std::size_t i = 1; i < all.size(); ++i) {
    const std::map<std::string, std::string> results = results_on(all[i]);
    EXPECT_EQ(results.size(), expected.size()) << all[i].name;
    for (const auto& [name, bytes] : expected) {
      EXPECT_TRUE(results.count(name) > 0 && results.at(name) == bytes)
          << all[i].name << " and " << all.front().name << " differ in: " << name;
    }
  }
}

TEST(InstructionSets, AreChosenByAVariable) {
  const TemporaryFolder folder;
  for (const std::string& name : available_instructions()) {
    const RunResult result = run({"env", std::string(kVariable) + "=" + name,
                                  tool("surfel-generate"), "plane", "--count", "100", "--quiet",
                                  "-o", folder / "plane.ply", "--stats", folder / "stats.json"});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_EQ(nlohmann::json::parse(read_text(folder / "stats.json"))["instructions"], name);
  }
}

TEST(InstructionSets, OthersAreRefused) {
  const RunResult result =
      run({"env", std::string(kVariable) + "=mmx", tool("surfel-info"), "--version"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_TRUE(contains(result.errors, "SURFEL_INSTRUCTIONS: 'mmx'")) << result.errors;
  for (const std::string& name : available_instructions()) {
    EXPECT_TRUE(contains(result.errors, name)) << result.errors;
  }
}

}  // namespace
}  // namespace surfel::test
