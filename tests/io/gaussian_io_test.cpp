#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <sstream>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>

#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

InputFile file_of(const std::string& bytes, const std::string& name = "file.ply") {
  return {name, std::as_bytes(std::span(bytes.data(), bytes.size()))};
}

/// A trained Gaussian as a PLY file has it, its properties by their names.
struct Trained {
  std::vector<std::pair<std::string, float>> values{
      {"x", 1},       {"y", 2},      {"z", 3},       {"nx", 7},      {"ny", 7},      {"nz", 7},
      {"f_dc_0", 1},  {"f_dc_1", 2}, {"f_dc_2", -1}, {"opacity", 0}, {"scale_0", 0}, {"scale_1", 1},
      {"scale_2", 2}, {"rot_0", 2},  {"rot_1", 0},   {"rot_2", 0},   {"rot_3", 0}};

  Trained& set(const std::string& name, float value) {
    for (auto& [known, old] : values) {
      if (known == name) {
        old = value;
        return *this;
      }
    }
    values.emplace_back(name, value);
    return *this;
  }
  Trained& drop(const std::string& name) {
    std::erase_if(values, [&](const auto& value) { return value.first == name; });
    return *this;
  }
};

/// A binary file of these Gaussians, which all have the properties of the first.
std::string ply_of(const std::vector<Trained>& all, const std::string& comments = "",
                   const std::string& count = "") {
  std::string file = "ply\nformat binary_little_endian 1.0\n" + comments;
  file += "element vertex " + (count.empty() ? std::to_string(all.size()) : count) + "\n";
  for (const auto& [name, value] : all.front().values) file += "property float " + name + "\n";
  file += "end_header\n";
  for (const Trained& one : all) {
    for (const auto& [name, value] : one.values) {
      file.append(reinterpret_cast<const char*>(&value), sizeof(value));
    }
  }
  return file;
}

GaussianCloud cloud_of(const std::vector<Trained>& all, const std::string& comments = "") {
  return read_gaussians(file_of(ply_of(all, comments)));
}

std::string error_of(const std::string& bytes, const std::string& name = "file.ply") {
  const std::string message = message_of([&] { read_gaussians(file_of(bytes, name)); });
  EXPECT_TRUE(message.starts_with(name + ": ")) << message;
  return message;
}

std::string content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

/// Colour of a Gaussian as .splat has it, 0..1.
double base_color(const GaussianCloud& cloud, std::size_t i, std::size_t channel) {
  return 0.5 + GaussianCloud::kHarmonic0 * cloud.harmonics[i * cloud.harmonics_stride() + channel];
}

TEST(GaussianPly, ValuesAreThoseThatTheRendererUses) {
  const GaussianCloud cloud = cloud_of({Trained().set("opacity", 1).set("rot_3", -2)});
  ASSERT_EQ(cloud.size(), 1U);
  EXPECT_EQ(cloud.position[0], Vec3f(1, 2, 3));
  EXPECT_FLOAT_EQ(cloud.scale[0][0], 1);
  EXPECT_FLOAT_EQ(cloud.scale[0][1], std::exp(1.0F));
  EXPECT_FLOAT_EQ(cloud.scale[0][2], std::exp(2.0F));
  EXPECT_FLOAT_EQ(cloud.amplitude[0], 1 / (1 + std::exp(-1.0F)));
  const float half = std::sqrt(0.5F);
  EXPECT_FLOAT_EQ(cloud.rotation[0][0], half);
  EXPECT_FLOAT_EQ(cloud.rotation[0][3], -half);
  EXPECT_EQ(cloud.degree, 0);
  EXPECT_EQ(cloud.harmonics, (Array<float>{1, 2, -1}));
  EXPECT_EQ(cloud.rule, AmplitudeRule::kOpacity);
  EXPECT_EQ(cloud.trained_with, TrainedWith::kUnknown);
  EXPECT_FALSE(cloud.up);
  EXPECT_EQ(cloud.unusable_skipped, 0U);
}

