// No tool writes over what it reads, twice to one file, or to a name of another format.

#include <gtest/gtest.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

/// A folder with one input of every kind.
class Files : public testing::Test {
 protected:
  Files() {
    write_text(at("cloud.ply"),
               "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
               "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
               "property float variance\nend_header\n0 0 0 0 0 1 .2\n1 0 0 0 0 1 .2\n"
               "0 1 0 0 0 1 .2\n1 1 0 0 0 1 .2\n");
    for (const char* more : {"second.ply", "cloud.csv", "cloud.json"}) {
      fs::copy_file(at("cloud.ply"), at(more));
    }
    write_text(at("mesh.obj"),
               "mtllib mesh.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\n"
               "vt 0 1\nusemtl m\nf 1/1 2/2 3/3\n");
    write_text(at("mesh.mtl"), "newmtl m\nmap_Kd skin.png\n");
    write_text(at("view.toml"), "eye = [0, 0, 3]\n");
    write_text(at("scene.toml"), "[environment]\nimage = \"sky.png\"\n");
    write_text(at("config.json"), "cutoff = 1\n");
    const std::string picture = at("sky.png");
    run({tool("surfel-generate"), "checker", "--size", "16x8", "--image", picture});
    for (const char* more : {"skin.png", "map.png", "other.png", "view_0001.png"}) {
      fs::copy_file(picture, at(more));
    }
  }
  std::string at(const std::string& name) const { return folder_ / name; }

  /// Runs a tool in the folder, which must stay as it is: file names need no path.
  RunResult run_here(const std::string& command) const {
    const auto before = contents();
    const RunResult result = run({"sh", "-c",
                                  // A megabyte a file, for a run that would fill the disk.
                                  "ulimit -f 2048; cd '" + (folder_ / "") + "' && " +
                                      std::string(SURFEL_TOOL_DIR) + "/" + command});
    EXPECT_EQ(contents(), before) << command;
    return result;
  }
  /// Wrong usage, with a message that says so.
  void expect_refused(const std::string& command, const std::string& message) const {
    const RunResult result = run_here(command);
    EXPECT_EQ(result.exit_code, 2) << command << "\n" << result.errors;
    EXPECT_TRUE(contains(result.errors, message)) << command << "\n" << result.errors;
  }

 private:
  std::vector<std::pair<std::string, std::string>> contents() const {
    std::vector<std::pair<std::string, std::string>> all;
    for (const std::string& name : entries(folder_ / "")) {
      if (fs::is_regular_file(at(name))) all.emplace_back(name, read_text(at(name)));
    }
    return all;
  }
  TemporaryFolder folder_;
};

TEST_F(Files, NamesInFilesLeadOutOfTheirFoldersOnlyWherePermitted) {
  fs::create_directory(at("in"));
  write_text(at("in/scene.toml"), "[environment]\nimage = \"../sky.png\"\n");
  const std::string command = "surfel-render cloud.ply --size 8 --scene in/scene.toml -o - ";
  const RunResult refused = run_here(command);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_TRUE(contains(refused.errors,
                       "in/scene.toml: names the file sky.png, which lies outside "
                       "of this file's folder and is read only with "
                       "--allow-outside"))
      << refused.errors;
  const RunResult allowed = run_here(command + "--allow-outside");
  EXPECT_EQ(allowed.exit_code, 0) << allowed.errors;
}

