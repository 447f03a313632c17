#include <algorithm>
#include <bit>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <random>

#include <fcntl.h>
#include <surfel/base/color.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>
#include <sys/resource.h>
#include <unistd.h>

#include "io/cloud_of_bytes.h"
#include "support/cases.h"
#include "support/memory_file.h"
#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel {
namespace {

using test::cloud_of;
using test::error_of;
using test::MemoryFile;
using test::TemporaryFolder;

std::string content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// An ascii PLY file with one property a word of `properties` ("float x,uchar red").
std::string ply(const std::string& properties, const std::string& body, int count = 1) {
  std::string header = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(count) + "\n";
  std::string word;
  for (const char c : properties + ",") {
    if (c != ',') {
      word += c;
    } else {
      header += "property " + word + "\n";
      word.clear();
    }
  }
  return header + "end_header\n" + body;
}

template <class T>
bool same_bits(const Array<T>& a, const Array<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(static_cast<const void*>(a.data()),
                                   static_cast<const void*>(b.data()), a.size() * sizeof(T)) == 0);
}

/// Calls check(name, a's column, b's column) for all columns but the positions.
template <class Check>
void compare_columns(const SurfelCloud& a, const SurfelCloud& b, Check&& check) {
  check("normal", a.normal, b.normal);
  check("variance", a.variance, b.variance);
  check("tangent", a.tangent, b.tangent);
  check("variance_u", a.variance_u, b.variance_u);
  check("variance_v", a.variance_v, b.variance_v);
  check("area", a.area, b.area);
  check("clip1", a.clip1, b.clip1);
  check("clip1_d", a.clip1_distance, b.clip1_distance);
  check("clip2", a.clip2, b.clip2);
  check("clip2_d", a.clip2_distance, b.clip2_distance);
  check("color", a.color, b.color);
  check("alpha", a.alpha, b.alpha);
  check("coefficient", a.coefficient, b.coefficient);
  check("uv", a.uv, b.uv);
  check("dpdu", a.dpdu, b.dpdu);
  check("dpdv", a.dpdv, b.dpdv);
  check("material", a.material, b.material);
  check("group", a.group, b.group);
  check("group_radius", a.group_radius, b.group_radius);
  check("source", a.source, b.source);
  check("level", a.level, b.level);
  for (std::size_t k = 0; k < std::min(a.extra.size(), b.extra.size()); ++k) {
    check(a.extra[k].name.c_str(), a.extra[k].data, b.extra[k].data);
  }
}

/// Empty, or the first thing in which the clouds differ; positions count by their world place.
std::string difference(const SurfelCloud& a, const SurfelCloud& b) {
  std::string found;
  if (a.size() != b.size()) return "size";
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      const double x = a.world(i)[k];
      const double y = b.world(i)[k];
      if (x != y && !(std::isnan(x) && std::isnan(y))) return "position " + std::to_string(i);
    }
  }
  compare_columns(a, b, [&](const char* name, const auto& from, const auto& to) {
    if (!same_bits(from, to)) found = name;
  });
  if (a.color.size() && a.color_encoding != b.color_encoding) found = "color_encoding";
  if (a.alpha.size() && a.alpha_as_uint8 != b.alpha_as_uint8) found = "alpha_as_uint8";
  if (a.extra.size() != b.extra.size()) return "number of extra columns";
  for (std::size_t k = 0; k < a.extra.size(); ++k) {
    if (a.extra[k].name != b.extra[k].name) found = "name of " + a.extra[k].name;
    if (a.extra[k].type != b.extra[k].type) found = "type of " + a.extra[k].name;
  }
  if (a.basis_cutoff != b.basis_cutoff) found = "basis_cutoff";
  if (a.provenance != b.provenance) found = "provenance";
  if (a.comments != b.comments) found = "comments";
  return found;
}

/// Random clouds; each attribute is there or not by a coin.
class RandomCloud {
 public:
  explicit RandomCloud(std::uint64_t seed) : engine_(seed) {}

