#include <cmath>
#include <fstream>
#include <functional>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>

#include "io/cloud_of_bytes.h"
#include "support/e57_file.h"
#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

using Field = E57FileMaker::Field;

std::uint64_t bits_of(float value) { return std::bit_cast<std::uint32_t>(value); }
std::uint64_t bits_of(double value) { return std::bit_cast<std::uint64_t>(value); }

std::string float_xml(const std::string& name, bool single = true) {
  return fmt::format(R"(<{} type="Float" precision="{}"/>)", name, single ? "single" : "double");
}
std::string integer_xml(const std::string& name, std::int64_t min, std::int64_t max) {
  return fmt::format(R"(<{} type="Integer" minimum="{}" maximum="{}"/>)", name, min, max);
}

/// A field of floats; value i is of(i).
Field floats(const std::string& name, std::size_t count,
             const std::function<float(std::size_t)>& of) {
  Field field{float_xml(name), 32, {}};
  for (std::size_t i = 0; i < count; ++i) field.values.push_back(bits_of(of(i)));
  return field;
}

/// A field of integers from `min` on; value i is of(i) above that.
Field integers(const std::string& name, std::int64_t min, std::int64_t max, std::size_t count,
               const std::function<std::uint64_t(std::size_t)>& of) {
  const auto range = static_cast<std::uint64_t>(max) - static_cast<std::uint64_t>(min);
  Field field{integer_xml(name, min, max), static_cast<unsigned>(std::bit_width(range)), {}};
  for (std::size_t i = 0; i < count; ++i) field.values.push_back(of(i));
  return field;
}

/// Coordinates (i, 2 i, 3).
std::vector<Field> line_of(std::size_t count) {
  return {floats("cartesianX", count, [](std::size_t i) { return static_cast<float>(i); }),
          floats("cartesianY", count, [](std::size_t i) { return static_cast<float>(2 * i); }),
          floats("cartesianZ", count, [](std::size_t) { return 3.0F; })};
}

std::string file_of(const std::vector<Field>& fields, const std::string& more = "",
                    std::size_t most = 1 << 12) {
  E57FileMaker maker;
  const std::string points = maker.points(fields, most);
  return maker.file({more + points});
}

TEST(E57, FilesOfOtherPrograms) {
  SURFEL_REQUIRE_TEST_DATA();
  const auto folder = data_folder() / "formats/e57";
  const SurfelCloud bunny = read_cloud(folder / "bunnyInt32.e57");
  EXPECT_EQ(bunny.size(), 30571U);
  // The file's XML tells these bounds.
  const Bounds box = bunny.bounds();
  EXPECT_TRUE(box.min.isApprox(Vec3d(-0.094689, 0.040011, -0.061873), 1e-6));
  EXPECT_TRUE(box.max.isApprox(Vec3d(0.061009, 0.187321, 0.058799), 1e-6));
  EXPECT_EQ(bunny.comments, std::vector<std::string>{"scan 0: bunny"});
  const SurfelCloud cube = read_cloud(folder / "ColouredCubeFloat.e57");
  ASSERT_EQ(cube.size(), 7680U);
  for (std::size_t i = 0; i < cube.size(); ++i) {
    // Each face has a colour of its own, and lies at one half from the middle.
    ASSERT_EQ(cube.position[i].cwiseAbs().maxCoeff(), 0.5F) << i;
    ASSERT_EQ(cube.color[i].maxCoeff(), 1.0F) << i;
  }
  const SurfelCloud two = read_cloud(folder / "A_B.e57");
  ASSERT_EQ(two.size(), 6U);
  EXPECT_FALSE(read_cloud(folder / "bunnyInt32.e57").up);
  EXPECT_EQ(values_of(two, "scan"), (std::vector<double>{0, 0, 1, 1, 1, 1}));
  EXPECT_EQ(two.color[0], Vec3f(1, 1, 0));
  EXPECT_EQ(two.color[5], Vec3f(0, 1, 0));
  EXPECT_FLOAT_EQ(static_cast<float>(values_of(two, "intensity")[5]), 257.89603F);
  EXPECT_EQ(read_cloud(folder / "ColourRepresentation.e57").size(), 153U);
  for (const auto& [name, says] :
       {std::pair("ZeroPoints.e57", "holds no points"), std::pair("empty.e57", "holds no scans"),
        std::pair("bad-crc.e57", "page 1 of 1, bytes 0 to 1023, has a wrong checksum")}) {
    EXPECT_NE(message_of([&, file = name] { read_cloud(folder / file); }).find(says),
              std::string::npos)
        << name;
  }
}

