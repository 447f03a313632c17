#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/color.h>
#include <surfel/store/render_cloud.h>
#include <surfel/view/packed_cluster.h>

#include "view/some_surfels.h"

namespace surfel::test {
namespace {

/// The surfels of packed clusters, read by what the header says of them.
struct Unpacked {
  std::vector<Vec3f> position, normal, color;
  std::vector<float> u, v, area, angle, alpha, attribute;
  struct HalfPlane {
    std::uint16_t angle, distance;
  };
  std::array<std::vector<HalfPlane>, 2> half_planes;
};

class Reader {
 public:
  explicit Reader(std::string_view bytes) : at_(bytes.data()) {}
  template <class Value>
  Value next() {
    Value value;
    std::memcpy(&value, at_, sizeof(value));
    at_ += sizeof(value);
    return value;
  }
  const char* at() const { return at_; }

 private:
  const char* at_;
};

Unpacked unpack(const std::string& bytes) {
  Unpacked out;
  Reader read(bytes);
  while (read.at() < bytes.data() + bytes.size()) {
    const auto h = read.next<PackedCluster>();
    const std::size_t first = out.position.size();
    const std::size_t end = first + h.count;
    const auto each = [&](const auto& set) {
      for (std::size_t i = first; i < end; ++i) set(i);
    };
    const auto has = [&](PackedColumn column) { return (h.columns & column) != 0; };
    out.position.resize(end);
    for (int axis = 0; axis < 3; ++axis) {
      each([&](std::size_t i) {
        out.position[i][axis] = h.min[axis] + h.step[axis] * read.next<std::uint16_t>();
      });
    }
    out.normal.resize(end, Vec3f(0, 0, 0));
    if (has(kPackedNormal)) {
      each([&](std::size_t i) { out.normal[i] = unpack_direction(read.next<PackedDirection>()); });
    }
    const auto deviation = [&](std::vector<float>& to) {
      each([&](std::size_t i) {
        to[i] = std::exp2(h.deviation_log + h.deviation_step * read.next<std::uint16_t>());
      });
    };
    out.u.resize(end, std::exp2(h.deviation_log));
    out.angle.resize(end);
    if (has(kPackedDeviation)) deviation(out.u);
    out.v.insert(out.v.end(), out.u.begin() + static_cast<std::ptrdiff_t>(first), out.u.end());
    if (has(kPackedAcross)) {
      deviation(out.v);
      each([&](std::size_t i) { out.angle[i] = 3.14159265F / 65536 * read.next<std::uint16_t>(); });
    }
    out.area.resize(end, std::exp2(h.area_log));
    if (has(kPackedArea)) {
      each([&](std::size_t i) {
        out.area[i] = std::exp2(h.area_log + h.area_step * read.next<std::uint16_t>());
      });
    }
    const auto color = [&](std::uint8_t code) {
      return h.color_low + h.color_scale * srgb8_to_linear(code);
    };
    out.color.resize(end, Vec3f(color(h.color[0]), color(h.color[1]), color(h.color[2])));
    if (has(kPackedColor)) {
      each([&](std::size_t i) {
        for (int c = 0; c < 3; ++c) out.color[i][c] = color(read.next<std::uint8_t>());
      });
    }
    out.alpha.resize(end, 1);
    if (has(kPackedAlpha)) {
      each([&](std::size_t i) { out.alpha[i] = read.next<std::uint8_t>() / 255.0F; });
    }
    if (has(kPackedShading)) each([&](std::size_t) { read.next<PackedDirection>(); });
    out.attribute.resize(end, h.attribute / 255.0F);
    if (has(kPackedAttribute)) {
      each([&](std::size_t i) { out.attribute[i] = read.next<std::uint8_t>() / 255.0F; });
    }
    for (std::size_t j = 0; j < 2; ++j) {
      out.half_planes[j].resize(end, {0, 0xffff});
      if (!has(j == 0 ? kPackedClip1 : kPackedClip2)) continue;
      each([&](std::size_t i) { out.half_planes[j][i] = read.next<Unpacked::HalfPlane>(); });
    }
  }
  return out;
}

std::string packed(const RenderCloud& cloud) {
  std::string bytes;
  for (std::uint32_t c = 0; c < cloud.clusters().size(); ++c)
    pack_cluster(cloud, c, nullptr, bytes);
  return bytes;
}

/// The row of the cloud nearest to each unpacked surfel.
std::vector<std::size_t> rows_of(const Unpacked& surfels, const RenderCloud& cloud) {
  std::vector<std::size_t> rows;
  for (const Vec3f& p : surfels.position) {
    std::size_t nearest = 0;
    float least = 1e30F;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const float d = (Vec3f(cloud.x[i], cloud.y[i], cloud.z[i]) - p).squaredNorm();
      if (d >= least) continue;
      least = d;
      nearest = i;
    }
    rows.push_back(nearest);
  }
  return rows;
}

TEST(PackedCluster, KeepsSurfelsWithinTheStatedErrors) {
  for (const bool elliptic : {false, true}) {
    const RenderCloud cloud(sphere(700, elliptic));
    const Unpacked found = unpack(packed(cloud));
    ASSERT_EQ(found.position.size(), cloud.size());
    const std::vector<std::size_t> rows = rows_of(found, cloud);
    EXPECT_EQ(std::set<std::size_t>(rows.begin(), rows.end()).size(), cloud.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const std::size_t row = rows[i];
      const Vec3f p(cloud.x[row], cloud.y[row], cloud.z[row]);
      EXPECT_LT((p - found.position[i]).cwiseAbs().maxCoeff(), 2.0F / 131070 + 1e-7F);
      const Vec3f n(cloud.normal_x[row], cloud.normal_y[row], cloud.normal_z[row]);
      EXPECT_LT(n.cross(found.normal[i]).norm(), 0.004 * 3.1416 / 180);
      EXPECT_NEAR(found.u[i] / cloud.deviation_u[row], 1, 3e-5);
      EXPECT_NEAR(found.area[i] / cloud.area[row], 1, 3e-5);
      const Vec3f color(cloud.red[row], cloud.green[row], cloud.blue[row]);
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(linear_to_srgb(found.color[i][c]), linear_to_srgb(color[c]), 0.5 / 255 + 1e-5);
      }
      if (!elliptic) continue;
      EXPECT_NEAR(found.v[i] / cloud.deviation_v[row], 1, 3e-5);
      const Vec3f a = packed_tangent(found.normal[i]);
      const Vec3f t =
          std::cos(found.angle[i]) * a + std::sin(found.angle[i]) * found.normal[i].cross(a);
      const Vec3f tangent(cloud.tangent_x[row], cloud.tangent_y[row], cloud.tangent_z[row]);
      EXPECT_LT(t.cross(tangent).norm(), 0.006 * 3.1416 / 180);
    }
  }
}

