// surfel-render: the renderers that it chooses from, and options that would have no effect.

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>
#include <surfel/truth/image_error.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A textured square as mesh, and its surfels.
struct Square {
  TemporaryFolder folder;
  std::string mesh = folder / "square.obj";
  std::string surfels = folder / "square.ply";

  Square() {
    write_text(mesh,
               "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
               "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n");
    const std::string plain = folder / "plain.ply";
    run({tool("surfel-from-mesh"), mesh, "--spacing", "0.02", "--variance-scale", "1", "-o", plain,
         "--quiet"});
    run({tool("surfel-texture"), plain, "--image", "checker:2", "-o", surfels, "--quiet"});
  }
  static const Square& get() {
    static const Square square;
    return square;
  }

  Image picture(const Words& options) const {
    const std::string file = folder / "picture.exr";
    Words command{
        tool("surfel-render"), "-o",   file,     "--eye", "0.3,-0.6,3", "--target", "0,0,0",
        "--shading",           "none", "--size", "64x64"};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_image(file, true);
  }
};

TEST(Render, EveryRendererSeesTheSamePicture) {
  const Square& s = Square::get();
  const Image fast = s.picture({s.surfels, "--cutoff", "2"});
  const auto inside = [&](const Image& image) {
    return image_error(fast, image, {.inside_only = true}).psnr;
  };
  EXPECT_GT(inside(s.picture({s.surfels, "--cutoff", "2", "--kernel", "perspective"})), 45);
  EXPECT_GT(inside(s.picture({s.surfels, "--cutoff", "2", "--filter", "ewa-source"})), 45);
  EXPECT_GT(inside(s.picture({s.surfels, "--cutoff", "2", "--reference", "--samples", "8"})), 30);
  EXPECT_GT(inside(s.picture({"--mesh", s.mesh, "--image", "checker:2", "--samples", "8"})), 18);
  EXPECT_LT(inside(s.picture({"--mesh", s.mesh, "--image", "checker:3", "--samples", "8"})), 15);
}

TEST(Render, MessagesNameOptionsInTheOrderOfTheUser) {
  const auto told = [](const Words& options, const std::string& message) {
    Words command{tool("surfel-render"), "-o", "refused.png"};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_TRUE(contains(result.errors, message)) << result.errors;
  };
  told({"--mesh", "a.obj", "--reference"}, "--mesh and --reference do not go together");
  told({"--reference", "--mesh", "a.obj"}, "--reference and --mesh do not go together");
  told({"a.ply", "--peel", "2", "--voronoi", "off"},
       "--peel has no effect with --method abuffer; "
       "leave it out; --voronoi has no effect");
  told({"a.ply", "--voronoi", "off", "--peel", "2"},
       "--voronoi has no effect with --method "
       "abuffer; leave it out; --peel has no effect");
}

TEST(Render, BackgroundIsWhiteWhereThePictureHasNoAlpha) {
  const Square& s = Square::get();
  const TemporaryFolder folder;
  // The upper left corner, far from the square: R G B A.
  const auto corner = [&](const std::string& name, const Words& options) {
    Words command{
        tool("surfel-render"), s.surfels, "-o", folder / name, "--size", "32", "--zoom", "0.3"};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    const Image image = read_image(folder / name);
    EXPECT_EQ(image.width, 32);
    EXPECT_EQ(image.height, 32);
    return std::vector<float>(image.data.begin(), image.data.begin() + 4);
  };
  using Pixel = std::vector<float>;
  EXPECT_EQ(corner("a.png", {}), (Pixel{0, 0, 0, 0}));
  EXPECT_EQ(corner("a.exr", {}), (Pixel{0, 0, 0, 0}));
  EXPECT_EQ(corner("a.jpg", {}), (Pixel{1, 1, 1, 1}));
  EXPECT_EQ(corner("a.hdr", {}), (Pixel{1, 1, 1, 1}));
  EXPECT_EQ(corner("a.jpg", {"--background", "black"}), (Pixel{0, 0, 0, 1}));
  EXPECT_EQ(corner("b.png", {"--background", "1,1,1"}), (Pixel{1, 1, 1, 1}));
  EXPECT_EQ(corner("c.png", {"--background=#ff0000"}), (Pixel{1, 0, 0, 1}));
  write_text(folder / "config.toml", "background = \"lime\"\n");
  EXPECT_EQ(corner("d.png", {"--config", folder / "config.toml"}), (Pixel{0, 1, 0, 1}));
  write_text(folder / "config.toml", "background = [0, 0, 1]\n");
  EXPECT_EQ(corner("e.png", {"--config", folder / "config.toml"}), (Pixel{0, 0, 1, 1}));
}