TEST(E57, FieldsOfAllTypesRunOnOverPackets) {
  constexpr std::size_t kCount = 1000;
  const auto random = [](std::size_t i, int field) {
    return static_cast<std::uint64_t>(random_uniform(5, i, field) * 0x1p53);
  };
  std::vector<Field> fields = line_of(kCount);
  fields[1].xml =
      R"(<cartesianY type="ScaledInteger" minimum="-1000" maximum="30000" scale="0.5" offset="7"/>)";
  fields[1].bits = 15;
  fields[2].xml = float_xml("cartesianZ", false);
  fields[2].bits = 64;
  for (std::size_t i = 0; i < kCount; ++i) {
    fields[1].values[i] = random(i, 0) & 0x7FFF;
    fields[2].values[i] = bits_of(1e9 + static_cast<double>(i) / 3);
  }
  struct Range {
    std::int64_t min, max;
    ScalarType type;
  };
  const std::vector<Range> ranges{{0, 1, ScalarType::kUint8},
                                  {5, 5, ScalarType::kUint8},
                                  {-3, 4, ScalarType::kInt8},
                                  {0, 255, ScalarType::kUint8},
                                  {-1, 255, ScalarType::kInt16},
                                  {0, 100000, ScalarType::kUint32},
                                  {-40000, 1, ScalarType::kInt32},
                                  {0, (std::int64_t{1} << 33) - 1, ScalarType::kFloat64},
                                  {std::numeric_limits<std::int64_t>::min(),
                                   std::numeric_limits<std::int64_t>::max(), ScalarType::kFloat64}};
  for (std::size_t k = 0; k < ranges.size(); ++k) {
    const auto& [min, max, type] = ranges[k];
    const std::uint64_t range = static_cast<std::uint64_t>(max) - static_cast<std::uint64_t>(min);
    fields.push_back(
        integers("ext:someValue" + std::to_string(k), min, max, kCount, [&](std::size_t i) {
          const std::uint64_t value = random(i, static_cast<int>(k) + 1) << 11;
          return range == ~std::uint64_t{0} ? value : value % (range + 1);
        }));
  }
  fields.push_back({R"(<label type="String"/>)", 8, std::vector<std::uint64_t>(kCount, 0)});
  for (const std::size_t most : {3UL, 97UL, 4000UL}) {
    const SurfelCloud cloud = cloud_of(file_of(fields, "", most));
    ASSERT_EQ(cloud.size(), kCount);
    ASSERT_EQ(cloud.extra.size(), ranges.size());
    EXPECT_TRUE(cloud.double_positions);
    for (std::size_t i = 0; i < kCount; ++i) {
      const Vec3d truth(static_cast<double>(i),
                        (static_cast<double>(fields[1].values[i]) - 1000) * 0.5 + 7,
                        1e9 + static_cast<double>(i) / 3);
      ASSERT_NEAR((cloud.world(i) - truth).norm(), 0, 2e-3) << i;
    }
    for (std::size_t k = 0; k < ranges.size(); ++k) {
      const std::string name = "some_value" + std::to_string(k);
      EXPECT_EQ(cloud.extra[k].type, ranges[k].type) << name;
      const std::vector<double> values = values_of(cloud, name);
      for (std::size_t i = 0; i < kCount; ++i) {
        const auto truth = static_cast<double>(static_cast<std::int64_t>(
            static_cast<std::uint64_t>(ranges[k].min) + fields[3 + k].values[i]));
        ASSERT_EQ(values[i], truth) << name << " " << i;
      }
    }
  }
}