TEST(GaussianPly, HarmonicsAreOrderedByCoefficientThenColor) {
  for (int degree = 0; degree <= 4; ++degree) {
    const int coefficients = degree * (degree + 2);
    Trained one;
    for (int k = 0; k < 3 * coefficients; ++k) {
      one.set("f_rest_" + std::to_string(k), static_cast<float>(100 + k));
    }
    const GaussianCloud cloud = cloud_of({one, one});
    ASSERT_EQ(cloud.degree, degree);
    ASSERT_EQ(cloud.harmonics.size(), 2 * cloud.harmonics_stride());
    const float* const second = cloud.harmonics.data() + cloud.harmonics_stride();
    EXPECT_EQ(second[1], 2);
    for (int k = 0; k < coefficients; ++k) {
      for (int color = 0; color < 3; ++color) {
        EXPECT_EQ(second[3 * (k + 1) + color], 100 + color * coefficients + k);
      }
    }
  }
  Trained one;
  for (int k = 0; k < 10; ++k) one.set("f_rest_" + std::to_string(k), 0);
  EXPECT_NE(error_of(ply_of({one})).find("10 numbers of spherical harmonics"), std::string::npos);
  one.drop("f_rest_3");
  EXPECT_NE(error_of(ply_of({one})).find("no property 'f_rest_3'"), std::string::npos);
}

TEST(GaussianPly, WithoutAThirdScaleItIsFlat) {
  const GaussianCloud cloud = cloud_of({Trained().drop("scale_2")}, "comment antialiased 1\n");
  EXPECT_EQ(cloud.scale[0][2], 0);
  EXPECT_EQ(cloud.trained_with, TrainedWith::k2dgs);
  EXPECT_EQ(cloud.rule, AmplitudeRule::kOpacity);
}

TEST(GaussianPly, FilterOfMipSplattingIsBakedIn) {
  const GaussianCloud cloud =
      cloud_of({Trained().set("filter_3D", 2), Trained().set("filter_3D", 0)});
  EXPECT_EQ(cloud.trained_with, TrainedWith::kMip);
  EXPECT_EQ(cloud.rule, AmplitudeRule::kCompensated);
  double ratio = 1;
  for (int k = 0; k < 3; ++k) {
    const double before = std::exp(k);
    const double after = std::sqrt(before * before + 4);
    EXPECT_NEAR(cloud.scale[0][k], after, 1e-6 * after);
    ratio *= before / after;
  }
  EXPECT_NEAR(cloud.amplitude[0], 0.5 * ratio, 1e-7);
  EXPECT_FLOAT_EQ(cloud.scale[1][1], std::exp(1.0F));
  EXPECT_EQ(cloud.amplitude[1], 0.5F);
}

TEST(GaussianPly, TagsOfTheHeaderNameTheRenderer) {
  const auto tags = [](const std::string& comments) {
    const GaussianCloud cloud = cloud_of({Trained()}, comments);
    return std::pair(cloud.rule, cloud.trained_with);
  };
  using enum AmplitudeRule;
  EXPECT_EQ(tags("comment SplatRenderMode: mip\n"), std::pair(kCompensated, TrainedWith::kMip));
  EXPECT_EQ(tags("comment SplatRenderMode: default\n"), std::pair(kOpacity, TrainedWith::kInria));
  EXPECT_EQ(tags("comment SplatRenderMode: 2dgs\n"), std::pair(kOpacity, TrainedWith::k2dgs));
  EXPECT_EQ(tags("comment antialiased 1\n"), std::pair(kCompensated, TrainedWith::kMip));
  EXPECT_EQ(tags("comment antialiased: 1\n"), std::pair(kCompensated, TrainedWith::kMip));
  // The last one wins.
  EXPECT_EQ(tags("comment SplatRenderMode: mip\ncomment antialiased 0\n"),
            std::pair(kOpacity, TrainedWith::kInria));
  EXPECT_EQ(tags("comment SplatRenderMode: new\n"), std::pair(kOpacity, TrainedWith::kUnknown));
}

TEST(GaussianPly, WhatCannotBeDrawnIsLeftOut) {
  const GaussianCloud cloud = cloud_of({
      Trained().set("x", kNan),
      Trained().set("z", kInfinity),
      Trained().set("scale_1", 88),  // 1.6e38
      Trained().set("scale_1", kInfinity),
      Trained().set("opacity", kNan),
      Trained().set("rot_2", kInfinity),
      Trained().set("f_dc_1", kNan),
      Trained().set("x", 5),
  });
  ASSERT_EQ(cloud.size(), 1U);
  EXPECT_EQ(cloud.unusable_skipped, 7U);
  EXPECT_EQ(cloud.position[0][0], 5);
  EXPECT_EQ(cloud.harmonics, (Array<float>{1, 2, -1}));
  EXPECT_NE(error_of(ply_of({Trained().set("x", kNan)})).find("none of its 1 Gaussians"),
            std::string::npos);
}

