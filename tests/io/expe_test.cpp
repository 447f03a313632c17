#include <cstring>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/io/cloud_io.h>

#include "io/cloud_of_bytes.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

/// Two surfels with a property of another meaning in front.
std::string two_surfels(const std::string& count = "2") {
  std::string file =
      "[Expe/PointSet/Binary/0.1]\nproperty other 3\nproperty position 12\n"
      "property radius 4\nproperty normal 12\nproperty color 4\nnofpoints " +
      count + "\ndata\n";
  for (int i = 0; i < 2; ++i) {
    const auto k = static_cast<float>(i);
    const float numbers[7] = {k, 2, 3, 0.5F + k, 0, 0, 1};
    std::string record(3, 'x');
    record.append(reinterpret_cast<const char*>(numbers), sizeof(numbers));
    file += record + std::string("\xFF\x80\x00\x00", 4);
  }
  return file;
}

TEST(Expe, SurfelsWithRadiiNormalsAndColors) {
  const SurfelCloud cloud = cloud_of(two_surfels());
  ASSERT_EQ(cloud.size(), 2U);
  EXPECT_EQ(cloud.position[1], Vec3f(1, 2, 3));
  EXPECT_EQ(cloud.normal[1], Vec3f(0, 0, 1));
  EXPECT_EQ(cloud.variance[1], 1.5F * 1.5F / 2);
  EXPECT_EQ(cloud.color[0], Vec3f(1, srgb8_to_linear(128), 0));
  EXPECT_EQ(cloud.color_light, ColorLight::kReflectance);
  EXPECT_TRUE(cloud.alpha.empty() && cloud.extra.empty());
}

TEST(Expe, RealFile) {
  SURFEL_REQUIRE_TEST_DATA();
  const SurfelCloud bunny = read_cloud(data_folder() / "surfels/bunny16k_surfels.pts");
  ASSERT_EQ(bunny.size(), 16130U);
  EXPECT_NEAR(bunny.bounds().max[0], 50, 1e-4);
  float least = 1e9F;
  float most = 0;
  for (const float variance : bunny.variance) {
    least = std::min(least, variance);
    most = std::max(most, variance);
  }
  EXPECT_NEAR(std::sqrt(2 * least), 0.267, 1e-3);
  EXPECT_NEAR(std::sqrt(2 * most), 5.55, 5e-3);
}

TEST(Expe, WhatIsWrongIsNamed) {
  const std::string file = two_surfels();
  const std::size_t data = file.find("data\n") + 5;
  for (std::size_t size = 16; size < file.size(); ++size) {
    const std::string says = size < data ? "" : "the header promises 2 points";
    EXPECT_NE(error_of(file.substr(0, size)), "no error") << size;
    EXPECT_NE(error_of(file.substr(0, size)).find(says), std::string::npos) << size;
  }
  EXPECT_NE(error_of(two_surfels("99999999999999999999")).find("nofpoints"), std::string::npos);
  EXPECT_NE(error_of(two_surfels("3")).find("promises 3 points"), std::string::npos);
  EXPECT_NE(error_of(two_surfels("0")).find("holds no points"), std::string::npos);
  EXPECT_NE(error_of("[Expe/PointSet/Ascii/0.1]\ndata\n").find("binary"), std::string::npos);
  EXPECT_NE(error_of("[Expe/PointSet/Binary/0.1]\nproperty position 0\ndata\n").find("bytes"),
            std::string::npos);
  EXPECT_NE(error_of("[Expe/PointSet/Binary/0.1]\nnofpoints 9\ndata\n"), "no error");
}

}  // namespace
}  // namespace surfel::test
