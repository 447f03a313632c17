// What the fields of LAS and LAZ hold of columns whose values may not fit.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>

#include "io/cloud_of_bytes.h"
#include "support/cases.h"
#include "support/message_of.h"
#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

using FieldValues = std::vector<double>;
constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

ExtraProperty column_of(const std::string& name, ScalarType type, const FieldValues& values) {
  ExtraProperty column{name, type, {}};
  for (const double value : values) {
    visit_type(type, [&]<class T>(T) {
      const auto stored = static_cast<T>(value);
      const auto* bytes = reinterpret_cast<const std::byte*>(&stored);
      column.data.insert(column.data.end(), bytes, bytes + sizeof(T));
    });
  }
  return column;
}

SurfelCloud cloud_with(std::vector<ExtraProperty> columns, std::size_t count) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < count; ++i)
    cloud.position.emplace_back(static_cast<float>(i), 2.0F, 3.0F);
  cloud.extra = std::move(columns);
  return cloud;
}

/// A number of a LAS file's bytes.
template <class T>
T las_number(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

int point_format_of(const std::string& las) { return las.at(104); }

/// Where a field is in points, by the tables of the LAS 1.4 specification.
struct FieldPlace {
  std::size_t at;
  char type;  ///< b: some bits of a byte, B: a byte, s and S: 16 bits, signed or not, d: a double.
  int shift = 0;
  int bits = 8;
};

FieldPlace field_place(const std::string& name, int format) {
  const bool more = format >= 6;
  if (name == "intensity") return {12, 'S'};
  if (name == "return_number") return more ? FieldPlace{14, 'b', 0, 4} : FieldPlace{14, 'b', 0, 3};
  if (name == "number_of_returns")
    return more ? FieldPlace{14, 'b', 4, 4} : FieldPlace{14, 'b', 3, 3};
  if (name == "withheld") return more ? FieldPlace{15, 'b', 2, 1} : FieldPlace{15, 'b', 7, 1};
  if (name == "scanner_channel") return {15, 'b', 4, 2};
  if (name == "classification") return more ? FieldPlace{16, 'B'} : FieldPlace{15, 'b', 0, 5};
  if (name == "scan_angle") return {18, 's'};
  if (name == "scan_angle_rank") return {16, 'c'};
  if (name == "user_data") return {17, 'B'};
  if (name == "point_source_id") return {more ? 20U : 18U, 'S'};
  if (name == "gps_time") return {more ? 22U : 20U, 'd'};
  return {36, 'S'};  // nir
}

FieldValues field_of(const std::string& las, const std::string& name) {
  const FieldPlace place = field_place(name, point_format_of(las));
  const std::size_t begin = las_number<std::uint32_t>(las, 96);
  const std::size_t stride = las_number<std::uint16_t>(las, 105);
  FieldValues values;
  for (std::size_t p = begin; p + stride <= las.size(); p += stride) {
    const std::size_t at = p + place.at;
    switch (place.type) {
      case 's':
        values.push_back(las_number<std::int16_t>(las, at));
        break;
      case 'S':
        values.push_back(las_number<std::uint16_t>(las, at));
        break;
      case 'c':
        values.push_back(las_number<std::int8_t>(las, at));
        break;
      case 'd':
        values.push_back(las_number<double>(las, at));
        break;
      default:
        values.push_back(las_number<std::uint8_t>(las, at) >> place.shift &
                         ((1 << place.bits) - 1));
    }
  }
  return values;
}

struct FieldCase {
  const char* column;
  FieldValues values;
  FieldValues stored;
  int format;
  std::string note;  ///< Empty: none.
};

/// FieldValues of which the last ones, fewer than one in a hundred, are these.
FieldValues mostly_whole(double most, const FieldValues& last) {
  FieldValues values;
  for (int i = 0; i < 1000; ++i) values.push_back(std::fmod(37 * i, most + 1));
  values.insert(values.end(), last.begin(), last.end());
  return values;
}

FieldValues eleven_times(const FieldValues& values) {
  FieldValues all;
  for (int i = 0; i < 11; ++i) all.insert(all.end(), values.begin(), values.end());
  return all;
}

TEST(LasFields, HoldWhatFitsAndWhatDoesNotIsSaid) {
  const std::vector<FieldCase> all{
      {"intensity", {0, 7, 65535}, {0, 7, 65535}, 0, ""},
      {"intensity", {0, 0.25, 1}, {0, 16384, 65535}, 0, "stored as the value times 65535"},
      {"intensity",
       {0, kNotANumber, 0.5, 1},
       {0, 0, 32768, 65535},
       0,
       "stored as the value times 65535, 1 of 4 values not a number, stored as 0"},
      {"intensity", mostly_whole(5000, {-1, 70000, kInfinity, kNotANumber}),
       mostly_whole(5000, {0, 65535, 65535, 0}), 0,
       "3 of 1004 values clamped to 0 to 65535, 1 of 1004 values not a number, stored as 0"},
      {"intensity", mostly_whole(5000, {2.5}), mostly_whole(5000, {3}), 0,
       "1 of 1001 values rounded"},
      {"intensity", eleven_times({0.5, 100.25, 255}), eleven_times({129, 25764, 65535}), 0,
       "stored as the value times 257"},
      {"intensity", eleven_times({-2048, 0, 2047}), eleven_times({0, 2048, 4095}), 0,
       "stored as (the value +2048) times 1"},
      {"intensity", eleven_times({-20.5, 0, 110.57}), eleven_times({0, 10250, 65535}), 0,
       "stored as (the value +20.5) times 500"},
      {"intensity",
       {-1, 20.5, 30, 70000},
       {0, 21, 30, 65535},
       0,
       "1 of 4 values rounded, 2 of 4 values clamped to 0 to 65535"},
      {"nir", {0, 0.5, 1}, {0, 32768, 65535}, 8, "stored as the value times 65535"},
      {"classification", {2, 31}, {2, 31}, 0, ""},
      {"classification", {2, 40}, {2, 40}, 6, ""},
      {"classification", {-1, 300}, {0, 255}, 6, "2 of 2 values clamped to 0 to 255"},
      {"return_number", {1, 9}, {1, 9}, 6, ""},
      {"number_of_returns", {1, 16}, {1, 15}, 6, "1 of 2 values clamped to 0 to 15"},
      {"number_of_returns", {1, 2, 3}, {1, 2, 3}, 0, ""},
      {"scan_angle", {-2083, 12}, {-2083, 12}, 6, ""},
      {"scan_angle", {-12.498, 30}, {-2083, 5000}, 6, "stored as the value times 166.666667"},
      {"scan_angle_rank", {-7, 12}, {-7, 12}, 0, ""},
      {"point_source_id", {1, 70000}, {1, 65535}, 0, "1 of 2 values clamped to 0 to 65535"},
      {"user_data",
       {-1, 256, 7, 1.5},
       {0, 255, 7, 2},
       0,
       "1 of 4 values rounded, 2 of 4 values clamped to 0 to 255"},
      {"withheld", {0, 1, 2}, {0, 1, 1}, 0, "1 of 3 values clamped to 0 to 1"},
      {"scanner_channel", {0, 3, 4}, {0, 3, 3}, 6, "1 of 3 values clamped to 0 to 3"},
      {"gps_time", {-1e9, 0.1, 3e8 + 0.015625}, {-1e9, 0.1, 3e8 + 0.015625}, 1, ""},
  };
  const TemporaryFolder folder;
  for (const FieldCase& c : all) {
    const std::string what = c.column + (" " + c.note);
    const SurfelCloud cloud =
        cloud_with({column_of(c.column, ScalarType::kFloat64, c.values)}, c.values.size());
    const std::vector<std::string> notes = write_cloud(cloud, folder / "a.las");
    const std::vector<std::string> expected{c.column + (": " + c.note)};
    EXPECT_EQ(notes, c.note.empty() ? std::vector<std::string>() : expected) << what;
    EXPECT_EQ(write_cloud(cloud, folder / "a.laz"), notes) << what;
    const std::string las = read_text(folder / "a.las");
    EXPECT_EQ(point_format_of(las), c.format) << what;
    EXPECT_EQ(field_of(las, c.column), c.stored) << what;
    for (const char* file : {"a.las", "a.laz"}) {
      EXPECT_EQ(values_of(read_cloud(folder / file), c.column), c.stored) << what << " " << file;
    }
  }
}

TEST(LasFields, DegreesWithFractionsAreKeptAndInTheFieldOfOtherPrograms) {
  const TemporaryFolder folder;
  const SurfelCloud cloud =
      cloud_with({column_of("scan_angle_rank", ScalarType::kFloat64, {-12.498, 30})}, 2);
  EXPECT_TRUE(write_cloud(cloud, folder / "a.las").empty());
  EXPECT_EQ(field_of(read_text(folder / "a.las"), "scan_angle"), (FieldValues{-2083, 5000}));
  EXPECT_EQ(values_of(read_cloud(folder / "a.las"), "scan_angle_rank"), (FieldValues{-12.498, 30}));
}

TEST(LasFields, NamesAreKeptOrSaid) {
  const std::string name = "a_column_whose_name_is_of_more_tan_32_characters";
  const TemporaryFolder folder;
  const SurfelCloud cloud =
      cloud_with({column_of(name + "_a", ScalarType::kInt32, {1, 2}),
                  column_of(name + "_b", ScalarType::kInt32, {3, 4}),
                  column_of("Intensity", ScalarType::kInt32, {5, 6}),
                  column_of("red", ScalarType::kInt32, {7, 8}),
                  column_of("of_exactly_32_characters_as_said", ScalarType::kInt32, {9, 9})},
                 2);
  const std::vector<std::string> notes = write_cloud(cloud, folder / "a.laz");
  ASSERT_EQ(notes.size(), 2U);
  EXPECT_TRUE(notes[0].starts_with(name + "_a is named a_column_whose_name_is_of_more_t:"))
      << notes[0];
  EXPECT_TRUE(notes[1].starts_with(name + "_b is named a_column_whose_name_is_of_more_2:"))
      << notes[1];
  const SurfelCloud read = read_cloud(folder / "a.laz");
  EXPECT_EQ(values_of(read, "a_column_whose_name_is_of_more_t"), (FieldValues{1, 2}));
  EXPECT_EQ(values_of(read, "a_column_whose_name_is_of_more_2"), (FieldValues{3, 4}));
  EXPECT_EQ(values_of(read, "intensity"), (FieldValues{5, 6}));
  EXPECT_EQ(values_of(read, "red"), (FieldValues{7, 8}));
  for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(read.world(i), cloud.world(i));
}

TEST(LasFields, ColoursOutsideOfTheirRangeAreCounted) {
  const TemporaryFolder folder;
  SurfelCloud cloud = cloud_with({}, 3);
  cloud.color = {{0, 0.5F, 1}, {2, 0, 0}, {0, 0, std::nanf("")}};
  cloud.color_encoding = ColorEncoding::kFloatLinear;
  EXPECT_EQ(write_cloud(cloud, folder / "a.las"),
            std::vector<std::string>{"2 of 3 colours clamped to 0 to 1"});
}

/// Whatever stands in a column, every value comes back under the column's name as it was, or a
/// note says that the column is not as it was.
TEST(LasFields, NothingIsLostWithoutAWord) {
  const std::vector<std::string> names{"intensity",
                                       "return_number",
                                       "number_of_returns",
                                       "classification",
                                       "scan_angle",
                                       "scan_angle_rank",
                                       "point_source_id",
                                       "user_data",
                                       "withheld",
                                       "scanner_channel",
                                       "gps_time",
                                       "nir",
                                       "key_point",
                                       "overlap",
                                       "amplitude",
                                       "edge_of_flight_line",
                                       "some_long_name_that_has_more_than_32_characters"};
  const FieldValues awkward{0,     1,   2,     7,           8,         15,         31,
                            32,    0.5, -0.25, -1,          255,       256,        65535,
                            65536, 1e9, -1e9,  kNotANumber, kInfinity, -kInfinity, 1e300};
  const TemporaryFolder folder;
  std::mt19937 random(7);
  std::size_t said = 0;
  std::size_t kept = 0;
  for (int round = 0; round < cases(15); ++round) {
    const std::size_t count = 1 + random() % 300;
    std::vector<ExtraProperty> columns;
    for (const std::string& name : names) {
      if (random() % 2 == 0) continue;
      const auto type = static_cast<ScalarType>(random() % 8);
      const double usual = static_cast<double>(random() % 3 == 0 ? 1 : random() % 70000);
      FieldValues values;
      for (std::size_t i = 0; i < count; ++i) {
        double value = random() % 60 == 0 ? awkward[random() % awkward.size()]
                                          : std::fmod(static_cast<double>(random()), usual + 1);
        visit_type(type, [&]<class T>(T) {
          using Limits = std::numeric_limits<T>;
          const bool real = std::is_floating_point_v<T>;
          const bool fits = value >= static_cast<double>(Limits::lowest()) &&
                            value <= static_cast<double>(Limits::max());
          if (!fits && !(real && !std::isfinite(value))) value = 1;
        });
        values.push_back(value);
      }
      columns.push_back(column_of(name, type, values));
    }
    const SurfelCloud cloud = cloud_with(std::move(columns), count);
    const std::vector<std::string> notes = write_cloud(cloud, folder / "a.las");
    EXPECT_EQ(write_cloud(cloud, folder / "a.laz"), notes);
    const SurfelCloud read = read_cloud(folder / "a.las");
    const SurfelCloud compressed = read_cloud(folder / "a.laz");
    for (std::size_t k = 0; k < read.extra.size(); ++k) {
      EXPECT_TRUE(compressed.extra.at(k).data == read.extra[k].data) << read.extra[k].name;
    }
    for (const ExtraProperty& column : cloud.extra) {
      const bool noted = std::any_of(notes.begin(), notes.end(), [&](const std::string& note) {
        return note.starts_with(column.name + ": ") || note.starts_with(column.name + " is named");
      });
      said += noted ? 1 : 0;
      const FieldValues before = values_of(cloud, column.name);
      const FieldValues after = values_of(read, column.name.substr(0, 32));
      const bool same = std::equal(before.begin(), before.end(), after.begin(), [](auto a, auto b) {
        return a == b || (std::isnan(a) && std::isnan(b));
      });
      kept += same ? 1 : 0;
      EXPECT_TRUE(same || noted) << "round " << round << ", " << column.name;
      EXPECT_EQ(std::count_if(
                    read.extra.begin(), read.extra.end(),
                    [&](const auto& other) { return other.name.starts_with(column.name + "_2"); }),
                0)
          << column.name;
    }
  }
  EXPECT_GT(said, 20U);
  EXPECT_GT(kept, 20U);
}

TEST(LasFields, NamesOfCopcAreRefused) {
  const TemporaryFolder folder;
  const std::string message =
      message_of([&] { write_cloud(cloud_with({}, 2), folder / "a.COPC.laz"); });
  EXPECT_NE(message.find("a.laz"), std::string::npos) << message;
  EXPECT_FALSE(std::filesystem::exists(folder / "a.COPC.laz"));
}

}  // namespace
}  // namespace surfel::test