TEST(GaussianPly, LimitsOfWhatIsTrainedAreUsable) {
  const GaussianCloud cloud = cloud_of({
      Trained().set("opacity", kInfinity).set("rot_0", 0),
      Trained().set("opacity", -kInfinity).set("scale_2", -kInfinity),
      Trained().set("rot_0", 1e30F).set("rot_1", 1e30F),
  });
  ASSERT_EQ(cloud.size(), 3U);
  EXPECT_EQ(cloud.amplitude[0], 1);
  EXPECT_EQ(cloud.rotation[0], (std::array<float, 4>{1, 0, 0, 0}));
  EXPECT_EQ(cloud.amplitude[1], 0);
  EXPECT_EQ(cloud.scale[1][2], 0);
  EXPECT_FLOAT_EQ(cloud.rotation[2][0], std::sqrt(0.5F));
}

TEST(GaussianPly, TextAndDoublesAreReadToo) {
  std::string text = "ply\nformat ascii 1.0\nelement vertex 1\n";
  std::string row;
  for (const auto& [name, value] : Trained().values) {
    const bool wide = name == "x" || name == "y" || name == "z";
    text += fmt::format("property {} {}\n", wide ? "double" : "float", name);
    row += fmt::format("{} ", wide ? 5e6 + value + 0.125 : value);
  }
  const GaussianCloud cloud = read_gaussians(file_of(text + "end_header\n" + row + "\n"));
  ASSERT_EQ(cloud.size(), 1U);
  const Vec3d world = cloud.origin + cloud.position[0].cast<double>();
  EXPECT_EQ(world, Vec3d(5e6 + 1.125, 5e6 + 2.125, 5e6 + 3.125));
  EXPECT_FLOAT_EQ(cloud.scale[0][2], std::exp(2.0F));
}

TEST(GaussianPly, WhatIsWrongIsNamed) {
  const std::string file = ply_of({Trained(), Trained()});
  EXPECT_TRUE(holds_gaussians(file_of(file)));
  const std::size_t header = file.find("end_header\n") + 11;
  for (std::size_t size = 0; size < file.size(); ++size) error_of(file.substr(0, size));
  EXPECT_NE(error_of(file.substr(0, header + 100)).find("promises 2"), std::string::npos);
  EXPECT_NE(error_of(ply_of({Trained()}, "", "99999999999999")).find("promises 99999999999999"),
            std::string::npos);
  EXPECT_NE(error_of(ply_of({Trained()}, "", "0")).find("holds no Gaussians"), std::string::npos);
  EXPECT_NE(error_of(ply_of({Trained().drop("rot_3")})).find("no property 'rot_3'"),
            std::string::npos);
  EXPECT_NE(error_of(ply_of({Trained()}, "comment surfel_origin 1 2\n")).find("origin"),
            std::string::npos);
}

TEST(GaussianPly, PointsAndMeshesHoldNone) {
  const std::string points =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nproperty float opacity\nend_header\n0 0 0 1\n";
  EXPECT_FALSE(holds_gaussians(file_of(points)));
  EXPECT_NE(error_of(points).find("holds no trained Gaussians"), std::string::npos);
  EXPECT_FALSE(holds_gaussians(file_of("0 0 0\n", "points.xyz")));
  EXPECT_FALSE(holds_gaussians("-"));
}

TEST(GaussianPly, RealFile) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::string path = data_folder() / "surfels/gaussians_train_1000.ply";
  EXPECT_TRUE(holds_gaussians(path));
  const GaussianCloud cloud = read_gaussians(path);
  ASSERT_EQ(cloud.size(), 1000U);
  EXPECT_EQ(cloud.degree, 3);
  EXPECT_EQ(cloud.unusable_skipped, 0U);
  float least = 1e9F;
  float most = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    least = std::min(least, cloud.position[i][0]);
    most = std::max(most, cloud.position[i][0]);
    const Eigen::Vector4f q(cloud.rotation[i].data());
    EXPECT_NEAR(q.norm(), 1, 1e-6);
    EXPECT_TRUE(cloud.amplitude[i] > 0 && cloud.amplitude[i] < 1);
  }
  EXPECT_NEAR(least, -13.021, 1e-3);
  EXPECT_NEAR(most, 10.2932, 1e-4);
  EXPECT_LT((cloud.position[0] - Vec3f(2.09585F, -0.59983F, 1.21915F)).norm(), 1e-5F);
}