TEST(E57, ManyBlocksByAnyNumberOfThreads) {
  constexpr std::size_t kCount = 80000;
  std::vector<Field> fields = line_of(kCount);
  fields.push_back(integers("cartesianInvalidState", 0, 2, kCount,
                            [](std::size_t i) { return i % 7 == 3 ? 1 + i % 2 : 0; }));
  fields.push_back(integers("rowIndex", 0, kCount, kCount, [](std::size_t i) { return i; }));
  const std::string bytes = file_of(fields, "", 12000);
  set_thread_count(1);
  const SurfelCloud one = cloud_of(bytes);
  set_thread_count(4);
  const SurfelCloud four = cloud_of(bytes);
  set_thread_count(0);
  std::size_t left = 0;
  for (std::size_t i = 0; i < kCount; ++i) {
    if (i % 7 == 3) continue;
    ASSERT_EQ(one.position.at(left), Vec3f(static_cast<float>(i), static_cast<float>(2 * i), 3));
    ++left;
  }
  EXPECT_EQ(one.size(), left);
  EXPECT_EQ(one.unmeasured_skipped, kCount - left);
  EXPECT_EQ(one.position, four.position);
  EXPECT_TRUE(one.extra.at(0).data == four.extra.at(0).data);
  EXPECT_EQ(values_of(one, "row_index").at(3), 4);
}

TEST(E57, SphericalCoordinates) {
  constexpr double kPi = std::numbers::pi;
  std::vector<Field> fields{
      floats("sphericalRange", 3, [](std::size_t) { return 2.0F; }),
      floats("sphericalAzimuth", 3, [](std::size_t i) { return i == 1 ? float(kPi / 2) : 0.0F; }),
      floats("sphericalElevation", 3,
             [](std::size_t i) { return i == 2 ? float(kPi / 6) : 0.0F; })};
  const SurfelCloud cloud = cloud_of(file_of(fields));
  ASSERT_EQ(cloud.size(), 3U);
  EXPECT_TRUE(cloud.position[0].isApprox(Vec3f(2, 0, 0)));
  EXPECT_TRUE(cloud.position[1].isApprox(Vec3f(0, 2, 0), 1e-6F));
  EXPECT_TRUE(cloud.position[2].isApprox(Vec3f(std::sqrt(3.0F), 0, 1), 1e-6F));
  ASSERT_TRUE(cloud.viewpoint);  // The scanner is the centre of the sphere.
  EXPECT_EQ(cloud.viewpoint->position, Vec3d(0, 0, 0));
  fields.push_back(integers("sphericalInvalidState", 0, 2, 3, [](std::size_t i) { return i; }));
  EXPECT_EQ(cloud_of(file_of(fields)).size(), 1U);
}

constexpr const char* kQuarterTurn =
    "<pose><rotation><w>0.70710678118654752</w><x/><y/><z>0.70710678118654752</z></rotation>"
    "<translation><x>100</x><y>200</y><z>300</z></translation></pose>";

