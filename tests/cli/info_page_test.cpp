// surfel-info --html: pages of files of every kind.

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/sample/generate.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

class InfoPages : public testing::Test {
 protected:
  InfoPages() {
    SurfelCloud cloud = generate_surfels(procedural_scene("sphere", 1), {.count = 2000});
    write_cloud(cloud, surfels_);
    cloud.variance.clear();
    cloud.area.clear();
    write_cloud(cloud, points_);
    write_text(mesh_, "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n");
    Image image = rgba_image(4, 3);
    for (float& value : image.data) value = 1;
    write_image(image, image_);
  }
  std::string page_of(const std::string& file) {
    const std::string page = folder_ / "page.html";
    const RunResult result = run({tool("surfel-info"), file, "--html", page});
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(contains(result.output, "kind")) << "the figures are printed as well";
    const std::string html = read_text(page);
    EXPECT_TRUE(contains(html, "</html>")) << file;
    EXPECT_FALSE(contains(html, "://")) << file;
    return html;
  }
  TemporaryFolder folder_;
  std::string surfels_ = folder_ / "<i>&'.ply";
  std::string points_ = folder_ / "points.ply";
  std::string mesh_ = folder_ / "square.obj";
  std::string image_ = folder_ / "white.png";
};

TEST_F(InfoPages, HavePicturesHistogramsAndAdvice) {
  const std::string surfels = page_of(surfels_);
  for (const char* part : {"What is wrong, and what to do", "radius of the disc at cutoff 1",
                           "elevation", "other surfels within the radius", "of all surfels",
                           "&lt;i&gt;&amp;&#39;.ply", "image/png", "coverage"}) {
    EXPECT_TRUE(contains(surfels, part)) << part;
  }
  EXPECT_FALSE(contains(surfels, "<i>&'"));
  EXPECT_EQ(page_of(surfels_), surfels);
  const std::string points = page_of(points_);
  EXPECT_TRUE(contains(points, "image/png"));
  EXPECT_TRUE(contains(points, "surfel-estimate"));
  EXPECT_TRUE(contains(page_of(mesh_), "image/png"));
  EXPECT_TRUE(contains(page_of(image_), "colours"));
}

TEST_F(InfoPages, AreTheSameForAnyNumberOfThreads) {
  const std::string html = page_of(points_);
  const std::string page = folder_ / "page.html";
  ASSERT_EQ(run({tool("surfel-info"), points_, "--html", page, "--threads", "1"}).exit_code, 0);
  EXPECT_EQ(read_text(page), html);
}

TEST_F(InfoPages, AreWrittenWholeOrNotAtAll) {
  const std::string out = folder_ / "out";
  std::filesystem::create_directory(out);
  const std::string broken = folder_ / "broken.ply";
  write_text(broken, "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nend_header\n1\n");
  EXPECT_EQ(run({tool("surfel-info"), broken, "--html", out + "/a.html"}).exit_code, 1);
  EXPECT_EQ(run({tool("surfel-info"), mesh_, "--html", out + "/none/a.html"}).exit_code, 1);
  EXPECT_EQ(run({tool("surfel-info"), mesh_, "--html", out + "/a.ply"}).exit_code, 2);
  EXPECT_EQ(run({tool("surfel-info"), mesh_, "--html", "-"}).exit_code, 2);
  EXPECT_TRUE(std::filesystem::is_empty(out));
  write_text(out + "/a.html", "kept");
  EXPECT_EQ(run({tool("surfel-info"), mesh_, "--html", out + "/a.html", "--no-clobber"}).exit_code,
            1);
  EXPECT_EQ(read_text(out + "/a.html"), "kept");
}

}  // namespace
}  // namespace surfel::test
