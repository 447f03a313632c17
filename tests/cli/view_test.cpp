// --up and --view: what is guessed, what is said, and what stays as it is.

#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/image_io.h>
#include <surfel/truth/image_error.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

std::string box(double x0, double y0, double z0, double x1, double y1, double z1, int first) {
  std::ostringstream out;
  for (int corner = 0; corner < 8; ++corner) {
    out << "v " << (corner & 1 ? x1 : x0) << ' ' << (corner & 2 ? y1 : y0) << ' '
        << (corner & 4 ? z1 : z0) << '\n';
  }
  constexpr int kQuads[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& quad : kQuads) {
    out << 'f';
    for (const int corner : quad) out << ' ' << first + corner;
    out << '\n';
  }
  return out.str();
}

/// A post with an arm on a square plinth, z up, as mesh and as surfels.
struct Post {
  TemporaryFolder folder;
  std::string mesh = folder / "post.obj";
  std::string surfels = folder / "post.ply";

  Post() {
    write_text(mesh, box(-1, -1, 0, 1, 1, 0.4, 1) + box(-0.2, -0.2, 0.4, 0.2, 0.2, 2.4, 9) +
                         box(0.2, -0.15, 1.6, 0.9, 0.15, 1.9, 17));
    const RunResult made = run({tool("surfel-from-mesh"), mesh, "--count", "20000", "--seed", "1",
                                "-o", surfels, "--quiet"});
    EXPECT_EQ(made.exit_code, 0) << made.errors;
  }
  static const Post& get() {
    static const Post post;
    return post;
  }

  RunResult render(const Words& options, const std::string& name = "picture.png") const {
    Words command{tool("surfel-render"), "-o", folder / name, "--size", "64x64"};
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  }
  /// The bytes of a picture.
  std::string picture(const Words& options) const {
    Words all{surfels};
    all.insert(all.end(), options.begin(), options.end());
    const RunResult result = render(all);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_text(folder / "picture.png");
  }
};

/// What a run has said but for its last line, which tells what was written.
std::string guess_said(const RunResult& result) {
  const std::size_t end = result.errors.rfind('\n', result.errors.size() - 2);
  const std::size_t last = end == std::string::npos ? 0 : end + 1;
  EXPECT_TRUE(contains(result.errors.substr(last), " pixels, ")) << result.errors;
  return result.errors.substr(0, last);
}

TEST(View, GuessIsSaidUnlessQuiet) {
  const Post& post = Post::get();
  const std::string said = "up z, seen from the front right (largest flat support)";
  const std::string stats = post.folder / "stats.json";
  const RunResult loud = post.render({post.surfels, "--stats", stats});
  EXPECT_EQ(guess_said(loud), "surfel-render: " + said + "\n");
  EXPECT_EQ(nlohmann::json::parse(read_text(stats))["view"], said);
  EXPECT_EQ(post.render({post.surfels, "--quiet"}).errors, "");
  // Of a mesh without surfels, too; and nothing is said where nothing is guessed.
  EXPECT_EQ(guess_said(post.render({"--mesh", post.mesh, "--samples", "1"})),
            "surfel-render: " + said + "\n");
  EXPECT_EQ(guess_said(post.render({post.surfels, "--from", "1,2,3"})), "");
  EXPECT_EQ(guess_said(post.render({post.surfels, "--eye", "1,2,9", "--up", "z"})), "");
  EXPECT_EQ(guess_said(post.render({post.surfels, "--from", "1,2,3", "--up", "auto"})),
            "surfel-render: up z (largest flat support)\n");
  EXPECT_EQ(guess_said(post.render({post.surfels, "--up", "-y"})),
            "surfel-render: up -y, seen from the front right (as given)\n");
}

