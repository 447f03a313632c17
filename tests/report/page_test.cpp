#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/report/page.h>
#include <surfel/report/page_chart.h>

#include "report/pages.h"

namespace surfel::test {
namespace {

TEST(Base64, KnownValues) {
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64("\xff\xfe\xfd"), "//79");
}

TEST(EscapeHtml, LeavesNothingThatMarksUp) {
  EXPECT_EQ(escape_html("a<b>&\"c\"'d'"), "a&lt;b&gt;&amp;&quot;c&quot;&#39;d&#39;");
  EXPECT_EQ(escape_html("\xff byte"), "\xef\xbf\xbd byte");
  EXPECT_EQ(escape_html("Maß"), "Maß");
}

TEST(Page, IsWholeAndEscaped) {
  const std::string html = page_html({.title = kHostile,
                                      .heading = kHostile,
                                      .subtitle = kHostile,
                                      .body_html = "<p id=\"body\"></p>",
                                      .script = "run();"});
  expect_page(html);
  EXPECT_NE(html.find("<p id=\"body\">"), std::string::npos);
  EXPECT_NE(html.find("<script>\nrun();</script>"), std::string::npos);
  EXPECT_NE(html.find("prefers-color-scheme: dark"), std::string::npos);
  expect_escaped(facts_html({{kHostile, kHostile}}) + pre_html(kHostile));
}

TEST(PagePictures, HoldEachPictureOnce) {
  PagePictures pictures;
  Image grey = rgba_image(3, 2);
  std::fill(grey.data.begin(), grey.data.end(), 0.5F);
  Image white = grey;
  std::fill(white.data.begin(), white.data.end(), 1.0F);
  std::string page;
  for (const Image* image : {&grey, &white, &grey}) page += pictures.add(*image);
  EXPECT_EQ(count(page, "data:image/png;base64,iVBOR"), 2U);
  EXPECT_EQ(count(page, "<use href=\"#p0\"/>"), 1U);
  EXPECT_EQ(count(page, "viewBox=\"0 0 3 2\""), 3U);
}

TEST(HistogramOf, CountsEveryFiniteValue) {
  const Histogram h = histogram_of({-1, 0, 0.1, 0.5, 1, 2, std::numeric_limits<double>::quiet_NaN(),
                                    std::numeric_limits<double>::infinity()},
                                   0, 1, 4);
  EXPECT_EQ(h.edges, (std::vector<double>{0, 0.25, 0.5, 0.75, 1}));
  EXPECT_EQ(h.counts, (std::vector<std::size_t>{3, 0, 1, 2}));
}

TEST(Charts, HaveABarForEveryCountThatIsNotZero) {
  const Histogram h{{0, 1, 2, 3}, {5, 0, 1}};
  EXPECT_EQ(count(histogram_svg(h), "<rect"), 2U);
  EXPECT_EQ(count(histogram_svg(h, true), "<rect"), 2U);
  EXPECT_EQ(count(histogram_svg({}), "<rect"), 0U);
  const std::string named = named_counts_svg({{kHostile, 3}, {"b", 1}});
  expect_escaped(named);
  EXPECT_EQ(count(named, "<rect"), 2U);
  EXPECT_NE(color_scale_svg(ColorMap::kGrey, 0, 0.5, "m").find(">0.25</text>"), std::string::npos);
}

}  // namespace
}  // namespace surfel::test
