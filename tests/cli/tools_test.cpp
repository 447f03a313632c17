// What holds for every tool: usage, bad input, bad output, interruption, number of threads.

#include <algorithm>
#include <filesystem>
#include <map>
#include <sstream>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/io/picture_part.h>
#include <surfel/io/volume_io.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

Words operator+(Words a, const Words& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// Small files of every kind that the tools read, made once.
struct Inputs {
  TemporaryFolder folder;
  std::string surfels = folder / "surfels.ply";
  std::string mesh = folder / "mesh.obj";
  std::string volume = folder / "volume.nrrd";
  std::string image = folder / "image.png";
  std::string other_image = folder / "other.png";

  Inputs() {
    write_text(mesh,
               "v 0 0 0\nv 1 0 0\nv 1 1 0.2\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
               "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n");
    run({tool("surfel-generate"), "checker", "--size", "16x16", "--image", image, "--quiet"});
    run({tool("surfel-generate"), "noise", "--size", "16x16", "--image", other_image, "--quiet"});
    run({tool("surfel-from-mesh"), mesh, "--spacing", "0.05", "-o", surfels, "--quiet"});
    write_text(volume, "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 3 3 3\nencoding: raw\n\n" +
                           std::string(13, '\1') + "a" + std::string(13, '\1'));
  }
  static const Inputs& get() {
    static const Inputs inputs;
    return inputs;
  }
  /// A part of a picture, which is made where a test asks for it: EXR takes a process half a
  /// second.
  static const std::string& part() {
    static const std::string file = [] {
      std::string path = get().folder / "part.exr";
      run({tool("surfel-render"), get().surfels, "--size", "16", "--tiles", "1/1", "-o", path,
           "--quiet"});
      return path;
    }();
    return file;
  }
};

/// How to run a tool: its input (if it has one) comes first, then options, then the output.
struct Usage {
  std::string name;
  Words options;
  std::string input;   ///< "surfels", "mesh", "volume", "image" (with another one), "part", "any";
                       ///< "" for none.
  std::string output;  ///< Extension of the output; empty for none.
};

/// For the names of tests, which would otherwise hold addresses.
void PrintTo(const Usage& usage, std::ostream* out) { *out << usage.name; }

const std::vector<Usage>& usages() {
  static const std::vector<Usage> all = {
      {"surfel-generate", {"plane", "--count", "400"}, "", ".ply"},
      {"surfel-from-mesh", {"--spacing", "0.05"}, "mesh", ".ply"},
      {"surfel-from-volume", {"--transfer", "ct"}, "volume", ".ply"},
      {"surfel-estimate", {"-k", "8", "--orient", "up"}, "surfels", ".ply"},
      {"surfel-texture", {"--image", "checker"}, "surfels", ".ply"},
      {"surfel-group", {}, "surfels", ".ply"},
      {"surfel-convert", {"--scale", "2"}, "surfels", ".ply"},
      {"surfel-lod", {}, "surfels", ".ply"},
      {"surfel-simplify", {"--max-error", "0.05"}, "surfels", ".ply"},
      {"surfel-render", {"--size", "48x32"}, "surfels", ".png"},
      {"surfel-join", {}, "part", ".png"},
      {"surfel-info", {"--json"}, "any", ""},
      {"surfel-compare", {"--json"}, "image", ".exr"},
      {"surfel-view", {}, "surfels", ".html"},
      {"surfel-chart",
       {"--recommend", "--max-error", "1", "--quick", "--size", "8x8", "--repeats", "1",
        "--samples", "1", "--count", "100"},
       "any",
       ""},
  };
  return all;
}

std::string good_input(const Usage& usage) {
  if (usage.input == "image") return Inputs::get().image;
  if (usage.input == "part") return Inputs::part();
  if (usage.input == "volume") return Inputs::get().volume;
  return usage.input == "mesh" ? Inputs::get().mesh : Inputs::get().surfels;
}

/// The tool, `input` if it takes any, and its options.
Words command_on(const Usage& usage, const std::string& input) {
  Words command = {tool(usage.name)};
  if (!usage.input.empty()) command.push_back(input);
  if (usage.input == "image") command.push_back(Inputs::get().other_image);
  return command + usage.options;
}

RunResult run_on(const Usage& usage, const std::string& input, const std::string& output,
                 const Words& more = {}, const RunSetup& setup = {}) {
  Words command = command_on(usage, input);
  if (!usage.output.empty()) command = command + Words{"-o", output};
  return run(command + more, setup);
}

class EveryTool : public testing::TestWithParam<Usage> {
 protected:
  std::string output(const std::string& stem = "out") const {
    return folder_ / (stem + GetParam().output);
  }
  RunResult run_good(const Words& more = {}) const {
    return run_on(GetParam(), good_input(GetParam()), output(), more);
  }
  /// Exit code 1 with one message, of this tool, that names `file`; and no file is left.
  void expect_refused(const RunResult& result, const std::string& file) const {
    EXPECT_EQ(result.exit_code, 1)
        << file << " (signal " << result.signal << "): " << result.errors;
    EXPECT_TRUE(contains(result.errors, GetParam().name + ": error: ")) << result.errors;
    EXPECT_TRUE(contains(result.errors, fs::path(file).filename().string())) << result.errors;
    EXPECT_EQ(entries(folder_ / ""), Words{}) << file;
  }

  TemporaryFolder folder_;
};

TEST_P(EveryTool, TellsItsVersionAndHelp) {
  const std::string path = tool(GetParam().name);
  EXPECT_EQ(run({path, "--version"}).output, GetParam().name + " 0.1.0\n");
  const RunResult all = run({path, "--help-all"});
  EXPECT_EQ(all.exit_code, 0);
  for (const char* option : {"--threads", "--config", "--stats", "--no-clobber", "--help-all"}) {
    EXPECT_TRUE(contains(all.output, option)) << option;
  }
}

/// The lines of a text that begin with `start`, without it.
Words lines_with(const std::string& text, const std::string& start) {
  Words found;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(start)) found.push_back(line.substr(start.size()));
  }
  return found;
}