  SurfelCloud make() {
    SurfelCloud cloud;
    const std::size_t n = 1 + engine_() % 50;
    // Multiples of 1/16 stay exact however far away they are put.
    const double far[] = {0, 0, 1e3, 3e6, 1e7, -5e8};
    for (int k = 0; k < 3; ++k) cloud.origin[k] = far[engine_() % 6];
    cloud.double_positions = coin();
    fill(cloud.position, n, [&] { return Vec3f(sixteenth(), sixteenth(), sixteenth()); });
    if (coin()) fill(cloud.normal, n, [&] { return direction(); });
    if (coin()) fill(cloud.variance, n, [&] { return any(); });
    if (coin()) {
      fill(cloud.tangent, n, [&] { return direction(); });
      fill(cloud.variance_u, n, [&] { return any(); });
      fill(cloud.variance_v, n, [&] { return any(); });
    }
    if (coin()) fill(cloud.area, n, [&] { return any(); });
    if (coin()) {
      fill(cloud.clip1, n, [&] { return Vec3f(any(), any(), any()); });
      fill(cloud.clip1_distance, n, [&] { return any(); });
    }
    if (coin()) fill_color(cloud, n);
    if (coin()) {
      cloud.alpha_as_uint8 = coin();
      fill(cloud.alpha, n, [&] {
        return cloud.alpha_as_uint8 ? static_cast<float>(engine_() % 256) / 255.0f : any();
      });
    }
    if (coin()) fill(cloud.coefficient, n, [&] { return Vec3f(any(), any(), any()); });
    if (coin()) fill(cloud.uv, n, [&] { return Vec2f(any(), any()); });
    if (coin()) fill(cloud.dpdu, n, [&] { return Vec3f(any(), any(), any()); });
    if (coin()) fill(cloud.dpdv, n, [&] { return Vec3f(any(), any(), any()); });
    if (coin()) fill(cloud.material, n, [&] { return static_cast<std::uint16_t>(engine_()); });
    if (coin()) fill(cloud.group, n, [&] { return static_cast<std::uint16_t>(engine_()); });
    if (coin()) fill(cloud.group_radius, n, [&] { return any(); });
    if (coin()) fill(cloud.source, n, [&] { return static_cast<std::uint32_t>(engine_()); });
    if (coin()) fill(cloud.level, n, [&] { return static_cast<std::uint8_t>(engine_()); });
    for (int type = 0; type < 8; ++type) {
      if (coin()) add_extra(cloud, static_cast<ScalarType>(type), n);
    }
    if (coin()) cloud.basis_cutoff = 1.25;
    if (coin()) cloud.provenance = {"surfel-a 1 --x 2", "surfel-b 1"};
    if (coin()) cloud.comments = {"made by hand", ""};
    return cloud;
  }

 private:
  bool coin() { return engine_() % 2 == 0; }
  float sixteenth() { return static_cast<float>(static_cast<int>(engine_() % 3200) - 1600) / 16; }
  /// Any float but NaN, whose bits text does not keep.
  float any() {
    const auto value = std::bit_cast<float>(static_cast<std::uint32_t>(engine_()));
    return std::isnan(value) ? INFINITY : value;
  }
  Vec3f direction() {
    if (engine_() % 8 == 0) return Vec3f::Zero();
    return (Vec3f(sixteenth(), sixteenth(), sixteenth()) + Vec3f(0.01f, 0, 0)).normalized();
  }
  void fill_color(SurfelCloud& cloud, std::size_t n) {
    cloud.color_encoding = static_cast<ColorEncoding>(engine_() % 3);
    const auto channel = [&] {
      const auto bits = static_cast<std::uint16_t>(engine_());
      switch (cloud.color_encoding) {
        case ColorEncoding::kUint8Srgb:
          return srgb8_to_linear(static_cast<std::uint8_t>(bits));
        case ColorEncoding::kUint16Srgb:
          return srgb16_to_linear(bits);
        case ColorEncoding::kFloatLinear:
          break;
      }
      return any();
    };
    fill(cloud.color, n, [&] { return Vec3f(channel(), channel(), channel()); });
  }
  void add_extra(SurfelCloud& cloud, ScalarType type, std::size_t n) {
    ExtraProperty& extra = cloud.extra.emplace_back();
    extra.name = "extra_" + std::to_string(static_cast<int>(type));
    extra.type = type;
    extra.data.resize(n * scalar_size(type));
    for (std::byte& b : extra.data) b = static_cast<std::byte>(engine_() % 120);  // No NaN.
  }
  template <class T, class Make>
  void fill(Array<T>& column, std::size_t n, Make make) {
    column.resize(n);
    for (T& value : column) value = make();
  }

  std::mt19937_64 engine_;
};

TEST(CloudIo, RoundTripKeepsEveryAttribute) {
  TemporaryFolder folder;
  // Each column is in half of the clouds.
  for (int seed = 1; seed <= test::cases(25); ++seed) {
    const SurfelCloud cloud = RandomCloud(static_cast<std::uint64_t>(seed)).make();
    for (const char* name : {"binary.ply", "ascii.ply", "binary.pcd"}) {
      write_cloud(cloud, folder / name, {.ascii = std::string(name) == "ascii.ply"});
      const SurfelCloud read = read_cloud(folder / name);
      ASSERT_EQ(difference(cloud, read), "") << name << ' ' << seed;
      // What was read is written the same.
      write_cloud(read, folder / "again.ply");
      const std::string first = content(folder / "again.ply");
      write_cloud(read_cloud(folder / "again.ply"), folder / "again.ply");
      ASSERT_TRUE(content(folder / "again.ply") == first) << name << ' ' << seed;
    }
  }
}