TEST(Render, OptionsWithoutEffectAreRefused) {
  const Square& s = Square::get();
  const std::string glass = std::string(SURFEL_SOURCE_DIR) + "/configs/scene-glass.toml";
  for (const Words& options :
       {Words{s.surfels, "--reference", "--layers", "2"},
        Words{s.surfels, "--reference", "--kernel", "affine"},
        Words{s.surfels, "--filter", "ewa-source", "--kernel", "auto"},
        Words{s.surfels, "--filter", "circular", "--kernel", "perspective"},
        Words{s.surfels, "--reference", "--method", "abuffer"},
        Words{s.surfels, "--peel", "4"},
        Words{s.surfels, "--voronoi", "off"},
        Words{s.surfels, "--method", "depth-peel", "--voronoi", "off"},
        Words{s.surfels, "--method", "depth-peel", "--layers", "2"},
        Words{s.surfels, "--method", "deferred", "--peel", "2"},
        Words{s.surfels, "--method", "two-pass", "--peel", "2"},
        Words{s.surfels, "--method", "two-pass", "--voronoi", "off"},
        Words{s.surfels, "--method", "two-pass", "--scene", glass},
        Words{s.surfels, "--method", "transparent", "--layers-by", "group", "--lowpass", "2"},
        Words{s.surfels, "--method", "transparent", "--voronoi", "off"},
        Words{s.surfels, "--method", "deferred", "--layers-by", "group"},
        Words{s.surfels, "--method", "transparent-high", "--layers", "2"},
        Words{s.surfels, "--filter", "ewa-source", "--method", "deferred"},
        Words{"--mesh", s.mesh, "--method", "depth-peel"},
        Words{s.surfels, "--samples", "4"},
        Words{s.surfels, "--image", "checker"},
        Words{s.surfels, "--mesh", s.mesh, "--reference"},
        Words{s.surfels, "--bump", "noise"},
        Words{"--mesh", s.mesh, "--bump-scale", "2"},
        Words{"--mesh", s.mesh, "--bump", "noise", "--shading", "none"},
        Words{"--mesh", s.mesh, "--cutoff", "2"},
        Words{s.surfels, "--refraction", "single"},
        Words{s.surfels, "--scene", glass, "--bounces", "2"},
        Words{"--mesh", s.mesh, "--bounces", "2"},
        Words{"--mesh", s.mesh, "--scene", glass, "--bounces", "33"},
        Words{"--mesh", s.mesh, "--scene", glass, "--bounces", "2", "--refraction", "single"},
        Words{s.surfels, "--reference", "--explain"},
        Words{"--mesh", s.mesh, "--explain"},
        Words{s.surfels, "--reference", "--explain-pixel", "3,4"},
        Words{s.surfels, "--filter", "ewa-source", "--explain-pixel", "3,4"},
        Words{"--mesh", s.mesh, "--explain-pixel", "3,4"},
        Words{s.surfels, "--contact-sheet", "--explain-pixel", "3,4"},
        Words{s.surfels, "--eye", "0,0,1", "--projection", "equirectangular", "--explain-pixel",
              "3,4"},
        Words{s.surfels, "--explain-pixel", "3"},
        Words{s.surfels, "--explain-pixel", "3,4,5"},
        Words{s.surfels, "--explain-pixel=-1,4"},
        Words{s.surfels, "--size", "64x32", "--explain-pixel", "64,4"},
        Words{s.surfels, "--size", "64x32", "--explain-pixel", "3,4", "--explain-pixel", "3,32"},
        Words{s.surfels, "--scene", glass, "--shading", "none", "--refraction", "single"},
        Words{}}) {
    Words command{tool("surfel-render"), "-o", s.folder / "refused.png"};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 2) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(s.folder / "refused.png"));
  }
}

