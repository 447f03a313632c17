#include <filesystem>
#include <string>

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/process.h>
#include <sys/file.h>
#include <unistd.h>

#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

/// A ball, whole and in parts.
class Join : public testing::Test {
 protected:
  static constexpr int kParts = 3;

  void SetUp() override {
    const RunResult made = run({tool("surfel-generate"), "sphere", "--count", "2000", "--texture",
                                "checker", "-o", folder_ / "ball.ply"});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  }
  RunResult render(const Words& words) const {
    Words command{tool("surfel-render"), folder_ / "ball.ply", "--size", "80x90"};
    command.insert(command.end(), words.begin(), words.end());
    return run(command);
  }
  std::string part(int number) const { return folder_ / fmt::format("part_{}.exr", number); }
  void make_part(int number) const {
    const RunResult made =
        render({"-o", part(number), "--tiles", fmt::format("{}/{}", number, kParts)});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  }
  RunResult join(const Words& words) const {
    Words command{tool("surfel-join")};
    for (int number = 1; number <= kParts; ++number) {
      if (fs::exists(part(number))) command.push_back(part(number));
    }
    command.insert(command.end(), words.begin(), words.end());
    return run(command);
  }

  TemporaryFolder folder_;
};

TEST_F(Join, ThePictureHasTheSameBytes) {
  for (int number = 1; number <= kParts; ++number) make_part(number);
  for (const char* name : {"exr", "png", "tif"}) {
    const std::string whole = folder_ / ("whole." + std::string(name));
    const std::string joined = folder_ / ("joined." + std::string(name));
    ASSERT_EQ(render({"-o", whole}).exit_code, 0);
    const RunResult result = join({"-o", joined});
    ASSERT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(read_text(whole) == read_text(joined)) << name;
  }
  // Without alpha the background is white.
  EXPECT_EQ(join({"-o", folder_ / "joined.jpg"}).exit_code, 0);
  EXPECT_EQ(render({"-o", folder_ / "whole.jpg"}).exit_code, 0);
  const RunResult same = run(
      {tool("surfel-compare"), folder_ / "joined.jpg", folder_ / "whole.jpg", "--min-psnr", "50"});
  EXPECT_EQ(same.exit_code, 0) << same.output;
}

