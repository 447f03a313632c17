// Pages of surfel-view in Chromium, which draws them by the processor, beside surfel-render's
// pictures.

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kChromium = "/usr/bin/chromium";

/// Bytes of a text in base64.
std::string decoded(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  unsigned group = 0;
  int bits = 0;
  for (const char c : text.substr(0, text.find('='))) {
    group = (group << 6 | static_cast<unsigned>(digits.find(c))) & 0xffffff;
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    bytes += static_cast<char>(group >> bits & 255);
  }
  return bytes;
}

/// The text of an element of a document.
std::string element(const std::string& document, const std::string& id) {
  const std::string mark = "id=\"" + id + "\">";
  const std::size_t at = document.find(mark);
  if (at == std::string::npos) return "";
  const std::size_t begin = at + mark.size();
  return document.substr(begin, document.find('<', begin) - begin);
}

class Browser : public testing::Test {
 protected:
  void SetUp() override {
    if (fs::exists(kChromium)) return;
    ASSERT_EQ(std::getenv("CI"), nullptr) << "CI installs chromium";
    GTEST_SKIP() << "there is no " << kChromium;
  }

  /// The document that a page has become.
  std::string document(const std::string& address) const {
    const RunResult result =
        run({kChromium, "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle",
             "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--disable-background-networking", "--disable-component-update", "--disable-sync",
             "--no-first-run", "--user-data-dir=" + (folder_ / "profile"),
             "--virtual-time-budget=20000", "--dump-dom", address});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return result.output;
  }

  /// Least PSNR of the page's picture and the one that the page's own command makes.
  double psnr(const std::string& surfels, const std::string& fragment) const {
    const std::string page = folder_ / "page.html";
    const RunResult made = run({tool("surfel-view"), surfels, "-o", page, "--quiet"});
    EXPECT_EQ(made.exit_code, 0) << made.errors;
    const std::string seen = document("file://" + page + "#capture&size=160x120&" + fragment);
    const std::string prefix = "data:image/png;base64,";
    const std::string picture = element(seen, "picture");
    EXPECT_TRUE(picture.starts_with(prefix)) << element(seen, "failure");
    if (!picture.starts_with(prefix)) return 0;
    write_text(folder_ / "seen.png", decoded(picture.substr(prefix.size())));
    const std::string command = element(seen, "commands");
    const std::string bin = fs::path(tool("surfel-render")).parent_path();
    const RunResult drawn =
        run({"/bin/sh", "-c", "cd " + (folder_ / "") + " && " + bin + "/" + command + " --quiet"});
    EXPECT_EQ(drawn.exit_code, 0) << command << drawn.errors;
    const RunResult compared =
        run({tool("surfel-compare"), folder_ / "seen.png", folder_ / "view.png", "--json"});
    EXPECT_EQ(compared.exit_code, 0) << compared.errors;
    return nlohmann::json::parse(compared.output)["psnr"].get<double>();
  }

  TemporaryFolder folder_;
};

TEST_F(Browser, ShowsWhatItsCommandDraws) {
  const std::string ball = folder_ / "ball.ply";
  ASSERT_EQ(
      run({tool("surfel-generate"), "sphere", "--count", "4000", "--quiet", "-o", ball}).exit_code,
      0);
  EXPECT_GT(psnr(ball, "lit=1&background=%23204060"), 38);
  EXPECT_GT(psnr(ball, "lit=1&ortho=1&camera=3,2,4,0,0,0,0,1,0,40,2.5"), 38);
  EXPECT_GT(psnr(ball, "lit=0&mode=normal&clipAxis=x&clipPlace=0.6"), 38);
}

/// Discs of all directions within a ball: nearly every pixel has several surfaces of both sides.
std::string leaves() {
  std::mt19937 random(7);
  const auto number = [&] { return static_cast<double>(random()) / 2147483648.0 - 1; };
  std::string text =
      "ply\nformat ascii 1.0\ncomment surfel 0.1.0\nelement vertex 1500\nproperty float x\n"
      "property float y\nproperty float z\nproperty float nx\nproperty float ny\n"
      "property float nz\nproperty float variance\nproperty float area\nend_header\n";
  for (int i = 0; i < 1500; ++i) {
    double v[6];
    for (double& x : v) x = number();
    const double size = std::hypot(v[3], v[4], v[5]) + 1e-6;
    const double spread = 0.0008 * (1.2 + number());
    text += fmt::format("{} {} {} {} {} {} {} {}\n", v[0], v[1], v[2], v[3] / size, v[4] / size,
                        v[5] / size, spread, 4 * spread);
  }
  return text;
}

TEST_F(Browser, TellsSurfacesApartAsSurfelRenderDoes) {
  const std::string bush = folder_ / "bush.ply";
  write_text(bush, leaves());
  EXPECT_GT(psnr(bush, "lit=0&mode=normal"), 35);
  EXPECT_GT(psnr(bush, "lit=1"), 35);
}

/// A box without a lid, its walls of unlike heights.
constexpr const char* kBox =
    "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 0.6\nv 1 1 0.9\nv -1 1 1.2\n"
    "f 4 3 2 1\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

TEST_F(Browser, EndsSurfelsAtLinesAsSurfelRenderDoes) {
  write_text(folder_ / "box.obj", kBox);
  const std::string box = folder_ / "box.ply";
  const auto sample = [&](const std::string& spacing) {
    const RunResult made = run({tool("surfel-from-mesh"), folder_ / "box.obj", "--clip",
                                "--spacing", spacing, "--quiet", "-o", box});
    ASSERT_EQ(made.exit_code, 0) << made.errors;
  };
  sample("0.04");
  EXPECT_GT(psnr(box, "lit=0&mode=normal"), 45) << "smaller than the pixel filter";
  sample("0.2");
  EXPECT_GT(psnr(box, "lit=1&ortho=1&camera=3,2,4,0,0,0,0,0,1,40,3.5"), 45);
  EXPECT_GT(psnr(box, "lit=1&camera=0.6,0.4,1.5,-1,-1,0,0,0,1,40"), 45);
}

TEST_F(Browser, ChoosesTheLevelsThatSurfelRenderChooses) {
  const std::string ball = folder_ / "ball.ply";
  const std::string levels = folder_ / "levels.ply";
  ASSERT_EQ(
      run({tool("surfel-generate"), "sphere", "--count", "30000", "--quiet", "-o", ball}).exit_code,
      0);
  ASSERT_EQ(run({tool("surfel-lod"), ball, "--quiet", "-o", levels}).exit_code, 0);
  EXPECT_GT(psnr(levels, "lit=1"), 38);
}

}  // namespace
}  // namespace surfel::test