TEST(CloudIo, ByteOrdersReadTheSame) {
  const auto file = [](bool big) {
    std::string bytes = std::string("ply\nformat binary_") + (big ? "big" : "little") +
                        "_endian 1.0\nelement vertex 1\nproperty double x\nproperty float y\n"
                        "property short z\nproperty ushort red\nproperty ushort green\n"
                        "property ushort blue\nproperty int tag\nend_header\n";
    const auto put = [&](auto value) {
      char raw[sizeof(value)];
      std::memcpy(raw, &value, sizeof(value));
      if (big) std::reverse(raw, raw + sizeof(value));
      bytes.append(raw, sizeof(value));
    };
    put(1.5);
    put(-2.25f);
    put(std::int16_t{-300});
    for (const std::uint16_t c : std::initializer_list<std::uint16_t>{258, 65535, 1}) put(c);
    put(-123456);
    return bytes;
  };
  const SurfelCloud little = cloud_of(file(false));
  EXPECT_EQ(little.world(0), Vec3d(1.5, -2.25, -300));
  EXPECT_EQ(little.color[0], Vec3f(srgb16_to_linear(258), 1, srgb16_to_linear(1)));
  EXPECT_EQ(difference(little, cloud_of(file(true))), "");
}

TEST(CloudIo, AliasesReachTheirAttribute) {
  const std::string xyz = "float x,float y,float z,";
  const auto color = [&](const std::string& properties, const std::string& body) {
    const SurfelCloud cloud = cloud_of(ply(xyz + properties, "0 0 0 " + body));
    EXPECT_EQ(cloud.color.size(), 1) << properties;
    EXPECT_TRUE(cloud.extra.empty()) << properties;
    return cloud.color.empty() ? Vec3f(-1, -1, -1) : cloud.color[0];
  };
  const Vec3f decoded(1, 0, srgb8_to_linear(128));
  EXPECT_EQ(color("uchar red,uchar green,uchar blue", "255 0 128"), decoded);
  EXPECT_EQ(color("int red,int green,int blue", "255 0 128"), decoded);
  EXPECT_EQ(color("uchar diffuse_red,uchar diffuse_green,uchar diffuse_blue", "255 0 128"),
            decoded);
  EXPECT_EQ(color("uchar b,uchar g,uchar r", "128 0 255"), decoded);
  EXPECT_EQ(color("uchar R,uchar G,uchar B", "255 0 128"), decoded);
  EXPECT_EQ(color("float red,float green,float blue", "1.5 0 0.25"), Vec3f(1.5f, 0, 0.25f));
  for (const std::string uv :
       {"float u,float v", "float s,float t", "double texture_u,float texture_v"}) {
    EXPECT_EQ(cloud_of(ply(xyz + uv, "0 0 0 0.25 0.75")).uv[0], Vec2f(0.25f, 0.75f)) << uv;
  }
  const std::string normal = "float normal_x,float normal_y,float normal_z";
  EXPECT_EQ(cloud_of(ply(xyz + normal, "0 0 0 0 1 0")).normal[0], Vec3f(0, 1, 0));
  EXPECT_EQ(cloud_of(ply(xyz + "uchar alpha", "0 0 0 255")).alpha[0], 1);
  EXPECT_EQ(cloud_of(ply(xyz + "ushort alpha", "0 0 0 65535")).alpha[0], 1);
  EXPECT_EQ(cloud_of(ply(xyz + "float alpha", "0 0 0 0.125")).alpha[0], 0.125f);
}

TEST(CloudIo, WhatHasNoMeaningHereIsExtra) {
  const SurfelCloud cloud = cloud_of(ply(
      "float x,float y,float z,float intensity,uchar red,uchar green,int material,float opacity",
      "0 0 0 7 1 2 -1 0.5"));
  std::vector<std::string> names;
  for (const ExtraProperty& extra : cloud.extra) names.push_back(extra.name);
  EXPECT_EQ(names, (std::vector<std::string>{"intensity", "red", "green", "material", "opacity"}));
  EXPECT_TRUE(cloud.color.empty() && cloud.material.empty() && cloud.alpha.empty());
}

TEST(CloudIo, IntegerColoursRoundTripForEveryValue) {
  SurfelCloud cloud;
  cloud.color_encoding = ColorEncoding::kUint16Srgb;
  for (int i = 0; i < 65536; ++i) {
    cloud.position.push_back(Vec3f::Zero());
    cloud.color.push_back(Vec3f::Constant(srgb16_to_linear(static_cast<std::uint16_t>(i))));
  }
  TemporaryFolder folder;
  write_cloud(cloud, folder / "a.ply");
  write_cloud(read_cloud(folder / "a.ply"), folder / "b.ply");
  const std::string bytes = content(folder / "b.ply");
  EXPECT_EQ(bytes, content(folder / "a.ply"));
  ASSERT_GT(bytes.size(), 65536u * 18);
  std::uint16_t last = 0;
  std::memcpy(&last, bytes.data() + bytes.size() - 2, 2);
  EXPECT_EQ(last, 65535);
}

