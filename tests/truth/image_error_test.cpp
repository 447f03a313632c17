#include <cmath>
#include <functional>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/image_io.h>
#include <surfel/truth/image_error.h>

#include "support/test_data.h"

namespace surfel {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();
const ImageErrorOptions kLinear{.encoding = ImageEncoding::kLinear};

Image constant(int width, int height, std::array<float, 4> rgba) {
  Image image{width, height, {"R", "G", "B", "A"}, {}};
  for (int i = 0; i < width * height; ++i) {
    image.data.insert(image.data.end(), rgba.begin(), rgba.end());
  }
  return image;
}

/// Premultiplied, of random straight colours; opaque where `opaque`, else of random alpha.
Image random_image(int width, int height, std::uint64_t seed, bool opaque) {
  Image image = constant(width, height, {0, 0, 0, 1});
  for (int i = 0; i < width * height; ++i) {
    float* p = image.data.data() + 4 * static_cast<std::size_t>(i);
    if (!opaque) p[3] = static_cast<float>(random_uniform(seed, i, 3));
    for (int c = 0; c < 3; ++c) p[c] = static_cast<float>(random_uniform(seed, i, c)) * p[3];
  }
  return image;
}

ErrorKind kind_of_failure(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.kind();
  }
  ADD_FAILURE() << "no error";
  return ErrorKind::kInterrupted;
}

TEST(ImageErrorOptions, DefaultsAreValidAndBadValuesRefused) {
  EXPECT_TRUE(ImageErrorOptions{}.problems().empty());
  const Image image = constant(2, 2, {0, 0, 0, 1});
  for (const double threshold : {-0.1, 1.0, std::nan("")}) {
    const ImageErrorOptions bad{.threshold = threshold};
    EXPECT_EQ(bad.problems().size(), 1U) << threshold;
    EXPECT_EQ(kind_of_failure([&] { image_error(image, image, bad); }), ErrorKind::kUsage);
  }
  const ImageErrorOptions bad{.background = {0, 0, kNan, 1}};
  EXPECT_EQ(bad.problems().size(), 1U);
  EXPECT_EQ(kind_of_failure([&] { difference_image(image, image, {}, 0); }), ErrorKind::kUsage);
}

TEST(ImageError, OfEqualPicturesIsNone) {
  const Image image = random_image(37, 23, 1, false);
  const ImageError e = image_error(image, image);
  EXPECT_EQ(e.pixels, 37U * 23U);
  EXPECT_EQ(e.psnr, kInfinity);
  EXPECT_EQ(e.alpha_psnr, kInfinity);
  for (const double zero : {e.rmse, e.mean_absolute, e.maximum, e.beyond, e.holes}) {
    EXPECT_EQ(zero, 0);
  }
}

TEST(ImageError, OfAConstantOffsetIsTheOffset) {
  const Image truth = constant(64, 40, {0.25F, 0.25F, 0.25F, 1});
  const Image tested = constant(64, 40, {0.375F, 0.375F, 0.375F, 1});
  const ImageError e = image_error(tested, truth, kLinear);
  EXPECT_NEAR(e.rmse, 0.125, 1e-12);
  EXPECT_NEAR(e.mean_absolute, 0.125, 1e-12);
  EXPECT_NEAR(e.maximum, 0.125, 1e-12);
  EXPECT_NEAR(e.psnr, 20 * std::log10(8.0), 1e-9);
  EXPECT_EQ(e.beyond, 1);
}

TEST(ImageError, OfOneChangedChannelIsFoundWithItsPlace) {
  const Image truth = constant(50, 20, {0.5F, 0.5F, 0.5F, 1});
  Image tested = truth;
  tested.pixel(31, 7)[1] = 0;
  const ImageError e = image_error(tested, truth, kLinear);
  EXPECT_EQ(e.maximum, 0.5);
  EXPECT_EQ(e.x, 31);
  EXPECT_EQ(e.y, 7);
  EXPECT_EQ(e.channel, 1);
  EXPECT_NEAR(e.rmse, 0.5 / std::sqrt(3000.0), 1e-12);
  EXPECT_NEAR(e.mean_absolute, 0.5 / 3000, 1e-12);
  EXPECT_NEAR(e.beyond, 1.0 / 1000, 1e-12);
}

