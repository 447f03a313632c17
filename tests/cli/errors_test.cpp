// What the tools say of mistakes, written down in docs/errors.md. Where messages have changed on
// purpose, the page is made anew by running this test with SURFEL_WRITE_ERRORS=1 set.

#include <cstdlib>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

const std::string kPage = std::string(SURFEL_SOURCE_DIR) + "/docs/errors.md";

/// A command that cannot work, and what its message has to name.
struct Mistake {
  std::string command;
  std::string culprit;
};
struct Section {
  std::string title;
  std::vector<Mistake> mistakes;
};

const std::vector<Section>& sections() {
  static const std::vector<Section> kSections = {
      {"Files that are not there, or not whole",
       {{"surfel-render nowhere.ply -o out.png", "nowhere.ply"},
        {"surfel-render folder.ply -o out.png", "folder.ply"},
        {"surfel-render empty.ply -o out.png", "empty.ply"},
        {"surfel-render cut.ply -o out.png", "cut.ply"},
        {"surfel-info notes.docx", "notes.docx"},
        {"surfel-estimate words.xyz -o out.ply", "words.xyz"},
        {"surfel-estimate nan.xyz -o out.ply", "nan.xyz"},
        {"surfel-estimate flatland.ply -o out.ply", "flatland.ply"},
        {"surfel-convert ball.ply nowhere.ply -o out.ply", "nowhere.ply"},
        {"surfel-from-mesh nowhere.obj --count 100 -o out.ply", "nowhere.obj"},
        {"surfel-from-mesh index.obj --count 100 -o out.ply", "index.obj"},
        {"surfel-from-mesh points.obj --count 100 -o out.ply", "points.obj"},
        {"surfel-texture ball.ply --image nowhere.png -o out.ply", "nowhere.png"},
        {"surfel-texture ball.ply --image cut.png -o out.ply", "cut.png"},
        {"surfel-texture ball.ply --mesh nowhere.obj -o out.ply", "nowhere.obj"},
        {"surfel-compare picture.png small.png", "small.png"},
        {"surfel-render ball.ply --camera nowhere.toml -o out.png", "nowhere.toml"},
        {"surfel-render ball.ply --camera camera.toml -o out.png", "fovy"},
        {"surfel-render ball.ply --scene scene.toml -o out.png", "colour"},
        {"surfel-render ball.ply --config broken.toml -o out.png", "broken.toml"},
        {"surfel-from-mesh ball.obj --config typo.toml -o out.ply", "cuont"},
        {"surfel-chart nowhere.ply --quick -o report", "nowhere.ply"}}},
      {"One kind of file where another is wanted",
       {{"surfel-group ball.obj -o out.ply", "ball.obj"},
        {"surfel-group picture.png -o out.ply", "picture.png"},
        {"surfel-from-mesh ball.ply --count 100 -o out.ply", "ball.ply"},
        {"surfel-from-mesh picture.png --count 100 -o out.ply", "picture.png"},
        {"surfel-texture ball.ply --image ball.obj -o out.ply", "ball.obj"},
        {"surfel-chart picture.png --quick -o report", "picture.png"},
        {"surfel-render picture.png -o out.png", "picture.png"},
        {"surfel-join picture.png -o out.png", "picture.png"},
        {"surfel-texture points.xyz --image checker -o out.ply", "points.xyz"},
        {"surfel-simplify points.xyz --count 2 -o out.ply", "points.xyz"},
        {"surfel-render ball.ply --method deferred -o out.png", "ball.ply"},
        {"surfel-render ball.ply --lod on -o out.png", "ball.ply"},
        {"surfel-view points.xyz -o out.html", "points.xyz"},
        {"surfel-view ball.obj -o out.html", "ball.obj"}}},
      {"Outputs",
       {{"surfel-group ball.ply -o ball.ply", "ball.ply"},
        {"surfel-group ball.ply -o out --stats out", "--stats"},
        {"surfel-render --mesh ball.obj --image picture.png -o picture.png", "--image"},
        {"surfel-convert ball.ply -o q.stl", "q.stl"},
        {"surfel-convert ball.ply -o q.copc.laz", "q.copc.laz"},
        {"surfel-render ball.ply -o picture", "picture"},
        {"surfel-generate sky -o sky.png", "sky.png"},
        {"surfel-render ball.ply --quiet -o nowhere/out.png", "nowhere/out.png"},
        {"surfel-convert ball.ply -o folder.ply", "folder.ply"},
        {"surfel-convert ball.ply -o cut.ply --no-clobber", "cut.ply"},
        {"surfel-render ball.ply --skip-existing -o picture.png", "picture.png"},
        {"surfel-render ball.ply --turntable 4 --quiet -o out.png", "out.png"},
        {"surfel-render ball.ply --tiles 1/2 -o out.png", "out.png"},
        {"surfel-convert ball.ply --sort curve -o out.pcd", "out.pcd"},
        {"surfel-convert ball.ply -o city/", "city/"},
        {"surfel-generate sphere", "--output"}}},
      {"Words that a tool does not know",
       {{"surfel-render ball.ply -o out.png --zom 2", "--zom"},
        {"surfel-render ball.ply --ouput out.png", "--ouput"},
        {"surfel-render ball.ply -output out.png", "-output"},
        {"surfel-render my scan.ply -o out.png", "my"},
        {"surfel-render ball.ply -o out.png --method transparant", "transparant"},
        {"surfel-generate spher -o out.ply", "spher"},
        {"surfel-generate --case duplicate -o out.ply", "duplicate"},
        {"surfel-texture ball.ply --solid marbel -o out.ply", "marbel"},
        {"surfel-chart ball.ply --sweep cutof -o report", "cutof"},
        {"surfel-chart ball.ply --with 'surfel-rendr --cutoff 2' --quick -o report",
         "surfel-rendr"}}},
      {"Values",
       {{"surfel-render ball.ply", "--output"},
        {"surfel-render ball.ply -o", "--output"},
        {"surfel-render ball.ply -o out.png --size 640*480", "--size"},
        {"surfel-render ball.ply -o out.png --fov 200", "--fov"},
        {"surfel-render ball.ply -o out.png --eye 1,2", "--eye"},
        {"surfel-render ball.ply -o out.png --background pinkish", "pinkish"},
        {"surfel-render ball.ply -o out.png --memory lots", "--memory"},
        {"surfel-render ball.ply -o out.png --layers 2.5", "--layers"},
        {"surfel-render ball.ply -o out.png --threads 0", "--threads"},
        {"surfel-from-mesh ball.obj --count 0 -o out.ply", "--count"},
        {"surfel-from-mesh ball.obj --count -5 -o out.ply", "--count"},
        {"surfel-from-mesh ball.obj --spacing wide -o out.ply", "--spacing"},
        {"surfel-from-mesh ball.obj --spacing nan -o out.ply", "--spacing"},
        {"surfel-from-mesh ball.obj -o out.ply", "--spacing"},
        {"surfel-estimate points.xyz -k many -o out.ply", "-k"},
        {"surfel-estimate points.xyz -k 2 -o out.ply", "-k"},
        {"surfel-convert ball.ply --rotate 0,0,0,90 -o out.ply", "--rotate"},
        {"surfel-convert ball.ply --material 70000 -o out.ply", "--material"},
        {"surfel-compare picture.png picture.png --threshold 2", "--threshold"}}},
      {"Options that do not go together",
       {{"surfel-from-mesh ball.obj --count 10 --spacing 1 -o out.ply", "--spacing"},
        {"surfel-from-mesh ball.obj --count 10 --max-error 1 -o out.ply", "--max-error"},
        {"surfel-render --mesh ball.obj --reference -o out.png", "--mesh and --reference"},
        {"surfel-render ball.ply --image picture.png -o out.png", "--image"},
        {"surfel-render ball.ply --peel 3 -o out.png", "--peel"},
        {"surfel-render -o out.png", "--mesh"},
        {"surfel-texture ball.ply -o out.ply", "--image"},
        {"surfel-texture ball.ply --image checker --lambda 1 -o out.ply", "--lambda"},
        {"surfel-simplify ball.ply --count 10 --max-error 0.1 -o out.ply", "--max-error"},
        {"surfel-group ball.ply", "--output"},
        {"surfel-group ball.ply --cover-target 0.9 -o out.ply", "--cover-target"},
        {"surfel-convert ball.ply --align -o out.ply", "--align"},
        {"surfel-convert - - -o out.ply", "standard input"},
        {"surfel-convert ball.ply --ascii -o out.pcd", "--ascii"},
        {"surfel-generate checker --count 5 -o out.png", "--count"},
        {"surfel-view ball.ply", "--serve"},
        {"surfel-view ball.ply --serve -o out.html", "--serve"},
        {"surfel-generate sphere --case seam -o out.ply", "--case"},
        {"surfel-chart ball.ply --quick --recommend -o report", "--recommend"}}}};
  return kSections;
}