TEST(CloudIo, VarianceAndRadiusFollowOneAnother) {
  const std::string xyz = "float x,float y,float z,float radius";
  EXPECT_EQ(cloud_of(ply(xyz, "0 0 0 0.5")).variance, (Array<float>{0.125f}));
  EXPECT_EQ(cloud_of(ply(xyz + ",float variance", "0 0 0 9 0.125")).variance,
            (Array<float>{0.125f}));
  const SurfelCloud cloud =
      cloud_of(ply(xyz + ",float tx,float ty,float tz,float variance_u,float variance_v",
                   "0 0 0 9 0 0 2 0.125 0.5"));
  EXPECT_TRUE(cloud.anisotropic() && cloud.variance.empty() && cloud.extra.empty());
  EXPECT_EQ(cloud.tangent[0], Vec3f(0, 0, 1));
  TemporaryFolder folder;
  write_cloud(cloud, folder / "a.ply", {.ascii = true});
  const std::string text = content(folder / "a.ply");
  EXPECT_NE(text.find("property float variance_v\nproperty float radius\n"), text.npos);
  EXPECT_TRUE(text.ends_with("0 0 1 0.125 0.5 1\n")) << text;
}

TEST(CloudIo, NormalsAreUnitOrZero) {
  const SurfelCloud cloud = cloud_of(ply(
      "float x,float y,float z,float nx,float ny,float nz",
      "0 0 0 0 3 4\n0 0 0 0 0 0\n0 0 0 nan 0 1\n0 0 0 inf 0 0\n0 0 0 1e-30 0 0\n0 0 0 0 1e30 0\n"
      "0 0 0 0 0.60000002 0.80000001\n",
      7));
  const Array<Vec3f> expected{Vec3f(0, 0.6f, 0.8f), Vec3f::Zero(),  Vec3f::Zero(),
                              Vec3f::Zero(),        Vec3f(1, 0, 0), Vec3f(0, 1, 0),
                              Vec3f(0, 0.6f, 0.8f)};
  EXPECT_EQ(cloud.normal, expected);
}

TEST(CloudIo, PositionsThatAreNotFiniteAreKept) {
  const SurfelCloud cloud = cloud_of(
      ply("float x,float y,float z", "nan 1 2\n1 inf 3\n1e7 1e7 1e7\n1e7 1e7 10000001", 4));
  ASSERT_EQ(cloud.size(), 4);
  EXPECT_TRUE(std::isnan(cloud.position[0].x()));
  EXPECT_EQ(cloud.world(1).y(), INFINITY);
  EXPECT_EQ(cloud.world(3), Vec3d(1e7, 1e7, 10000001));
}

TEST(CloudIo, FarAwayDoublesKeepTheirPrecision) {
  const std::string body = "10000000.001 -2 5e6\n10000000.002 -1 5000001\n10000001 -1 5000000.25\n";
  const SurfelCloud cloud = cloud_of(ply("double x,double y,double z", body, 3));
  EXPECT_NE(cloud.origin, Vec3d::Zero());
  EXPECT_NEAR(cloud.world(0).x(), 10000000.001, 1e-7);
  EXPECT_NEAR(cloud.world(1).x(), 10000000.002, 1e-7);
  EXPECT_EQ(cloud.world(2).z(), 5000000.25);
  TemporaryFolder folder;
  for (const char* name : {"a.ply", "a.pcd"}) {
    write_cloud(cloud, folder / name);
    const SurfelCloud read = read_cloud(folder / name);
    EXPECT_EQ(difference(cloud, read), "") << name;
    EXPECT_EQ(read.origin, cloud.origin);
    EXPECT_TRUE(read.double_positions);
  }
  // Text has these digits even where its header says float.
  EXPECT_NEAR(cloud_of(ply("float x,float y,float z", body, 3)).world(1).x(), 10000000.002, 1e-7);
}

TEST(CloudIo, FarAwayFloatsStayFloatsBitForBit) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 200\n"
      "property float x\nproperty float y\nproperty float z\nend_header\n";
  const std::size_t header = bytes.size();
  std::mt19937 engine(1);
  for (int i = 0; i < 600; ++i) {
    const auto value = static_cast<float>(4320978.5 + static_cast<double>(engine() % 1000) / 7);
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  }
  const SurfelCloud cloud = cloud_of(bytes);
  EXPECT_NE(cloud.origin, Vec3d::Zero());
  EXPECT_LT(cloud.position[0].norm(), 1000);
  TemporaryFolder folder;
  write_cloud(cloud, folder / "a.ply");
  const std::string written = content(folder / "a.ply");
  EXPECT_EQ(written.substr(written.size() - 200 * 12), bytes.substr(header));
}