TEST(Render, ReliefsOfSurfelsAndMeshLookAlike) {
  const Square& s = Square::get();
  // A file, as procedural pictures have 2048 x 2048 texels.
  const std::string noise = s.folder / "noise.exr";
  ASSERT_EQ(run({tool("surfel-generate"), "plane", "--texture", "noise", "--frequency", "3",
                 "--image", noise, "--size", "256", "--quiet"})
                .exit_code,
            0);
  const Words relief{"--bump", noise, "--bump-scale", "1"};
  const std::string bent = s.folder / "bent.ply";
  Words command{tool("surfel-texture"), s.surfels, "-o", bent, "--quiet"};
  command.insert(command.end(), relief.begin(), relief.end());
  ASSERT_EQ(run(command).exit_code, 0);
  const auto picture = [&](const Words& options) {
    const std::string file = s.folder / "lit.exr";
    Words render{tool("surfel-render"),
                 "-o",
                 file,
                 "--eye",
                 "0.3,-0.6,3",
                 "--target",
                 "0,0,0",
                 "--size",
                 "40x40"};
    render.insert(render.end(), options.begin(), options.end());
    const RunResult result = run(render);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_image(file, true);
  };
  Words of_mesh{"--mesh", s.mesh, "--image", "checker:2", "--samples", "6"};
  const Image flat = picture(of_mesh);
  of_mesh.insert(of_mesh.end(), relief.begin(), relief.end());
  const Image truth = picture(of_mesh);
  const auto psnr = [&](const Image& image) {
    return image_error(image, truth, {.inside_only = true}).psnr;
  };
  const double with_relief = psnr(picture({bent, "--cutoff", "2"}));
  EXPECT_GT(with_relief, psnr(picture({s.surfels, "--cutoff", "2"})) + 3);
  EXPECT_LT(psnr(flat), with_relief);
}

TEST(Render, MeshHasTheLightOfItsSurfels) {
  const Square& s = Square::get();
  const std::string mesh = s.folder / "valley.obj";
  write_text(mesh,
             "v -2 -2 2\nv 0 -2 0\nv 0 2 0\nv -2 2 2\nv 2 -2 2\nv 2 2 2\n"
             "f 1 2 3 4\nf 2 5 6 3\n");
  const auto picture = [&](const Words& options) {
    const std::string file = s.folder / "valley.exr";
    Words render{tool("surfel-render"),
                 "-o",
                 file,
                 "--eye",
                 "0.4,0.6,5",
                 "--target",
                 "0,0,0",
                 "--size",
                 "96x96"};
    render.insert(render.end(), options.begin(), options.end());
    const RunResult result = run(render);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_image(file, true);
  };
  const Image drawn = picture({mesh, "--cutoff", "2"});
  const auto psnr = [&](const Words& options) {
    return image_error(drawn, picture(options), {.inside_only = true}).psnr;
  };
  const double beside_mesh = psnr({"--mesh", mesh, "--samples", "4"});
  EXPECT_GT(beside_mesh, 40);
  EXPECT_LT(psnr({"--mesh", mesh, "--samples", "4", "--relief", "none"}), beside_mesh - 3);
}

TEST(Render, ExplainsItsChoicesOnce) {
  const Square& s = Square::get();
  const auto explanation = [&](const Words& options) {
    Words command{
        tool("surfel-render"), s.surfels, "--explain", "--size", "64x64", "--turntable", "2", "-o",
        s.folder / "t%d.png"};
    command.insert(command.end(), options.begin(), options.end());
    return run(command).errors;
  };
  const std::string lit = explanation({"--eye", "0,-0.02,0.01"});
  for (const char* part : {"memory: all surfels are kept", "level of detail: none in the file",
                           "shape: discs", "opacity: no surfel", "normals: kept", "layers: 4"}) {
    const std::size_t first = lit.find(part);
    EXPECT_NE(first, std::string::npos) << part << " in " << lit;
    EXPECT_EQ(lit.find(part, first + 1), std::string::npos) << part;
  }
  // So near to the square that affine kernels are wrong.
  EXPECT_EQ(lit.find("kernel: exact for 0 of"), std::string::npos) << lit;
  EXPECT_NE(explanation({"--shading", "none"}).find("normals: left out"), std::string::npos);
}