TEST_F(Files, NoOutputIsAnInput) {
  const auto lost = [&](const std::string& command, const std::string& files) {
    expect_refused(command, files + " are one file, which would be lost; give --");
  };
  lost("surfel-estimate cloud.ply -o cloud.ply", "cloud cloud.ply and --output cloud.ply");
  for (const char* tool :
       {"texture --image checker", "group", "convert", "lod", "simplify --count 2"}) {
    lost(std::string("surfel-") + tool + " cloud.ply -o cloud.ply",
         "surfels cloud.ply and --output cloud.ply");
  }
  lost("surfel-convert second.ply cloud.ply -o cloud.ply",
       "surfels cloud.ply and --output cloud.ply");
  fs::copy_file(at("mesh.obj"), at("mesh.ply"));
  lost("surfel-from-mesh mesh.ply --count 3 -o mesh.ply", "mesh mesh.ply and --output mesh.ply");
  lost("surfel-texture cloud.ply --mesh mesh.ply -o mesh.ply",
       "--mesh mesh.ply and --output mesh.ply");
  lost("surfel-compare other.png map.png -o other.png", "tested other.png and --output other.png");
  lost("surfel-compare other.png map.png -o map.png", "truth map.png and --output map.png");
  lost("surfel-info cloud.json --stats cloud.json", "file cloud.json and --stats cloud.json");
  lost("surfel-info cloud.ply --config config.json --stats config.json",
       "--config config.json and --stats config.json");
  fs::create_directory(at("report"));
  fs::rename(at("cloud.csv"), at("report/report.csv"));
  lost("surfel-chart report/report.csv -o report",
       "input report/report.csv and --output report/report.csv");
}

TEST_F(Files, NoPictureIsAnInput) {
  const auto lost = [&](const std::string& options, const std::string& files) {
    expect_refused("surfel-render " + options, files + " are one file, which would be lost");
  };
  lost("--mesh mesh.obj --image map.png -o map.png", "--image map.png and --output map.png");
  lost("--mesh mesh.obj --normal-map map.png -o map.png",
       "--normal-map map.png and --output map.png");
  lost("--mesh mesh.obj --bump map.png -o map.png", "--bump map.png and --output map.png");
  lost("--mesh mesh.obj -o skin.png", "--output skin.png and the mesh's image skin.png");
  lost("cloud.ply --scene scene.toml -o sky.png",
       "--output sky.png and the environment map sky.png");
  lost("--mesh mesh.obj --image view_0001.png --turntable 2 -o view_%04d.png",
       "--image view_0001.png and --output view_0001.png");
  fs::copy_file(at("view.toml"), at("toml.png"));
  lost("cloud.ply --camera toml.png -o toml.png", "--camera toml.png and --output toml.png");
  lost("cloud.ply --scene toml.png -o toml.png", "--scene toml.png and --output toml.png");
}

TEST_F(Files, LinksAndOtherPathsAreFollowedAndTheOrderIsTheUsers) {
  fs::create_symlink("cloud.ply", at("link.ply"));
  fs::create_hard_link(at("cloud.ply"), at("hard.ply"));
  const std::string tool = "surfel-group ";
  expect_refused(tool + "cloud.ply -o ./cloud.ply", "surfels cloud.ply and --output ./cloud.ply");
  expect_refused(tool + "link.ply -o cloud.ply", "surfels link.ply and --output cloud.ply");
  expect_refused(tool + "cloud.ply -o link.ply", "surfels cloud.ply and --output link.ply");
  expect_refused(tool + "cloud.ply -o hard.ply", "surfels cloud.ply and --output hard.ply");
  expect_refused(tool + "-o hard.ply cloud.ply", "--output hard.ply and surfels cloud.ply");
}

TEST_F(Files, StandardStreamsAreTheFilesThatTheyLeadTo) {
  expect_refused("surfel-convert cloud.ply -o - >> cloud.ply",
                 "surfels cloud.ply and --output - are one file, which would be lost");
  expect_refused("surfel-convert - -o cloud.ply < cloud.ply",
                 "surfels - and --output cloud.ply are one file, which would be lost");
  expect_refused("surfel-estimate - -o - < cloud.ply >> cloud.ply",
                 "cloud - and --output - are one file, which would be lost");
  expect_refused("surfel-render - -o sky.png < sky.png", "files - and --output sky.png are one");
  expect_refused("surfel-group cloud.ply -o - --stats cloud.json >> cloud.json",
                 "--output - and --stats cloud.json are one file");
}