TEST(CloudIo, OriginStaysAtZeroNearby) {
  EXPECT_EQ(cloud_of(ply("double x,double y,double z", "1 2 3\n2 3 5", 2)).origin, Vec3d::Zero());
  EXPECT_EQ(cloud_of(ply("float x,float y,float z", "100 0 0")).origin, Vec3d::Zero());
  EXPECT_EQ(cloud_of(ply("double x,double y,double z", "nan nan nan")).origin, Vec3d::Zero());
  const SurfelCloud one = cloud_of(ply("double x,double y,double z", "10000000.3 0 0"));
  EXPECT_NEAR(one.world(0).x(), 10000000.3, 1e-7);
}

TEST(CloudIo, HeaderCommentsApplyToTheCloud) {
  std::string bytes = ply("float x,float y,float z", "0 0 0");
  bytes.insert(bytes.find("element"),
               "comment surfel 0.0.1\ncomment surfel_basis 2.5\ncomment surfel_provenance a b  c\n"
               "comment VCGLIB generated\ncomment surfel_viewpoint 1 2 3 0 1 0 0\nobj_info x\n");
  const SurfelCloud cloud = cloud_of(bytes);
  EXPECT_EQ(cloud.basis_cutoff, 2.5);
  EXPECT_EQ(cloud.provenance, (std::vector<std::string>{"a b  c"}));
  EXPECT_EQ(cloud.comments, (std::vector<std::string>{"VCGLIB generated"}));
  ASSERT_TRUE(cloud.viewpoint);
  EXPECT_EQ(cloud.viewpoint->position, Vec3d(1, 2, 3));
  EXPECT_EQ(cloud.viewpoint->orientation, Vec4d(0, 1, 0, 0));
  EXPECT_FALSE(cloud.up);
  bytes.replace(bytes.find("2.5"), 3, "two");
  EXPECT_EQ(error_of(bytes), "the header comment 'surfel_basis two' has no cutoff > 0");
}

TEST(CloudIo, WhatColoursAreGoesThroughEveryFormat) {
  const std::string bare = ply("float x,float y,float z", "0 0 0");
  const auto saying = [&](const std::string& what) {
    std::string bytes = bare;
    return bytes.insert(bytes.find("element"), "comment surfel_color " + what + "\n");
  };
  EXPECT_EQ(cloud_of(bare).color_light, ColorLight::kUnsaid);
  test::TemporaryFolder folder;
  for (const auto& [what, light] : {std::pair{"recorded", ColorLight::kRecorded},
                                    {"reflectance", ColorLight::kReflectance},
                                    {"mixed", ColorLight::kMixed}}) {
    const SurfelCloud cloud = cloud_of(saying(what));
    EXPECT_EQ(cloud.color_light, light);
    EXPECT_EQ(cloud.gathered({0}).color_light, light);
    for (const char* name : {"a.ply", "a.pcd"}) {
      write_cloud(cloud, folder / name);
      EXPECT_EQ(read_cloud(folder / name).color_light, light) << name;
    }
  }
  EXPECT_EQ(error_of(saying("bright")),
            "the header comment 'surfel_color bright' says neither recorded, reflectance nor "
            "mixed");
}

TEST(CloudIo, UpGoesThroughEveryFormat) {
  std::string bytes = ply("float x,float y,float z", "0 0 0");
  bytes.insert(bytes.find("element"), "comment surfel_up 0 0 -2\n");
  const SurfelCloud cloud = cloud_of(bytes);
  EXPECT_EQ(cloud.up, Vec3d(0, 0, -1));
  test::TemporaryFolder folder;
  for (const char* name : {"a.ply", "a.pcd"}) {
    write_cloud(cloud, folder / name);
    EXPECT_EQ(read_cloud(folder / name).up, cloud.up) << name;
  }
  for (const std::string wrong : {"0 0 0", "0 0", "0 0 nan", "z"}) {
    std::string broken = bytes;
    broken.replace(broken.find("0 0 -2"), 6, wrong);
    EXPECT_EQ(error_of(broken), "the header comment 'surfel_up " + wrong + "' has no direction");
  }
}

/// A range grid of `side` x `side` cells, whose points are `point(column, row)`; every seventh cell
/// is empty.
template <class Point>
std::string range_grid(int side, const Point& point) {
  std::string points;
  std::string cells;
  int count = 0;
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      if ((row * side + column) % 7 == 3) {
        cells += "0\n";
        continue;
      }
      const Vec3d p = point(column, row);
      points +=
          std::to_string(p.x()) + " " + std::to_string(p.y()) + " " + std::to_string(p.z()) + "\n";
      cells += "1 " + std::to_string(count++) + "\n";
    }
  }
  const std::string sides = std::to_string(side);
  return "ply\nformat ascii 1.0\nobj_info num_cols " + sides + "\nobj_info num_rows " + sides +
         "\nelement vertex " + std::to_string(count) +
         "\nproperty float x\nproperty float y\nproperty float z\nelement range_grid " +
         std::to_string(side * side) + "\nproperty list uchar int vertex_indices\nend_header\n" +
         points + cells;
}