/// A message advises where it says what to do, or what would be right.
bool advises(const std::string& message) {
  for (const char* mark : {"; ", " must ", "did you mean", " is not one of ", " needs "}) {
    if (contains(message, mark)) return true;
  }
  return false;
}

class Errors : public testing::Test {
 protected:
  Errors() {
    in_folder("surfel-generate sphere --count 500 -o ball.ply --mesh ball.obj --resolution 8");
    in_folder("surfel-generate checker --size 64 -o picture.png");
    in_folder("surfel-generate checker --size 32 -o small.png");
    in_folder("head -c 2000 ball.ply > cut.ply && head -c 100 picture.png > cut.png");
    fs::create_directory(folder_ / "folder.ply");
    for (const auto& [name, text] : std::vector<std::pair<std::string, std::string>>{
             {"empty.ply", ""},
             {"notes.docx", "Dear diary\n"},
             {"words.xyz", "0 0 0\n1 zero 0\n"},
             {"nan.xyz", "nan nan nan\nnan nan nan\n"},
             {"points.xyz", "0 0 0\n1 0 0\n0 1 0\n1 1 0\n"},
             {"flatland.ply",
              "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
              "end_header\n0 0\n"},
             {"index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"},
             {"points.obj", "v 0 0 0\nv 1 0 0\n"},
             {"camera.toml", "eye = [0, 0, 3]\nfovy = 30\n"},
             {"scene.toml", "[[light]]\ncolour = [1, 1, 1]\n"},
             {"broken.toml", "eye = [0, 0\n"},
             {"typo.toml", "cuont = 5\n"}}) {
      write_text(folder_ / name, text);
    }
  }
  RunResult in_folder(const std::string& command) const {
    return run({"sh", "-c", "cd \"$1\" && PATH=\"$2:$PATH\" && " + command, "sh", folder_ / "",
                SURFEL_TOOL_DIR});
  }
  Words files() const { return entries(folder_ / ""); }