TEST(View, UpIsAnAxisOrNumbers) {
  const Post& post = Post::get();
  const auto from = [&](const Words& up) {
    Words options{"--from", "1,0.5,0.4"};
    options.insert(options.end(), up.begin(), up.end());
    return post.picture(options);
  };
  EXPECT_EQ(from({"--up", "z"}), from({"--up", "0,0,1"}));
  EXPECT_EQ(from({"--up", "-z"}), from({"--up", "0,0,-1"}));
  EXPECT_EQ(from({"--up=-x"}), from({"--up=-2,0,0"}));
  EXPECT_EQ(from({"--up", "auto"}), from({"--up", "z"}));
  EXPECT_NE(from({"--up", "z"}), from({"--up", "-z"}));
  // A direction without an upward one has y up.
  EXPECT_EQ(from({}), from({"--up", "y"}));
}

TEST(View, SidesAreThoseOfTheGuess) {
  const Post& post = Post::get();
  const auto from = [&](const std::string& direction, const std::string& up) {
    return post.picture({"--from=" + direction, "--up=" + up});
  };
  // The plane of symmetry is y = 0: the front is along x.
  const std::string front = post.picture({"--view", "front"});
  const bool along_x = front == from("1,0,0", "z");
  EXPECT_TRUE(along_x || front == from("-1,0,0", "z"));
  const std::string sign = along_x ? "" : "-";
  const std::string other = along_x ? "-" : "";
  EXPECT_EQ(post.picture({"--view", "back"}), from(other + "1,0,0", "z"));
  EXPECT_EQ(post.picture({"--view", "right"}), from("0," + sign + "1,0", "z"));
  EXPECT_EQ(post.picture({"--view", "left"}), from("0," + other + "1,0", "z"));
  EXPECT_EQ(post.picture({"--view", "top"}), from("0,0,1", other + "x"));
  EXPECT_EQ(post.picture({"--view", "bottom"}), from("0,0,-1", sign + "x"));
  EXPECT_EQ(post.picture({"--view", "iso"}), from(sign + "1," + sign + "1,1", "z"));
  EXPECT_EQ(post.picture({"--view", "top", "--up", "z"}), post.picture({"--view", "top"}));
}

TEST(View, TurntableTurnsAboutUp) {
  const Post& post = Post::get();
  ASSERT_EQ(post.render({post.surfels, "--view", "front", "--ortho", "4", "--turntable", "4"},
                        "turn_%d.exr")
                .exit_code,
            0);
  ASSERT_EQ(post.render({post.surfels, "--view", "right", "--ortho", "4"}, "right.exr").exit_code,
            0);
  const Image turned = read_image(post.folder / "turn_1.exr", true);
  EXPECT_GT(image_error(turned, read_image(post.folder / "right.exr", true)).psnr, 40);
  const Image opposite = read_image(post.folder / "turn_3.exr", true);
  EXPECT_LT(image_error(turned, opposite).psnr, 25);
}

TEST(View, WrongUsageIsRefused) {
  const Post& post = Post::get();
  const auto expect_refused = [&](const Words& options, const std::string& part) {
    Words all{post.surfels};
    all.insert(all.end(), options.begin(), options.end());
    const RunResult result = post.render(all);
    EXPECT_EQ(result.exit_code, 2) << part;
    EXPECT_TRUE(contains(result.errors, part)) << result.errors;
  };
  expect_refused({"--view", "front", "--from", "1,0,0"}, "--view and a direction of the camera");
  expect_refused({"--view", "top", "--eye", "1,0,9"}, "--view and a direction of the camera");
  expect_refused({"--view", "sensor"}, "does not say where a sensor stood");
  expect_refused({"--view", "down"}, "'down' is not one of front, back");
  expect_refused({"--up", "w"}, "--up: 'w' is not");
  expect_refused({"--up", "0,0,0"}, "--up must be a finite direction");
}

