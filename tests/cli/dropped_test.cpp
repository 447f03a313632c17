// Inputs of which parts are not used: tools say so, or refuse where the result would be wrong.

#include <filesystem>

#include <gtest/gtest.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A sheet of 20 x 20 points with colours, of which one position and one colour are not finite.
std::string sheet(const std::string& normal) {
  std::string text = "x y z r g b" + std::string(normal.empty() ? "" : " nx ny nz") + "\n";
  for (int i = 0; i < 400; ++i) {
    text += (i == 7 ? "nan" : std::to_string(i % 20)) + " " + std::to_string(i / 20) + " 0 " +
            (i == 9 ? "nan" : "200") + " 100 50" + (normal.empty() ? "" : " " + normal) + "\n";
  }
  return text;
}

class Dropped : public testing::Test {
 protected:
  RunResult run_tool(Words words) const {
    words[0] = tool(words[0]);
    return run(words);
  }
  /// The run succeeds and says this in one of its lines.
  void expect_said(const Words& words, const std::string& what) const {
    const RunResult result = run_tool(words);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(contains(result.errors, what)) << result.errors;
  }
  TemporaryFolder folder_;
  std::string out_ = folder_ / "out.ply";
};

TEST_F(Dropped, FacesOfAFileWhosePointsAreUsedAreCounted) {
  const std::string mesh = folder_ / "mesh.ply";
  ASSERT_EQ(run_tool({"surfel-generate", "head", "--mesh", mesh, "--resolution", "8"}).exit_code,
            0);
  const std::string said = "faces are not used, the vertices alone are; surfel-from-mesh";
  expect_said({"surfel-estimate", mesh, "-o", out_}, said);
  expect_said({"surfel-convert", mesh, "-o", out_}, said);
}

TEST_F(Dropped, ValuesThatAreNotFiniteAreCounted) {
  const std::string points = folder_ / "points.xyz";
  write_text(points, sheet(""));
  expect_said({"surfel-estimate", points, "-o", out_}, "1 of 400 points are not finite: removed");
  expect_said({"surfel-estimate", points, "-o", out_}, "1 of 400 colours are not finite");
  expect_said({"surfel-convert", points, "-o", out_},
              "1 positions, 1 colours of 400 surfels are not finite: kept");
  expect_said({"surfel-render", points, "--size", "16", "-o", folder_ / "p.png"},
              "1 of 400 points are not finite and left out");
}

TEST_F(Dropped, NormalsCanOnlyBeAlignedWithNormals) {
  const std::string bare = folder_ / "bare.xyz";
  const std::string zero = folder_ / "zero.xyz";
  const std::string some = folder_ / "some.xyz";
  write_text(bare, sheet(""));
  write_text(zero, sheet("0 0 0"));
  std::string text = sheet("0 0 1");
  text.replace(text.find("0 0 1\n"), 5, "0 0 0");
  write_text(some, text);
  for (const std::string& file : {bare, zero}) {
    const RunResult result = run_tool({"surfel-estimate", file, "--orient", "align", "-o", out_});
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_TRUE(contains(result.errors, file + ": holds no normals")) << result.errors;
    EXPECT_TRUE(contains(result.errors, "mst")) << result.errors;
  }
  // Without a choice the zeros of a file are no normals.
  expect_said({"surfel-render", zero, "--size", "16", "-o", folder_ / "p.png"},
              "surfel-estimate " + zero + " -o ");
  expect_said({"surfel-estimate", some, "--orient", "align", "-o", out_},
              "1 of 400 points have no usable normal to align with");
}

TEST_F(Dropped, AMeshThatNoSurfelLiesOnIsRefused) {
  const std::string mesh = folder_ / "mesh.obj";
  const std::string surfels = folder_ / "surfels.ply";
  const std::string far = folder_ / "far.ply";
  const std::string both = folder_ / "both.ply";
  run_tool({"surfel-generate", "head", "--mesh", mesh, "--resolution", "8", "--image",
            folder_ / "head.png", "--size", "32"});
  run_tool({"surfel-from-mesh", mesh, "--count", "300", "-o", surfels});
  run_tool({"surfel-convert", surfels, "--translate", "9,0,0", "-o", far});
  run_tool({"surfel-convert", surfels, far, "-o", both});
  const RunResult refused = run_tool({"surfel-texture", far, "--mesh", mesh, "-o", out_});
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_TRUE(contains(refused.errors, far)) << refused.errors;
  EXPECT_TRUE(contains(refused.errors, mesh + ": the nearest is ")) << refused.errors;
  EXPECT_FALSE(std::filesystem::exists(out_));
  expect_said({"surfel-texture", both, "--mesh", mesh, "-o", out_}, "(50 %) do not lie on " + mesh);
  const RunResult quiet = run_tool({"surfel-texture", surfels, "--mesh", mesh, "-o", out_});
  EXPECT_EQ(quiet.exit_code, 0);
  EXPECT_FALSE(contains(quiet.errors, "do not lie on")) << quiet.errors;
}

TEST_F(Dropped, OptionsWithoutEffectAreRefused) {
  const std::string points = folder_ / "points.xyz";
  write_text(points, sheet(""));
  for (const Words& options : {Words{"--k-min", "9"}, Words{"--outlier-k", "9"}, Words{"--up", "x"},
                               Words{"--variance", "max-distance", "--max-radius", "2"}}) {
    Words words{"surfel-estimate", points, "-o", out_};
    words.insert(words.end(), options.begin(), options.end());
    const RunResult result = run_tool(words);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_TRUE(contains(result.errors, options[options.size() - 2] + " has no effect without"))
        << result.errors;
  }
}

}  // namespace
}  // namespace surfel::test