TEST(ImageError, EqualsTheSumsOverAllValues) {
  const Image a = random_image(211, 97, 1, true);
  const Image b = random_image(211, 97, 2, true);
  double sum = 0;
  double squares = 0;
  double largest = 0;
  std::size_t beyond = 0;
  for (std::size_t i = 0; i < a.data.size(); i += 4) {
    bool is_beyond = false;
    for (std::size_t c = 0; c < 3; ++c) {
      const double d =
          std::abs(double{linear_to_srgb(a.data[i + c])} - double{linear_to_srgb(b.data[i + c])});
      sum += d;
      squares += d * d;
      largest = std::max(largest, d);
      is_beyond = is_beyond || d > 0.3;
    }
    beyond += is_beyond ? 1 : 0;
  }
  const double pixels = 211.0 * 97;
  const ImageError e = image_error(a, b, {.threshold = 0.3});
  EXPECT_NEAR(e.mean_absolute, sum / (3 * pixels), 1e-7);
  EXPECT_NEAR(e.rmse, std::sqrt(squares / (3 * pixels)), 1e-7);
  EXPECT_NEAR(e.maximum, largest, 1e-6);
  EXPECT_NEAR(e.beyond, static_cast<double>(beyond) / pixels, 1e-12);
  const auto seen = [&](const Image& image) {
    return double{linear_to_srgb(image.pixel(e.x, e.y)[e.channel])};
  };
  EXPECT_EQ(std::abs(seen(a) - seen(b)), e.maximum);
}

TEST(ImageError, SrgbComparesWhatIsSeen) {
  // Darks differ more than their light does; beyond 0..1 nothing is seen.
  const Image dark = constant(8, 8, {0, 0, 0, 1});
  const Image grey = constant(8, 8, {srgb8_to_linear(51), srgb8_to_linear(51), 0, 1});
  EXPECT_NEAR(image_error(grey, dark).maximum, 0.2, 1e-6);
  EXPECT_NEAR(image_error(grey, dark, kLinear).maximum, srgb8_to_linear(51), 1e-7);
  const Image white = constant(8, 8, {1, 1, 1, 1});
  const Image sun = constant(8, 8, {9, 1, 1, 1});
  EXPECT_EQ(image_error(sun, white).maximum, 0);
  // The peak is 1 whatever the pictures hold: rms = 8 / sqrt(3).
  EXPECT_NEAR(image_error(sun, white, kLinear).psnr, -20 * std::log10(8 / std::sqrt(3.0)), 1e-9);
}

TEST(ImageError, ThresholdLetsTheRoundingOf8BitsPass) {
  for (int level = 0; level < 254; ++level) {
    const auto grey = [](int value) {
      const float v = srgb8_to_linear(static_cast<std::uint8_t>(value));
      return constant(2, 2, {v, v, v, 1});
    };
    EXPECT_EQ(image_error(grey(level + 1), grey(level)).beyond, 0) << level;
    EXPECT_EQ(image_error(grey(level + 2), grey(level)).beyond, 1) << level;
  }
}

TEST(ImageError, BackgroundShowsWhereAlphaIsMissing) {
  const Image empty = constant(8, 8, {0, 0, 0, 0});
  const Image black = constant(8, 8, {0, 0, 0, 1});
  const Image half = constant(8, 8, {0, 0, 0, 0.5F});
  EXPECT_EQ(image_error(empty, black).maximum, 0);
  ImageErrorOptions over = kLinear;
  over.background = {1, 0.5F, 0.25F, 1};
  EXPECT_NEAR(image_error(empty, black, over).mean_absolute, 1.75 / 3, 1e-7);
  EXPECT_NEAR(image_error(half, black, over).mean_absolute, 1.75 / 6, 1e-7);
  over.background[3] = 0.5F;
  EXPECT_NEAR(image_error(empty, black, over).mean_absolute, 1.75 / 6, 1e-7);
  EXPECT_NEAR(image_error(half, black).alpha_psnr, 20 * std::log10(2.0), 1e-9);
}

TEST(ImageError, HolesAreWhereASolidTruthIsMissing) {
  Image truth = constant(10, 10, {0.5F, 0.5F, 0.5F, 1});
  for (int x = 0; x < 10; ++x) truth.pixel(x, 0)[3] = 0.9F;  // Not solid: 90 pixels are left.
  Image tested = truth;
  tested.pixel(3, 0)[3] = 0;      // Nothing solid is missing there.
  tested.pixel(3, 4)[3] = 0.51F;  // Thin, no hole.
  tested.pixel(4, 4)[3] = 0.49F;
  tested.pixel(5, 4)[3] = 0;
  tested.pixel(6, 4)[3] = kNan;
  EXPECT_NEAR(image_error(tested, truth).holes, 3.0 / 90, 1e-12);
  EXPECT_EQ(image_error(truth, truth).holes, 0);
  EXPECT_EQ(image_error(truth, constant(10, 10, {0, 0, 0, 0.5F})).holes, 0);
}