TEST(View, SensorsPlaceGoesThroughTheTools) {
  const TemporaryFolder folder;
  // A depth camera in (1, 2, 3), z forward, in front of a bent wall.
  std::string points;
  for (int row = 0; row < 40; ++row) {
    for (int column = 0; column < 60; ++column) {
      const double x = (column - 30) / 60.0;
      const double y = (row - 20) / 60.0;
      const double z = 4 + 0.3 * std::sin(5 * x);
      std::ostringstream line;
      line << 1 + x * z << ' ' << 2 + y * z << ' ' << 3 + z << '\n';
      points += line.str();
    }
  }
  const std::string scan = folder / "scan.pcd";
  write_text(scan,
             "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 60\nHEIGHT 40\nVIEWPOINT 1 2 3 1 0 0 0\n"
             "DATA ascii\n" +
                 points);
  std::string last = scan;
  int step = 0;
  const auto then = [&](const std::string& name, const Words& options) {
    const std::string next = folder / (std::to_string(step++) + ".ply");
    Words command{tool(name), last, "-o", next, "--quiet"};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    last = next;
  };
  then("surfel-estimate", {"--orient", "viewpoint"});
  then("surfel-convert", {"--scale", "2"});
  then("surfel-simplify", {"--count", "1500"});
  then("surfel-group", {});
  then("surfel-lod", {});
  const RunResult info = run({tool("surfel-info"), last, "--json"});
  EXPECT_EQ(nlohmann::json::parse(info.output)["viewpoint"], (std::vector<double>{2, 4, 6}))
      << info.errors;
  const std::string picture = folder / "picture.png";
  const RunResult seen = run({tool("surfel-render"), last, "-o", picture, "--size", "120x80"});
  EXPECT_EQ(guess_said(seen), "surfel-render: up -y, seen from where the sensor stood\n");
  // The field of view of the sensor is filled, but for a margin of a twentieth.
  const Image image = read_image(picture, true);
  double covered = 0;
  for (std::size_t i = 3; i < image.data.size(); i += image.channels.size()) {
    covered += image.data[i];
  }
  EXPECT_GT(covered / (120 * 80), 0.85);
}

/// The axis that a word names.
Vec3d axis(const std::string& word) {
  const bool negative = word[0] == '-';
  return (negative ? -1 : 1) * Vec3d::Unit(word.back() - 'x');
}

/// Is the direction nearest to one of the axes that a list names?
bool nearest(const nlohmann::json& direction, const std::string& list) {
  if (list == "any") return true;
  const Vec3d d(direction[0].get<double>(), direction[1].get<double>(), direction[2].get<double>());
  std::istringstream words(list);
  for (std::string word; std::getline(words, word, ',');) {
    if (axis(word).dot(d) > std::sqrt(0.5)) return true;
  }
  return false;
}

TEST(View, GuessIsRightOnNineOfTenFiles) {
  SURFEL_REQUIRE_TEST_DATA();
  std::ifstream table(std::string(SURFEL_SOURCE_DIR) + "/tests/views.txt");
  const TemporaryFolder folder;
  int files = 0;
  int right = 0;
  std::string wrong;
  for (std::string line; std::getline(table, line);) {
    if (line.starts_with('#')) continue;
    std::istringstream words(line);
    std::string file;
    std::string maker;
    std::string option;
    std::string up;
    std::string front;
    ASSERT_TRUE(words >> file >> maker >> option >> up >> front) << line;
    Words command{tool(maker), data_folder() / file, "-o", folder / "surfels.ply", "--quiet"};
    if (option != "-") command.push_back(option);
    if (maker == "surfel-from-mesh") command.insert(command.end(), {"--count", "20000"});
    const RunResult made = run(command);
    ASSERT_EQ(made.exit_code, 0) << made.errors;
    const RunResult info =
        run({tool("surfel-info"), folder / "surfels.ply", "--json", "--samples", "10"});
    ASSERT_EQ(info.exit_code, 0) << info.errors;
    const nlohmann::json view = nlohmann::json::parse(info.output)["view"];
    const bool good = nearest(view["up"], up) && nearest(view["front"], front);
    ++files;
    right += good ? 1 : 0;
    if (!good) wrong += file + ": " + view.dump() + "\n";
  }
  ASSERT_GE(files, 18);
  EXPECT_GE(right, 0.9 * files) << wrong;
  RecordProperty("right", std::to_string(right) + " of " + std::to_string(files));
}

}  // namespace
}  // namespace surfel::test
