#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/truth/flicker.h>

namespace surfel {
namespace {

/// A grey picture of an sRGB value.
Image grey(float encoded, int width = 3, int height = 2) {
  Image image;
  image.width = width;
  image.height = height;
  image.channels = {"R", "G", "B", "A"};
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  for (std::size_t i = 0; i < pixels; ++i) {
    for (int c = 0; c < 3; ++c) image.data.push_back(srgb_to_linear(encoded));
    image.data.push_back(1);
  }
  return image;
}

TEST(Flicker, IsTheChangeBesideTheTruths) {
  // The truth brightens by 0.1 a frame, the tested pictures do not change.
  EXPECT_NEAR(flicker({grey(0.5F), grey(0.5F), grey(0.5F)}, {grey(0.2F), grey(0.3F), grey(0.4F)}),
              0.1, 1e-6);
  // One of two changes is 0.2, the other none.
  EXPECT_NEAR(flicker({grey(0.5F), grey(0.7F), grey(0.7F)}, {grey(0), grey(0), grey(0)}),
              0.2 / std::sqrt(2.0), 1e-6);
}

TEST(Flicker, ForgivesAnErrorThatStays) {
  EXPECT_NEAR(flicker({grey(0.4F), grey(0.5F)}, {grey(0.2F), grey(0.3F)}), 0, 1e-6);
}

TEST(Flicker, CountsThePixelsThatFlicker) {
  Image flash = grey(0, 10, 10);
  for (int c = 0; c < 3; ++c) flash.pixel(4, 7)[c] = 1;
  // One of a hundred pixels changes by 1.
  EXPECT_NEAR(flicker({grey(0, 10, 10), flash}, {grey(0, 10, 10), grey(0, 10, 10)}), 0.1, 1e-6);
}

TEST(Flicker, RefusesWhatDoesNotGoTogether) {
  EXPECT_THROW(flicker({grey(0)}, {grey(0)}), Error);
  EXPECT_THROW(flicker({grey(0), grey(0)}, {grey(0)}), Error);
  EXPECT_THROW(flicker({grey(0), grey(0, 4)}, {grey(0), grey(0)}), Error);
  EXPECT_THROW(flicker({grey(0), grey(0, 4)}, {grey(0), grey(0, 4)}), Error);
  Image no_red = grey(0);
  no_red.channels[0] = "Z";
  EXPECT_THROW(flicker({grey(0), no_red}, {grey(0), grey(0)}), Error);
}

}  // namespace
}  // namespace surfel