/// 32 bytes of a .splat file.
std::string splat_record(const std::array<float, 6>& floats, const std::string& bytes) {
  return std::string(reinterpret_cast<const char*>(floats.data()), sizeof(floats)) + bytes;
}

TEST(SplatFile, BytesAreDecoded) {
  using namespace std::string_literals;
  const std::string file =
      splat_record({1, 2, 3, 0.5F, 0.25F, -2}, "\x00\x80\xff\x33\xff\x80\x80\x01"s) +
      splat_record({4, 5, 6, 1, 1, 1}, "\x00\x00\x00\x00\x80\x80\x80\x80"s);
  const GaussianCloud cloud = read_gaussians(file_of(file, "a.splat"));
  ASSERT_EQ(cloud.size(), 2U);
  EXPECT_EQ(cloud.position[0], Vec3f(1, 2, 3));
  EXPECT_EQ(cloud.scale[0], Vec3f(0.5F, 0.25F, 2));
  EXPECT_FLOAT_EQ(cloud.amplitude[0], 0.2F);
  EXPECT_NEAR(base_color(cloud, 0, 0), 0, 1e-7);
  EXPECT_NEAR(base_color(cloud, 0, 1), 128 / 255.0, 1e-7);
  EXPECT_NEAR(base_color(cloud, 0, 2), 1, 1e-7);
  const float half = std::sqrt(0.5F);
  EXPECT_FLOAT_EQ(cloud.rotation[0][0], half);
  EXPECT_FLOAT_EQ(cloud.rotation[0][3], -half);
  // Four bytes of 128 are a zero quaternion.
  EXPECT_EQ(cloud.rotation[1], (std::array<float, 4>{1, 0, 0, 0}));
}

TEST(SplatFile, WhatIsWrongIsNamed) {
  EXPECT_NE(error_of(std::string(33, 'x'), "a.splat").find("not a multiple of 32"),
            std::string::npos);
  EXPECT_NE(error_of("", "a.splat").find("is empty"), std::string::npos);
  const std::string huge = splat_record({0, 0, 0, 1e38F, 1, 1}, "rgbarota");
  EXPECT_NE(error_of(huge, "a.splat").find("none of its 1 Gaussians"), std::string::npos);
}

TEST(SplatFile, RealFile) {
  SURFEL_REQUIRE_TEST_DATA();
  const std::string path = data_folder() / "surfels/table.splat";
  EXPECT_TRUE(holds_gaussians(path));
  const GaussianCloud cloud = read_gaussians(path);
  EXPECT_EQ(cloud.size(), 72637U);
  EXPECT_EQ(cloud.degree, 0);
}

/// Gaussians of all degrees that differ in everything.
GaussianCloud some_gaussians(std::size_t count, int degree) {
  GaussianCloud cloud;
  cloud.degree = degree;
  for (std::size_t i = 0; i < count; ++i) {
    const auto x = static_cast<float>(i);
    cloud.position.emplace_back(x, -x, 0.5F * x);
    cloud.scale.emplace_back(0.1F + x, 0.2F, 0.3F / (1 + x));
    const Eigen::Quaternionf q = Eigen::Quaternionf(1, 0.1F * x, 0.5F, -0.3F).normalized();
    cloud.rotation.push_back({q.w(), q.x(), q.y(), q.z()});
    cloud.amplitude.push_back((1 + x) / static_cast<float>(count + 2));
    for (std::size_t k = 0; k < cloud.harmonics_stride(); ++k) {
      cloud.harmonics.push_back(std::sin(x + static_cast<float>(k)));
    }
  }
  return cloud;
}

TEST(GaussianPly, WhatIsWrittenReadsBack) {
  const TemporaryFolder folder;
  for (int degree = 0; degree <= 4; ++degree) {
    GaussianCloud cloud = some_gaussians(5000, degree);
    cloud.origin = Vec3d(4e6, 0.1, -3);
    cloud.rule = AmplitudeRule::kCompensated;
    cloud.trained_with = TrainedWith::kMip;
    write_gaussians(cloud, folder / "a.ply", {.provenance = {"line\nbreak"}});
    const GaussianCloud back = read_gaussians(folder / "a.ply");
    EXPECT_EQ(back.origin, cloud.origin);
    EXPECT_EQ(back.position, cloud.position);
    EXPECT_EQ(back.harmonics, cloud.harmonics);
    EXPECT_EQ(back.rule, cloud.rule);
    EXPECT_EQ(back.trained_with, cloud.trained_with);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      for (int k = 0; k < 3; ++k) {
        ASSERT_NEAR(back.scale[i][k], cloud.scale[i][k], 1e-6 * cloud.scale[i][k]);
      }
      ASSERT_NEAR(back.amplitude[i], cloud.amplitude[i], 1e-6);
      for (std::size_t k = 0; k < 4; ++k) {
        ASSERT_NEAR(back.rotation[i][k], cloud.rotation[i][k], 1e-6);
      }
    }
  }
}