TEST_F(Files, NoTwoOutputsAreOneFile) {
  const auto twice = [&](const std::string& command, const std::string& files) {
    expect_refused(command, files + " are one file, which would be lost; give each a name");
  };
  twice("surfel-group cloud.ply -o new --stats ./new", "--output new and --stats ./new");
  twice("surfel-group --stats new cloud.ply -o new", "--stats new and --output new");
  twice("surfel-generate sphere -o a.ply --mesh a.ply", "--output a.ply and --mesh a.ply");
  // Standard output and devices can take both.
  EXPECT_EQ(run_here("surfel-group cloud.ply -o /dev/null --stats /dev/null").exit_code, 0);
  EXPECT_EQ(run_here("surfel-convert - -o - < cloud.ply").exit_code, 0);
  expect_refused("surfel-generate checker -o a.png --image b.png",
                 "--output and --image both name the picture");
}

TEST_F(Files, NamesOfOtherFormatsAreRefused) {
  const auto other = [&](const std::string& command, const std::string& message) {
    expect_refused(command, message);
  };
  const std::string surfels = "q.stl: surfels are not written as '.stl'; use .ply or .pcd";
  other("surfel-convert cloud.ply -o q.stl",
        "q.stl: surfels and Gaussians are not written as '.stl'; use .ply or .pcd");
  other("surfel-estimate cloud.ply -o q.stl", surfels);
  for (const char* tool : {"convert", "estimate", "group", "simplify --count 2"}) {
    other(std::string("surfel-") + tool + " cloud.ply -o q.copc.laz",
          "q.copc.laz: COPC is not written, and other programs take such a name for it; write "
          "q.laz");
  }
  other("surfel-texture cloud.ply --image checker -o q.stl", surfels);
  other("surfel-group cloud.ply -o q.stl", surfels);
  other("surfel-simplify cloud.ply --count 2 -o q.stl", surfels);
  other("surfel-from-mesh mesh.obj --count 3 -o q.stl", surfels);
  other("surfel-generate sphere -o q.stl", surfels);
  other("surfel-generate --case layers -o q.stl", surfels);
  other("surfel-lod cloud.ply -o q.pcd", "not written as '.pcd'; use .ply");
  other("surfel-generate sphere --mesh q.stl",
        "meshes are not written as '.stl'; use .obj or .ply");
  other("surfel-generate sphere --mesh q", "not written to a name without extension; use .obj");
  const std::string picture = "q.ply: images are not written as '.ply'; use .png, .exr";
  other("surfel-generate checker -o q.ply", picture);
  other("surfel-generate checker --image q.ply", picture);
  other("surfel-generate sky -o q.png", "not written as '.png'; use .exr or .hdr");
  other("surfel-render cloud.ply -o q.ply", picture);
  other("surfel-render cloud.ply -o q",
        "q: images are not written to a name without extension; use .png, .exr");
  other("surfel-compare map.png other.png -o q.ply", picture);
  other("surfel-info cloud.ply --stats q.ply", "reports are not written as '.ply'; use .json");
}

TEST_F(Files, ClosedStandardStreamsAreNeverFiles) {
  const auto fails = [&](const std::string& command, const std::string& message) {
    const RunResult result = run_here(command);
    EXPECT_EQ(result.exit_code, 1) << command << "\n" << result.errors;
    EXPECT_TRUE(contains(result.errors, message)) << command << "\n" << result.errors;
  };
  const std::string closed = "standard output is closed; name a file";
  fails("surfel-convert cloud.ply -o - >&-", closed);
  fails("surfel-convert cloud.ply -o - <&- >&-", closed);
  fails("surfel-convert cloud.ply -o - 1< /dev/null", closed);
  // Other names of it.
  fails("surfel-convert cloud.ply -o /dev/stdout >&-", closed);
  fails("surfel-convert cloud.ply -o /dev/fd/1 >&-", closed);
  fails("surfel-convert cloud.ply -o /proc/self/fd/1 <&- >&- 2>&-", "");
  fails("surfel-render cloud.ply --size 4x4 -o - >&-", closed);
  fails("surfel-info cloud.ply >&-", closed);
  fails("surfel-info --help >&-", closed);
  fails("surfel-info cloud.ply --stats - >&-", closed);
  fails("surfel-convert - -o /dev/null <&-", "standard input is closed; name a file");
  fails("surfel-convert cloud.ply -o /dev/full", "/dev/full: cannot be written: No space left");
  fails("surfel-render cloud.ply --size 4x4 -o /dev/full", "/dev/full: cannot be written");
}

