#include <cmath>
#include <cstring>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/scene/surfel_cloud.h>

namespace surfel {
namespace {

/// Every column filled with values that tell column and row.
SurfelCloud full_cloud(std::size_t count) {
  SurfelCloud cloud;
  cloud.origin = Vec3d(1e7, -2e6, 3);
  cloud.double_positions = true;
  cloud.color_encoding = ColorEncoding::kFloatLinear;
  cloud.alpha_as_uint8 = true;
  cloud.basis_cutoff = 1.5;
  cloud.provenance = {"surfel-made"};
  cloud.comments = {"a comment"};
  cloud.viewpoint = Viewpoint{Vec3d(1, 2, 3), Eigen::Vector4d(0, 1, 0, 0)};
  int column = 0;
  SurfelCloud::visit_columns(cloud, [&](auto& values) {
    using Value = typename std::decay_t<decltype(values)>::value_type;
    values.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const int number = static_cast<int>(i) + 10 * column;
      if constexpr (std::is_arithmetic_v<Value>) {
        values[i] = static_cast<Value>(number);
      } else {
        values[i] = Value::Constant(static_cast<float>(number));
      }
    }
    ++column;
  });
  for (const auto& [name, type] :
       {std::pair{"time", ScalarType::kFloat64}, std::pair{"class", ScalarType::kUint8}}) {
    ExtraProperty property{name, type, {}};
    property.data.resize(count * scalar_size(type));
    for (std::size_t i = 0; i < property.data.size(); ++i) property.data[i] = std::byte(i);
    cloud.extra.push_back(property);
  }
  return cloud;
}

TEST(SurfelCloud, ExactCoordinatesCountUntilASurfelIsMoved) {
  SurfelCloud cloud;
  cloud.origin = Vec3d(1e14, 0.5, 0);
  cloud.position.resize(2);
  cloud.exact.resize(2);
  const Vec3d place(-6.144, 1.0 / 3, std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < 2; ++i) cloud.place(i, place);
  cloud.position[1].y() += 1;
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(cloud.world(i).x(), place.x());
    EXPECT_TRUE(std::isnan(cloud.world(i).z()));
  }
  EXPECT_EQ(cloud.world(0).y(), place.y());
  EXPECT_EQ(cloud.world(1).y(), 0.5 + static_cast<double>(cloud.position[1].y()));
}

TEST(SurfelCloud, GatheredTakesEveryColumnAndKeepsWhatIsFileWide) {
  const SurfelCloud cloud = full_cloud(4);
  const Array<std::uint32_t> order = {3, 0, 0, 2, 1};
  const SurfelCloud picked = cloud.gathered(order);
  EXPECT_EQ(picked.size(), order.size());
  EXPECT_NO_THROW(picked.check_columns("picked"));
  EXPECT_EQ(picked.origin, cloud.origin);
  EXPECT_EQ(picked.double_positions, true);
  EXPECT_EQ(picked.color_encoding, ColorEncoding::kFloatLinear);
  EXPECT_EQ(picked.alpha_as_uint8, true);
  EXPECT_EQ(picked.basis_cutoff, 1.5);
  EXPECT_EQ(picked.provenance, cloud.provenance);
  EXPECT_EQ(picked.comments, cloud.comments);
  ASSERT_TRUE(picked.viewpoint.has_value());
  EXPECT_EQ(picked.viewpoint->position, Vec3d(1, 2, 3));

  // Columns are compared in the order in which both clouds are visited.
  std::vector<std::vector<double>> expected;
  SurfelCloud::visit_columns(cloud, [&](const auto& values) {
    std::vector<double> rows;
    for (const std::uint32_t i : order) {
      if constexpr (std::is_arithmetic_v<std::decay_t<decltype(values[i])>>) {
        rows.push_back(values[i]);
      } else {
        rows.push_back(values[i][1]);
      }
    }
    expected.push_back(rows);
  });
  std::size_t column = 0;
  SurfelCloud::visit_columns(picked, [&](const auto& values) {
    ASSERT_EQ(values.size(), order.size()) << "column " << column;
    for (std::size_t i = 0; i < values.size(); ++i) {
      if constexpr (std::is_arithmetic_v<std::decay_t<decltype(values[i])>>) {
        EXPECT_EQ(values[i], expected[column][i]) << "column " << column;
      } else {
        EXPECT_EQ(values[i][1], expected[column][i]) << "column " << column;
      }
    }
    ++column;
  });
  for (std::size_t p = 0; p < cloud.extra.size(); ++p) {
    const ExtraProperty& from = cloud.extra[p];
    const ExtraProperty& to = picked.extra.at(p);
    EXPECT_EQ(to.name, from.name);
    const std::size_t bytes = scalar_size(from.type);
    for (std::size_t i = 0; i < order.size(); ++i) {
      EXPECT_EQ(std::memcmp(to.data.data() + i * bytes, from.data.data() + order[i] * bytes, bytes),
                0);
    }
  }
}