TEST(PackedCluster, HoldsNoColumnsOfEqualValues) {
  SurfelCloud cloud = sphere(300);
  cloud.variance.assign(300, 0.01F);
  cloud.area.assign(300, 0.02F);
  cloud.color.assign(300, Vec3f(0.5F, 0.25F, 0.125F));
  const RenderCloud drawn(cloud);
  const std::string bytes = packed(drawn);
  EXPECT_EQ(bytes.size(), 2 * sizeof(PackedCluster) + 300 * 10U) << "positions and normals alone";
  const Unpacked found = unpack(bytes);
  EXPECT_NEAR(found.u[7], 0.1F, 1e-6);
  EXPECT_NEAR(found.area[7], 0.02F, 1e-7);
  EXPECT_NEAR(found.color[7].y(), 0.25F, 0.004);
}

TEST(PackedCluster, FirstSurfelsAreSpreadOverTheCluster) {
  const RenderCloud cloud(sphere(256));
  const Unpacked found = unpack(packed(cloud));
  Vec3f min(1, 1, 1);
  Vec3f max(-1, -1, -1);
  for (std::size_t i = 0; i < 16; ++i) {
    min = min.cwiseMin(found.position[i]);
    max = max.cwiseMax(found.position[i]);
  }
  EXPECT_GT((max - min).minCoeff(), 1.2F) << "of a sphere of diameter 2";
}

