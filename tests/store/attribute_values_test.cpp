// What surfels can be coloured by, and the colours that come of it.

#include <cmath>
#include <cstring>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/store/attribute_values.h>
#include <surfel/store/colored_source.h>
#include <surfel/store/render_cloud.h>

#include "support/message_of.h"

namespace surfel {
namespace {

constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();

template <class T>
void add_column(SurfelCloud& cloud, const std::string& name, ScalarType type,
                const std::vector<T>& values) {
  ExtraProperty& column = cloud.extra.emplace_back(ExtraProperty{name, type, {}});
  column.data.resize(values.size() * sizeof(T));
  std::memcpy(column.data.data(), values.data(), column.data.size());
}

/// Surfels along x, half a unit apart, of radius 1 and spacing 3.
SurfelCloud row(std::size_t count) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    cloud.position.emplace_back(static_cast<float>(i) / 2, 2.0F, 5.0F);
    cloud.normal.emplace_back(0.0F, 0.0F, 1.0F);
    cloud.variance.push_back(0.5F);
    cloud.area.push_back(9);
  }
  return cloud;
}

AttributeSummary summary(const SurfelCloud& cloud, const std::string& name,
                         const Vec3d& up = {0, 0, 1}) {
  const CloudSource source(cloud, "row");
  return AttributeValues(source, name, up, "row").summary(0, source.size());
}

TEST(AttributeValues, PercentilesAreThoseOfTheRank) {
  const AttributeSummary x = summary(row(1001), "x");
  EXPECT_EQ(x.count, 1001u);
  EXPECT_EQ(x.min, 0);
  EXPECT_EQ(x.percentile_1, 5);
  EXPECT_EQ(x.median, 250);
  EXPECT_EQ(x.percentile_99, 495);
  EXPECT_EQ(x.max, 500);
  EXPECT_EQ(x.robust_range(), std::pair(5.0, 495.0));
}

TEST(AttributeValues, ComeFromPlacesAndSizes) {
  SurfelCloud cloud = row(3);
  cloud.origin = {512000, 5400000, 200};
  EXPECT_EQ(summary(cloud, "y").median, 5400002);
  EXPECT_EQ(summary(cloud, "elevation").median, 205);
  EXPECT_EQ(summary(cloud, "elevation", {0, -2, 0}).median, -5400002) << "up is made unit";
  EXPECT_NEAR(summary(cloud, "radius").median, 1, 1e-6);
  EXPECT_NEAR(summary(cloud, "spacing").median, 3, 1e-6);
  EXPECT_NEAR(summary(cloud, "density").median, 1.0 / 9, 1e-7);
}

TEST(AttributeValues, NamesAreFoundAsProgramsSpellThem) {
  SurfelCloud cloud = row(2);
  add_column<float>(cloud, "scalar_Intensity", ScalarType::kFloat32, {1, 2});
  add_column<std::uint8_t>(cloud, "label", ScalarType::kUint8, {1, 2});
  cloud.group = {4, 7};
  const CloudSource source(cloud, "row");
  EXPECT_EQ(AttributeValues::find(source, "intensity"), "scalar_Intensity");
  EXPECT_EQ(AttributeValues::find(source, "classification"), "label");
  EXPECT_EQ(AttributeValues::find(source, "Z"), "z");
  EXPECT_EQ(AttributeValues::find(source, "group"), "group");
  EXPECT_EQ(AttributeValues::find(source, "confidence"), std::nullopt);
  const std::string message =
      test::message_of([&] { AttributeValues(source, "elevatoin", Vec3d::UnitZ(), "row.ply"); });
  EXPECT_EQ(message.find("row.ply: "), 0u) << message;
  EXPECT_NE(message.find("did you mean elevation?"), std::string::npos) << message;
  EXPECT_NE(message.find("group, scalar_Intensity, label"), std::string::npos) << message;
}

TEST(AttributeValues, AFilesOwnColumnWins) {
  SurfelCloud cloud = row(2);
  add_column<float>(cloud, "density", ScalarType::kFloat32, {40, 40});
  EXPECT_EQ(summary(cloud, "density").median, 40);
}

TEST(AttributeValues, WhatIsNoNumberIsMissing) {
  SurfelCloud cloud = row(5);
  const float infinity = std::numeric_limits<float>::infinity();
  add_column<float>(cloud, "v", ScalarType::kFloat32, {kNoNumber, 3, -1, infinity, 2});
  cloud.position[2].x() = kNoNumber;  // Not drawn, so that its value does not count.
  const AttributeSummary v = summary(cloud, "v");
  EXPECT_EQ(v.count, 2u);
  EXPECT_EQ(v.missing, 2u);
  EXPECT_EQ(v.min, 2);
  EXPECT_EQ(v.max, 3);
}

TEST(AttributeValues, CategoriesAreCounted) {
  SurfelCloud cloud = row(6);
  add_column<float>(cloud, "class", ScalarType::kFloat32, {2, 6, 2, 2.5F, kNoNumber, -1});
  const AttributeSummary c = summary(cloud, "classification");
  EXPECT_EQ(c.categories, (std::map<std::int64_t, std::size_t>{{-1, 1}, {2, 2}, {6, 1}}));
  EXPECT_EQ(c.missing, 2u) << "2.5 is no class";
}

