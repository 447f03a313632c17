#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/measure/cloud_needs.h>

namespace surfel {
namespace {

/// A regular grid of spacing 1 in a plane, discs that reach `reach` at cutoff 1, coloured.
SurfelCloud grid(int n, float reach) {
  SurfelCloud cloud;
  for (int i = 0; i < n * n; ++i) {
    cloud.position.emplace_back(static_cast<float>(i % n), static_cast<float>(i / n), 0.0F);
    cloud.normal.push_back(Vec3f::UnitZ());
    cloud.variance.push_back(reach * reach / 2);
    cloud.area.push_back(1);
    cloud.color.emplace_back(0.5F, 0.5F, 0.5F);
  }
  return cloud;
}

std::vector<CloudNeed> needs_of(const SurfelCloud& cloud,
                                const CloudStatisticsOptions& options = {}) {
  return cloud_needs(cloud, cloud_statistics(cloud, options), options, "a.ply");
}

/// The need of a topic, or an empty one.
CloudNeed need(const SurfelCloud& cloud, const std::string& topic,
               const CloudStatisticsOptions& options = {}) {
  for (const CloudNeed& found : needs_of(cloud, options)) {
    if (found.topic == topic) return found;
  }
  return {};
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Discs that just reach the corners of their unit cells.
constexpr float kClosing = 0.72F;

TEST(CloudNeeds, RefusesBadOptions) {
  const SurfelCloud cloud = grid(3, kClosing);
  EXPECT_THROW(cloud_needs(cloud, cloud_statistics(cloud), {.cutoff = 0}, "a.ply"), Error);
}

TEST(CloudNeeds, ASoundCloudNeedsNothing) {
  EXPECT_TRUE(needs_of(grid(30, kClosing)).empty());
  EXPECT_TRUE(needs_of(grid(30, 1.4F)).empty());
}

TEST(CloudNeeds, MissingColumnsNameTheirTool) {
  SurfelCloud cloud;
  cloud.position.assign(10, Vec3f(0, 0, 0));
  for (std::size_t i = 0; i < 10; ++i) cloud.position[i].x() = static_cast<float>(i);
  EXPECT_EQ(need(cloud, "normals").command, "surfel-estimate a.ply -o OUT");
  EXPECT_EQ(need(cloud, "variance").command, "surfel-estimate a.ply -o OUT");
  EXPECT_TRUE(contains(need(cloud, "colors").command, "surfel-texture a.ply --mesh"));
  cloud.uv.assign(10, Vec2f(0, 0));
  EXPECT_TRUE(contains(need(cloud, "colors").command, "surfel-texture a.ply --image"));
  cloud = grid(10, kClosing);
  for (int i = 0; i < 5; ++i) cloud.normal[i].setZero();
  EXPECT_EQ(need(cloud, "normals").measure, "5 % are unknown");
}

TEST(CloudNeeds, HolesNameTheCutoffThatClosesThem) {
  // At cutoff c discs reach sqrt(c) times as far: 0.6 closes cells of half diagonal 0.71 from 1.39
  // on.
  const CloudNeed found = need(grid(30, 0.6F), "holes");
  EXPECT_TRUE(contains(found.measure, "at cutoff 1, 0 % at 1.5")) << found.measure;
  EXPECT_TRUE(contains(found.command, "surfel-render a.ply --cutoff 1.5")) << found.command;
  EXPECT_TRUE(contains(found.command, "surfel-estimate")) << found.command;
  EXPECT_TRUE(contains(need(grid(30, 0.45F), "holes").measure, "0 % at 3"));
  EXPECT_TRUE(contains(need(grid(30, 0.38F), "holes").measure, "0 % at 4"));
  // Discs that no cutoff up to 4 makes large enough.
  EXPECT_EQ(need(grid(30, 0.2F), "holes").command, "surfel-estimate a.ply -o OUT");
  EXPECT_TRUE(need(grid(30, 0.6F), "holes", {.cutoff = 2}).topic.empty());
}

TEST(CloudNeeds, TooMuchOverlap) {
  const CloudNeed found = need(grid(40, 2.5F), "overlap");
  // pi 2.5^2 discs, fewer at borders.
  EXPECT_EQ(found.measure.substr(0, 2), "19") << found.measure;
}

TEST(CloudNeeds, AreasThatAreNotTheCells) {
  SurfelCloud cloud = grid(30, kClosing);
  for (float& area : cloud.area) area = 3;
  EXPECT_EQ(need(cloud, "area").measure.substr(0, 7), "3 times");
  for (float& area : cloud.area) area = 1.2F;
  EXPECT_TRUE(need(cloud, "area").topic.empty());
}

TEST(CloudNeeds, RoundEllipsesNeedNoAxes) {
  SurfelCloud cloud = grid(30, kClosing);
  cloud.tangent.assign(cloud.size(), Vec3f::UnitX());
  cloud.variance_u.assign(cloud.size(), 0.3F * std::pow(1.05F, 4.0F));
  cloud.variance_v.assign(cloud.size(), 0.3F);
  cloud.variance = {};
  const CloudNeed found = need(cloud, "anisotropy");
  EXPECT_TRUE(contains(found.measure, "within 5 % of a disc's")) << found.measure;
  EXPECT_TRUE(contains(found.command, "--anisotropy off"));
  for (std::size_t i = 0; i < cloud.size(); i += 10) cloud.variance_u[i] = 3;
  EXPECT_TRUE(need(cloud, "anisotropy").topic.empty());
}

TEST(CloudNeeds, WhatDrawingShouldKnow) {
  SurfelCloud cloud = grid(30, kClosing);
  cloud.coefficient = cloud.color;
  cloud.basis_cutoff = 2.0;
  EXPECT_EQ(need(cloud, "cutoff").command, "surfel-render a.ply --cutoff 2");
  EXPECT_TRUE(need(cloud, "cutoff", {.cutoff = 2}).topic.empty());
  cloud.alpha.assign(cloud.size(), 1.0F);
  EXPECT_TRUE(need(cloud, "layers").topic.empty());
  cloud.alpha[3] = cloud.alpha[4] = 0.5F;
  EXPECT_TRUE(contains(need(cloud, "layers").command, "--layers 8"));
  cloud.position[7].x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(contains(need(cloud, "flaws").measure, "1 value"));
  const SurfelCloud large = grid(600, kClosing);
  EXPECT_EQ(need(large, "lod").command, "surfel-lod a.ply -o OUT");
  EXPECT_TRUE(contains(need(large, "lod").measure, "1.4 surfels a pixel"));
}

TEST(CloudNeeds, CoincidentSurfels) {
  SurfelCloud cloud = grid(20, kClosing);
  for (std::size_t i = 0; i < 40; ++i) cloud.position[i] = cloud.position[i + 40];
  EXPECT_TRUE(contains(need(cloud, "coincident").command, "surfel-simplify a.ply"));
}

}  // namespace
}  // namespace surfel