TEST(CloudIo, RangeGridTellsWhereTheScannerStood) {
  // Lines of sight along z, and a bump on a slope: its mean slope must not turn the direction.
  const auto bump = [](int column, int row) {
    return Vec3d(0.1 * column, 0.1 * row,
                 0.03 * column + std::exp(-0.1 * ((column - 5) * (column - 5) + row)));
  };
  const SurfelCloud cloud = cloud_of(range_grid(12, bump));
  ASSERT_TRUE(cloud.viewpoint);
  const Vec3d to_sensor = (cloud.viewpoint->position - cloud.bounds().center()).normalized();
  EXPECT_GT(to_sensor.z(), 0.9999);
  const Vec4d& q = cloud.viewpoint->orientation;
  const Eigen::Matrix3d axes = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
  EXPECT_LT((axes.col(2) - Vec3d(0, 0, -1)).norm(), 0.02);  // Forward.
  EXPECT_LT((axes.col(1) - Vec3d(0, -1, 0)).norm(), 0.02);  // Down.

  // Of a plane the front is told, of a line nothing.
  const auto plane = [](int column, int row) { return Vec3d(0, 0.1 * column, 0.1 * row); };
  const SurfelCloud flat = cloud_of(range_grid(12, plane));
  ASSERT_TRUE(flat.viewpoint);
  EXPECT_GT(flat.viewpoint->position.x(), 10);
  const auto line = [](int column, int row) { return Vec3d(column + row, 0, 0); };
  EXPECT_FALSE(cloud_of(range_grid(12, line)).viewpoint);

  // Grids that do not fit, and vertices that are not there.
  std::string bytes = range_grid(12, bump);
  bytes.replace(bytes.find("num_rows 12"), 11, "num_rows 13");
  EXPECT_FALSE(cloud_of(bytes).viewpoint);
  bytes = range_grid(12, bump);
  bytes.replace(bytes.rfind("\n1 5\n"), 5, "\n1 -9\n");
  EXPECT_TRUE(cloud_of(bytes).viewpoint);
}

TEST(CloudIo, UnusableInputSaysWhatIsMissing) {
  EXPECT_EQ(error_of(ply("float x,float z", "0 0")),
            "the points have no column y; x, y and z are needed");
  EXPECT_EQ(error_of(ply("float x,float y,list uchar int z", "0 0 0")),
            "the points have no column z; x, y and z are needed");
  EXPECT_EQ(error_of(ply("float x,float y,float z", "", 0)), "holds no points");
  EXPECT_EQ(error_of("ply\nformat ascii 1.0\nelement face 0\nend_header\n"),
            "holds no points: it has no element 'vertex'");
  EXPECT_EQ(error_of(""), "is empty; make it anew");
  EXPECT_EQ(error_of("FSAL and so on"),
            "format not supported; surfels and points are read from PLY, PCD, LAS, LAZ, E57 and "
            "text (PTX, XYZ, PTS)");
}

TEST(CloudIo, UnreadFormatsNameAConverter) {
  const TemporaryFolder folder;
  for (const auto& [name, program] :
       {std::pair("a b.fbx", "`assimp export "), std::pair("c.dae", "`assimp export "),
        std::pair("d.sog", "`splat-transform "), std::pair("e.3mf", "`assimp export ")}) {
    const std::string path = folder / name;
    std::ofstream(path) << "something";
    for (const std::string& message : {test::message_of([&] { read_cloud(path); }),
                                       test::message_of([&] { file_kind(path); })}) {
      EXPECT_NE(message.find(program), std::string::npos) << message;
    }
  }
}

/// Replaces a standard stream by another descriptor for the object's life.
class Redirected {
 public:
  Redirected(int stream, int descriptor) : stream_(stream), saved_(dup(stream)) {
    dup2(descriptor, stream);
    close(descriptor);
  }
  ~Redirected() {
    dup2(saved_, stream_);
    close(saved_);
  }
  Redirected(const Redirected&) = delete;
  Redirected& operator=(const Redirected&) = delete;

 private:
  int stream_;
  int saved_;
};