TEST(E57, PosesMovePointsAndAreViewpoints) {
  E57FileMaker maker;
  std::vector<Field> with_normals = line_of(2);
  with_normals.push_back(floats("nor:normalX", 2, [](std::size_t) { return 1.0F; }));
  with_normals.push_back(floats("nor:normalY", 2, [](std::size_t) { return 0.0F; }));
  with_normals.push_back(floats("nor:normalZ", 2, [](std::size_t) { return 0.0F; }));
  const std::string first = kQuarterTurn + maker.points(with_normals);
  const std::string second =
      "<pose><translation><x>-5</x></translation></pose>" + maker.points(line_of(3));
  const SurfelCloud one = cloud_of(maker.file({first}));
  ASSERT_EQ(one.size(), 2U);
  EXPECT_TRUE(one.world(1).isApprox(Vec3d(98, 201, 303), 1e-6));
  EXPECT_TRUE(one.normal[0].isApprox(Vec3f(0, 1, 0), 1e-6F));
  ASSERT_TRUE(one.viewpoint);
  EXPECT_EQ(one.viewpoint->position, Vec3d(100, 200, 300));
  EXPECT_EQ(one.up, std::optional<Vec3d>(Vec3d::UnitZ()));
  EXPECT_NEAR(one.viewpoint->orientation[3], std::sqrt(0.5), 1e-12);
  EXPECT_TRUE(one.scan_viewpoints.empty());

  const SurfelCloud two = cloud_of(maker.file({first, second}));
  EXPECT_FALSE(two.viewpoint);
  ASSERT_EQ(two.scan_viewpoints.size(), 2U);
  EXPECT_EQ(two.scan_viewpoints[1].position, Vec3d(-5, 0, 0));
  EXPECT_TRUE(two.world(4).isApprox(Vec3d(-3, 4, 3), 1e-6));
  EXPECT_EQ(two.normal[4], Vec3f(0, 0, 0));  // A scan without normals.
  const Array<Vec3d> sensors = two.sensors();
  ASSERT_EQ(sensors.size(), 5U);
  EXPECT_EQ(sensors[1], Vec3d(100, 200, 300));
  EXPECT_EQ(sensors[2], Vec3d(-5, 0, 0));
  // The tools' own files keep what each scan was seen from.
  const TemporaryFolder folder;
  for (const char* name : {"a.ply", "a.pcd", "a.las"}) {
    write_cloud(two, folder / name);
    const SurfelCloud again = read_cloud(folder / name);
    ASSERT_EQ(again.scan_viewpoints.size(), 2U) << name;
    EXPECT_EQ(again.sensors(), sensors) << name;
  }
  // One scan whose place is unknown leaves no place for any.
  const std::string unknown = maker.points(line_of(2));
  const SurfelCloud three = cloud_of(maker.file({first, second, unknown}));
  EXPECT_TRUE(!three.viewpoint && three.scan_viewpoints.empty());
}

TEST(E57, ColorsBetweenTheirLimits) {
  const auto with_colors = [](std::int64_t max, std::array<std::uint64_t, 3> values,
                              const std::string& limits = "") {
    std::vector<Field> fields = line_of(1);
    for (std::size_t k = 0; k < 3; ++k) {
      constexpr std::array<const char*, 3> kNames{"colorRed", "colorGreen", "colorBlue"};
      fields.push_back(integers(kNames[k], 0, max, 1, [&](std::size_t) { return values[k]; }));
    }
    return cloud_of(file_of(fields, limits));
  };
  const SurfelCloud bytes = with_colors(255, {10, 20, 255});
  EXPECT_EQ(bytes.color_encoding, ColorEncoding::kUint8Srgb);
  EXPECT_EQ(bytes.color[0], Vec3f(srgb8_to_linear(10), srgb8_to_linear(20), 1));
  const SurfelCloud wide = with_colors(65535, {10, 20, 300});
  EXPECT_EQ(wide.color_encoding, ColorEncoding::kUint16Srgb);
  EXPECT_EQ(wide.color[0][2], srgb16_to_linear(300));
  // Codes of 8 bits in a field of 16.
  EXPECT_EQ(with_colors(65535, {10, 20, 255}).color, bytes.color);
  const std::string limits =
      "<colorLimits><colorRedMaximum>1023</colorRedMaximum><colorGreenMaximum>1023"
      "</colorGreenMaximum><colorBlueMaximum>1023</colorBlueMaximum></colorLimits>";
  EXPECT_EQ(with_colors(65535, {0, 1023, 341}, limits).color[0],
            Vec3f(0, 1, srgb16_to_linear(65535 / 3)));
  EXPECT_EQ(with_colors(65535, {0, 0, 0}).color.size(), 0U);

  std::vector<Field> fields = line_of(2);
  for (const char* name : {"colorRed", "colorGreen", "colorBlue"}) {
    fields.push_back(floats(name, 2, [](std::size_t) { return 0.5F; }));
  }
  fields.push_back(integers("isColorInvalid", 0, 1, 2, [](std::size_t i) { return i; }));
  const SurfelCloud halves = cloud_of(file_of(fields));
  EXPECT_NEAR(halves.color[0][0], srgb_to_linear(0.5F), 1e-4);
  EXPECT_NEAR(halves.color[1][0], SurfelCloud::colorless()[0], 3e-3);
  fields[3].values[0] = bits_of(200.0F);
  EXPECT_NE(error_of(file_of(fields)).find("colorRed is 200"), std::string::npos);
}