 private:
  TemporaryFolder folder_;
};

TEST_F(Errors, NameTheCulpritAndAdviseAndThePageHasThemAll) {
  const Words before = files();
  int count = 0;
  std::string page =
      "# Mistakes, and what the tools say\n\n"
      "Exit code 1: the input or the run failed; 2: the command was not understood. Neither leaves "
      "a file behind. This page is made by\nrunning the commands: "
      "`SURFEL_WRITE_ERRORS=1 build/release/tests/cli_tests --gtest_filter='Errors.*'` makes it "
      "anew, and the test\nfails where it is out of date.\n";
  for (const auto& [title, mistakes] : sections()) {
    page += "\n## " + title + "\n\n```console\n";
    for (const auto& [command, culprit] : mistakes) {
      const RunResult result = in_folder(command);
      const std::string tool = command.substr(0, command.find(' '));
      const std::string start = tool + ": error: ";
      EXPECT_TRUE(result.exit_code == 1 || result.exit_code == 2) << command;
      EXPECT_EQ(result.output, "") << command;
      EXPECT_TRUE(result.errors.starts_with(start)) << result.errors;
      EXPECT_EQ(std::count(result.errors.begin(), result.errors.end(), '\n'), 1) << result.errors;
      const std::string message =
          result.errors.substr(std::min(start.size(), result.errors.size()));
      EXPECT_TRUE(contains(message, culprit)) << command << "\n" << message;
      EXPECT_TRUE(advises(message)) << command << "\n" << message;
      EXPECT_EQ(files(), before) << command;
      page += fmt::format("{}$ {}\n{}[exit code {}]\n", page.ends_with("console\n") ? "" : "\n",
                          command, result.errors, result.exit_code);
      ++count;
    }
    page += "```\n";
  }
  EXPECT_GE(count, 60);
  if (std::getenv("SURFEL_WRITE_ERRORS")) {
    write_text(kPage, page);
  } else {
    EXPECT_TRUE(read_text(kPage) == page) << kPage << " is out of date; make it anew as it says";
  }
}

}  // namespace
}  // namespace surfel::test
