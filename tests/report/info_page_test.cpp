#include <cstring>
#include <string>

#include <gtest/gtest.h>
#include <surfel/report/info_charts.h>
#include <surfel/report/info_page.h>
#include <surfel/sample/generate.h>

#include "report/pages.h"

namespace surfel::test {
namespace {

TEST(InfoPage, HoldsAllThatIsToldEscaped) {
  InfoPage page;
  page.file = "folder/" + kHostile;
  page.kind = "surfels";
  page.figures = {{"count", "12"}};
  page.facts = {{kHostile, kHostile}};
  page.findings = {{kHostile, "few", kHostile}};
  page.pictures = {{kHostile, rgba_image(4, 4)}};
  page.no_pictures = kHostile;
  page.charts = {{kHostile, kHostile, "<svg id=\"chart\"></svg>"}};
  page.next = kHostile;
  page.command = kHostile;
  const std::string html = info_page_html(page);
  expect_page(html);
  EXPECT_EQ(count(html, "alert"), 10U);
  EXPECT_EQ(count(html, "data:image/png"), 1U);
  EXPECT_EQ(count(html, "<svg id=\"chart\">"), 1U);
  EXPECT_EQ(html, info_page_html(page));
}

TEST(InfoPage, TellsWhatIsJudged) {
  InfoPage page;
  EXPECT_EQ(info_page_html(page).find("What is wrong"), std::string::npos);
  page.findings.emplace();
  EXPECT_NE(info_page_html(page).find("Nothing is missing or wrong."), std::string::npos);
}

TEST(CloudCharts, HaveSizesColorsAndColumns) {
  SurfelCloud cloud = generate_surfels(procedural_scene("sphere", 1), {.count = 500});
  ExtraProperty& more = cloud.extra.emplace_back();
  more.name = kHostile;
  more.data.resize(cloud.size() * sizeof(float));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto value = static_cast<float>(i % 7);
    std::memcpy(more.data.data() + i * sizeof(float), &value, sizeof(float));
  }
  InfoPage page;
  page.file = kHostile;
  page.charts = cloud_charts(cloud, {0, 1, 0}, "of some");
  std::string titles;
  for (const InfoChart& chart : page.charts) titles += chart.title + "|";
  EXPECT_EQ(titles, "radius of the disc at cutoff 1|spacing (root of the area)|colours|elevation|" +
                        kHostile + "|");
  expect_page(info_page_html(page));
  EXPECT_TRUE(cloud_charts({}, {0, 1, 0}, "").empty());
}

}  // namespace
}  // namespace surfel::test
