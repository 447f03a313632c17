// Pages of surfel-view in Chromium, which draws them by the processor, beside surfel-render's
// pictures. Chromium takes seconds to start: one process draws all pictures.

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <ostream>
#include <random>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/io/image_io.h>
#include <surfel/truth/image_error.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kChromium = "/usr/bin/chromium";

/// A picture of a page.
struct PageView {
  const char* name;
  const char* page;     ///< Name of the page, and of the surfels that it shows.
  const char* address;  ///< Settings behind the # of its address.
  double least_psnr;    ///< Of its picture and the one that its own command makes, dB.
};

/// For messages, which would otherwise hold addresses.
void PrintTo(const PageView& view, std::ostream* out) { *out << view.name; }

constexpr PageView kViews[] = {
    {"LitBall", "ball", "lit=1&background=%23204060", 38},
    {"BallInParallelProjection", "ball", "lit=1&ortho=1&camera=3,2,4,0,0,0,0,1,0,40,2.5", 38},
    {"ClippedBall", "ball", "lit=0&mode=normal&clipAxis=x&clipPlace=0.6", 38},
    {"SurfacesApartByNormals", "bush", "lit=0&mode=normal", 35},
    {"SurfacesApartInLight", "bush", "lit=1", 35},
    {"LinesOfSurfelsSmallerThanThePixelFilter", "fine-box", "lit=0&mode=normal", 45},
    {"LinesInParallelProjection", "coarse-box", "lit=1&ortho=1&camera=3,2,4,0,0,0,0,0,1,40,3.5",
     45},
    {"LinesFromWithin", "coarse-box", "lit=1&camera=0.6,0.4,1.5,-1,-1,0,0,0,1,40", 45},
    {"ChosenLevels", "levels", "lit=1", 38},
};

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

/// A box without a lid, its walls of unlike heights.
constexpr const char* kBox =
    "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 0.6\nv 1 1 0.9\nv -1 1 1.2\n"
    "f 4 3 2 1\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// Opens addresses one after the other in a frame, and gathers what each page leaves.
constexpr const char* kDriver = R"(<!DOCTYPE html>
<script type="module">
for (const [name, address] of [@views@]) {
  const frame = document.createElement('iframe');
  frame.src = address;
  document.body.append(frame);
  const text = (id) => frame.contentDocument?.getElementById(id)?.textContent ?? '';
  while (!text('picture') && !text('failure')) {
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
  for (const id of ['picture', 'failure', 'commands']) {
    const copy = document.createElement('pre');
    copy.id = `${name}-${id}`;
    copy.textContent = text(id);
    document.body.append(copy);
  }
  frame.remove();
}
</script>
)";

/// Runs a command, which is to succeed.
void succeed(const Words& command) {
  const RunResult result = run(command);
  EXPECT_EQ(result.exit_code, 0) << command[0] << ": " << result.errors;
}

/// All pages, and the document with the pictures of all views.
struct Pages {
  TemporaryFolder folder;
  std::string document;

  Pages() {
    make_surfels();
    for (const char* page : {"ball", "bush", "fine-box", "coarse-box", "levels"}) {
      succeed({tool("surfel-view"), surfels(page), "-o", html(page), "--quiet"});
    }
    draw();
  }

  std::string surfels(const std::string& page) const { return folder / (page + ".ply"); }
  std::string html(const std::string& page) const { return folder / (page + ".html"); }

  void make_surfels() const {
    succeed(
        {tool("surfel-generate"), "sphere", "--count", "4000", "--quiet", "-o", surfels("ball")});
    write_text(surfels("bush"), leaves());
    write_text(folder / "box.obj", kBox);
    for (const auto& [page, spacing] : {std::pair("fine-box", "0.04"), {"coarse-box", "0.2"}}) {
      succeed({tool("surfel-from-mesh"), folder / "box.obj", "--clip", "--spacing", spacing,
               "--quiet", "-o", surfels(page)});
    }
    succeed(
        {tool("surfel-generate"), "sphere", "--count", "30000", "--quiet", "-o", surfels("many")});
    succeed({tool("surfel-lod"), surfels("many"), "--quiet", "-o", surfels("levels")});
  }

  void draw() {
    std::string views;
    for (const PageView& view : kViews) {
      views += fmt::format("['{}', 'file://{}#capture&size=160x120&{}'],", view.name,
                           html(view.page), view.address);
    }
    std::string driver = kDriver;
    const std::string mark = "@views@";
    driver.replace(driver.find(mark), mark.size(), views);
    write_text(folder / "driver.html", driver);
    const RunResult result =
        run({kChromium, "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle",
             "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--disable-background-networking", "--disable-component-update", "--disable-sync",
             "--no-first-run", "--user-data-dir=" + (folder / "profile"),
             "--allow-file-access-from-files", "--virtual-time-budget=180000", "--dump-dom",
             "file://" + (folder / "driver.html")},
            {.longest = std::chrono::minutes(10)});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    document = result.output;
  }
};

class Browser : public testing::TestWithParam<PageView> {
 protected:
  static void SetUpTestSuite() {
    if (fs::exists(kChromium)) pages_ = std::make_unique<Pages>();
  }
  static void TearDownTestSuite() { pages_.reset(); }
  void SetUp() override { SURFEL_REQUIRE(pages_, std::string("there is no ") + kChromium); }

  static inline std::unique_ptr<Pages> pages_;
};

TEST_P(Browser, ShowsWhatTheCommandOfThePageDraws) {
  const PageView& view = GetParam();
  const std::string of = std::string(view.page) + ".html, " + view.name + ": ";
  const auto left = [&](const char* id) {
    return element(pages_->document, fmt::format("{}-{}", view.name, id));
  };
  const std::string prefix = "data:image/png;base64,";
  const std::string picture = left("picture");
  ASSERT_TRUE(picture.starts_with(prefix)) << of << "no picture; " << left("failure");
  const std::string seen = pages_->folder / "seen.png";
  write_text(seen, decoded(picture.substr(prefix.size())));
  const std::string drawn = pages_->folder / "view.png";
  fs::remove(drawn);
  const std::string command = left("commands");
  const std::string bin = fs::path(tool("surfel-render")).parent_path();
  const RunResult result = run(
      {"/bin/sh", "-c", "cd " + (pages_->folder / "") + " && " + bin + "/" + command + " --quiet"});
  ASSERT_EQ(result.exit_code, 0) << of << command << result.errors;
  const ImageError error =
      image_error(read_premultiplied_image(seen), read_premultiplied_image(drawn));
  EXPECT_GT(error.psnr, view.least_psnr) << of << command;
}

INSTANTIATE_TEST_SUITE_P(Pages, Browser, testing::ValuesIn(kViews),
                         [](const auto& view) { return std::string(view.param.name); });

}  // namespace
}  // namespace surfel::test
