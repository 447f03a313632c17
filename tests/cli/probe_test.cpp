// The command line that all tools share, seen from outside on a tool that does nothing else.

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

using nlohmann::json;

class Probe : public testing::Test {
 protected:
  RunResult probe(const std::vector<std::string>& arguments, const RunSetup& setup = {}) const {
    std::vector<std::string> command = {SURFEL_PROBE};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return run(command, setup);
  }
  /// With input and output given, and a report.
  RunResult work(std::vector<std::string> arguments, const RunSetup& setup = {}) const {
    for (const std::string& more : {std::string("in"), std::string("-o"), output_}) {
      arguments.insert(arguments.begin(), more);
    }
    std::swap(arguments[0], arguments[1]);
    arguments.insert(arguments.end(), {"--stats", stats_});
    return probe(arguments, setup);
  }
  json report() const { return json::parse(read_text(stats_)); }

  TemporaryFolder folder_;
  std::string output_ = folder_ / "out.txt";
  std::string stats_ = folder_ / "stats.json";
};

TEST_F(Probe, HelpNamesOptionsWithDefaults) {
  const RunResult result = probe({"--help"});
  EXPECT_EQ(result.exit_code, 0);
  for (const char* part :
       {"--threads", "--config", "--print-config", "--manual", "--quiet", "--verbose",
        "--no-clobber", "--stats", "--version", "--spacing FLOAT=0.01", "--eye N,N,N=0,0,3",
        "--size WxH=640x480", "--ending NAME=done"}) {
    EXPECT_TRUE(contains(result.output, part)) << part << "\n" << result.output;
  }
  EXPECT_EQ(result.errors, "");
}

TEST_F(Probe, MisspeltOptionsAreToldWithTheNearest) {
  const auto told = [&](const std::vector<std::string>& arguments, const std::string& message) {
    const RunResult result = probe(arguments);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_TRUE(contains(result.errors, "error: " + message)) << result.errors;
  };
  told({"in", "-o", "x", "--siez", "4"}, "--siez is not an option; did you mean --size?");
  told({"in", "-o", "x", "--siez=4"}, "--siez is not an option; did you mean --size?");
  told({"in", "-o", "x", "--shininess", "4"}, "--shininess is not an option; see");
  // Also where the required option is the one that is misspelt, and in the order of the user.
  told({"in", "--ouput", "x"}, "--ouput is not an option; did you mean --output?");
  told(
      {"--siez", "4", "--eey", "1,2,3"},
      "--siez is not an option; did you mean --size?; --eey is not an option; did you mean --eye?");
  told({"in", "-output", "x"}, "-output has one dash too few; did you mean --output?");
  told({"in", "-o", "x", "-size=4"}, "-size=4 has one dash too few; did you mean --size?");
  told({"in", "more", "most", "-o", "x"}, "'more' 'most' are not expected;");
  told({"in", "-o", "x", "--ending", "usge"}, "--ending: 'usge' is not one of done, usage,");
  EXPECT_TRUE(contains(probe({"in", "-o", "x", "--ending", "usge"}).errors, "did you mean usage?"));
  write_text(folder_ / "config.toml", "spaicng = 1\n");
  told({"in", "--config", folder_ / "config.toml"},
       (folder_ / "config.toml") + ": line 1: unknown option 'spaicng'; did you mean spacing?");
  write_text(folder_ / "config.toml", "spacing.of = 1\n");
  told({"in", "--config", folder_ / "config.toml"},
       (folder_ / "config.toml") + ": line 1: 'spacing' is not a value or a list of values");
  std::string deep;
  for (int i = 0; i < 100000; ++i) deep += "spacing.";
  write_text(folder_ / "config.toml", deep + "spacing = 1\n");
  told({"in", "--config", folder_ / "config.toml"},
       (folder_ / "config.toml") + ": line 1: keys of more than 32 parts");
}