TEST_F(Join, FailedPartsAreNamed) {
  make_part(1);
  make_part(2);
  fs::resize_file(part(2), fs::file_size(part(2)) / 2);
  const RunResult result = join({"-o", folder_ / "joined.png"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_FALSE(fs::exists(folder_ / "joined.png"));
  for (const char* said : {"part_2.exr", "there is no part 3 of 3 (rows 64 to 89)",
                           "there is no part 2 of 3 (rows 32 to 63)", "--size 80x90", "--tiles"}) {
    EXPECT_NE(result.errors.find(said), std::string::npos) << said << ": " << result.errors;
  }
  const RunResult missing = join({"--missing"});
  EXPECT_EQ(missing.exit_code, 0) << missing.errors;
  EXPECT_EQ(missing.output, "2,3\n");
  // What is there is left alone, what is not is made.
  const std::string before = read_text(part(1));
  fs::remove(part(2));
  for (int number = 1; number <= kParts; ++number) {
    const auto time =
        fs::exists(part(number)) ? fs::last_write_time(part(number)) : fs::file_time_type::min();
    ASSERT_EQ(render({"-o", part(number), "--tiles", fmt::format("{}/{}", number, kParts),
                      "--skip-existing"})
                  .exit_code,
              0);
    if (number == 1) {
      EXPECT_EQ(fs::last_write_time(part(1)), time);
    }
  }
  EXPECT_EQ(read_text(part(1)), before);
  EXPECT_EQ(join({"--missing"}).output, "");
  EXPECT_EQ(join({"-o", folder_ / "joined.png"}).exit_code, 0);
}

TEST_F(Join, PartsThatAreThereAreMadeAgainWhereTheyAreNotTheSame) {
  const auto again = [&](const Words& more) {
    Words words{"-o", part(1), "--tiles", "1/3", "--skip-existing"};
    words.insert(words.end(), more.begin(), more.end());
    const RunResult made = render(words);
    EXPECT_EQ(made.exit_code, 0) << made.errors;
    return read_text(part(1));
  };
  const std::string first = again({});
  EXPECT_FALSE(again({"--zoom", "2"}) == first);
  EXPECT_TRUE(again({}) == first);
  fs::resize_file(part(1), fs::file_size(part(1)) / 2);
  EXPECT_TRUE(again({}) == first);
}

TEST_F(Join, PartsOfOtherPicturesAreRefused) {
  make_part(1);
  make_part(2);
  ASSERT_EQ(render({"-o", part(3), "--tiles", "3/3", "--zoom", "1.1"}).exit_code, 0);
  const RunResult result = join({"-o", folder_ / "joined.png"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.errors.find("--zoom 1.1 [ball.ply: "), std::string::npos) << result.errors;
  ASSERT_EQ(render({"-o", part(3), "--tiles", "3/3", "--cutoff", "2"}).exit_code, 0);
  const RunResult other = join({"-o", folder_ / "joined.png"});
  EXPECT_EQ(other.exit_code, 1);
  EXPECT_NE(other.errors.find("--cutoff 2"), std::string::npos) << other.errors;
}

TEST_F(Join, PartsOfOtherContentOfTheSameNameAreRefused) {
  make_part(1);
  make_part(2);
  const std::string before = read_text(part(2));
  ASSERT_EQ(run({tool("surfel-generate"), "sphere", "--count", "2001", "--texture", "checker", "-o",
                 folder_ / "ball.ply"})
                .exit_code,
            0);
  make_part(3);
  const RunResult result = join({"-o", folder_ / "joined.png"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_FALSE(fs::exists(folder_ / "joined.png"));
  for (const char* said : {"part_3.exr: was made by", "[ball.ply: ", "unlike ", "part_1.exr"}) {
    EXPECT_NE(result.errors.find(said), std::string::npos) << said << ": " << result.errors;
  }
  // A part of other content is not taken for one that is there.
  ASSERT_EQ(render({"-o", part(2), "--tiles", "2/3", "--skip-existing"}).exit_code, 0);
  EXPECT_FALSE(read_text(part(2)) == before);
}

TEST_F(Join, WrongUsageIsRefused) {
  EXPECT_EQ(render({"-o", folder_ / "a.png", "--tiles", "1/2"}).exit_code, 2);
  EXPECT_EQ(render({"-o", folder_ / "a.exr", "--tiles", "3/2"}).exit_code, 2);
  EXPECT_EQ(render({"-o", folder_ / "a.exr", "--tiles", "1/7"}).exit_code, 2);
  EXPECT_EQ(render({"-o", folder_ / "a.exr", "--tiles", "1/2", "--contact-sheet"}).exit_code, 2);
  make_part(1);
  EXPECT_EQ(join({}).exit_code, 2);
  EXPECT_EQ(join({"--missing", "-o", folder_ / "a.png"}).exit_code, 2);
  EXPECT_EQ(join({"-o", folder_ / "a.png", "--fps", "20"}).exit_code, 2);
  EXPECT_EQ(join({"-o", part(1)}).exit_code, 2);
}

TEST_F(Join, PicturesBecomeAFilm) {
  if (find_program("ffmpeg").empty()) GTEST_SKIP() << "ffmpeg is not installed";
  Words words{tool("surfel-join")};
  for (const char* frames : {"0-1", "2-3"}) {
    const RunResult made = render({"-o", folder_ / "frame_%d.png", "--turntable", "4", "--frames",
                                   frames, "--background", "white"});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  }
  for (int i = 0; i < 4; ++i) words.push_back(folder_ / fmt::format("frame_{}.png", i));
  words.insert(words.end(), {"-o", folder_ / "turn.mp4", "--fps", "25"});
  const RunResult joined = run(words);
  ASSERT_EQ(joined.exit_code, 0) << joined.errors;
  const RunResult whole = render(
      {"-o", folder_ / "whole.mp4", "--turntable", "4", "--fps", "25", "--background", "white"});
  ASSERT_EQ(whole.exit_code, 0) << whole.errors;
  EXPECT_TRUE(read_text(folder_ / "turn.mp4") == read_text(folder_ / "whole.mp4"));

  // Pictures that a killed process left are removed; pictures of a film in the making stay.
  for (const char* name : {".killed.mp4.frames-abcdef", ".made.mp4.frames-abcdef"}) {
    fs::create_directory(folder_ / name);
    write_text(folder_ / (name + std::string("/000000.png")), "a picture");
  }
  const int made = open((folder_ / ".made.mp4.frames-abcdef").c_str(), O_RDONLY | O_DIRECTORY);
  ASSERT_EQ(flock(made, LOCK_EX | LOCK_NB), 0);
  EXPECT_EQ(run(words).exit_code, 0);
  close(made);
  EXPECT_FALSE(fs::exists(folder_ / ".killed.mp4.frames-abcdef"));
  EXPECT_TRUE(fs::exists(folder_ / ".made.mp4.frames-abcdef/000000.png"));
  fs::remove_all(folder_ / ".made.mp4.frames-abcdef");
  for (const std::string& name : entries(folder_ / "")) {
    EXPECT_FALSE(contains(name, ".frames-")) << name;
  }

  fs::remove(folder_ / "turn.mp4");
  ASSERT_EQ(run({tool("surfel-render"), folder_ / "ball.ply", "--size", "40", "-o",
                 folder_ / "frame_3.png"})
                .exit_code,
            0);
  const RunResult mixed = run(words);
  EXPECT_EQ(mixed.exit_code, 1);
  EXPECT_NE(mixed.errors.find("frame_3.png: is a picture of 40x40 pixels"), std::string::npos)
      << mixed.errors;
  write_text(folder_ / "frame_3.png", "");
  const RunResult empty = run(words);
  EXPECT_EQ(empty.exit_code, 1);
  EXPECT_NE(empty.errors.find("frame_3.png"), std::string::npos) << empty.errors;
  EXPECT_FALSE(fs::exists(folder_ / "turn.mp4"));
}

}  // namespace
}  // namespace surfel::test
