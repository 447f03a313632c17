// surfel-compare: what it prints, what it writes, how it ends.

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

/// A grey picture, 8 x 4, opaque; and the same with one pixel changed.
struct Pictures {
  TemporaryFolder folder;
  std::string grey = folder / "grey.exr";
  std::string changed = folder / "changed.exr";
  std::string small = folder / "small.exr";

  Pictures() {
    Image image = make(8, 4);
    write_image(image, grey);
    image.pixel(5, 2)[1] = 1;
    write_image(image, changed);
    write_image(make(4, 4), small);
  }
  static Image make(int width, int height) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = {"R", "G", "B", "A"};
    for (int i = 0; i < width * height; ++i) {
      for (const float value : {0.25F, 0.25F, 0.25F, 1.0F}) image.data.push_back(value);
    }
    return image;
  }
};

TEST(Compare, EqualPicturesPassEveryLimit) {
  const Pictures p;
  const RunResult result = run({tool("surfel-compare"), p.grey, p.grey, "--min-psnr", "200",
                                "--max-beyond", "0", "--max-holes", "0", "--json"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  const nlohmann::json json = nlohmann::json::parse(result.output);
  EXPECT_TRUE(json["psnr"].is_null()) << "infinite";
  EXPECT_EQ(json["maximum"], 0);
}

TEST(Compare, DifferencesAreMeasuredAndDrawn) {
  const Pictures p;
  const std::string difference = p.folder / "difference.exr";
  const RunResult result = run({tool("surfel-compare"), p.changed, p.grey, "--encoding", "linear",
                                "--json", "-o", difference, "--scale", "2"});
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  const nlohmann::json json = nlohmann::json::parse(result.output);
  EXPECT_NEAR(json["maximum"].get<double>(), 0.75, 1e-6);
  EXPECT_EQ(json["maximum_x"], 5);
  EXPECT_EQ(json["maximum_y"], 2);
  EXPECT_NEAR(json["beyond"].get<double>(), 1.0 / 32, 1e-9);
  // One channel of 96 is off by 0.75.
  EXPECT_NEAR(json["psnr"].get<double>(), -10 * std::log10(0.75 * 0.75 / 96), 1e-3);
  const Image drawn = read_image(difference, true);
  EXPECT_NEAR(drawn.pixel(5, 2)[1], 1.5F, 1e-6F);
  EXPECT_EQ(drawn.pixel(4, 2)[1], 0.0F);
}

TEST(Compare, AMissedLimitIsAFailure) {
  const Pictures p;
  for (const auto& [option, value] : {std::pair{"--min-psnr", "60"}, {"--max-beyond", "0.01"}}) {
    const RunResult result = run({tool("surfel-compare"), p.changed, p.grey, option, value});
    EXPECT_EQ(result.exit_code, 1) << option;
    EXPECT_NE(result.errors.find("surfel-compare: error: "), std::string::npos);
    EXPECT_FALSE(result.output.empty()) << "the measures are printed all the same";
  }
}

TEST(Compare, WritesAPageThatIsTheSameEachTime) {
  const Pictures p;
  const std::string hostile = p.folder / "<b>&'.exr";
  std::filesystem::copy_file(p.changed, hostile);
  const std::string page = p.folder / "page.html";
  const Words command{tool("surfel-compare"), hostile, p.grey, "--html", page};
  ASSERT_EQ(run(command).exit_code, 0);
  const std::string html = read_text(page);
  EXPECT_TRUE(contains(html, "</html>"));
  EXPECT_TRUE(contains(html, "&lt;b&gt;&amp;&#39;.exr"));
  EXPECT_FALSE(contains(html, "<b>&'"));
  ASSERT_EQ(run(command).exit_code, 0);
  EXPECT_EQ(read_text(page), html);
  // A missed limit is in the page, and a failure.
  Words limited = command;
  limited.insert(limited.end(), {"--min-psnr", "60"});
  EXPECT_EQ(run(limited).exit_code, 1);
  EXPECT_TRUE(contains(read_text(page), "below --min-psnr 60"));
}

TEST(Compare, WritesNoPartOfAPage) {
  const Pictures p;
  const std::string folder = p.folder / "pages";
  std::filesystem::create_directory(folder);
  EXPECT_EQ(run({tool("surfel-compare"), p.small, p.grey, "--html", folder + "/a.html"}).exit_code,
            1);
  EXPECT_EQ(
      run({tool("surfel-compare"), p.grey, p.grey, "--html", folder + "/none/a.html"}).exit_code,
      1);
  EXPECT_EQ(run({tool("surfel-compare"), p.grey, p.grey, "--html", folder + "/a.png"}).exit_code,
            2);
  EXPECT_EQ(run({tool("surfel-compare"), p.grey, p.grey, "--html", "-"}).exit_code, 2);
  EXPECT_TRUE(std::filesystem::is_empty(folder));
}

TEST(Compare, RefusesWhatCannotBeCompared) {
  const Pictures p;
  const RunResult sizes = run({tool("surfel-compare"), p.small, p.grey});
  EXPECT_EQ(sizes.exit_code, 1);
  EXPECT_NE(sizes.errors.find("4x4"), std::string::npos) << sizes.errors;
  EXPECT_EQ(run({tool("surfel-compare"), p.grey, p.folder / "none.exr"}).exit_code, 1);
  EXPECT_EQ(run({tool("surfel-compare"), p.grey}).exit_code, 2);
  EXPECT_EQ(run({tool("surfel-compare"), p.grey, p.grey, "--scale", "-1"}).exit_code, 2);
}

}  // namespace
}  // namespace surfel::test