TEST(ImageError, InsideOnlyLeavesTheSilhouetteOut) {
  Image truth = constant(10, 10, {0.5F, 0.5F, 0.5F, 1});
  Image tested = constant(10, 10, {0.25F, 0.25F, 0.25F, 1});
  for (int y = 0; y < 10; ++y) {
    truth.pixel(0, y)[3] = 0.98F;
    tested.pixel(1, y)[3] = 0;
    for (const int x : {0, 1}) std::fill_n(tested.pixel(x, y), 3, 1.0F);
  }
  ImageErrorOptions inside = kLinear;
  inside.inside_only = true;
  const ImageError e = image_error(tested, truth, inside);
  EXPECT_EQ(e.pixels, 80U);
  EXPECT_NEAR(e.rmse, 0.25, 1e-12);
  EXPECT_NEAR(e.mean_absolute, 0.25, 1e-12);
  EXPECT_EQ(e.maximum, 0.25);
  EXPECT_EQ(e.beyond, 1);
  EXPECT_NEAR(e.holes, 10.0 / 90, 1e-12);  // Alpha is still looked at everywhere.
  EXPECT_NEAR(e.alpha_psnr, -10 * std::log10((10 + 10 * 0.02 * 0.02) / 100), 1e-5);
  EXPECT_GT(image_error(tested, truth, kLinear).rmse, 0.25);
}

TEST(ImageError, NothingToCompareIsAnError) {
  const Image thin = constant(4, 4, {0.2F, 0.2F, 0.2F, 0.5F});
  EXPECT_EQ(kind_of_failure([&] { image_error(thin, thin, {.inside_only = true}); }),
            ErrorKind::kInput);
  EXPECT_EQ(kind_of_failure([] { image_error(constant(0, 0, {}), constant(0, 0, {})); }),
            ErrorKind::kInput);
}

TEST(ImageError, ValuesThatAreNotFiniteAreWrongByFullScale) {
  const Image truth = constant(10, 10, {0.5F, 0.5F, 0.5F, 1});
  for (const float bad : {kNan, kInfinity, -kInfinity}) {
    for (const int channel : {0, 1, 2, 3}) {
      for (const bool inside : {false, true}) {
        Image tested = truth;
        tested.pixel(3, 4)[channel] = bad;
        tested.pixel(8, 9)[channel] = bad;
        ImageErrorOptions options;
        options.inside_only = inside;
        const ImageError e = image_error(tested, truth, options);
        EXPECT_EQ(e.nonfinite, 2U);
        EXPECT_EQ(e.pixels, 100U);
        EXPECT_NEAR(e.beyond, 0.02, 1e-12);
        EXPECT_NEAR(e.psnr, -10 * std::log10(0.02), 1e-9);
        EXPECT_EQ(e.maximum, 1);
        EXPECT_EQ(e.x, 3);
        EXPECT_EQ(e.y, 4);
        // In both pictures it is no better than in one.
        EXPECT_EQ(image_error(tested, tested, options).nonfinite, 2U);
        EXPECT_EQ(image_error(truth, tested, options).nonfinite, 2U);
        EXPECT_EQ(difference_image(tested, truth, options, 1).pixel(8, 9)[2], 1);
      }
    }
  }
}

TEST(ImageError, PicturesThatDoNotMatchAreRefused) {
  const Image a = constant(64, 48, {0, 0, 0, 1});
  const Image b = constant(48, 64, {0, 0, 0, 1});
  try {
    image_error(a, b);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInput);
    EXPECT_NE(std::string(error.what()).find("64 x 48"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("48 x 64"), std::string::npos) << error.what();
  }
  Image no_color = a;
  no_color.channels = {"X", "Y", "Z", "A"};
  EXPECT_EQ(kind_of_failure([&] { image_error(no_color, a); }), ErrorKind::kInput);
}

