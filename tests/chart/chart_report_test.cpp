#include <limits>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/base/process.h>
#include <surfel/chart/chart_judge.h>
#include <surfel/chart/chart_report.h>
#include <surfel/io/image_io.h>
#include <surfel/scene/image.h>

#include "support/test_data.h"

namespace surfel {
namespace {

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; ++at) ++n;
  return n;
}

/// A report of one sweep whose names hold what must be escaped.
class SmallReport : public testing::Test {
 protected:
  SmallReport() {
    Image image;
    image.width = image.height = 2;
    image.channels = {"R", "G", "B", "A"};
    image.data.assign(16, 0.5F);
    write_image(image, folder_ / "truth.png");
    image.data[0] = 0.25F;
    write_image(image, folder_ / "point.png");

    report_.summary = {{"Input", "/data/<b>\"a\" & 'c'.ply"}, {"Odd", "\xff byte"}};
    report_.truth_commands = {"surfel-render '<truth>'"};
    ChartSweep sweep;
    sweep.name = "cutoff";
    sweep.title = "Cutoff";
    sweep.about = "About.";
    sweep.time = "time of the picture";
    sweep.truth = folder_ / "truth.png";
    ChartPoint point;
    point.label = "c < 1, \"quoted\"";
    point.standard = true;
    point.commands = {"surfel-render 'a & b.ply'"};
    point.time = point.render = {10, 9, 11};
    point.stages = {{"surfel-render raster", 9.5}};
    point.error.psnr = std::numeric_limits<double>::infinity();
    point.error.alpha_psnr = 40;
    point.flicker = 0.0123;
    point.picture = folder_ / "point.png";
    sweep.points = {point, point};
    sweep.points[1].label = "refused";
    sweep.points[1].standard = false;
    sweep.points[1].refused = "surfel-render: no <such> thing";
    judge(sweep);
    report_.sweeps = {sweep};
  }
  test::TemporaryFolder folder_;
  ChartReport report_;
};

TEST_F(SmallReport, PageIsWholeAndEscaped) {
  SURFEL_REQUIRE_PROGRAM("gnuplot");
  const std::string html = report_html(report_, "surfel-chart '<in>'", folder_ / "");
  for (const char* part :
       {"&lt;b&gt;&quot;a&quot; &amp; &#39;c&#39;.ply", "c &lt; 1, &quot;quoted&quot;",
        "no &lt;such&gt; thing", "surfel-render &#39;a &amp; b.ply&#39;", "\xef\xbf\xbd byte",
        "surfel-chart &#39;&lt;in&gt;&#39;", "data:image/svg+xml;base64,", "0.0123", "equal",
        "surfel-render raster", "on the Pareto front"}) {
    EXPECT_TRUE(contains(html, part)) << part;
  }
  EXPECT_FALSE(contains(html, "<b>\"a\""));
  EXPECT_FALSE(contains(html, "://"));  // Opens offline.
  // The truth, the point and their difference, each once.
  EXPECT_EQ(count(html, "data:image/png;base64,"), 3U);
}

TEST_F(SmallReport, JsonHoldsWhatWasMeasured) {
  const auto json = nlohmann::json::parse(report_json(report_));
  const auto& points = json["sweeps"][0]["points"];
  EXPECT_TRUE(points[0]["psnr"].is_null());
  EXPECT_EQ(points[0]["alpha_psnr"], 40);
  EXPECT_EQ(points[0]["flicker"], 0.0123);
  EXPECT_EQ(points[0]["time_ms"]["median"], 10);
  EXPECT_EQ(points[0]["stages_ms"]["surfel-render raster"], 9.5);
  EXPECT_EQ(points[1]["refused"], "surfel-render: no <such> thing");
  EXPECT_FALSE(points[1].contains("psnr"));
}

TEST_F(SmallReport, CsvHasARowForEveryPoint) {
  const std::string csv = report_csv(report_);
  EXPECT_EQ(count(csv, "\r\n"), 3U);
  EXPECT_TRUE(contains(csv, "cutoff,\"c < 1, \"\"quoted\"\"\",1,1,10,9,11,"));
  EXPECT_TRUE(contains(csv, ",inf,"));
  // Each row has as many fields as the header; two of them are quoted ones with a comma or none.
  const std::string header = csv.substr(0, csv.find("\r\n"));
  const std::string last = csv.substr(csv.rfind("\r\n", csv.size() - 3) + 2);
  EXPECT_EQ(count(header, ","), count(last, ","));
}

TEST_F(SmallReport, IsWrittenWholeOrNotAtAll) {
  SURFEL_REQUIRE_PROGRAM("gnuplot");
  std::filesystem::create_directory(folder_ / "out");
  report_.sweeps[0].truth = folder_ / "none.png";
  EXPECT_ANY_THROW(write_report(report_, "", folder_ / "", folder_ / "out", false));
  EXPECT_TRUE(std::filesystem::is_empty(folder_ / "out"));
  report_.sweeps[0].truth = folder_ / "truth.png";
  write_report(report_, "", folder_ / "", folder_ / "out", false);
  for (const char* name : {"report.html", "report.csv", "report.json"}) {
    EXPECT_TRUE(std::filesystem::exists(folder_ / (std::string("out/") + name))) << name;
  }
  EXPECT_ANY_THROW(write_report(report_, "", folder_ / "", folder_ / "out", true));
}

TEST(CsvField, QuotesWhatNeedsIt) {
  EXPECT_EQ(csv_field("plain"), "plain");
  EXPECT_EQ(csv_field("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_field("say \"x\""), "\"say \"\"x\"\"\"");
  EXPECT_EQ(csv_field("two\nlines"), "\"two\nlines\"");
}

}  // namespace
}  // namespace surfel