TEST(GaussianPly, FlatAndOpaqueStayFinite) {
  const TemporaryFolder folder;
  GaussianCloud cloud = some_gaussians(2, 0);
  cloud.amplitude = {1, 0};
  for (Vec3f& scale : cloud.scale) scale[2] = 0;
  write_gaussians(cloud, folder / "a.ply");
  const GaussianCloud spatial = read_gaussians(folder / "a.ply");
  EXPECT_EQ(spatial.unusable_skipped, 0U);
  EXPECT_NEAR(spatial.amplitude[0], 1, 2e-6);
  EXPECT_NEAR(spatial.amplitude[1], 0, 2e-6);
  EXPECT_LT(spatial.scale[0][2], 1e-30F);
  cloud.trained_with = TrainedWith::k2dgs;
  write_gaussians(cloud, folder / "a.ply");
  EXPECT_EQ(content(folder / "a.ply").find("scale_2"), std::string::npos);
  const GaussianCloud flat = read_gaussians(folder / "a.ply");
  EXPECT_EQ(flat.trained_with, TrainedWith::k2dgs);
  EXPECT_EQ(flat.scale[0][2], 0);
}

TEST(GaussianPly, DensitiesStayDensities) {
  const TemporaryFolder folder;
  GaussianCloud cloud = some_gaussians(2, 0);
  cloud.rule = AmplitudeRule::kDensity;
  cloud.amplitude = {37.5F, 0};
  write_gaussians(cloud, folder / "a.ply");
  const GaussianCloud back = read_gaussians(folder / "a.ply");
  EXPECT_EQ(back.rule, AmplitudeRule::kDensity);
  EXPECT_EQ(back.amplitude, cloud.amplitude);
  EXPECT_NE(message_of([&] { write_gaussians(cloud, folder / "a.splat"); }).find("densities"),
            std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(folder / "a.splat"));
}

TEST(SplatFile, WhatIsWrittenReadsBackToItsBytes) {
  const TemporaryFolder folder;
  const GaussianCloud cloud = some_gaussians(5000, 2);
  write_gaussians(cloud, folder / "a.splat");
  const GaussianCloud back = read_gaussians(folder / "a.splat");
  EXPECT_EQ(back.position, cloud.position);
  EXPECT_EQ(back.scale, cloud.scale);
  ASSERT_EQ(back.degree, 0);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    ASSERT_NEAR(back.amplitude[i], cloud.amplitude[i], 0.5 / 255 + 1e-6);
    for (std::size_t k = 0; k < 3; ++k) {
      const double color = std::clamp(base_color(cloud, i, k), 0.0, 1.0);
      ASSERT_NEAR(base_color(back, i, k), color, 0.5 / 255 + 1e-6);
    }
    const Eigen::Vector4f q(cloud.rotation[i].data());
    const Eigen::Vector4f read(back.rotation[i].data());
    ASSERT_LT((q - read).norm(), 0.01);
  }
  // A second time nothing changes any more.
  write_gaussians(back, folder / "b.splat");
  const GaussianCloud again = read_gaussians(folder / "b.splat");
  EXPECT_EQ(again.harmonics, back.harmonics);
  EXPECT_EQ(again.amplitude, back.amplitude);
}

TEST(ReadCloud, GaussiansAreNoSurfels) {
  const std::string ply = ply_of({Trained()});
  const TemporaryFolder folder;
  std::ofstream(folder / "a.ply", std::ios::binary) << ply;
  EXPECT_EQ(file_kind(folder / "a.ply"), FileKind::kGaussians);
  EXPECT_NE(message_of([&] { read_cloud(file_of(ply)); }).find("file.ply: holds Gaussians"),
            std::string::npos);
  std::ofstream(folder / "a.splat", std::ios::binary) << splat_record({}, "rgbarota");
  EXPECT_EQ(file_kind(folder / "a.splat"), FileKind::kGaussians);
  EXPECT_NE(message_of([&] { read_cloud(folder / "a.splat"); }).find("a.splat: holds Gaussians"),
            std::string::npos);
}

