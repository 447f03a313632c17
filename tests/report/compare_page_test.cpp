#include <algorithm>
#include <limits>
#include <string>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/report/compare_page.h>

#include "report/pages.h"

namespace surfel::test {
namespace {

Image filled(float value) {
  Image image = rgba_image(6, 4);
  std::fill(image.data.begin(), image.data.end(), value);
  for (int x = 0; x < 6; ++x) image.pixel(x, 1)[3] = 1;
  return image;
}

TEST(ComparePage, HoldsPicturesDifferenceAndMap) {
  ComparePage page;
  page.tested = kHostile;
  page.truth = "truth.png";
  page.figures = {{"psnr", kHostile}};
  page.command = kHostile;
  const Image truth = filled(0.5F);
  Image tested = truth;
  tested.pixel(2, 2)[0] = 0.25F;
  const std::string html = compare_page_html(page, tested, truth, {});
  expect_page(html);
  EXPECT_EQ(count(html, "data:image/png"), 4U);
  EXPECT_EQ(count(html, "class=\"verdict"), 0U);
  EXPECT_EQ(html, compare_page_html(page, tested, truth, {}));
  page.limited = true;
  EXPECT_NE(compare_page_html(page, tested, truth, {}).find("All limits are met."),
            std::string::npos);
  page.missed = {kHostile};
  EXPECT_EQ(count(compare_page_html(page, tested, truth, {}), "class=\"verdict off\""), 1U);
}

TEST(ComparePage, TakesEqualPicturesAndValuesThatAreNotFinite) {
  ComparePage page;
  page.tested = kHostile;
  const Image truth = filled(0.5F);
  expect_page(compare_page_html(page, truth, truth, {}));
  Image tested = truth;
  tested.pixel(1, 1)[1] = std::numeric_limits<float>::quiet_NaN();
  tested.pixel(3, 1)[2] = std::numeric_limits<float>::infinity();
  expect_page(compare_page_html(page, tested, truth, {.background = {1, 1, 1, 1}}));
  expect_page(compare_page_html(page, tested, truth, {.encoding = ImageEncoding::kLinear}));
  EXPECT_THROW(compare_page_html(page, rgba_image(2, 2), truth, {}), Error);
}

}  // namespace
}  // namespace surfel::test