TEST(E57, InvalidIntensitiesAndFieldsThatScansLack) {
  E57FileMaker maker;
  std::vector<Field> a = line_of(2);
  a.push_back(integers("intensity", 0, 4095, 2, [](std::size_t i) { return 100 + i; }));
  a.push_back(integers("isIntensityInvalid", 0, 1, 2, [](std::size_t i) { return i; }));
  std::vector<Field> b = line_of(1);
  b.push_back(floats("timeStamp", 1, [](std::size_t) { return 0.25F; }));
  b.push_back(integers("returnIndex", 0, 7, 1, [](std::size_t) { return 2; }));
  const std::string first = maker.points(a);
  const SurfelCloud cloud = cloud_of(maker.file({first, maker.points(b)}));
  const std::vector<double> intensity = values_of(cloud, "intensity");
  EXPECT_EQ(intensity[0], 100);
  EXPECT_TRUE(std::isnan(intensity[1]) && std::isnan(intensity[2]));
  const std::vector<double> time = values_of(cloud, "time_stamp");
  EXPECT_TRUE(std::isnan(time[0]));
  EXPECT_EQ(time[2], 0.25);
  EXPECT_EQ(values_of(cloud, "return_index"), (std::vector<double>{0, 0, 2}));
  EXPECT_EQ(cloud.extra.size(), 4U);  // And `scan`.
}

TEST(E57, EveryDamagedByteIsFound) {
  const std::string bytes = file_of(line_of(20));
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x20);
    ASSERT_NE(message_of([&] {
                read_cloud(InputFile("damaged.e57", std::as_bytes(std::span(damaged))));
              }).find("damaged.e57: "),
              std::string::npos)
        << at;
  }
}

TEST(E57, FilesCutAnywhereAreRefused) {
  const std::string bytes = file_of(line_of(300), "", 500);
  ASSERT_GT(bytes.size(), 4096U);
  for (std::size_t size = 1; size < bytes.size(); ++size) {
    const std::string cut = bytes.substr(0, size);
    ASSERT_NE(message_of([&] {
                read_cloud(InputFile("cut.e57", std::as_bytes(std::span(cut))));
              }).find("cut.e57: "),
              std::string::npos)
        << size;
  }
  // Cut contents in sound pages.
  E57FileMaker maker;
  const std::string xml = "<e57Root><data3D><vectorChild>" + maker.points(line_of(300), 500) +
                          "</vectorChild></data3D></e57Root>";
  const std::string contents = maker.contents(xml);
  for (std::size_t size = 48; size < contents.size(); ++size) {
    const std::string cut = with_checksums(contents.substr(0, size));
    const std::string message =
        message_of([&] { read_cloud(InputFile("cut.e57", std::as_bytes(std::span(cut)))); });
    // The last page is filled up, so that the last bytes of the XML may be missing at most.
    ASSERT_NE(message.find("cut.e57: "), std::string::npos) << size;
  }
}