/// The numbers of an attribute of a .usda text, one after the other.
std::vector<float> numbers_of(const std::string& text, const std::string& attribute) {
  const std::size_t name = text.find(" " + attribute + " = [");
  EXPECT_NE(name, std::string::npos) << attribute;
  const std::size_t begin = text.find('[', name);
  std::string list = text.substr(begin, text.find(']', begin) - begin);
  std::replace_if(
      list.begin(), list.end(), [](char c) { return c == '[' || c == '(' || c == ')' || c == ','; },
      ' ');
  std::istringstream in(list);
  return {std::istream_iterator<float>(in), std::istream_iterator<float>()};
}

TEST(UsdaFile, HoldsWhatParticleFieldsNeed) {
  const TemporaryFolder folder;
  GaussianCloud cloud = some_gaussians(3, 1);
  write_gaussians(cloud, folder / "a.usda", {.provenance = {"by \"me\"\n"}});
  std::string text = content(folder / "a.usda");
  EXPECT_TRUE(text.starts_with("#usda 1.0\n"));
  EXPECT_NE(text.find("def ParticleField \"Gaussians\""), std::string::npos);
  EXPECT_NE(text.find("\"ParticleFieldKernelGaussianEllipsoidAPI\""), std::string::npos);
  EXPECT_NE(text.find("doc = \"surfel"), std::string::npos);
  EXPECT_EQ(text.find("xformOp"), std::string::npos);
  EXPECT_EQ(std::count(text.begin(), text.end(), '"') % 2, 0);
  const std::vector<float> positions = numbers_of(text, "positions");
  ASSERT_EQ(positions.size(), 9U);
  EXPECT_EQ(Vec3f(positions.data() + 3), cloud.position[1]);
  const std::vector<float> turns = numbers_of(text, "orientations");
  ASSERT_EQ(turns.size(), 12U);
  EXPECT_EQ(turns[4], cloud.rotation[1][0]);
  EXPECT_EQ(numbers_of(text, "opacities").size(), 3U);
  EXPECT_EQ(numbers_of(text, "scales")[8], cloud.scale[2][2]);
  const std::vector<float> colors = numbers_of(text, "radiance:sphericalHarmonicsCoefficients");
  EXPECT_TRUE(
      std::equal(colors.begin(), colors.end(), cloud.harmonics.begin(), cloud.harmonics.end()));
  EXPECT_NE(text.find("int radiance:sphericalHarmonicsDegree = 1"), std::string::npos);

  // Flat Gaussians are surflets; what is upside down, or far away, is moved.
  for (Vec3f& scale : cloud.scale) scale[2] = 0;
  cloud.origin = Vec3d(4000000.5, 0, 0);
  cloud.up = Vec3d(0, -1, 0);
  write_gaussians(cloud, folder / "a.usda");
  text = content(folder / "a.usda");
  EXPECT_NE(text.find("\"ParticleFieldKernelGaussianSurfletAPI\""), std::string::npos);
  EXPECT_EQ(numbers_of(text, "scales")[2], 1);
  EXPECT_NE(text.find("xformOp:translate = (4000000.5, 0, 0)"), std::string::npos);
  EXPECT_NE(text.find("xformOpOrder = [\"xformOp:rotateX\", \"xformOp:translate\"]"),
            std::string::npos);
}

TEST(WriteGaussians, OtherNamesAreRefused) {
  const TemporaryFolder folder;
  EXPECT_NE(message_of([&] {
              write_gaussians(some_gaussians(1, 0), folder / "a.xyz");
            }).find("PLY, .splat or .usda"),
            std::string::npos);
  write_gaussians(some_gaussians(1, 0), folder / "a.ply");
  EXPECT_NE(message_of([&] {
              write_gaussians(some_gaussians(1, 0), folder / "a.ply", {.no_clobber = true});
            }),
            "");
}

TEST(WriteGaussians, BytesDoNotDependOnTheThreads) {
  const TemporaryFolder folder;
  const GaussianCloud cloud = some_gaussians(10000, 3);
  for (const char* name : {"a.ply", "a.splat"}) {
    set_thread_count(1);
    write_gaussians(cloud, folder / name);
    const std::string one = content(folder / name);
    set_thread_count(3);
    write_gaussians(cloud, folder / name);
    EXPECT_EQ(content(folder / name), one);
    set_thread_count(0);
  }
}

}  // namespace
}  // namespace surfel::test