TEST(SurfelCloud, GatheredLeavesAbsentColumnsAbsent) {
  SurfelCloud cloud;
  cloud.position.assign(3, Vec3f(1, 2, 3));
  const SurfelCloud picked = cloud.gathered({1, 2});
  EXPECT_EQ(picked.size(), 2U);
  EXPECT_TRUE(picked.normal.empty());
  EXPECT_TRUE(picked.level.empty());
  EXPECT_TRUE(cloud.gathered({}).empty());
}

TEST(SurfelCloud, BoundsLeaveOutWhatIsNotFinite) {
  SurfelCloud cloud;
  EXPECT_TRUE(cloud.bounds().empty());
  EXPECT_EQ(cloud.bounds().diagonal(), 0);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  cloud.position = {Vec3f(kNan, 0, 0), Vec3f(0, std::numeric_limits<float>::infinity(), 0)};
  EXPECT_TRUE(cloud.bounds().empty());
  cloud.position.push_back(Vec3f(1, -2, 3));
  cloud.position.push_back(Vec3f(-1, 2, 5));
  cloud.origin = Vec3d(1e7, 0, 0);
  const Bounds box = cloud.bounds();
  EXPECT_EQ(box.min, Vec3d(1e7 - 1, -2, 3));
  EXPECT_EQ(box.max, Vec3d(1e7 + 1, 2, 5));
  EXPECT_EQ(box.center(), Vec3d(1e7, 0, 4));
  EXPECT_DOUBLE_EQ(box.diagonal(), std::sqrt(4.0 + 16 + 4));
}

TEST(SurfelCloud, BoundsSpanAllBlocksOfALargeCloud) {
  SurfelCloud cloud;
  cloud.position.assign(300000, Vec3f::Zero());
  cloud.position.front() = Vec3f(-1, 0, 0);
  cloud.position.back() = Vec3f(0, 0, 2);
  EXPECT_EQ(cloud.bounds().min, Vec3d(-1, 0, 0));
  EXPECT_EQ(cloud.bounds().max, Vec3d(0, 0, 2));
}

TEST(SurfelCloud, CheckColumnsRefusesColumnsOfOtherLengths) {
  const auto refused = [](const SurfelCloud& cloud) {
    try {
      cloud.check_columns("scan.ply");
    } catch (const Error& error) {
      return error.kind() == ErrorKind::kInput &&
             std::string(error.what()).starts_with("scan.ply: ");
    }
    return false;
  };
  EXPECT_FALSE(refused(full_cloud(3)));
  // Each column but the positions in turn.
  int columns = 0;
  const SurfelCloud one = full_cloud(1);
  SurfelCloud::visit_columns(one, [&](const auto&) { ++columns; });
  for (int wrong = 1; wrong < columns; ++wrong) {
    SurfelCloud cloud = full_cloud(3);
    int column = 0;
    SurfelCloud::visit_columns(cloud, [&](auto& values) {
      if (column++ == wrong) values.pop_back();
    });
    EXPECT_TRUE(refused(cloud)) << "column " << wrong;
  }
  SurfelCloud cloud = full_cloud(3);
  cloud.extra[0].data.pop_back();
  EXPECT_TRUE(refused(cloud));
}

TEST(SurfelCloud, CoefficientsWinOverColours) {
  SurfelCloud cloud;
  EXPECT_EQ(cloud.render_color(), nullptr);
  cloud.color.assign(1, Vec3f::Zero());
  EXPECT_EQ(cloud.render_color(), &cloud.color);
  cloud.coefficient.assign(1, Vec3f::Zero());
  EXPECT_EQ(cloud.render_color(), &cloud.coefficient);
}

}  // namespace
}  // namespace surfel
