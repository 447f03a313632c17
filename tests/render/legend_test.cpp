// Legends: their ticks, and where they lie in a picture.

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/render/legend.h>
#include <surfel/scene/glyphs.h>

namespace surfel {
namespace {

std::vector<std::string> texts(double min, double max, int most) {
  std::vector<std::string> out;
  for (const Tick& tick : round_ticks(min, max, most)) out.push_back(tick.text);
  return out;
}

using Texts = std::vector<std::string>;

TEST(Ticks, AreRoundNumbersWithTheDecimalsThatTheyNeed) {
  EXPECT_EQ(texts(0, 1, 6), (Texts{"0.0", "0.2", "0.4", "0.6", "0.8", "1.0"}));
  EXPECT_EQ(texts(0, 0.31, 5), (Texts{"0.0", "0.1", "0.2", "0.3"}));
  EXPECT_EQ(texts(295.6, 403.1, 6), (Texts{"300", "320", "340", "360", "380", "400"}));
  EXPECT_EQ(texts(-7, 12, 5), (Texts{"-5", "0", "5", "10"}));
  EXPECT_EQ(texts(5403547.5, 5403850, 4), (Texts{"5403600", "5403700", "5403800"}));
  EXPECT_EQ(texts(1e-7, 4e-7, 4), (Texts{"1e-07", "2e-07", "3e-07", "4e-07"}));
  EXPECT_EQ(texts(5, 5, 4), (Texts{"5"}));
}

TEST(Ticks, AreWithinTheRangeAndNeverTooMany) {
  for (const double size : {1e-9, 0.003, 0.7, 1.0, 42.0, 1e6}) {
    for (const double start : {-1e5, -3.3, 0.0, 0.1, 5e6}) {
      if (start + size == start) continue;
      for (int most = 2; most < 12; ++most) {
        const std::vector<Tick> ticks = round_ticks(start, start + size, most);
        EXPECT_LE(ticks.size(), static_cast<std::size_t>(most));
        for (const Tick& tick : ticks) {
          EXPECT_GE(tick.value, start - 1e-6 * size);
          EXPECT_LE(tick.value, start + size * (1 + 1e-6));
        }
        for (std::size_t i = 1; i < ticks.size(); ++i) {
          EXPECT_NE(ticks[i].text, ticks[i - 1].text);
        }
      }
    }
  }
}

Image grey_picture(int width, int height) {
  Image image = rgba_image(width, height);
  std::fill(image.data.begin(), image.data.end(), 0.5F);
  return image;
}

/// The box of the pixels that are not as they were: left, top, right, bottom; one past the last.
std::array<int, 4> changed(const Image& image) {
  std::array<int, 4> box{image.width, image.height, 0, 0};
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const float* p = image.pixel(x, y);
      if (std::all_of(p, p + 4, [](float v) { return v == 0.5F; })) continue;
      box = {std::min(box[0], x), std::min(box[1], y), std::max(box[2], x + 1),
             std::max(box[3], y + 1)};
    }
  }
  return box;
}

Legend classes(std::size_t count) {
  Legend legend{.title = "classification"};
  for (std::size_t i = 0; i < count; ++i) {
    const auto number = static_cast<std::int64_t>(i);
    legend.entries.push_back({las_class_color(number), las_class_name(number), i});
  }
  return legend;
}

TEST(Legend, StaysInsideOfPicturesOfAllSizes) {
  const std::array legends{Legend{.title = "elevation", .min = 295.6, .max = 403.1},
                           Legend{.title = std::string(200, 'W'), .min = -5e6, .max = -4.99999e6},
                           Legend{.title = "flat", .min = 7, .max = 7}, classes(3), classes(300)};
  for (const auto& [width, height] : {std::pair{64, 64},
                                      {255, 4096},
                                      {256, 256},
                                      {256, 4096},
                                      {4096, 256},
                                      {300, 1100},
                                      {512, 512},
                                      {1920, 1080}}) {
    for (const Legend& legend : legends) {
      Image image = grey_picture(width, height);
      const bool room = std::min(width, height) >= Legend::kLeastPixels;
      ASSERT_EQ(draw_legend(legend, image), room);
      const auto [left, top, right, bottom] = changed(image);
      if (!room) {
        EXPECT_EQ(right, 0) << "nothing is drawn";
        continue;
      }
      // The panel leaves a margin, so that nothing of it was cut off.
      EXPECT_GT(left, 0) << width << 'x' << height << ' ' << legend.title;
      EXPECT_GT(top, 0) << width << 'x' << height << ' ' << legend.title;
      EXPECT_LT(right, width);
      EXPECT_LT(bottom, height);
      EXPECT_GT(left + right, width) << "at the right";
      EXPECT_GT(top + bottom, height) << "at the bottom";
    }
  }
}