TEST_P(EveryTool, HelpHasTheEverydayOptionsAndThreeExamplesThatAreUnderstood) {
  const std::string path = tool(GetParam().name);
  const RunResult help = run({path, "--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_EQ(help.errors, "");
  const std::size_t options =
      lines_with(help.output, "  -").size() - lines_with(help.output, "  -h,").size();
  EXPECT_GE(options, 4U) << help.output;
  EXPECT_LE(options, 13U) << help.output;
  const Words every = lines_with(run({path, "--help-all"}).output, "  -");
  EXPECT_GT(every.size(), options);
  EXPECT_TRUE(
      contains(help.output, "--help-all prints all " + std::to_string(every.size()) + " options"))
      << help.output;
  const Words examples = lines_with(help.output, "  " + GetParam().name + " ");
  EXPECT_EQ(examples.size(), 3U) << help.output;
  for (const std::string& example : examples) {
    const RunResult understood = run({"sh", "-c", path + " " + example + " --print-config"});
    EXPECT_EQ(understood.exit_code, 0) << example << "\n" << understood.errors;
  }
}

TEST_P(EveryTool, HasAManualPageWithAllOptions) {
  const std::string path = tool(GetParam().name);
  const RunResult manual = run({path, "--manual"});
  ASSERT_EQ(manual.exit_code, 0) << manual.errors;
  EXPECT_TRUE(manual.output.starts_with(".TH "));
  const Words every = lines_with(run({path, "--help-all"}).output, "  -");
  EXPECT_EQ(lines_with(manual.output, "\\fB\\-").size(), every.size());
  EXPECT_EQ(lines_with(manual.output, GetParam().name.substr(0, 6) + "\\-").size(), 4U)
      << "the name, and three examples";
}

TEST_P(EveryTool, LetsShellsCompleteItsOptions) {
  const std::string path = tool(GetParam().name);
  std::string function = "_" + GetParam().name;
  std::replace(function.begin(), function.end(), '-', '_');
  // As bash asks for what may follow the words, the last of which is not finished.
  std::string script = "eval \"$(" + path + " --completion bash)\"\n";
  for (const char* words :
       {"x --progress ''", "x --progress j", "x --no-clo", "x --stats ''", "x ''"}) {
    script += std::string("COMP_WORDS=(") + words +
              "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMPREPLY=(); " + function +
              "; echo \"${COMPREPLY[*]}\"\n";
  }
  const RunResult bash = run({"bash", "-c", script});
  EXPECT_EQ(bash.exit_code, 0) << bash.errors;
  EXPECT_EQ(bash.errors, "");
  EXPECT_EQ(bash.output, "auto none json\njson\n--no-clobber\n\n\n");
  const RunResult zsh = run({path, "--completion", "zsh"});
  EXPECT_TRUE(zsh.output.starts_with("#compdef " + GetParam().name + "\n"));
  EXPECT_TRUE(contains(zsh.output,
                       "  '--progress[Progress of what takes longer than a second, on "
                       "standard error]:NAME:(auto none json)' \\\n"));
  EXPECT_TRUE(contains(run({path, "--completion", "fish"}).output,
                       "complete -c " + GetParam().name + " -l progress -x -a 'auto none json' "));
}

TEST_P(EveryTool, StartsWithoutHeavyLibraries) {
  // What the dynamic linker would load at the start; plug-ins come later, if they are needed.
  const RunResult loaded =
      run({"env", "LD_TRACE_LOADED_OBJECTS=1", tool(GetParam().name), "--version"});
  // "\tlibceres.so.3 => /folder/libceres.so.3 (0x...)", of which folders do not matter.
  std::string names;
  std::istringstream lines(loaded.output);
  for (std::string line; std::getline(lines, line);) {
    names += fs::path(line.substr(0, line.find(" =>"))).filename().string() + "\n";
  }
  EXPECT_TRUE(contains(names, "libsurfel"));
  for (const char* heavy : {"OpenImageIO", "pcl", "vtk", "OpenMesh", "ceres", "opencv"}) {
    EXPECT_FALSE(contains(names, heavy)) << heavy;
  }
}

TEST_P(EveryTool, WrongUsageEndsWithTwo) {
  const std::string path = tool(GetParam().name);
  write_text(folder_ / "bad.toml", "no-such-option = 1\n");
  for (const Words& arguments :
       {Words{}, Words{"--no-such-option"}, Words{"--threads", "0"},
        Words{"--config", folder_ / "bad.toml"}, Words{"a", "b", "c", "d"}}) {
    const RunResult result = run(Words{path} + arguments);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_TRUE(result.errors.starts_with(GetParam().name + ": error: ")) << result.errors;
  }
  EXPECT_TRUE(contains(run({path, "--config", folder_ / "bad.toml"}).errors, "'no-such-option'"));
}

TEST_P(EveryTool, PrintedSettingsReadBackAreTheSame) {
  const std::string path = tool(GetParam().name);
  const RunResult first = run({path, "--print-config", "--threads", "2"});
  ASSERT_EQ(first.exit_code, 0) << first.errors;
  EXPECT_TRUE(contains(first.output, "threads = 2\n"));
  write_text(folder_ / "config.toml", first.output);
  const RunResult second = run({path, "--print-config", "--config", folder_ / "config.toml"});
  EXPECT_EQ(second.exit_code, 0) << second.errors;
  EXPECT_EQ(second.output, first.output);
}

TEST_P(EveryTool, DoesItsWorkAndReportsIt) {
  const std::string stats = folder_ / "stats.json";
  const RunResult result = run_good({"--stats", stats, "--threads", "2"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_NE(GetParam().output.empty(), fs::exists(output()));
  const auto report = nlohmann::json::parse(read_text(stats));
  EXPECT_EQ(report["tool"], GetParam().name);
  EXPECT_EQ(report["version"], "0.1.0");
  EXPECT_EQ(report["threads"], 2);
  EXPECT_GT(report["total_ms"].get<double>(), 0);
  EXPECT_GT(report["peak_memory_bytes"].get<double>(), 1e5);
  EXPECT_EQ(report["options"]["threads"], 2);
}

TEST_P(EveryTool, GivesTheSameBytesForAnyNumberOfThreads) {
  if (GetParam().output.empty()) GTEST_SKIP() << "writes no file";
  ASSERT_EQ(run_good({"--threads", "1"}).exit_code, 0);
  const std::string alone = read_text(output());
  EXPECT_FALSE(alone.empty());
  for (const char* threads : {"2", "5"}) {
    ASSERT_EQ(run_good({"--threads", threads}).exit_code, 0);
    EXPECT_TRUE(read_text(output()) == alone) << threads << " threads";
  }
}

TEST_P(EveryTool, RefusesInputThatIsNotThere) {
  if (GetParam().input.empty()) GTEST_SKIP() << "reads no file";
  const std::string extension = fs::path(good_input(GetParam())).extension();
  const TemporaryFolder bad;
  fs::create_directory(bad / ("folder" + extension));
  write_text(bad / ("empty" + extension), "");
  write_text(bad / "unknown.xyzzy", "no format that anybody knows");
  write_text(bad / ("noise" + extension), std::string("\0\1\2\xff\xfe noise", 12));
  for (const std::string& file : {"none" + extension, "folder" + extension, "empty" + extension,
                                  "noise" + extension, std::string("unknown.xyzzy")}) {
    expect_refused(run_on(GetParam(), bad / file, output()), file);
  }
}

TEST_P(EveryTool, RefusesOutputThatCannotBe) {
  const Usage& usage = GetParam();
  if (usage.output.empty()) GTEST_SKIP() << "writes no file";
  const TemporaryFolder bad;
  fs::create_directory(bad / ("folder" + usage.output));
  for (const std::string& file : {"folder" + usage.output, "none/out" + usage.output}) {
    expect_refused(run_on(usage, good_input(usage), bad / file), file);
  }
  EXPECT_EQ(entries(bad / ""), Words{"folder" + usage.output});
}

TEST_P(EveryTool, NoClobberKeepsAnOlderFile) {
  if (GetParam().output.empty()) GTEST_SKIP() << "writes no file";
  write_text(output(), "old");
  EXPECT_EQ(run_good({"--no-clobber"}).exit_code, 1);
  EXPECT_EQ(read_text(output()), "old");
  EXPECT_EQ(run_good().exit_code, 0);
  EXPECT_NE(read_text(output()), "old");
}

TEST_P(EveryTool, LeavesTheOldFileWhereTheDiskIsFull) {
  const Usage& usage = GetParam();
  if (usage.output.empty()) GTEST_SKIP() << "writes no file";
  write_text(output(), "old");
  // A limit on the size of files fails as a full disk does; no output is as small as its 512 bytes.
  const RunResult result = run(Words{"sh", "-c", "ulimit -f 1; exec \"$@\"", "sh"} +
                               command_on(usage, good_input(usage)) + Words{"-o", output()});
  EXPECT_EQ(result.exit_code, 1) << result.signal << result.errors;
  EXPECT_EQ(read_text(output()), "old");
  EXPECT_EQ(entries(folder_ / "").size(), 1U);
}

/// Whether the tool takes its input for a picture whatever its name: each process then loads the
/// libraries of pictures, which takes half a second.
bool reads_pictures(const Usage& usage) {
  return usage.input == "image" || usage.input == "part" || usage.input == "volume";
}

/// Reads a file as the tool does.
void read_picture(const Usage& usage, const std::string& file) {
  if (usage.input == "image") read_premultiplied_image(file);
  if (usage.input == "part") PictureJoin().add(file);
  if (usage.input == "volume") read_image_stack({file}, Vec3d(1, 1, 1));
}

void expect_no_picture(const Usage& usage, const std::string& file) {
  try {
    read_picture(usage, file);
    ADD_FAILURE() << usage.name << " reads " << file;
  } catch (const Error& error) {
    EXPECT_TRUE(contains(error.what(), fs::path(file).filename().string())) << error.what();
  }
}

TEST_P(EveryTool, RefusesMalformedFiles) {
  SURFEL_REQUIRE_TEST_DATA();
  const Usage& usage = GetParam();
  if (usage.input.empty()) GTEST_SKIP() << "reads no file";
  int refused = 0;
  for (const auto& entry : fs::directory_iterator(data_folder() / "malformed" / "invalid")) {
    const std::string file = entry.path();
    // Odd, but a whole mesh of one face: tools for meshes and for any file read it.
    const bool whole = entry.path().filename() == "trimesh_no_faces_in_chunk.obj";
    if (whole && (usage.input != "surfels" || usage.name == "surfel-render")) continue;
    // A good point at a time that is no number.
    if (entry.path().filename() == "pdal_gps_time_nan.las") continue;
    const std::string extension = entry.path().extension();
    const bool picture = extension == ".png" || extension == ".exr";
    if (reads_pictures(usage) && !picture) {
      expect_no_picture(usage, file);
    } else {
      expect_refused(run_on(usage, file, output()), file);
    }
    ++refused;
  }
  EXPECT_GT(refused, 10);
}

/// "surfel-from-mesh" is "frommesh" in the names of tests.
std::string test_name(const testing::TestParamInfo<Usage>& usage) {
  std::string name = usage.param.name.substr(usage.param.name.find('-') + 1);
  name.erase(std::remove(name.begin(), name.end(), '-'), name.end());
  return name;
}
INSTANTIATE_TEST_SUITE_P(Tools, EveryTool, testing::ValuesIn(usages()), test_name);

TEST(Tools, AreAllTested) {
  std::istringstream built(SURFEL_TOOLS);
  for (std::string name; std::getline(built, name, ',');) {
    const bool tested = std::any_of(usages().begin(), usages().end(),
                                    [&](const Usage& usage) { return usage.name == name; });
    EXPECT_TRUE(tested) << name;
  }
}

TEST(Tools, ShippedConfigurationsWork) {
  const TemporaryFolder folder;
  int loaded = 0;
  for (const auto& entry : fs::directory_iterator(fs::path(SURFEL_SOURCE_DIR) / "configs")) {
    // configs/TOOL-WHAT.toml is for surfel-TOOL --config, the others are for options of
    // surfel-render.
    const std::map<std::string, std::string> options{
        {"render", "--config"}, {"scene", "--scene"}, {"views", "--views"}, {"path", "--path"}};
    const std::string name = entry.path().filename().string();
    const auto option = options.find(name.substr(0, name.find('-')));
    ASSERT_TRUE(option != options.end()) << name << ": say here how it is used";
    const bool known = name.ends_with(".json");  // Such pictures have a shape.
    const RunResult result = run({tool("surfel-render"), Inputs::get().surfels, option->second,
                                  entry.path().string(), "--size", known ? "32x24" : "16x16", "-o",
                                  folder / (name + "_%04d.png"), "--frames", "0-0"});
    EXPECT_EQ(result.exit_code, 0) << name << ": " << result.errors;
    EXPECT_TRUE(fs::exists(folder / (name + "_0000.png"))) << name;
    ++loaded;
  }
  EXPECT_GE(loaded, 6);
}

TEST(Tools, ReadAndWritePipes) {
  const TemporaryFolder folder;
  const std::string from_mesh = tool("surfel-from-mesh") + " " + Inputs::get().mesh;
  const std::string direct = folder / "direct.png";
  const std::string piped = folder / "piped.png";
  const std::string steps = from_mesh + " --spacing 0.05 --quiet -o {0} && " +
                            tool("surfel-texture") + " {0} --image checker --quiet -o {1} && " +
                            tool("surfel-render") + " {1} --size 40x40 --quiet -o " + direct;
  std::string by_files = steps;
  for (const auto& [mark, file] : {std::pair{"{0}", folder / "a.ply"}, {"{1}", folder / "b.ply"}}) {
    for (std::size_t at = 0; (at = by_files.find(mark)) != std::string::npos;) {
      by_files.replace(at, 3, file);
    }
  }
  const RunResult files = run({"sh", "-c", by_files});
  ASSERT_EQ(files.exit_code, 0) << files.errors;
  const RunResult pipes = run({"sh", "-c",
                               from_mesh + " --spacing 0.05 --quiet -o - | " +
                                   tool("surfel-texture") + " - --image checker --quiet -o - | " +
                                   tool("surfel-render") + " - --size 40x40 --quiet -o " + piped});
  ASSERT_EQ(pipes.exit_code, 0) << pipes.errors;
  EXPECT_FALSE(read_text(direct).empty());
  EXPECT_TRUE(read_text(direct) == read_text(piped));
}

TEST(Tools, AdaptiveSpacingTakesAnErrorOrACount) {
  const TemporaryFolder folder;
  const std::string output = folder / "out.ply";
  const Words command{tool("surfel-from-mesh"), Inputs::get().mesh, "-o", output};
  const RunResult made = run(command + Words{"--adaptive", "--max-error", "0.1", "--image",
                                             "checker:4", "--stats", folder / "s.json"});
  EXPECT_EQ(made.exit_code, 0) << made.errors;
  EXPECT_TRUE(contains(made.errors, "expected error")) << made.errors;
  EXPECT_TRUE(contains(read_text(folder / "s.json"), "\"color_error\""));
  EXPECT_EQ(run(command + Words{"--adaptive", "--count", "300"}).exit_code, 0);
  for (const Words& wrong : {Words{"--adaptive"},
                             {"--adaptive", "--spacing", "0.1"},
                             {"--adaptive", "--max-error", "0"},
                             {"--adaptive", "--max-error", "0.1", "--count", "10"},
                             {"--spacing", "0.1", "--max-error", "0.1"},
                             {"--spacing", "0.1", "--image", "checker"}}) {
    EXPECT_EQ(run(command + wrong).exit_code, 2) << wrong.back();
  }
  EXPECT_EQ(run(command + Words{"--adaptive", "--count", "10", "--image", "no.png"}).exit_code, 1);
}

TEST(Tools, MalformedTexturesAreRefused) {
  SURFEL_REQUIRE_TEST_DATA();
  const TemporaryFolder folder;
  for (const char* name : {"libpng_badcrc.png", "libpng_huge_text_chunk.png", "openexr_oom.exr",
                           "openexr_heap_overflow.exr"}) {
    const std::string image = data_folder() / "malformed" / "invalid" / name;
    const RunResult result = run({tool("surfel-texture"), Inputs::get().surfels, "--image", image,
                                  "-o", folder / "out.ply"});
    EXPECT_EQ(result.exit_code, 1) << name;
    EXPECT_TRUE(contains(result.errors, name)) << result.errors;
    EXPECT_EQ(entries(folder / ""), Words{});
  }
}

TEST(Tools, InterruptedWorkLeavesNoTemporary) {
  const TemporaryFolder folder;
  const auto written = [&] {
    std::uintmax_t bytes = 0;
    std::error_code gone;  // The tool may rename its temporary meanwhile.
    for (const auto& entry : fs::directory_iterator(folder / "")) bytes += entry.file_size(gone);
    return bytes;
  };
  // The signal comes as soon as the temporary is there, and when the first of two pieces of 140
  // and 37 MB, and the second, are being written; only a whole file may be left.
  for (const std::uintmax_t reached : {0, 1 << 20, 150 << 20}) {
    const RunSetup interrupt{
        .input = {}, .meanwhile = [&](pid_t process) {
          wait_until([&] { return !entries(folder / "").empty() && written() >= reached; });
          kill(process, SIGINT);
        }};
    const RunResult result = run({tool("surfel-generate"), "plane", "--count", "2500000", "--quiet",
                                  "-o", folder / "out.ply"},
                                 interrupt);
    if (result.exit_code == 0) {
      fs::remove(folder / "out.ply");
      EXPECT_GT(reached, 0U);
    } else {
      EXPECT_EQ(result.exit_code, 1);
      EXPECT_TRUE(contains(result.errors, "interrupted")) << result.errors;
    }
    EXPECT_EQ(entries(folder / ""), Words{});
  }
}

TEST(SurfelEstimate, CloudsLargerThanTheMemoryGetTheSameBytes) {
  const TemporaryFolder folder;
  const std::string points = folder / "points.ply";
  // Generated surfels are in the order of a space-filling curve.
  ASSERT_EQ(run({tool("surfel-generate"), "terrain", "--count", "60000", "--no-uv", "-o", points})
                .exit_code,
            0);
  const auto estimate = [&](const std::string& input, const std::string& output,
                            const Words& options) {
    Words command{tool("surfel-estimate"), input, "-o", folder / output};
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  };
  ASSERT_EQ(estimate(points, "whole.ply", {"--orient", "align"}).exit_code, 0);
  const RunResult blocks =
      estimate(points, "blocks.ply", {"--orient", "align", "--memory", "16M", "--resume"});
  ASSERT_EQ(blocks.exit_code, 0) << blocks.errors;
  EXPECT_EQ(read_text(folder / "blocks.ply"), read_text(folder / "whole.ply"));

  const auto refused = [&](const std::string& input, const std::string& output,
                           const Words& options, int exit_code, const std::string& message) {
    Words more = options;
    more.emplace_back("--memory");
    more.emplace_back("16M");
    const RunResult result = estimate(input, output, more);
    EXPECT_EQ(result.exit_code, exit_code);
    EXPECT_TRUE(contains(result.errors, message)) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(folder / output));
  };
  refused(points, "no.ply", {}, 2, "too few to find the sides of 60000 points");
  refused(points, "no.ply", {"--orient", "up", "--voxel", "auto"}, 2, "averaging in voxels");
  for (const char* side : {"mst", "outward"}) {
    refused(points, "no.ply", {"--orient", side}, 2, "orient by winding, up or viewpoint");
  }
  refused(points, "no.las", {"--orient", "up"}, 2, "give a .ply");
  const std::string text = folder / "points.xyz";
  ASSERT_EQ(run({tool("surfel-convert"), points, "-o", text}).exit_code, 0);
  refused(text, "no.ply", {"--orient", "up"}, 1, "surfel-convert --sort curve");
}

TEST(SurfelEstimate, SidesOfTheWholeSurfaceAreFoundBeyondTheMemory) {
  const TemporaryFolder folder;
  const std::string points = folder / "points.ply";
  ASSERT_EQ(run({tool("surfel-generate"), "sphere", "--count", "400000", "--no-uv", "-o", points})
                .exit_code,
            0);
  const Words command{tool("surfel-estimate"), points, "-o"};
  const auto estimate = [&](const std::string& output, const Words& options) {
    Words words = command;
    words.push_back(folder / output);
    words.insert(words.end(), options.begin(), options.end());
    return run(words);
  };
  ASSERT_EQ(estimate("whole.ply", {}).exit_code, 0);
  const RunResult blocks = estimate("blocks.ply", {"--memory", "130M", "--resume"});
  ASSERT_EQ(blocks.exit_code, 0) << blocks.errors;
  EXPECT_TRUE(read_text(folder / "blocks.ply") == read_text(folder / "whole.ply"));
}

TEST(SurfelEstimate, SearchesFindTheSameOrTellHowMuch) {
  const TemporaryFolder folder;
  const auto estimated = [&](const std::string& search) {
    const RunResult result =
        run({tool("surfel-estimate"), Inputs::get().surfels, "--search", search, "--stats",
             folder / "stats.json", "--verbose", "-o", folder / "out.ply"});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    const auto stats = nlohmann::json::parse(read_text(folder / "stats.json"));
    const bool approximate = search == "flann-approx";
    EXPECT_EQ(stats.contains("search_recall"), approximate);
    EXPECT_EQ(contains(result.errors, "of the nearest neighbours"), approximate);
    if (approximate) {
      EXPECT_GT(stats["search_recall"], 0.9);
      EXPECT_LE(stats["search_recall"], 1.0);
    }
    // The header tells which search it was.
    const std::string file = read_text(folder / "out.ply");
    return file.substr(file.find("end_header"));
  };
  EXPECT_EQ(estimated("exact"), estimated("flann"));
  estimated("flann-approx");
  EXPECT_EQ(run({tool("surfel-estimate"), Inputs::get().surfels, "--search", "grid", "-o",
                 folder / "out.ply"})
                .exit_code,
            2);
}

TEST(SurfelFromMesh, TellsOfEdgesThatNoClosedSurfaceHas) {
  TemporaryFolder folder;
  const auto notes = [&](const std::string& mesh) {
    const RunResult result = run({tool("surfel-from-mesh"), mesh, "--count", "50", "-o",
                                  folder / "out.ply", "--stats", folder / "out.json"});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return result.errors;
  };
  EXPECT_TRUE(contains(notes(Inputs::get().mesh), "has edges 4 of one face (surfels end there);"));
  const std::string tetrahedron =
      "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 1 -1 -1\nf 1 3 2\nf 1 2 4\nf 1 4 3\n";
  write_text(folder / "closed.obj", tetrahedron + "f 2 3 4\n");
  EXPECT_FALSE(contains(notes(folder / "closed.obj"), "edges"));
  write_text(folder / "fin.obj", tetrahedron + "f 2 4 3\nf 1 2 5\n");
  EXPECT_TRUE(contains(notes(folder / "fin.obj"),
                       "has edges 2 of one face (surfels end there), 1 of three faces or more "
                       "(sheets touch there), 3 of two faces that face opposite ways"));
  const auto report = nlohmann::json::parse(read_text(folder / "out.json"));
  EXPECT_EQ(report["border_edges"], 2);
  EXPECT_EQ(report["non_manifold_edges"], 1);
  EXPECT_EQ(report["inconsistent_edges"], 3);
  const RunResult info = run({tool("surfel-info"), folder / "fin.obj"});
  EXPECT_TRUE(contains(info.output, "\nnon_manifold_at      0.5 0 0\n")) << info.output;
  EXPECT_TRUE(contains(info.output, "faces_turned 1, vertices_split 2,")) << info.output;
}

TEST(SurfelInfo, DescribesSurfelsMeshesAndImages) {
  const auto describe = [](const std::string& file) {
    const RunResult result = run({tool("surfel-info"), file, "--json"});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return nlohmann::json::parse(result.output);
  };
  const auto surfels = describe(Inputs::get().surfels);
  EXPECT_EQ(surfels["kind"], "surfels");
  EXPECT_GT(surfels["count"].get<int>(), 100);
  EXPECT_EQ(surfels["properties"][0]["name"], "x");
  EXPECT_EQ(surfels["zero_normals"], 0);
  EXPECT_GT(surfels["spacing"]["mean"].get<double>(), 0.03);
  EXPECT_LT(surfels["spacing"]["mean"].get<double>(), 0.06);
  EXPECT_TRUE(surfels["coverage"].contains("hole_share"));
  EXPECT_TRUE(surfels["coverage"].contains("overlap"));
  EXPECT_FALSE(surfels["provenance"].empty());
  const auto mesh = describe(Inputs::get().mesh);
  EXPECT_EQ(mesh["kind"], "mesh");
  EXPECT_EQ(mesh["faces"], 2);
  EXPECT_EQ(mesh["border_edges"], 4);
  EXPECT_EQ(mesh["border_loops"], 1);
  EXPECT_EQ(mesh["crease_edges"], 0);
  EXPECT_EQ(mesh["genus"], nullptr);
  EXPECT_EQ(mesh["repair"]["vertices_split"], 0);
  EXPECT_EQ(mesh["uv"], true);
  const auto image = describe(Inputs::get().image);
  EXPECT_EQ(image["kind"], "image");
  EXPECT_EQ(image["width"], 16);

  const RunResult text = run({tool("surfel-info"), Inputs::get().surfels});
  EXPECT_TRUE(contains(text.output, "spacing"));
  EXPECT_TRUE(contains(text.output, "surfel-from-mesh"));
  EXPECT_TRUE(contains(text.output, "\nneeds colors         none, but u, v")) << text.output;
  ASSERT_EQ(surfels["needs"].size(), 1U);
  EXPECT_EQ(surfels["needs"][0]["topic"], "colors");
  TemporaryFolder folder;
  write_text(folder / "raw.xyz", "0 0 0\n1 0 0\n0 1 0\n");
  const std::string raw = run({tool("surfel-info"), folder / "raw.xyz"}).output;
  EXPECT_TRUE(contains(raw, "\nneeds normals        none")) << raw;
  EXPECT_TRUE(contains(raw, " surfel-estimate " + (folder / "raw.xyz") + " -o OUT\n")) << raw;
  EXPECT_EQ(describe(folder / "raw.xyz")["needs"][1]["topic"], "variance");
}

TEST(SurfelInfo, DescribesSplats) {
  const TemporaryFolder folder;
  const std::string splats = folder / "a.splat";
  ASSERT_EQ(run({tool("surfel-convert"), Inputs::get().surfels, "-o", splats}).exit_code, 0);
  const RunResult result = run({tool("surfel-info"), splats, "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const auto info = nlohmann::json::parse(result.output);
  EXPECT_EQ(info["kind"], "gaussians");
  EXPECT_EQ(info["degree"], 0);
  EXPECT_EQ(info["trained_with"], nullptr);
  EXPECT_EQ(info["opacity_histogram"]["counts"].size(), 10U);
  EXPECT_GT(info["opacity_histogram"]["counts"][9], 100);
  EXPECT_EQ(info["invisible"], 0);
  EXPECT_NEAR(info["flatness"]["median"].get<double>(), 0.01, 1e-4);
  EXPECT_EQ(run({tool("surfel-info"), splats, "--every", "2"}).exit_code, 2);
  EXPECT_TRUE(contains(run({tool("surfel-info"), splats}).output, "opacity_histogram"));
}

TEST(SurfelInfo, NamesStrayPoints) {
  const TemporaryFolder folder;
  std::string points;
  for (int i = 0; i < 1000; ++i) {
    const bool stray = i == 123 || i == 500;
    points += stray ? "0 0 0\n"
                    : fmt::format("{} {} {}\n", 5e5 + i % 40 / 10.0, 5.4e6 + i / 40 / 10.0, 7);
  }
  write_text(folder / "scan.xyz", points);
  const std::string text = run({tool("surfel-info"), folder / "scan.xyz"}).output;
  EXPECT_TRUE(contains(text, "\nstrays               count 2, first 123, at 0 0 0\n")) << text;
  EXPECT_TRUE(contains(text, "2 of 1000 points lie far from all others; the first is point 123 "))
      << text;
  const auto json = [](const std::string& file) {
    return nlohmann::json::parse(run({tool("surfel-info"), file, "--json"}).output);
  };
  const nlohmann::json scan = json(folder / "scan.xyz");
  EXPECT_EQ(scan["strays"], (nlohmann::json{{"count", 2}, {"first", 123}, {"at", {0, 0, 0}}}));
  // The command that is named leaves out these points and no others.
  ASSERT_EQ(scan["needs"][0]["topic"], "strays");
  std::string command = scan["needs"][0]["command"];
  command.replace(command.find("OUT"), 3, folder / "clean.ply");
  const std::string bin = fs::path(tool("surfel-info")).parent_path();
  const RunResult cut = run({"/bin/sh", "-c", "PATH=" + bin + ":$PATH && " + command});
  EXPECT_EQ(cut.exit_code, 0) << command << cut.errors;
  const nlohmann::json clean = json(folder / "clean.ply");
  EXPECT_EQ(clean["count"], 998);
  EXPECT_EQ(clean["strays"], nullptr);
}

TEST(SurfelInfo, EndsWithACommandThatRuns) {
  const TemporaryFolder folder;
  const std::string here = folder / ".";
  const std::string raw = folder / "my points.xyz";
  write_text(raw, "0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 0 0\n2 1 0.2\n");
  const std::string bin = fs::path(tool("surfel-info")).parent_path();
  const auto next = [&](const std::string& file) {
    const std::string text = run({tool("surfel-info"), file}).output;
    const std::size_t line = text.rfind("\nnext ");
    EXPECT_EQ(text.find('\n', line + 1), text.size() - 1) << text;
    return text.substr(text.find("surfel-", line));
  };
  for (const auto& [file, made] :
       {std::pair{raw, "my points-surfels.ply"},
        {folder / "my points-surfels.ply", "my points-surfels-picture.png"},
        {Inputs::get().mesh, ""}}) {
    const std::string command = next(file);
    const RunResult result =
        run({"/bin/sh", "-c", "cd " + here + " && PATH=" + bin + ":$PATH && " + command});
    EXPECT_EQ(result.exit_code, 0) << command << result.errors;
    EXPECT_TRUE(fs::exists(folder / made)) << command;
  }
  EXPECT_TRUE(next(Inputs::get().mesh).starts_with("surfel-render "));
  EXPECT_TRUE(next(Inputs::get().image).starts_with("surfel-compare "));
}

TEST(SurfelInfo, ReadsTrickyFilesOfSupportedFormats) {
  SURFEL_REQUIRE_TEST_DATA();
  int read = 0;
  for (const auto& entry : fs::directory_iterator(data_folder() / "malformed" / "tricky")) {
    const std::string extension = entry.path().extension();
    const Words supported = {".ply", ".pcd", ".las", ".obj", ".off", ".png"};
    // Points without faces are no mesh, and OBJ is no format of surfels.
    const bool points = entry.path().filename() == "tinyobj_points.obj";
    if (points || std::count(supported.begin(), supported.end(), extension) == 0) continue;
    const RunResult result = run({tool("surfel-info"), entry.path(), "--json"});
    EXPECT_EQ(result.exit_code, 0) << entry.path() << result.errors;
    ++read;
  }
  EXPECT_GT(read, 20);
}

}  // namespace
}  // namespace surfel::test
