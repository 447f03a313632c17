#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/random.h>
#include <surfel/base/types.h>
#include <surfel/render/sheet_search.h>

namespace surfel::test {
namespace {

/// A cluster's surfels, with columns as a RenderCloud has them.
struct Surfels {
  std::vector<float> x, y, z, normal_x, normal_y, normal_z, deviation, area;
  std::vector<float> clip_x, clip_zero;

  void add(const Vec3f& place, const Vec3f& normal) {
    x.push_back(place.x());
    y.push_back(place.y());
    z.push_back(place.z());
    const Vec3f n = normal.normalized();
    normal_x.push_back(n.x());
    normal_y.push_back(n.y());
    normal_z.push_back(n.z());
    deviation.push_back(1);
    area.push_back(1);
    clip_x.push_back(0);
    clip_zero.push_back(0);
  }
  std::vector<SurfaceSheet> sheets(const std::uint16_t* material = nullptr) const {
    Surfels padded = *this;
    for (auto* column :
         {&padded.x, &padded.y, &padded.z, &padded.normal_x, &padded.normal_y, &padded.normal_z,
          &padded.deviation, &padded.area, &padded.clip_x, &padded.clip_zero}) {
      column->resize(column->size() + 16);
    }
    SurfelColumns columns{};
    columns.x = padded.x.data();
    columns.y = padded.y.data();
    columns.z = padded.z.data();
    columns.normal_x = padded.normal_x.data();
    columns.normal_y = padded.normal_y.data();
    columns.normal_z = padded.normal_z.data();
    columns.deviation_u = padded.deviation.data();
    columns.area = padded.area.data();
    columns.clip[0] = {padded.clip_x.data(), padded.clip_zero.data(), padded.clip_zero.data(),
                       padded.clip_zero.data()};
    return find_sheets(columns, material, static_cast<int>(x.size()));
  }
};

/// `rows` rows of 16 surfels, one unit apart, of the paraboloid z = z0 + bend (x^2 + y^2) / 2.
void add_patch(Surfels& to, int rows, float z0, float bend = 0) {
  for (int i = 0; i < 16 * rows; ++i) {
    const auto u = static_cast<float>(i % 16) - 7.5F;
    const auto v = static_cast<float>(i / 16) - 7.5F;
    to.add({u, v, z0 + bend * (u * u + v * v) / 2}, {-bend * u, -bend * v, 1});
  }
}

TEST(SheetSearch, SmoothSurfaceIsOneSheet) {
  for (const float bend : {0.0F, 0.02F, -0.02F}) {
    Surfels surfels;
    add_patch(surfels, 16, 3, bend);
    const std::vector<SurfaceSheet> sheets = surfels.sheets();
    ASSERT_EQ(sheets.size(), 1) << bend;
    const SurfaceSheet& sheet = sheets[0];
    EXPECT_EQ(sheet.count, 256);
    EXPECT_LT(sheet.off, 0.02F);
    EXPECT_NEAR(sheet.axis[2], 1, 1e-4F);
    EXPECT_NEAR(sheet.center[0], 0, 1e-3F);
    // The steepest normal is the corners'.
    const float steepest = std::sqrt(112.5F) * bend;
    EXPECT_NEAR(sheet.cone_cosine, 1 / std::sqrt(1 + steepest * steepest), 1e-3F);
    for (std::size_t i = 0; i < 256; ++i) {
      const Vec3f offset(surfels.x[i] - sheet.center[0], surfels.y[i] - sheet.center[1],
                         surfels.z[i] - sheet.center[2]);
      ASSERT_LE(offset.norm(), sheet.radius + 1e-3F);
    }
  }
}

TEST(SheetSearch, TwoSurfacesAreTwoSheets) {
  Surfels surfels;
  add_patch(surfels, 8, 0);
  add_patch(surfels, 8, 3);
  const std::vector<SurfaceSheet> sheets = surfels.sheets();
  ASSERT_EQ(sheets.size(), 2);
  for (const SurfaceSheet& sheet : sheets) {
    EXPECT_EQ(sheet.count, 128);
    EXPECT_EQ(has_surfel(sheet.surfels, 0), has_surfel(sheet.surfels, 127));
    EXPECT_NE(has_surfel(sheet.surfels, 0), has_surfel(sheet.surfels, 128));
  }
}

TEST(SheetSearch, NoSheetHasSurfelsOfTwoSurfaces) {
  // However the surfels of both follow one another.
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    for (const float apart : {0.8F, 1.5F, 3.0F}) {
      Surfels surfels;
      std::vector<bool> upper;
      for (std::size_t i = 0; i < 256; ++i) {
        upper.push_back(random_uniform(seed, i) < 0.5);
        const auto u = static_cast<float>(16 * random_uniform(seed + 10, i));
        const auto v = static_cast<float>(16 * random_uniform(seed + 20, i));
        surfels.add({u, v, upper[i] ? apart : 0.0F}, {0, 0, 1});
      }
      for (const SurfaceSheet& sheet : surfels.sheets()) {
        int of_upper = 0;
        for (std::uint32_t i = 0; i < 256; ++i) {
          of_upper += upper[i] && has_surfel(sheet.surfels, i) ? 1 : 0;
        }
        EXPECT_TRUE(of_upper == 0 || of_upper == sheet.count) << seed << ' ' << apart;
      }
    }
  }
}

TEST(SheetSearch, RoughSurfacesHaveNoSheet) {
  Surfels smooth;
  add_patch(smooth, 16, 0);
  Surfels rough;
  for (std::size_t i = 0; i < 256; ++i) {
    const auto tilt = static_cast<float>(random_uniform(1, i) < 0.5 ? -0.4 : 0.4);
    rough.add({smooth.x[i], smooth.y[i], 0}, {tilt, 0, 1});
  }
  EXPECT_TRUE(rough.sheets().empty());
}

TEST(SheetSearch, SheetsHaveOneMaterialAndNoCutSurfels) {
  Surfels surfels;
  add_patch(surfels, 16, 0);
  surfels.clip_x[5] = 1;
  surfels.normal_z[9] = 0;
  std::vector<std::uint16_t> material(256, 3);
  for (std::size_t i = 0; i < 256; i += 2) material[i] = 7;
  const std::vector<SurfaceSheet> sheets = surfels.sheets(material.data());
  ASSERT_EQ(sheets.size(), 2);
  EXPECT_EQ(sheets[0].count, 128);
  EXPECT_EQ(sheets[1].count, 126);
  for (std::uint32_t i = 0; i < 256; ++i) {
    EXPECT_EQ(has_surfel(sheets[0].surfels, i), i % 2 == 0);
    EXPECT_EQ(has_surfel(sheets[1].surfels, i), i % 2 == 1 && i != 5 && i != 9);
  }
}

}  // namespace
}  // namespace surfel::test