TEST(Legend, TheBarHasTheMapsColours) {
  Image image = grey_picture(512, 512);
  draw_legend({.title = "z", .map = ColorMap::kViridis, .min = 0, .max = 1}, image);
  // The pixel that comes nearest to the map's colour at t.
  const auto place = [&](double t) {
    const Vec3f color = map_color(ColorMap::kViridis, t);
    float least = 1;
    Eigen::Vector2i at(0, 0);
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        const float* p = image.pixel(x, y);
        const float off = (color - Vec3f(p[0], p[1], p[2])).norm();
        if (off < least) at = {x, y};
        least = std::min(least, off);
      }
    }
    EXPECT_LT(least, 0.01F);
    return at;
  };
  const Eigen::Vector2i low = place(0.01);
  const Eigen::Vector2i middle = place(0.5);
  const Eigen::Vector2i high = place(0.99);
  EXPECT_EQ(low.x(), high.x());
  EXPECT_EQ(low.x(), middle.x());
  EXPECT_GT(low.y() - high.y(), 100);
  EXPECT_NEAR(middle.y(), (low.y() + high.y()) / 2.0, 2);
}

TEST(Legend, ShowsTheClassesOfMostPointsWhereThereIsNoRoom) {
  Image few = grey_picture(256, 256);
  Image all = grey_picture(256, 256);
  draw_legend(classes(10), few);
  draw_legend(classes(400), all);
  EXPECT_LT(changed(all)[1], changed(few)[1]);
  const Vec3f rare = las_class_color(2);
  for (std::size_t i = 0; i < all.data.size(); i += 4) {
    EXPECT_GT((Vec3f(all.data[i], all.data[i + 1], all.data[i + 2]) - rare).norm(), 1e-3F);
  }
}

TEST(Glyphs, TextCoversAsMuchAtAnySize) {
  // Ink by the square of the height, which resolution must not change.
  const auto ink = [](double height) {
    Image image = rgba_image(2000, 150);
    std::fill(image.data.begin(), image.data.end(), 0.0F);
    draw_text(image, "Elevation 0123456789", 3.3, 1.2 * height, height, {1, 1, 1});
    double sum = 0;
    for (std::size_t i = 3; i < image.data.size(); i += 4) sum += image.data[i];
    return sum / (height * height);
  };
  const double large = ink(80);
  EXPECT_GT(large, 1);
  for (const double height : {7.0, 11.5, 30.0}) EXPECT_NEAR(ink(height) / large, 1, 0.06) << height;
}

TEST(Glyphs, WidthIsThatOfTheInk) {
  Image image = rgba_image(400, 60);
  std::fill(image.data.begin(), image.data.end(), 0.0F);
  const std::string text = "Hxm 80";
  draw_text(image, text, 20, 40, 20, {1, 1, 1});
  int left = image.width;
  int right = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (image.pixel(x, y)[3] < 0.3F) continue;
      left = std::min(left, x);
      right = std::max(right, x + 1);
    }
  }
  EXPECT_NEAR(left, 20, 1.1);
  EXPECT_NEAR(right - left, 20 * text_width(text), 2.2);
}

TEST(Glyphs, TextBeyondThePictureIsLeftOut) {
  Image image = rgba_image(16, 16);
  std::fill(image.data.begin(), image.data.end(), 0.0F);
  draw_text(image, "\xC3\xA4 outside ~{}", -30, 4, 30, {1, 1, 1});
  draw_text(image, "x", 1000, 1000, 9, {1, 1, 1});
  for (const float v : image.data) EXPECT_TRUE(v >= 0 && v <= 1);
}

}  // namespace
}  // namespace surfel