TEST(Render, ExplainsPixelsOfEveryPicture) {
  const Square& s = Square::get();
  const TemporaryFolder folder;
  const RunResult result =
      run({tool("surfel-render"), s.surfels, "--size", "64x48", "--turntable", "2", "--shading",
           "none", "--explain-pixel", "32,24", "--explain-pixel", "0,0", "-o", folder / "t%d.exr",
           "--stats", folder / "stats.json"});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  for (const char* part : {"t0.exr, pixel 32,24: ", "t0.exr, pixel 0,0: ", "t1.exr, pixel 32,24: ",
                           "layers, nearest first", "splats, in the order"}) {
    EXPECT_TRUE(contains(result.output, part)) << part << " in " << result.output;
  }
  const auto report = nlohmann::json::parse(read_text(folder / "stats.json"));
  for (int i = 0; i < 2; ++i) {
    const Image image = read_image(folder / ("t" + std::to_string(i) + ".exr"), true);
    const auto& pixels = report["frames"][static_cast<std::size_t>(i)]["pixels"];
    ASSERT_EQ(pixels.size(), 2U);
    for (const auto& pixel : pixels) {
      const float* shown = image.pixel(pixel["x"], pixel["y"]);
      for (std::size_t c = 0; c < 3; ++c) {
        double sum = 0;
        for (const auto& splat : pixel["splats"]) {
          sum += splat["share"].get<double>() * splat["color"][c].get<double>();
        }
        EXPECT_NEAR(sum, shown[c], 1e-5);
        EXPECT_NEAR(pixel["pixel"][c].get<double>(), shown[c], 1e-6);
      }
    }
    EXPECT_GT(pixels[0]["splats"].size(), 1U);
  }
  EXPECT_EQ(run({tool("surfel-render"), s.surfels, "--explain-pixel", "1,1", "-o", "-"}).exit_code,
            2);
}

TEST(Render, ExplainsPixelsOfParts) {
  const Square& s = Square::get();
  const TemporaryFolder folder;
  Words command{tool("surfel-render"), s.surfels,        "--size", "64", "--tiles", "2/4", "-o",
                folder / "part.exr",   "--explain-pixel"};
  command.emplace_back("20,20");
  const RunResult inside = run(command);
  EXPECT_EQ(inside.exit_code, 0) << inside.errors;
  EXPECT_TRUE(contains(inside.output, "part.exr, pixel 20,20: ")) << inside.output;
  command.back() = "20,40";
  const RunResult outside = run(command);
  EXPECT_EQ(outside.exit_code, 2);
  EXPECT_TRUE(contains(outside.errors, "outside of the part")) << outside.errors;
}

