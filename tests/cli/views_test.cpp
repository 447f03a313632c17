#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/process.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/framing.h>

#include "support/measured_run.h"
#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

RunResult render(const TemporaryFolder& folder, const Words& words) {
  Words command{tool("surfel-render"), folder / "ball.ply"};
  command.insert(command.end(), words.begin(), words.end());
  return run(command);
}

void make_ball(const TemporaryFolder& folder) {
  const RunResult made = run({tool("surfel-generate"), "sphere", "--count", "2000", "--texture",
                              "checker", "-o", folder / "ball.ply"});
  ASSERT_EQ(made.exit_code, 0) << made.errors;
}

CameraOptions known_options() {
  CameraOptions options;
  options.eye = Vec3d(1.2, 0.9, 2.1);
  options.target = Vec3d(0.1, 0.2, -0.3);
  options.up = Vec3d(0, 1, 0);
  options.fov = 35;
  options.width = 96;
  options.height = 64;
  return options;
}

constexpr const char* kToml =
    "[[camera]]\nname = \"set/one.jpg\"\neye = [1.2, 0.9, 2.1]\ntarget = [0.1, 0.2, -0.3]\n"
    "up = [0, 1, 0]\nfov = 35\nsize = [96, 64]\n";

/// The known view in COLMAP's text, `count` times.
void write_colmap(const TemporaryFolder& folder, int count) {
  const Camera camera = make_camera(known_options(), {});
  const Eigen::Quaterniond q(camera.camera_from_world);
  const Vec3d t = -(camera.camera_from_world * camera.eye);
  std::filesystem::create_directory(folder / "colmap");
  write_text(folder / "colmap/cameras.txt",
             fmt::format("1 SIMPLE_PINHOLE 96 64 {} 48 32\n", camera.focal_x));
  std::string images;
  for (int i = 0; i < count; ++i) {
    images += fmt::format("{} {} {} {} {} {} {} {} 1 set/{}.jpg\n\n", i + 1, q.w(), q.x(), q.y(),
                          q.z(), t.x(), t.y(), t.z(), i);
  }
  write_text(folder / "colmap/images.txt", images);
}

void write_transforms(const TemporaryFolder& folder) {
  const Camera camera = make_camera(known_options(), {});
  std::string rows;
  for (int row = 0; row < 3; ++row) {
    const Vec3d axes = camera.camera_from_world.col(row);
    rows += fmt::format("[{}, {}, {}, {}], ", axes.x(), -axes.y(), -axes.z(), camera.eye[row]);
  }
  write_text(folder / "transforms.json",
             fmt::format(R"({{"w": 96, "h": 64, "fl_x": {}, "frames": [{{"file_path": "one.jpg",
                             "transform_matrix": [{}[0, 0, 0, 1]]}}]}})",
                         camera.focal_x, rows));
}

TEST(Views, AKnownViewGivesTheSamePictureInEachConvention) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_text(folder / "views.toml", kToml);
  write_colmap(folder, 1);
  write_transforms(folder);
  std::vector<Image> pictures;
  for (const char* views : {"views.toml", "colmap", "transforms.json"}) {
    const RunResult result =
        render(folder, {"--views", folder / views, "--up", "y", "-o", folder / "out.exr"});
    ASSERT_EQ(result.exit_code, 0) << views << result.errors;
    pictures.push_back(read_image(folder / "out.exr", true));
  }
  for (std::size_t k = 1; k < pictures.size(); ++k) {
    ASSERT_EQ(pictures[k].data.size(), pictures[0].data.size());
    double difference = 0;
    for (std::size_t i = 0; i < pictures[0].data.size(); ++i) {
      const double a = pictures[0].data[i];
      const double b = pictures[k].data[i];
      if (a != b) difference = std::max(difference, std::abs(a - b));
    }
    EXPECT_LT(difference, 1e-4) << k;  // Of codes that are 4e-3 apart.
  }
}