TEST_F(Files, MessagesThatNobodyReadsEndNoRun) {
  std::string tools = SURFEL_TOOLS;
  std::replace(tools.begin(), tools.end(), ',', '\n');
  std::istringstream names(tools);
  for (std::string name; std::getline(names, name);) {
    for (const char* to : {"2>&-", "2> /dev/full", "<&- >&- 2>&-"}) {
      EXPECT_EQ(run_here(name + " --no-such-option " + to).exit_code, 2) << name << to;
    }
  }
  for (const char* to : {"2>&-", "2> /dev/full", "<&- >&- 2>&-"}) {
    EXPECT_EQ(run_here(std::string("surfel-convert cloud.ply -o /dev/null ") + to).exit_code, 0);
    EXPECT_EQ(run_here(std::string("surfel-convert none.ply -o /dev/null ") + to).exit_code, 1);
  }
}

TEST_F(Files, EmptyNamesAndFoldersAreNoFiles) {
  expect_refused("surfel-convert cloud.ply -o ''", "--output is empty; name a file");
  expect_refused("surfel-convert '' -o new.ply", "surfels is empty; name a file");
  expect_refused("surfel-info cloud.ply --stats ''", "--stats is empty; name a file");
  expect_refused("surfel-convert cloud.ply -o new/", "new/: is the name of a folder; name a file");
  expect_refused("surfel-render cloud.ply -o new/", "new/: is the name of a folder; name a file");
  expect_refused("surfel-info cloud.ply --stats new/", "new/: is the name of a folder");
}

TEST_F(Files, PercentSignsOfNamesAreLetters) {
  fs::rename(at("second.ply"), at("50%d.ply"));
  fs::rename(at("skin.png"), at("%s%n.png"));
  const auto makes = [&](const std::string& command, const std::string& name) {
    const RunResult result =
        run({"sh", "-c", "cd '" + at("") + "' && " + std::string(SURFEL_TOOL_DIR) + "/" + command});
    EXPECT_EQ(result.exit_code, 0) << command << result.errors;
    EXPECT_TRUE(fs::remove(at(name))) << command;
  };
  makes("surfel-convert 50%d.ply -o 60%04d.ply", "60%04d.ply");
  makes("surfel-convert 50%d.ply -o %x{}.ply", "%x{}.ply");
  makes("surfel-render --mesh mesh.obj --image %s%n.png --size 4x4 -o %x.png", "%x.png");
  makes("surfel-generate checker --size 4x4 -o %d.png", "%d.png");
  // Of pictures the name is a pattern, of one view, too.
  makes("surfel-render 50%d.ply --size 4x4 -o %s%d.png", "%s%d.png");
  makes("surfel-render 50%d.ply --size 4x4 -o view%d.png", "view0.png");
  makes("surfel-compare %s%n.png %s%n.png -o 7%d.png", "7%d.png");
}

TEST_F(Files, AChartKeepsAFolderNamedWork) {
  fs::create_directories(at("charts/work"));
  write_text(at("charts/work/thesis.txt"), "mine");
  expect_refused("surfel-chart cloud.ply --quick -o charts", "charts/work: is there already");
  EXPECT_EQ(read_text(at("charts/work/thesis.txt")), "mine");
}

}  // namespace
}  // namespace surfel::test