TEST(ImageError, ChannelsAreFoundByName) {
  const Image truth = random_image(9, 7, 5, false);
  Image tested{9, 7, {"Z", "A", "B", "G", "R"}, {}};
  for (std::size_t i = 0; i < truth.data.size(); i += 4) {
    const float* p = truth.data.data() + i;
    for (const float value : {kNan, p[3], p[2], p[1], p[0]}) tested.data.push_back(value);
  }
  const ImageError e = image_error(tested, truth);
  EXPECT_EQ(e.psnr, kInfinity);
  EXPECT_EQ(e.alpha_psnr, kInfinity);
  EXPECT_EQ(e.nonfinite, 0U);

  Image opaque{1, 1, {"R", "G", "B"}, {}};
  opaque.data = {0.5F, 0.5F, 0.5F};
  EXPECT_EQ(image_error(opaque, constant(1, 1, {0.5F, 0.5F, 0.5F, 1})).alpha_psnr, kInfinity);
}

TEST(ImageError, SameForAnyNumberOfThreads) {
  const Image a = random_image(160, 120, 1, false);
  const Image b = random_image(160, 120, 2, false);
  set_thread_count(1);
  const ImageError one = image_error(a, b);
  const Image one_difference = difference_image(a, b);
  set_thread_count(4);
  const ImageError four = image_error(a, b);
  const Image four_difference = difference_image(a, b);
  set_thread_count(0);
  EXPECT_EQ(one.rmse, four.rmse);
  EXPECT_EQ(one.mean_absolute, four.mean_absolute);
  EXPECT_EQ(one.holes, four.holes);
  EXPECT_EQ(one.alpha_psnr, four.alpha_psnr);
  EXPECT_EQ(one_difference.data, four_difference.data);
}

TEST(ImageError, OfAPngFromItsExrIsTheRoundingOf8Bits) {
  const test::TemporaryFolder folder;
  const std::string exr = folder / "a.exr";
  const std::string png = folder / "a.png";
  const auto error = [&](const Image& image) {
    write_image(image, exr);
    write_image(image, png);
    return image_error(read_premultiplied_image(png), read_premultiplied_image(exr));
  };
  const ImageError opaque = error(random_image(64, 64, 3, true));
  EXPECT_LE(opaque.maximum, 0.5 / 255 + 1e-6);
  EXPECT_GT(opaque.maximum, 0.45 / 255);
  EXPECT_EQ(opaque.alpha_psnr, kInfinity);

  // Alpha is rounded, too; near 0 the curve is 12.92 times as steep.
  const ImageError translucent = error(random_image(64, 64, 3, false));
  EXPECT_LE(translucent.maximum, 0.5 / 255 * (1 + 12.92));
  EXPECT_EQ(translucent.holes, 0);
  EXPECT_GT(translucent.psnr, 50);
  EXPECT_GT(translucent.alpha_psnr, 55);
}

TEST(ReadPremultipliedImage, KeepsWhatAnExrStores) {
  const test::TemporaryFolder folder;
  Image image = random_image(16, 16, 4, false);
  std::fill_n(image.pixel(2, 3), 4, 0.0F);
  image.pixel(2, 3)[0] = 0.75F;  // Light without opacity.
  write_image(image, folder / "a.exr");
  EXPECT_EQ(read_premultiplied_image(folder / "a.exr").data, image.data);
}

TEST(DifferenceImage, ShowsTheScaledDifferences) {
  Image truth = constant(3, 2, {0.25F, 0.5F, 0.5F, 1});
  Image tested = constant(3, 2, {0.5F, 0.5F, 0.25F, 1});
  truth.pixel(1, 1)[3] = 0;
  ImageErrorOptions options = kLinear;
  options.inside_only = true;
  const Image linear = difference_image(tested, truth, options, 3);
  EXPECT_EQ(linear.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
  EXPECT_EQ((std::vector<float>(linear.pixel(2, 1), linear.pixel(2, 1) + 4)),
            (std::vector<float>{0.75F, 0, 0.75F, 1}));
  EXPECT_EQ((std::vector<float>(linear.pixel(1, 1), linear.pixel(1, 1) + 4)),
            (std::vector<float>{0, 0, 0, 1}));

  // 3 levels of 8 bits, ten times: 30 levels.
  const Image dark = constant(2, 2, {srgb8_to_linear(100), 0, 0, 1});
  const Image light = constant(2, 2, {srgb8_to_linear(103), 0, 0, 1});
  EXPECT_EQ(linear_to_srgb8(difference_image(light, dark).pixel(0, 0)[0]), 30);
}

}  // namespace
}  // namespace surfel