TEST(Views, PicturesAreNamedSelectedAndSkipped) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_colmap(folder, 4);
  std::filesystem::create_directory(folder / "out");
  const auto make = [&](const Words& words) {
    Words all{"--views", folder / "colmap", "-o", folder / "out/{name}.png"};
    all.insert(all.end(), words.begin(), words.end());
    return render(folder, all);
  };
  RunResult result = make({"--frames", "1-2"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(entries(folder / "out"), (Words{"1.png", "2.png"}));
  const auto time = std::filesystem::last_write_time(folder / "out/1.png");
  result = make({"--skip-existing"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "2 of 4 pictures are there already")) << result.errors;
  EXPECT_EQ(entries(folder / "out").size(), 4U);
  EXPECT_EQ(std::filesystem::last_write_time(folder / "out/1.png"), time);
  result = make({"--skip-existing"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "4 of 4 pictures are there already")) << result.errors;

  result = make({"--frames", "2-7"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_TRUE(contains(result.errors, "the last picture is 3")) << result.errors;
  EXPECT_EQ(make({"--frames", "2-1"}).exit_code, 2);
  result = make({"--fov", "30"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_TRUE(contains(result.errors, "--fov has no effect")) << result.errors;
  EXPECT_EQ(make({"--up", "auto"}).exit_code, 2);
  EXPECT_EQ(make({"--original-world"}).exit_code, 1);
}

/// Has surfel-render make `file` with --skip-existing.
RunResult skip_existing(const TemporaryFolder& folder, const std::string& file,
                        const Words& more = {}) {
  Words words{"--size", "32", "--skip-existing", "-o", folder / file};
  words.insert(words.end(), more.begin(), more.end());
  return render(folder, words);
}

/// The picture of other content, or of other options, is refused, stays, and is told from the one
/// asked for by `parts` of the message.
void expect_refused(const RunResult& result, const Words& parts) {
  EXPECT_EQ(result.exit_code, 1) << result.errors;
  for (const std::string& part : parts) {
    EXPECT_TRUE(contains(result.errors, part)) << part << ": " << result.errors;
  }
}

TEST(Views, PicturesOfAnotherContentAreNotSkipped) {
  const TemporaryFolder folder;
  make_ball(folder);
  const Words turn{"--turntable", "3"};
  ASSERT_EQ(render(folder, {"--size", "32", "--turntable", "3", "-o", folder / "%d.png"}).exit_code,
            0);
  EXPECT_EQ(skip_existing(folder, "%d.png", turn).exit_code, 0);
  // Threads make no difference, other options do.
  EXPECT_EQ(
      skip_existing(folder, "%d.png", {"--turntable", "3", "--threads", "1", "--frames", "1-2"})
          .exit_code,
      0);
  expect_refused(skip_existing(folder, "%d.png", {"--turntable", "3", "--cutoff", "2"}),
                 {"0.png: was made by \"surfel-render ", "--turntable 3 [ball.ply: ",
                  "not by \"surfel-render ", "--turntable 3 --cutoff 2 [ball.ply: ", "move it"});
  // A picture under the name of another.
  std::filesystem::rename(folder / "2.png", folder / "1.png");
  expect_refused(skip_existing(folder, "%d.png", turn), {"1.png", "[picture 2]", "[picture 1]"});
  EXPECT_FALSE(std::filesystem::exists(folder / "2.png"));
  // Other content under the same name.
  const std::string before = read_text(folder / "0.png");
  ASSERT_EQ(run({tool("surfel-generate"), "sphere", "--count", "2001", "-o", folder / "ball.ply"})
                .exit_code,
            0);
  expect_refused(skip_existing(folder, "%d.png", turn), {"0.png: was made by ", "[ball.ply: "});
  EXPECT_TRUE(read_text(folder / "0.png") == before);
  // Files of other programs, and what has no content that stays.
  write_text(folder / "0.png", "anything");
  expect_refused(skip_existing(folder, "%d.png", turn), {"0.png: does not say what made it"});
  EXPECT_EQ(run({tool("surfel-render"), "-", "--skip-existing", "-o", folder / "a.png"},
                {.input = folder / "ball.ply"})
                .exit_code,
            2);
}

TEST(Views, SinglePicturesAndFilmsAreSkippedWhereTheirFormatCanSayWhatTheyAre) {
  const TemporaryFolder folder;
  make_ball(folder);
  const std::string second = folder / "it's <a> & b.ply";
  std::filesystem::copy_file(folder / "ball.ply", second);
  Words names{"a.png", "a.exr", "a.tif", "a.jpg"};
  if (!find_program("ffmpeg").empty()) names.insert(names.end(), {"a.mp4", "a.gif"});
  for (const std::string& name : names) {
    const bool film = contains(name, ".mp4") || contains(name, ".gif");
    const Words words = film ? Words{second, "--turntable", "2"} : Words{second};
    EXPECT_EQ(skip_existing(folder, name, words).exit_code, 0) << name;
    const RunResult again = skip_existing(folder, name, words);
    if (name == "a.gif") {
      expect_refused(again, {name + ": does not say what made it"});
      continue;
    }
    EXPECT_EQ(again.exit_code, 0) << again.errors;
    EXPECT_TRUE(contains(again.errors, "already")) << again.errors;
    if (name != "a.png" && name != "a.mp4") continue;
    Words other = words;
    other.insert(other.end(), {"--cutoff", "2"});
    expect_refused(skip_existing(folder, name, other), {name + ": was made by", "--cutoff 2"});
  }
  // Any other single picture has the bytes of whatever makes it.
  ASSERT_EQ(render(folder, {"--size", "32", "-o", folder / "b.png"}).exit_code, 0);
  EXPECT_FALSE(contains(read_text(folder / "b.png"), "ball.ply"));
}

/// Comparing each with all others takes minutes.
TEST(Views, NamesOfThousandsOfPicturesTakeNoTime) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_text(folder / "turn_0.png", "there");
  const MeasuredRun made =
      measured_run({tool("surfel-render"), folder / "ball.ply", "-o", folder / "turn_%d.png",
                    "--turntable", "100000", "--no-clobber", "--quiet"},
                   folder / "");
  EXPECT_EQ(made.exit_code, 1);
  EXPECT_TRUE(contains(made.message, "turn_0.png")) << made.message;
  EXPECT_LT(made.seconds, 5);
}

TEST(Views, SizeScalesKnownViews) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_colmap(folder, 1);
  const RunResult half =
      render(folder, {"--views", folder / "colmap", "--size", "48x32", "-o", folder / "half.png"});
  ASSERT_EQ(half.exit_code, 0) << half.errors;
  const Image image = read_image(folder / "half.png");
  EXPECT_EQ(image.width, 48);
  const RunResult wrong =
      render(folder, {"--views", folder / "colmap", "--size", "48", "-o", folder / "wrong.png"});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_TRUE(contains(wrong.errors, "such as 48x32")) << wrong.errors;
}

TEST(Views, LensesBendTheSameScene) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_colmap(folder, 1);
  ASSERT_EQ(
      render(folder, {"--views", folder / "colmap", "--cutoff", "4", "-o", folder / "plain.exr"})
          .exit_code,
      0);
  const Camera camera = make_camera(known_options(), {});
  // Next to no distortion: what the resampling alone changes.
  write_text(folder / "colmap/cameras.txt",
             fmt::format("1 SIMPLE_RADIAL 96 64 {} 48 32 1e-12\n", camera.focal_x));
  RunResult result =
      render(folder, {"--views", folder / "colmap", "--cutoff", "4", "-o", folder / "lens.exr"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const Image plain = read_premultiplied_image(folder / "plain.exr");
  const Image lens = read_premultiplied_image(folder / "lens.exr");
  double sum = 0;
  for (std::size_t i = 0; i < plain.data.size(); ++i) {
    const double difference = plain.data[i] - lens.data[i];
    sum += difference * difference;
  }
  const double psnr = -10 * std::log10(sum / static_cast<double>(plain.data.size()));
  EXPECT_GT(psnr, 42);
  write_text(folder / "colmap/cameras.txt", "1 FOV 96 64 90 90 48 32 0.5\n");
  result = render(folder, {"--views", folder / "colmap", "-o", folder / "lens.exr"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "colmap image_undistorter")) << result.errors;
}

TEST(Views, PanoramasShowTheInsideOfABallAllAround) {
  const TemporaryFolder folder;
  make_ball(folder);
  const RunResult result =
      render(folder, {"--projection", "equirectangular", "--eye", "0.1,0,0", "--size", "128x64",
                      "--shading", "none", "-o", folder / "around.exr"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const Image image = read_image(folder / "around.exr", true);
  ASSERT_EQ(image.channels[4], "Z");
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      EXPECT_NEAR(image.pixel(x, y)[3], 1, 1e-3) << x << " " << y;
    }
  }
  // Without a target the middle looks along -z, and the right quarter along x.
  EXPECT_NEAR(image.pixel(64, 32)[4], std::sqrt(1 - 0.01), 0.02);
  EXPECT_NEAR(image.pixel(96, 32)[4], 0.9, 0.02);
  EXPECT_NEAR(image.pixel(32, 32)[4], 1.1, 0.02);
  const auto refused = [&](const Words& words) {
    Words all{"--projection", "equirectangular", "-o", folder / "wrong.png"};
    all.insert(all.end(), words.begin(), words.end());
    return render(folder, all).exit_code;
  };
  EXPECT_EQ(refused({}), 2);
  EXPECT_EQ(refused({"--eye", "0,0,0", "--size", "64x64"}), 2);
  EXPECT_EQ(refused({"--eye", "0,0,0", "--fov", "30"}), 2);
}

TEST(Views, ContactSheetsHaveSixPanels) {
  const TemporaryFolder folder;
  make_ball(folder);
  const auto sheet = [&](const Words& words) {
    Words all{"--contact-sheet", "--size", "64x48", "--from", "0,0,1", "-o", folder / "sheet.png"};
    all.insert(all.end(), words.begin(), words.end());
    return render(folder, all).exit_code;
  };
  ASSERT_EQ(sheet({}), 0);
  const Image image = read_image(folder / "sheet.png");
  EXPECT_EQ(image.width, 3 * 64);
  EXPECT_EQ(image.height, 2 * 48);
  EXPECT_EQ(image.pixel(2, 46)[2], 1);               // White where nothing is,
  EXPECT_GT(image.pixel(64 + 32, 24)[2], 0.95F);     // and the normal towards the eye, z.
  EXPECT_EQ(sheet({"--method", "transparent"}), 2);  // It knows no depths.
  EXPECT_EQ(sheet({"--reference"}), 2);
  EXPECT_EQ(sheet({"--legend", "on"}), 2);
}

TEST(Views, MapsSayWhereTheyLie) {
  const TemporaryFolder folder;
  make_ball(folder);
  RunResult result = render(folder, {"--map", "0.125", "-o", folder / "map.tif"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const Image image = read_image(folder / "map.tif");
  const std::string world = read_text(folder / "map.tfw");
  EXPECT_TRUE(world.starts_with("0.125\n0\n0\n-0.125\n")) << world;
  // The ball and the discs around it reach a little beyond 1.
  EXPECT_EQ(image.width % 2, 0);
  EXPECT_NEAR(image.width, 18, 2);
  const std::string left = fmt::format("\n{}\n", -image.width / 2 * 0.125 + 0.0625);
  EXPECT_TRUE(contains(world, left)) << world;
  const std::string bytes = read_text(folder / "map.tif");
  const double scale[] = {0.125, 0.125, 0};
  EXPECT_TRUE(contains(bytes, std::string(reinterpret_cast<const char*>(scale), sizeof(scale))));
  // A key says that pixels are areas, and no key names a coordinate system.
  const auto keys = [](std::vector<std::uint16_t> numbers) {
    return std::string(reinterpret_cast<const char*>(numbers.data()), 2 * numbers.size());
  };
  EXPECT_TRUE(contains(bytes, keys({1, 1, 1, 1, 1025, 0, 1, 1})));
  ASSERT_EQ(
      render(folder, {"--map", "0.125", "--epsg", "25832", "-o", folder / "utm.tif"}).exit_code, 0);
  EXPECT_TRUE(contains(read_text(folder / "utm.tif"),
                       keys({1, 1, 1, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25832})));
  EXPECT_EQ(render(folder, {"--epsg", "25832", "-o", folder / "no.png"}).exit_code, 2);
  EXPECT_EQ(render(folder, {"--map", "1", "--epsg", "7", "-o", folder / "no.png"}).exit_code, 2);
  result = render(folder, {"--map", "0.125", "-o", folder / "map.png"});
  EXPECT_EQ(read_text(folder / "map.pgw"), world);
  EXPECT_EQ(render(folder, {"--map", "0", "-o", folder / "no.png"}).exit_code, 2);
  EXPECT_EQ(render(folder, {"--map", "1e-9", "-o", folder / "no.png"}).exit_code, 2);
  EXPECT_EQ(render(folder, {"--map", "1", "--fov", "3", "-o", folder / "no.png"}).exit_code, 2);
}

TEST(Views, PathsGoThroughTheirViews) {
  const TemporaryFolder folder;
  make_ball(folder);
  write_text(folder / "path.toml",
             "[[camera]]\ntime = 0\neye = [0, 0, 3]\ntarget = [0, 0, 0]\n"
             "[[camera]]\ntime = 1\neye = [2, 1, 2]\ntarget = [0, 0, 0]\n"
             "[[camera]]\ntime = 1.5\neye = [3, 0, 0]\ntarget = [0, 0, 0]\n");
  const auto fly = [&](const Words& words) {
    Words all{"--path", folder / "path.toml", "--size", "32", "-o", folder / "fly_%02d.png"};
    all.insert(all.end(), words.begin(), words.end());
    return render(folder, all);
  };
  RunResult result = fly({"--fps", "2"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(std::filesystem::exists(folder / "fly_03.png"));
  EXPECT_FALSE(std::filesystem::exists(folder / "fly_04.png"));
  ASSERT_EQ(render(folder, {"--eye", "2,1,2", "--target", "0,0,0", "--size", "32", "-o",
                            folder / "key.png"})
                .exit_code,
            0);
  const Image key = read_image(folder / "key.png");
  const Image there = read_image(folder / "fly_02.png");
  ASSERT_EQ(key.data.size(), there.data.size());
  for (std::size_t i = 0; i < key.data.size(); ++i) {
    ASSERT_NEAR(key.data[i], there.data[i], 0.02) << i;
  }
  EXPECT_EQ(fly({"--path-pictures", "1"}).exit_code, 2);
  EXPECT_EQ(fly({"--turntable", "3"}).exit_code, 2);
  EXPECT_EQ(fly({"--views", folder / "path.toml"}).exit_code, 2);
  write_text(folder / "path.toml", "[[camera]]\neye = [0, 0, 3]\ntarget = [0, 0, 0]\n");
  result = fly({"--path-pictures", "5"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "two key frames")) << result.errors;
}

TEST(Views, WithoutFfmpegThePicturesStayAndTheCommandIsSaid) {
  const TemporaryFolder folder;
  make_ball(folder);
  const RunResult result =
      run({"/usr/bin/env", "PATH=" + folder / "", tool("surfel-render"), folder / "ball.ply",
           "--turntable", "3", "--size", "32", "-o", folder / "turn.mp4"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(contains(result.errors, "ffmpeg -y")) << result.errors;
  EXPECT_TRUE(contains(result.errors, "turn_frames")) << result.errors;
  EXPECT_EQ(entries(folder / "turn_frames"), (Words{"000000.png", "000001.png", "000002.png"}));
  EXPECT_FALSE(std::filesystem::exists(folder / "turn.mp4"));
}

TEST(Views, FilmsAreMadeWholeOrNotAtAll) {
  SURFEL_REQUIRE_PROGRAM("ffmpeg");
  const TemporaryFolder folder;
  make_ball(folder);
  const auto film = [&](const std::string& name, const Words& words) {
    Words all{"--turntable", "4", "--size", "33x32", "-o", folder / name};
    all.insert(all.end(), words.begin(), words.end());
    return render(folder, all);
  };
  for (const char* name : {"a.mp4", "a.webm", "a.gif", "a.webp"}) {
    const RunResult result = film(name, {});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_GT(std::filesystem::file_size(folder / name), 500U) << name;
  }
  const std::string before = read_text(folder / "a.mp4");
  ASSERT_EQ(film("a.mp4", {"--threads", "1"}).exit_code, 0);
  EXPECT_EQ(read_text(folder / "a.mp4"), before);
  EXPECT_EQ(entries(folder / ""), (Words{"a.gif", "a.mp4", "a.webm", "a.webp", "ball.ply"}));
  EXPECT_EQ(film("a.mp4", {"--no-clobber"}).exit_code, 1);
  EXPECT_EQ(film("a_%d.mp4", {}).exit_code, 2);
  EXPECT_EQ(film("none/a.mp4", {}).exit_code, 1);
  // An ffmpeg that fails leaves no film and no pictures.
  std::filesystem::create_directory(folder / "bin");
  write_text(folder / "bin/ffmpeg", "#!/bin/sh\necho no such codec >&2\nexit 1\n");
  std::filesystem::permissions(folder / "bin/ffmpeg", std::filesystem::perms::owner_all);
  const RunResult failed =
      run({"/usr/bin/env", "PATH=" + folder / "bin", tool("surfel-render"), folder / "ball.ply",
           "--turntable", "2", "--size", "32", "-o", folder / "b.mp4"});
  EXPECT_EQ(failed.exit_code, 1);
  EXPECT_TRUE(contains(failed.errors, "no such codec")) << failed.errors;
  EXPECT_EQ(entries(folder / "").size(), 6U);
  // What a film leaves that is killed, as by a second Ctrl+C, the next one removes.
  const auto pictures_lie_there = [&] {
    const Words names = entries(folder / "");
    return std::any_of(names.begin(), names.end(),
                       [](const std::string& name) { return contains(name, ".c.mp4.frames-"); });
  };
  const RunResult killed = run({tool("surfel-render"), folder / "ball.ply", "--turntable", "9999",
                                "--size", "99", "-o", folder / "c.mp4"},
                               {.meanwhile = [&](pid_t process) {
                                 wait_until(pictures_lie_there);
                                 kill(process, SIGKILL);
                               }});
  EXPECT_EQ(killed.signal, SIGKILL);
  EXPECT_TRUE(pictures_lie_there());
  EXPECT_EQ(film("a.gif", {}).exit_code, 0);
  EXPECT_EQ(entries(folder / "").size(), 6U);
}

}  // namespace
}  // namespace surfel::test