TEST(Render, EveryMethodSeesTheSamePicture) {
  const Square& s = Square::get();
  const std::string groups = s.folder / "groups.ply";
  ASSERT_EQ(run({tool("surfel-group"), s.surfels, "-o", groups, "--quiet"}).exit_code, 0);
  const Image expected = s.picture({groups});
  for (const std::string method : {"deferred", "two-pass", "depth-peel"}) {
    // The A-buffer's edges alone are filtered anew (EdgeCoverage).
    EXPECT_GT(image_error(s.picture({groups, "--method", method}), expected).psnr, 27) << method;
  }
  const RunResult result =
      run({tool("surfel-render"), s.surfels, "--method", "deferred", "-o", s.folder / "none.png"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.errors.find("surfel-group"), std::string::npos) << result.errors;
}

TEST(Render, StreamsWhatDoesNotFitIntoMemory) {
  const TemporaryFolder folder;
  const std::string surfels = folder / "head.ply";
  ASSERT_EQ(run({tool("surfel-generate"), "head", "--count", "200000", "--no-uv", "-o", surfels,
                 "--quiet"})
                .exit_code,
            0);
  const auto render = [&](const std::string& picture, const Words& options) {
    Words command{tool("surfel-render"), surfels, "--size", "100x100", "-o", folder / picture};
    command.insert(command.end(), options.begin(), options.end());
    return run(command);
  };
  const std::string stats = folder / "stats.json";
  EXPECT_EQ(render("whole.exr", {}).exit_code, 0);
  EXPECT_EQ(render("streamed.exr", {"--memory", "12M", "--stats", stats}).exit_code, 0);
  EXPECT_NE(read_text(stats).find("\"streamed\": true"), std::string::npos);
  // Smaller batches: fragments merge at other times.
  EXPECT_GT(image_error(read_image(folder / "whole.exr"), read_image(folder / "streamed.exr")).psnr,
            39);
  for (const Words& options : {Words{"--memory", "1M"}, Words{"--memory", "12M", "--reference"},
                               Words{"--memory", "12M", "--method", "two-pass"}}) {
    const RunResult result = render("none.png", options);
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_NE(result.errors.find("--memory"), std::string::npos) << result.errors;
  }
  for (const std::string wrong : {"", "2Q", "-1", "0", "1e99", "nan"}) {
    EXPECT_EQ(render("none.png", {"--memory", wrong}).exit_code, 2) << wrong;
  }
}

TEST(Render, StrayPointsAreLeftOutOfTheFrame) {
  const TemporaryFolder folder;
  const std::string ball = folder / "ball.ply";
  const std::string strays = folder / "strays.ply";
  const std::string both = folder / "both.ply";
  run({tool("surfel-generate"), "sphere", "--count", "20000", "-o", ball, "--quiet"});
  const std::string seven = folder / "seven.ply";
  run({tool("surfel-generate"), "sphere", "--count", "7", "-o", seven, "--quiet"});
  run({tool("surfel-convert"), seven, "--translate", "300,-70,10", "-o", strays, "--quiet"});
  run({tool("surfel-convert"), strays, ball, "-o", both, "--quiet"});
  const auto render = [&](const std::string& surfels, const std::string& picture,
                          const Words& options) {
    Words command{tool("surfel-render"), surfels, "--size", "64x64", "-o", folder / picture};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return result.errors;
  };
  const auto difference = [&](const std::string& a, const std::string& b) {
    return image_error(read_image(folder / a), read_image(folder / b)).psnr;
  };
  const std::string stats = folder / "stats.json";
  const std::string from = "--from=0,0.36,1";
  EXPECT_EQ(render(ball, "ball.exr", {from}).find("stray"), std::string::npos);
  const std::string note = render(both, "both.exr", {from, "--stats", stats});
  EXPECT_NE(note.find("7 stray points"), std::string::npos) << note;
  EXPECT_NE(note.find("--frame-all"), std::string::npos) << note;
  EXPECT_NE(read_text(stats).find("\"stray_points\": 7"), std::string::npos);
  EXPECT_GT(difference("ball.exr", "both.exr"), 60);
  EXPECT_EQ(render(both, "all.exr", {from, "--frame-all"}).find("stray"), std::string::npos);
  EXPECT_LT(difference("ball.exr", "all.exr"), 20);
  // What says where to look from, and at what, leaves nothing to be framed.
  const std::string placed = render(both, "eye.exr", {"--eye", "0,0,4", "--target", "0,0,0"});
  EXPECT_EQ(placed.find("stray"), std::string::npos);
  EXPECT_EQ(render(both, "turn_%04d.exr", {from, "--turntable", "2", "--quiet"}), "");
  render(ball, "alone_%04d.exr", {from, "--turntable", "2"});
  EXPECT_GT(difference("turn_0001.exr", "alone_0001.exr"), 60);
}

/// Encoding beside rendering changes nothing.
TEST(Render, TurntablePicturesAreThoseOfOneThread) {
  const Square& s = Square::get();
  for (const std::string threads : {"1", "3"}) {
    const RunResult result =
        run({tool("surfel-render"), s.surfels, "--turntable", "5", "--size", "40x40", "--threads",
             threads, "-o", s.folder / ("turn" + threads + "_%d.png")});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
  }
  for (const std::string i : {"0", "1", "2", "3", "4"}) {
    EXPECT_TRUE(read_text(s.folder / ("turn1_" + i + ".png")) ==
                read_text(s.folder / ("turn3_" + i + ".png")));
  }
}

TEST(Render, CopiesForGroupsAreDrawnOnceWhereGroupsDoNotMatter) {
  const Square& s = Square::get();
  const std::string copies = s.folder / "copies.ply";
  ASSERT_EQ(run({tool("surfel-group"), s.surfels, "--groups", "4", "--cover", "duplicate", "-o",
                 copies, "--quiet"})
                .exit_code,
            0);
  for (const Words& options :
       {Words{}, Words{"--method", "depth-peel"}, Words{"--method", "two-pass"}}) {
    const auto picture_of = [&](const std::string& surfels) {
      Words words{surfels};
      words.insert(words.end(), options.begin(), options.end());
      return s.picture(words);
    };
    EXPECT_GT(image_error(picture_of(copies), picture_of(s.surfels)).psnr, 60);
  }
  EXPECT_GT(image_error(s.picture({copies, "--reference", "--samples", "2"}),
                        s.picture({s.surfels, "--reference", "--samples", "2"}))
                .psnr,
            60);
}

}  // namespace
}  // namespace surfel::test
