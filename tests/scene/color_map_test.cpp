// Colour maps against their published values.

#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/scene/color_map.h>

namespace surfel {
namespace {

constexpr std::array kMaps{ColorMap::kViridis, ColorMap::kTurbo, ColorMap::kTerrain,
                           ColorMap::kGrey};

Vec3f srgb(ColorMap map, double t) {
  const Vec3f linear = map_color(map, t);
  return {linear_to_srgb(linear.x()), linear_to_srgb(linear.y()), linear_to_srgb(linear.z())};
}

double luminance(const Vec3f& c) { return 0.2126 * c.x() + 0.7152 * c.y() + 0.0722 * c.z(); }

/// Entries of a published table of 256 sRGB colours.
using Entries = std::vector<std::pair<int, Vec3f>>;

void expect_near(ColorMap map, const Entries& published, float tolerance) {
  for (const auto& [entry, color] : published) {
    EXPECT_LT((srgb(map, entry / 255.0) - color).cwiseAbs().maxCoeff(), tolerance) << entry;
  }
}

TEST(ColorMap, ViridisIsAsPublished) {
  expect_near(ColorMap::kViridis,
              {{0, {0.267004F, 0.004874F, 0.329415F}},
               {136, {0.120565F, 0.596422F, 0.543611F}},
               {255, {0.993248F, 0.906157F, 0.143936F}}},
              1e-5F);
  // Halfway between the entries that are stored.
  expect_near(ColorMap::kViridis,
              {{4, {0.272594F, 0.025563F, 0.353093F}},
               {44, {0.265145F, 0.232956F, 0.516599F}},
               {124, {0.132444F, 0.552216F, 0.553018F}},
               {156, {0.143303F, 0.669459F, 0.511215F}},
               {204, {0.477504F, 0.821444F, 0.318195F}},
               {244, {0.886271F, 0.892374F, 0.095374F}},
               {252, {0.964894F, 0.902323F, 0.123941F}}},
              0.0022F);
}

TEST(ColorMap, TurboIsAsPublished) {
  expect_near(ColorMap::kTurbo,
              {{0, {0.18995F, 0.07176F, 0.23217F}},
               {136, {0.72596F, 0.9647F, 0.2064F}},
               {255, {0.4796F, 0.01583F, 0.01055F}}},
              1e-5F);
  expect_near(ColorMap::kTurbo,
              {{4, {0.2086F, 0.11802F, 0.34607F}},
               {44, {0.27106F, 0.54015F, 0.9893F}},
               {84, {0.09958F, 0.8904F, 0.72393F}},
               {124, {0.59891F, 0.99638F, 0.26038F}},
               {172, {0.98549F, 0.7125F, 0.2165F}},
               {212, {0.89888F, 0.27824F, 0.04243F}},
               {252, {0.51989F, 0.02756F, 0.0078F}}},
              0.0016F);
}

TEST(ColorMap, GreyIsTheCodeItself) {
  for (const double t : {0.0, 0.25, 0.5, 1.0}) {
    const auto code = static_cast<float>(t);
    EXPECT_LT((srgb(ColorMap::kGrey, t) - Vec3f(code, code, code)).cwiseAbs().maxCoeff(), 1e-6F);
  }
}

// Turbo rises to its yellow, and falls from there.
TEST(ColorMap, LightnessHasNoWiggles) {
  constexpr int kSteps = 2000;
  for (const ColorMap map : kMaps) {
    int turns = 0;
    bool rising = true;
    for (int i = 0; i < kSteps; ++i) {
      const double step = luminance(map_color(map, (i + 1.0) / kSteps)) -
                          luminance(map_color(map, static_cast<double>(i) / kSteps));
      turns += (step > 0) != rising;
      rising = step > 0;
    }
    EXPECT_EQ(turns, map == ColorMap::kTurbo ? 1 : 0) << color_map_name(map);
  }
}

TEST(ColorMap, NumbersOutsideHaveTheColourOfTheNearerEnd) {
  for (const ColorMap map : kMaps) {
    const ColorTable table(map);
    EXPECT_EQ(map_color(map, -3), map_color(map, 0));
    EXPECT_EQ(map_color(map, 1e9), map_color(map, 1));
    EXPECT_EQ(table(-3), map_color(map, 0));
    EXPECT_EQ(table(1e9), map_color(map, 1));
  }
}

TEST(ColorMap, TheTableIsTheMap) {
  for (const ColorMap map : kMaps) {
    const ColorTable table(map);
    for (const double t : {0.0, 0.5, 1.0}) EXPECT_EQ(table(t), map_color(map, t));
    for (int i = 0; i < 1000; ++i) {
      const double t = (i + 0.37) / 1000;
      EXPECT_LT((table(t) - map_color(map, t)).cwiseAbs().maxCoeff(), 1e-5F);
    }
  }
}

TEST(CategoryColor, NumbersNearEachOtherHaveColoursThatDiffer) {
  for (std::int64_t a = -20; a < 60; ++a) {
    const Vec3f own = category_color(a);
    EXPECT_TRUE(own.minCoeff() >= 0 && own.maxCoeff() <= 1);
    for (std::int64_t b = a + 1; b < a + 12; ++b) {
      EXPECT_GT((own - category_color(b)).norm(), 0.1F) << a << ' ' << b;
    }
  }
}

TEST(LasClass, TheStandardsClassesHaveNamesAndColoursOfTheirOwn) {
  EXPECT_EQ(las_class_name(2), "2 ground");
  EXPECT_EQ(las_class_name(6), "6 building");
  EXPECT_EQ(las_class_name(18), "18 high noise");
  EXPECT_EQ(las_class_name(19), "19");
  EXPECT_EQ(las_class_name(-1), "-1");
  EXPECT_EQ(las_class_color(40), category_color(40));
  for (std::int64_t a = 0; a < 19; ++a) {
    for (std::int64_t b = 0; b < a; ++b) {
      EXPECT_GT((las_class_color(a) - las_class_color(b)).norm(), 0.05F) << a << ' ' << b;
    }
  }
}

}  // namespace
}  // namespace surfel