TEST(E57, DescriptionsThatAreWrongAreNamed) {
  E57FileMaker maker;
  const std::string points = maker.points(line_of(5));
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = points;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return maker.file({changed.replace(at, from.size(), to)});
  };
  const auto file = [&](const std::string& xml) { return maker.file_of_xml(xml); };
  const std::vector<std::pair<std::string, std::string>> cases{
      {with(R"(recordCount="5")", R"(recordCount="6")"), "hold values of 'cartesianX' for 5"},
      {with(R"(recordCount="5")", R"(recordCount="99999999999999")"), "promises 99999999999999"},
      {with(R"(recordCount="5")", R"(recordCount="-5")"), "recordCount is no number"},
      {with(R"(recordCount="5")", R"(recordCount="five")"), "recordCount is 'five'"},
      {with(R"(fileOffset="48")", R"(fileOffset="1021")"), "where none can be"},
      {with(R"(fileOffset="48")", R"(fileOffset="999999")"), "where none can be"},
      {with(R"(fileOffset="48")", R"(fileOffset="52")"), "there are no points where"},
      {with("CompressedVector", "Vector"), "not a CompressedVector"},
      {with("cartesianZ", "height"), "neither cartesianX"},
      {with("Float\" precision=\"single", "String"), "neither cartesianX"},
      {with("cartesianZ", "cartesianX"), "two fields 'cartesianX'"},
      {with("prototype type=\"Structure\"", "proto"), "broken"},
      {with("Float", "Structure"), "'Structure'; Float, Integer"},
      {with("single", "half"), "neither single nor double"},
      {with("Float\" precision=\"single", "Integer\" minimum=\"9\" maximum=\"5"), "minimum 9"},
      {with("Float\" precision=\"single", "ScaledInteger\" scale=\"0"),
       "scale of 'cartesianX' is 0"},
      {with("</codecs>", "<a><zipCodec/></a></codecs>"), "a codec that E57 1.0"},
      {maker.file({"<points type=\"CompressedVector\" recordCount=\"1\" fileOffset=\"48\"/>"}),
       "no prototype"},
      {maker.file({"<pose><rotation><w>nan</w></rotation></pose>" + points}), "w of its pose's"},
      {file("<e57Root>"), "its XML is broken"},
      {file("<other/>"), "no e57Root"},
      {file("<e57Root/>"), "holds no scans"},
  };
  for (const auto& [bytes, says] : cases) {
    EXPECT_NE(error_of(bytes).find(says), std::string::npos) << error_of(bytes);
  }
  const TemporaryFolder folder;
  std::ofstream(folder / "scan.e57") << "something else";
  EXPECT_EQ(file_kind(folder / "scan.e57"), FileKind::kCloud);
  EXPECT_NE(message_of([&] { read_cloud(folder / "scan.e57"); }).find("is not an E57 file"),
            std::string::npos);
}

/// Points that take no bytes, and scans that all point at the same bytes, must not make more memory
/// of a file than it has.
TEST(E57, MorePointsThanBytesAreRefused) {
  std::vector<Field> fields;
  for (const char* name : {"cartesianX", "cartesianY", "cartesianZ"}) {
    fields.push_back(integers(name, 7, 7, 3, [](std::size_t) { return 0; }));
  }
  E57FileMaker maker;
  std::string points = maker.points(fields);
  EXPECT_EQ(cloud_of(maker.file({points})).world(2), Vec3d(7, 7, 7));
  points.replace(points.find("recordCount=\"3\""), 15, "recordCount=\"300000000\"");
  EXPECT_NE(error_of(maker.file({points})).find("promises 300000000 points"), std::string::npos);

  E57FileMaker shared;
  const std::string hundred = shared.points(line_of(1000));
  EXPECT_NE(
      error_of(shared.file(std::vector<std::string>(9, hundred))).find("promises 1000 points"),
      std::string::npos);
}

}  // namespace
}  // namespace surfel::test