TEST(AttributeValues, MoreValuesThanAreSampledGiveNearlyTheSamePercentiles) {
  const std::size_t count = (std::size_t{1} << 20) + 700001;
  const AttributeSummary x = summary(row(count), "x");
  const double last = static_cast<double>(count - 1) / 2;
  EXPECT_EQ(x.count, count);
  EXPECT_EQ(x.max, last);
  // Five standard errors of a percentile of a million values.
  EXPECT_NEAR(x.percentile_1 / last, 0.01, 5e-4);
  EXPECT_NEAR(x.median / last, 0.5, 2.5e-3);
  EXPECT_NEAR(x.percentile_99 / last, 0.99, 5e-4);
}

TEST(AttributeValues, AConstantColumnHasOneValueForARange) {
  SurfelCloud cloud = row(300);
  std::vector<float> values(300, 4.0F);
  add_column(cloud, "same", ScalarType::kFloat32, values);
  values[7] = 5;
  add_column(cloud, "nearly", ScalarType::kFloat32, values);
  EXPECT_EQ(summary(cloud, "same").robust_range(), std::pair(4.0, 4.0));
  EXPECT_EQ(summary(cloud, "nearly").robust_range(), std::pair(4.0, 5.0)) << "all values";
}

TEST(AttributeValues, StrayPointsDoNotStretchTheRange) {
  SurfelCloud cloud = row(1001);
  cloud.origin = {1000, 0, 0};
  for (int i = 0; i < 200; ++i) {
    cloud.position.insert(cloud.position.begin(), Vec3f(-90000, 0, 0));
    cloud.normal.emplace_back(0.0F, 0.0F, 1.0F);
    cloud.variance.push_back(0.5F);
    cloud.area.push_back(9);
  }
  const AttributeSummary x = summary(cloud, "x");
  EXPECT_EQ(x.percentile_1, -89000);
  EXPECT_EQ(x.robust_range(), std::pair(1005.0, 1495.0));
}

RenderCloud colored(const SurfelCloud& cloud, const std::string& name,
                    const AttributeColors& colors) {
  CloudSource inner(cloud, "row");
  const AttributeValues values(inner, name, Vec3d::UnitZ(), "row");
  ColoredSource source(inner, values, colors);
  return RenderCloud(source, {}, "row");
}

Vec3f color_at(const RenderCloud& cloud, float x) {
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (std::abs(static_cast<float>(cloud.origin().x()) + cloud.x[i] - x) < 0.01F) {
      return {cloud.red[i], cloud.green[i], cloud.blue[i]};
    }
  }
  ADD_FAILURE() << "no surfel at " << x;
  return {};
}

TEST(ColoredSource, NumbersHaveTheMapsColours) {
  SurfelCloud cloud = row(9);
  cloud.color.assign(9, Vec3f(1, 0, 0));
  const RenderCloud c = colored(cloud, "x", {.map = ColorMap::kTurbo, .min = 1, .max = 3});
  EXPECT_EQ(color_at(c, 0), map_color(ColorMap::kTurbo, 0)) << "below the range";
  EXPECT_EQ(color_at(c, 1), map_color(ColorMap::kTurbo, 0));
  EXPECT_EQ(color_at(c, 2), map_color(ColorMap::kTurbo, 0.5));
  EXPECT_EQ(color_at(c, 3), map_color(ColorMap::kTurbo, 1));
  EXPECT_EQ(color_at(c, 4), map_color(ColorMap::kTurbo, 1));
}

TEST(AttributeColors, AColourHasItsValueBack) {
  for (const ColorMap map :
       {ColorMap::kViridis, ColorMap::kTurbo, ColorMap::kTerrain, ColorMap::kGrey}) {
    const AttributeColors colors{.map = map, .min = -50, .max = 150};
    for (int i = 0; i <= 40; ++i) {
      const double value = -50 + 5 * i;
      const auto found = colors.value_of(map_color(map, colors.place(value)));
      ASSERT_TRUE(found) << color_map_name(map);
      EXPECT_NEAR(*found, value, 0.2) << color_map_name(map);
    }
    EXPECT_NEAR(*colors.value_of(map_color(map, 7)), 150, 0.2) << "beyond the end";
  }
  EXPECT_FALSE(AttributeColors{}.value_of(missing_color()));
}

TEST(ColoredSource, AMiddleColourForARangeOfNoWidth) {
  const RenderCloud c = colored(row(3), "y", {.map = ColorMap::kViridis, .min = 2, .max = 2});
  EXPECT_EQ(color_at(c, 1), map_color(ColorMap::kViridis, 0.5));
}

TEST(ColoredSource, ClassesHaveTheirOwnColoursAndMissingValuesGrey) {
  SurfelCloud cloud = row(3);
  add_column<float>(cloud, "classification", ScalarType::kFloat32, {2, kNoNumber, 6});
  const RenderCloud c = colored(cloud, "classification", {});
  EXPECT_EQ(color_at(c, 0), las_class_color(2));
  EXPECT_EQ(color_at(c, 0.5F), missing_color());
  EXPECT_EQ(color_at(c, 1), las_class_color(6));
}

TEST(ColoredSource, NormalsAreCodes) {
  SurfelCloud cloud = row(3);
  cloud.normal[1] = {0, -1, 0};
  cloud.normal[2] = {0, 0, 0};
  const RenderCloud c = colored(cloud, "normal", {});
  const float half = srgb_to_linear(0.5F);
  EXPECT_EQ(color_at(c, 0), Vec3f(half, half, 1));
  EXPECT_EQ(color_at(c, 0.5F), Vec3f(half, 0, half));
  EXPECT_EQ(color_at(c, 1), missing_color()) << "unknown";
}

}  // namespace
}  // namespace surfel