TEST(PackedCluster, UnboundedCoefficientsAndAlphaKeepTheirRange) {
  SurfelCloud cloud = sphere(64);
  cloud.color[3] = Vec3f(-0.5F, 2, 0.5F);
  cloud.alpha.assign(64, 1);
  cloud.alpha[5] = 0.25F;
  const RenderCloud drawn(cloud);
  const Unpacked found = unpack(packed(drawn));
  const std::vector<std::size_t> rows = rows_of(found, drawn);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_NEAR(found.color[i].y(), drawn.green[rows[i]], 0.02);
    EXPECT_NEAR(found.alpha[i], drawn.alpha[rows[i]], 1.0 / 510 + 1e-6);
  }
}

TEST(PackedCluster, KeepsHalfPlanesWithinTheStatedErrors) {
  SurfelCloud cloud = sphere(300, true);
  cloud.clip1.resize(300);
  cloud.clip1_distance.resize(300);
  cloud.clip2.assign(300, Vec3f(0, 0, 0));
  cloud.clip2_distance.resize(300);
  for (std::size_t i = 0; i < 300; ++i) {
    const auto turn = static_cast<float>(i);
    const Vec3f& n = cloud.normal[i];
    const Vec3f across = n.cross(cloud.tangent[i]);
    const float deviation = std::sqrt(cloud.variance_u[i]);
    const Vec3f direction = std::cos(turn) * cloud.tangent[i] + std::sin(turn) * across;
    cloud.clip1[i] = direction;
    cloud.clip1_distance[i] = deviation * (std::sin(3 * turn) * 2);
    // What is cut far away is as if nothing were cut.
    if (i % 3 != 0) continue;
    cloud.clip2[i] = -direction;
    cloud.clip2_distance[i] = deviation * (i % 2 == 0 ? 1 : 100);
  }
  const RenderCloud drawn(cloud);
  const Unpacked found = unpack(packed(drawn));
  const std::vector<std::size_t> rows = rows_of(found, drawn);
  std::size_t seconds = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Vec3f a = packed_tangent(found.normal[i]);
    for (std::size_t j = 0; j < 2; ++j) {
      const RenderCloud::ClipColumns& clip = drawn.clip[j];
      const std::size_t row = rows[i];
      const float deviation = std::max(drawn.deviation_u[row], drawn.deviation_v[row]);
      const Unpacked::HalfPlane& line = found.half_planes[j][i];
      const bool cuts =
          RenderCloud::clips(clip, row) && clip.distance[row] < kPackedClipReach * deviation;
      ASSERT_EQ(line.distance != 0xffff, cuts);
      if (!cuts) continue;
      seconds += j;
      const float distance = (line.distance / 32767.0F - 1) * kPackedClipReach * deviation;
      EXPECT_NEAR(distance, clip.distance[row], 0.00013 * deviation);
      const float angle = 2 * 3.14159265F / 65536 * line.angle;
      const Vec3f direction = std::cos(angle) * a + std::sin(angle) * found.normal[i].cross(a);
      const Vec3f truth(clip.x[row], clip.y[row], clip.z[row]);
      EXPECT_GT(direction.dot(truth), 0.9F);
      EXPECT_LT(direction.cross(truth).norm(), 0.007 * 3.1416 / 180);
    }
  }
  EXPECT_EQ(seconds, 50U);
}

TEST(PackedDirection, IsExactWithinAHundredthOfADegreeEverywhere) {
  for (const Vec3f& p : sphere(5000).normal) {
    const Vec3f back = unpack_direction(pack_direction(p));
    EXPECT_NEAR(back.norm(), 1, 1e-6);
    EXPECT_LT(back.cross(p).norm(), 0.004 * 3.1416 / 180) << p.transpose();
    EXPECT_NEAR(packed_tangent(back).dot(back), 0, 1e-5);
    EXPECT_NEAR(packed_tangent(back).norm(), 1, 1e-4);
  }
  EXPECT_TRUE(unpack_direction(pack_direction(Vec3f(0, 0, 0))).isZero(0));
  EXPECT_FALSE(unpack_direction(pack_direction(Vec3f(0, 0, -1))).isZero(0));
}

}  // namespace
}  // namespace surfel::test