TEST(CloudIo, StandardStreams) {
  TemporaryFolder folder;
  const SurfelCloud cloud = RandomCloud(7).make();
  {
    const Redirected output(STDOUT_FILENO,
                            open((folder / "out.ply").c_str(), O_CREAT | O_WRONLY, 0600));
    write_cloud(cloud, "-");
  }
  EXPECT_EQ(difference(cloud, read_cloud(folder / "out.ply")), "");
  {
    const Redirected input(STDIN_FILENO, open((folder / "out.ply").c_str(), O_RDONLY));
    EXPECT_EQ(difference(cloud, read_cloud("-")), "");
  }
  int pipes[2];
  ASSERT_EQ(pipe(pipes), 0);
  const std::string bytes = content(folder / "out.ply");
  ASSERT_LT(bytes.size(), 60000);  // A pipe holds that much.
  ASSERT_EQ(write(pipes[1], bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  close(pipes[1]);
  const Redirected input(STDIN_FILENO, pipes[0]);
  EXPECT_EQ(difference(cloud, read_cloud("-")), "");
  try {
    read_cloud("-");  // The pipe is at its end.
    ADD_FAILURE() << "no error";
  } catch (const Error& e) {
    EXPECT_STREQ(e.what(), "standard input: is empty; make it anew");
  }
}

/// Lets files of this process grow to so many bytes only: what a full disk does.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &saved_);
    const rlimit limit{bytes, saved_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &saved_);
    std::signal(SIGXFSZ, handler_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit saved_{};
  void (*handler_)(int);
};

TEST(CloudIo, FailedWritingLeavesTheOldFileAndNoOther) {
  TemporaryFolder folder;
  SurfelCloud cloud;
  cloud.position.assign(20000, Vec3f(1, 2, 3));
  for (const std::string name : {"a.ply", "a.pcd"}) {
    std::ofstream(folder / name) << "old";
    {
      const FileSizeLimit limit(100000);
      EXPECT_THROW(write_cloud(cloud, folder / name), Error);
    }
    EXPECT_EQ(content(folder / name), "old");
    EXPECT_THROW(write_cloud(cloud, folder / name, {.no_clobber = true}), Error);
    EXPECT_EQ(content(folder / name), "old");
    cloud.area.assign(3, 1.0f);  // A column of the wrong length.
    EXPECT_THROW(write_cloud(cloud, folder / name), Error);
    cloud.area.clear();
  }
  EXPECT_THROW(write_cloud(cloud, folder / "no/a.ply"), Error);
  EXPECT_THROW(write_cloud(cloud, folder / "."), Error);
  const std::filesystem::directory_iterator files(folder / ".");
  EXPECT_EQ(std::distance(begin(files), end(files)), 2);
  if (std::filesystem::exists("/dev/full")) {
    EXPECT_THROW(write_cloud(cloud, "/dev/full"), Error);
  }
}

TEST(CloudIo, ThreadsDoNotChangeTheResult) {
  SurfelCloud cloud;
  cloud.origin = Vec3d(1e6, 0, 0);
  std::mt19937 engine(5);
  for (int i = 0; i < 300000; ++i) {
    const auto x = static_cast<float>(engine() % 1000) / 7;
    cloud.position.push_back(Vec3f(x, 1 - x, x * x));
    cloud.color.push_back(Vec3f(x / 200, 0.5f, 1));
  }
  TemporaryFolder folder;
  std::string first;
  SurfelCloud first_read;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    write_cloud(cloud, folder / "a.ply");
    const SurfelCloud read = read_cloud(folder / "a.ply");
    if (first.empty()) {
      first = content(folder / "a.ply");
      first_read = read;
    }
    EXPECT_TRUE(content(folder / "a.ply") == first);
    EXPECT_EQ(read.origin, first_read.origin);
    EXPECT_TRUE(same_bits(read.position, first_read.position));
  }
  set_thread_count(0);
}

/// A file that is right in every respect, as the base of broken ones.
std::string valid_file(bool binary) {
  const std::string header = std::string("ply\nformat ") +
                             (binary ? "binary_little_endian" : "ascii") +
                             " 1.0\ncomment surfel_basis 1\nelement face 1\n"
                             "property list uchar int corners\nelement vertex 3\n"
                             "property float x\nproperty float y\nproperty float z\n"
                             "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                             "property double extra\nend_header\n";
  if (!binary) return header + "3 0 1 2\n1 2 3 4 5 6 7\n1 2 3 4 5 6 7\n1 2 3 4 5 6 7\n";
  return header + std::string("\3\0\0\0\0\1\0\0\0\2\0\0\0", 13) + std::string(3 * 23, '\1');
}

TEST(CloudIo, MutatedFilesAreReadOrRefused) {
  const auto attempt = [](const std::string& bytes) {
    const MemoryFile file(bytes);
    try {
      read_cloud(file.path());
      return 1;
    } catch (const Error& e) {
      EXPECT_TRUE(std::string(e.what()).starts_with(file.path())) << e.what();
      return 0;
    }
  };
  int read = 0;
  int tried = 0;
  for (const bool binary : {false, true}) {
    const std::string valid = valid_file(binary);
    EXPECT_EQ(attempt(valid), 1);
    for (std::size_t at = 0; at < valid.size(); ++at) {
      attempt(valid.substr(0, at));
      std::string shorter = valid;
      read += attempt(shorter.erase(at, 1));
      for (const char c : {'\0', '\xff', ' ', '\n', '9', '-', 'e'}) {
        std::string changed = valid;
        changed[at] = c;
        read += attempt(changed);
        ++tried;
      }
    }
  }
  EXPECT_GT(read, 0);
  EXPECT_LT(read, tried);
}

TEST(CloudIo, RealFilesReadRight) {
  SURFEL_REQUIRE_TEST_DATA();
  struct Expected {
    const char* file;
    std::size_t size;
    Vec3d first;
  };
  const Expected files[] = {
      {"colour_clouds/lion_takanawa_third.ply", 113997, {-3.811, 2.263, -2.926}},
      {"colour_clouds/fragment_normals_rgb.pcd", 113662, {1.16797, 1.01803, 0.964844}},
      {"colour_clouds/milk_color.pcd", 13704, {-0.131608, -0.209543, 0.772}},
      {"lidar/samp11-utm.pcd", 38010, {512743.63, 5403547.5, 308.68}},
      {"meshes/mri_head_surface.ply", 260205, {157.683365, 131.834961, 1.3644103}},
      {"raw_scans/bun0.pcd", 397, {0.0054216, 0.11349, 0.040749}},
      {"raw_scans/bun000_range_grid.ply", 40256, {-0.06325, 0.0359793, 0.0420873}},
      {"malformed/tricky/happly_faces_first.ply", 50, {-3.56263, -0.627972, 0.613591}},
      {"malformed/tricky/trimesh_lists_on_points.ply", 5, {-0.06325, 0.0359793, 0.0420873}},
      {"malformed/tricky/trimesh_uv_s_t.ply", 24, {0.5, 0.5, 0.5}},
      {"malformed/tricky/assimp_crlf_after_end_header.ply", 8, {0, 0, 0}},
      {"malformed/tricky/assimp_float_colour.ply", 3, {0, 0, 0}},
      {"malformed/tricky/draco_whitespace.ply", 3, {0.25, 0.1, 0}},
      {"malformed/tricky/draco_int_coordinates.ply", 16, {-409, 249, 4}},
      {"malformed/tricky/meshlab_many_small_holes.ply", 2004, {-0.0131592, -0.0598382, 1.58958}},
      {"malformed/tricky/meshlab_two_textures.ply", 8, {0, 0, 0}},
      {"malformed/tricky/pdal_utm17_tab.pcd", 10, {289814.15, 4320978.61, 170.76}},
      {"malformed/tricky/pcl_octants.pcd", 8, {-9, -9, -9}}};
  for (const Expected& expected : files) {
    const SurfelCloud cloud = read_cloud(test::data_folder() / expected.file);
    EXPECT_EQ(cloud.size(), expected.size) << expected.file;
    EXPECT_LT((cloud.world(0) - expected.first).norm(), 1e-5 * (1 + expected.first.norm() / 1e4))
        << expected.file << ": " << cloud.world(0).transpose();
  }
  const auto tricky = [](const char* name) {
    return read_cloud(test::data_folder() / "malformed/tricky" / name);
  };
  EXPECT_EQ(tricky("trimesh_uv_s_t.ply").uv[0], Vec2f(0.625f, 0.5f));
  EXPECT_EQ(tricky("trimesh_uv_s_t.ply").normal[0], Vec3f(0, 0, 1));
  EXPECT_EQ(tricky("assimp_float_colour.ply").color[2], Vec3f(0, 0, 1));
  EXPECT_EQ(tricky("assimp_float_colour.ply").alpha[2], 1);
  EXPECT_EQ(tricky("draco_whitespace.ply").color[1],
            Vec3f(srgb8_to_linear(77), 0, srgb8_to_linear(205)));
  EXPECT_EQ(tricky("meshlab_many_small_holes.ply").extra[0].name, "quality");
  EXPECT_NEAR(tricky("pdal_utm17_tab.pcd").world(9).y(), 4320980.59, 1e-6);
}

TEST(CloudIo, RealInvalidFilesAreRefused) {
  SURFEL_REQUIRE_TEST_DATA();
  int refused = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(test::data_folder() / "malformed/invalid")) {
    // One good point; that its time is no number harms nobody.
    if (entry.path().filename() == "pdal_gps_time_nan.las") {
      EXPECT_EQ(read_cloud(entry.path()).size(), 1U);
      continue;
    }
    try {
      read_cloud(entry.path());
      ADD_FAILURE() << entry.path();
    } catch (const Error& e) {
      EXPECT_TRUE(std::string(e.what()).starts_with(entry.path().string())) << e.what();
      ++refused;
    }
  }
  EXPECT_GE(refused, 15);
}

}  // namespace
}  // namespace surfel