TEST_F(Probe, VersionIsOneLine) {
  const RunResult result = probe({"--version"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.output, "surfel-probe 0.1.0\n");
}

TEST_F(Probe, WrongUsageEndsWithTwoAndPointsToHelp) {
  const std::vector<std::vector<std::string>> wrong = {
      {},
      {"in"},
      {"in", "-o"},
      {"in", "more", "-o", "x"},
      {"in", "-o", "x", "--bogus"},
      {"in", "-o", "x", "--spacing", "wide"},
      {"in", "-o", "x", "--count", "1.5"},
      {"in", "-o", "x", "--seed", "-1"},
      {"in", "-o", "x", "--eye", "1,2"},
      {"in", "-o", "x", "--size", "0x1"},
      {"in", "-o", "x", "--ending", "never"},
      {"in", "-o", "x", "--threads", "0"},
      {"in", "-o", "x", "--threads", "-1"},
      {"in", "-o", "x", "--threads", "100000"},
      {"in", "-o", "x", "--config", "/nonexistent.toml"},
      {"in", "-o", "x", "--config", "/"},
  };
  for (const auto& arguments : wrong) {
    const RunResult result = probe(arguments);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_EQ(result.output, "");
    EXPECT_TRUE(result.errors.starts_with("surfel-probe: error: ")) << result.errors;
    EXPECT_TRUE(contains(result.errors, "--help")) << result.errors;
    EXPECT_EQ(std::count(result.errors.begin(), result.errors.end(), '\n'), 1) << result.errors;
  }
  EXPECT_TRUE(contains(probe({"in", "-o", "x", "--ending", "never"}).errors,
                       "'never' is not one of done, usage,"));
}

TEST_F(Probe, FailuresEndWithTheirCodeAndLeaveNothing) {
  const std::vector<std::tuple<std::string, int, std::string>> endings = {
      {"usage", 2, "surfel-probe: error: first problem; second problem\n"},
      {"input", 1, "surfel-probe: error: scan.ply: is made up; choose another ending\n"},
      {"memory", 1, "surfel-probe: error: in: out of memory; use fewer surfels"},
      {"size", 1, "surfel-probe: error: in: out of memory; use fewer surfels"},
      {"exception", 1, "surfel-probe: error: in: something else; surfel-info tells"}};
  for (const auto& [ending, code, message] : endings) {
    const RunResult result = work({"--ending", ending, "--quiet"});
    EXPECT_EQ(result.exit_code, code) << ending;
    EXPECT_TRUE(result.errors.starts_with(message)) << result.errors;
    // The report says why; there is no other file.
    EXPECT_EQ(entries(folder_ / ""), std::vector<std::string>{"stats.json"});
    EXPECT_TRUE(contains(result.errors, report()["error"].get<std::string>()));
  }
}

TEST_F(Probe, NotesAreSilencedByQuietAndDetailsAskedForByVerbose) {
  EXPECT_EQ(work({}).errors, "surfel-probe: at work\n");
  EXPECT_EQ(work({"--quiet"}).errors, "");
  EXPECT_EQ(work({"--verbose"}).errors, "surfel-probe: at work\nsurfel-probe: in detail\n");
}

TEST_F(Probe, ProgressIsToldAsJsonWhereItIsAskedFor) {
  const std::string told = work({"--progress", "json"}).errors;
  std::vector<json> lines;
  std::string rest = told;
  for (std::size_t end = rest.find('\n'); end != std::string::npos; end = rest.find('\n')) {
    const std::string line = rest.substr(0, end);
    rest.erase(0, end + 1);
    if (line.starts_with("{")) lines.push_back(json::parse(line));
  }
  ASSERT_GE(lines.size(), 2U) << told;
  EXPECT_EQ(lines.front()["event"], "begin");
  EXPECT_EQ(lines.front()["stage"], "working");
  EXPECT_EQ(lines.front()["done"], 0);
  EXPECT_EQ(lines.back()["event"], "end");
  EXPECT_EQ(lines.back()["done"], 4200000);
  EXPECT_EQ(lines.back()["total"], 10000000);
  EXPECT_EQ(lines.back()["unit"], "points");
  EXPECT_TRUE(lines.back()["rate"].is_number());
  EXPECT_TRUE(lines.back()["seconds_left"].is_number());
  EXPECT_TRUE(contains(told, "surfel-probe: at work\n"));
  EXPECT_EQ(work({"--progress", "json", "--quiet"}).errors, "");
  EXPECT_EQ(work({"--progress", "none"}).errors, work({}).errors);
}

TEST_F(Probe, ReportHoldsOptionsInForceAndMeasures) {
  ASSERT_EQ(work({"--eye", "-1,.5,2", "--threads", "3", "--light", "1", "2.5", "--flat"}).exit_code,
            0);
  const json stats = report();
  EXPECT_EQ(stats["tool"], "surfel-probe");
  EXPECT_EQ(stats["version"], "0.1.0");
  EXPECT_EQ(stats["threads"], 3);
  EXPECT_GE(stats["total_ms"].get<double>(), 0);
  EXPECT_GT(stats["peak_memory_bytes"].get<double>(), 1e5);
  EXPECT_EQ(stats["eye"], json({-1, 0.5, 2}));
  const json& options = stats["options"];
  EXPECT_EQ(options["input"], "in");
  EXPECT_EQ(options["output"], output_);
  EXPECT_EQ(options["spacing"], 0.01);
  EXPECT_EQ(options["count"], 7);
  EXPECT_EQ(options["flat"], true);
  EXPECT_EQ(options["quiet"], false);
  EXPECT_EQ(options["eye"], "-1,.5,2");
  EXPECT_EQ(options["size"], "640x480");
  EXPECT_EQ(options["light"], json({1, 2.5}));
  EXPECT_EQ(options["ending"], "done");
  EXPECT_FALSE(options.contains("target"));
  EXPECT_FALSE(stats.contains("error"));
}

TEST_F(Probe, ReportThatCannotBeWrittenFailsBeforeTheWork) {
  const RunResult result = probe({"in", "-o", output_, "--stats", folder_ / "none/stats.json"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "none/stats.json"));
  EXPECT_TRUE(entries(folder_ / "").empty());
}

TEST_F(Probe, ProvenanceHoldsWhatCanChangeTheResult) {
  ASSERT_EQ(probe({"some/folder/in.ply", "-o", output_, "--spacing", "0.5", "--threads", "2",
                   "--verbose", "--eye", "1,2,3", "--flat", "--stats", stats_})
                .exit_code,
            0);
  EXPECT_EQ(read_text(output_), "surfel-probe 0.1.0 in.ply --spacing 0.5 --flat --eye 1,2,3\n");
  ASSERT_EQ(probe({"two\nlines and blanks", "-o", output_}).exit_code, 0);
  EXPECT_EQ(read_text(output_), "surfel-probe 0.1.0 $'two\\012lines and blanks'\n");
  ASSERT_EQ(probe({"-o", output_, "--", "-it's"}).exit_code, 0);
  EXPECT_EQ(read_text(output_), "surfel-probe 0.1.0 './-it'\\''s'\n");
}

TEST_F(Probe, ConfigFileSetsOptionsAndTheCommandLineWins) {
  const std::string config = folder_ / "config.toml";
  write_text(config,
             "spacing = 0.25\neye = [1, 2.5, -3]\nflat = true\nsize = \"3x4\" # pixels\n"
             "light = [1, 2]\ntarget = \"0,0,0\"\nthreads = 2\nquiet = true\n");
  const RunResult result = work({"--config", config, "--spacing", "0.5"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(result.errors, "");
  const json stats = report();
  EXPECT_EQ(stats["spacing"], 0.5);
  EXPECT_EQ(stats["eye"], json({1, 2.5, -3}));
  EXPECT_EQ(stats["size"], json({3, 4}));
  EXPECT_EQ(stats["flat"], true);
  EXPECT_EQ(stats["target"], true);
  EXPECT_EQ(stats["threads"], 2);
  EXPECT_EQ(stats["options"]["light"], json({1, 2}));
  EXPECT_EQ(stats["options"]["config"], config);
}

TEST_F(Probe, WholeNumbersAndSizesAreReadHoweverTheyAreWritten) {
  const std::string config = folder_ / "config.toml";
  write_text(config, "seed = 2e6\nsize = 512\nthreads = \"2\"\n");
  ASSERT_EQ(work({"--config", config, "--count", "1.5k"}).exit_code, 0);
  const json stats = report();
  EXPECT_EQ(stats["options"]["count"], 1500);
  EXPECT_EQ(stats["options"]["seed"], 2000000);
  EXPECT_EQ(stats["options"]["threads"], 2);
  EXPECT_EQ(stats["size"], json({512, 512}));
  EXPECT_TRUE(contains(read_text(output_), "--count 1500")) << read_text(output_);
  // Nothing is cut off.
  for (const auto& [option, value, message] :
       std::vector<std::tuple<std::string, std::string, std::string>>{
           {"--count", "1.5", "--count: '1.5' is not a whole number"},
           {"--count", "3G", "--count: 3G is above 2147483647"},
           {"--count", "-3G", "--count: -3G is below -2147483648"},
           {"--seed", "-1", "--seed: -1 is below 0"},
           {"--seed", "1e20", "--seed: 1e20 is above 18446744073709551615"},
           {"--spacing", "wide", "--spacing: 'wide' is not a number"}}) {
    const RunResult result = work({option, value});
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_TRUE(contains(result.errors, message)) << result.errors;
  }
  for (const char* number : {"1.5", "\"1.5\"", "3e9"}) {
    write_text(config, std::string("count = ") + number + "\n");
    EXPECT_EQ(work({"--config", config}).exit_code, 2) << number;
  }
}

TEST_F(Probe, RequiredOptionsMayStandInTheConfigFile) {
  write_text(folder_ / "config.toml", "output = \"" + output_ + "\"\nflat = false\n");
  EXPECT_EQ(probe({"in", "--config", folder_ / "config.toml"}).exit_code, 0);
  EXPECT_TRUE(std::filesystem::exists(output_));
}

TEST_F(Probe, MistakesInConfigFilesNameFileLineAndKey) {
  const std::string config = folder_ / "config.toml";
  const std::vector<std::pair<std::string, std::string>> mistakes = {
      {"bogus = 1", "'bogus'"},
      {"spacing = \"wide\"", "spacing"},
      {"spacing = [1, 2]", "spacing"},
      {"size = \"0x4\"", "--size"},
      {"eye = [1, 2]", "--eye"},
      {"threads = 0", "--threads"},
      {"[eye]\nx = 1", "'eye'"},
      {"config = \"other.toml\"", "'config'"},
      {"help = true", "'help'"},
      {"input = \"in\"", "'input'"},
      {"o = \"out\"", "'o'"},
      {"flat = \"maybe\"", "flat"},
      {"output = 1979-05-27", "'output'"},
      {"spacing 1", "line 2"}};
  for (const auto& [text, named] : mistakes) {
    write_text(config, "count = 3\n" + text + "\n");
    const RunResult result = work({"--config", config});
    EXPECT_EQ(result.exit_code, 2) << text;
    EXPECT_TRUE(contains(result.errors, config + ": line 2: ")) << result.errors;
    EXPECT_TRUE(contains(result.errors, named)) << result.errors;
  }
}

TEST_F(Probe, PrintedSettingsReadBackAreTheSame) {
  const std::string config = folder_ / "config.toml";
  const RunResult first =
      probe({"--print-config", "--eye", "-1,2,3.5", "--light", "1", "2", "--flat", "--count", "9",
             "--ending", "input", "-o", "a \"quoted\" name\\"});
  EXPECT_EQ(first.exit_code, 0) << first.errors;
  write_text(config, first.output);
  const RunResult second = probe({"--print-config", "--config", config});
  EXPECT_EQ(second.exit_code, 0) << second.errors;
  EXPECT_EQ(second.output, first.output);
  EXPECT_TRUE(contains(first.output, "eye = \"-1,2,3.5\"\n"));
  EXPECT_TRUE(contains(first.output, "flat = true\n"));
  EXPECT_EQ(probe({"--print-config", "--bogus"}).exit_code, 2);
}

TEST_F(Probe, NoClobberKeepsAnOlderFile) {
  write_text(output_, "old");
  EXPECT_EQ(work({"--no-clobber"}).exit_code, 1);
  EXPECT_EQ(read_text(output_), "old");
  EXPECT_EQ(probe({"in", "-o", output_}).exit_code, 0);
  EXPECT_NE(read_text(output_), "old");
}

TEST_F(Probe, StandardOutputThatFailsIsAnError) {
  const auto full = [](const std::string& command) {
    return run({"sh", "-c", std::string(SURFEL_PROBE) + " " + command + " > /dev/full"});
  };
  for (const char* command : {"--help", "--version", "--print-config", "in -o -"}) {
    EXPECT_EQ(full(command).exit_code, 1) << command;
  }
  const RunResult closed = run({"sh", "-c", std::string(SURFEL_PROBE) + " in -o - | true"});
  EXPECT_EQ(closed.exit_code, 0);
}

/// Signals once the tool's temporary is there, which it makes after it began to handle signals.
void signal_at_work(pid_t process, int signal, const std::string& folder) {
  wait_until([&] { return !entries(folder).empty(); });
  kill(process, signal);
}

TEST_F(Probe, InterruptedRunsEndByTheirErrorPath) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    const RunResult result = probe({"in", "-o", output_, "--ending", "wait", "--quiet"},
                                   {.input = {}, .meanwhile = [&](pid_t process) {
                                      signal_at_work(process, signal, folder_ / "");
                                    }});
    EXPECT_EQ(result.exit_code, 1) << result.signal;
    EXPECT_EQ(result.errors, "surfel-probe: error: interrupted\n");
    EXPECT_TRUE(entries(folder_ / "").empty());
  }
}

TEST_F(Probe, ASecondSignalEndsAtOnceAndLeavesNoTemporary) {
  // The probe makes its input once it has seen the first signal.
  const std::string seen = folder_ / "seen";
  const RunResult result = probe({seen, "-o", output_, "--ending", "stuck", "--quiet"},
                                 {.input = {}, .meanwhile = [&](pid_t process) {
                                    signal_at_work(process, SIGINT, folder_ / "");
                                    wait_until([&] { return std::filesystem::exists(seen); });
                                    kill(process, SIGTERM);
                                  }});
  EXPECT_EQ(result.signal, SIGTERM);
  EXPECT_EQ(entries(folder_ / ""), std::vector<std::string>{"seen"});
}

TEST_F(Probe, ASignalEndsWorkThatDoesNotAskAndLeavesNoTemporary) {
  const std::string seen = folder_ / "seen";
  const RunResult result = probe({seen, "-o", output_, "--ending", "stuck", "--quiet"},
                                 {.input = {}, .meanwhile = [&](pid_t process) {
                                    signal_at_work(process, SIGINT, folder_ / "");
                                  }});
  EXPECT_EQ(result.signal, SIGTERM);
  EXPECT_EQ(entries(folder_ / ""), std::vector<std::string>{"seen"});
}

TEST_F(Probe, WritesNoControlSequencesWhereThereIsNoTerminal) {
  for (const auto& arguments : {std::vector<std::string>{}, {"--ending", "input"}}) {
    const RunResult result = work(arguments);
    EXPECT_FALSE(contains(result.errors, "\r"));
    EXPECT_FALSE(contains(result.errors, "\033"));
  }
}

}  // namespace
}  // namespace surfel::test
