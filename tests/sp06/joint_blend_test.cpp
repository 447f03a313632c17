// Layers of transparent surfaces that all groups tell together (SP06 sections 4.2.1, 4.2.2): discs
// of wide kernels, whose values in the middle of the picture are known.

#include <cmath>

#include <gtest/gtest.h>
#include <surfel/sp06/methods.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

const Vec3f kRed(1, 0, 0);
const Vec3f kGreen(0, 1, 0);
const Vec3f kBlue(0, 0, 1);
constexpr float kVariance = 0.04F;  // At cutoff 1 the radius is 0.283.
constexpr float kRadius = 0.2828427F;

struct Disc {
  Vec3f place;
  Vec3f color;
  std::uint16_t group = 0;
  float enlarged = kRadius;  ///< Radius.
  float alpha = 0.5F;
  bool front = true;
  float area = 20;  ///< So large that the kernel alone covers its pixels.
  std::uint32_t source = 0;
};

SurfelCloud cloud_of(const std::vector<Disc>& discs) {
  SurfelCloud cloud;
  for (std::size_t i = 0; i < discs.size(); ++i) {
    const Disc& d = discs[i];
    add_surfel(cloud, d.place, Vec3f(0, 0, d.front ? 1.0F : -1.0F), kVariance, d.area, d.color);
    cloud.alpha.push_back(d.alpha);
    cloud.group.push_back(d.group);
    cloud.group_radius.push_back(d.enlarged);
    cloud.source.push_back(d.source > 0 ? d.source : static_cast<std::uint32_t>(1000 + i));
  }
  return cloud;
}

/// The pixel in the middle of an unlit picture of [-1, 1]^2.
Rgba middle(const std::vector<Disc>& discs, LayersBy layers_by = LayersBy::kSurface) {
  RenderOptions options;
  options.method = compositing_method(Method::kTransparent, {.layers_by = layers_by});
  options.lit = false;
  RenderCloud surfels(cloud_of(discs), columns_of(Method::kTransparent));
  const Scene scene;
  Renderer renderer(surfels, scene, options);
  constexpr int kSize = 65;
  const Image image = renderer.render(square_camera(kSize));
  const float* const p = image.pixel(kSize / 2, kSize / 2);
  return {p[0], p[1], p[2], p[3]};
}

void expect_near(const Rgba& a, const Rgba& b) {
  constexpr double kRounding = 1e-5;
  EXPECT_NEAR(a.red, b.red, kRounding);
  EXPECT_NEAR(a.green, b.green, kRounding);
  EXPECT_NEAR(a.blue, b.blue, kRounding);
  EXPECT_NEAR(a.alpha, b.alpha, kRounding);
}

TEST(JointBlend, GroupsOfALayerAreAveraged) {
  expect_near(middle({{.place = {0, 0, 0}, .color = kRed, .group = 0},
                      {.place = {0.1F, 0, 0}, .color = kGreen, .group = 1}}),
              {0.25F, 0.25F, 0, 0.5F});
}

TEST(JointBlend, OfAGroupTheFragmentNearestToItsCentreStandsForALayer) {
  expect_near(middle({{.place = {0.2F, 0, 0}, .color = kRed},
                      {.place = {0.1F, 0, 0}, .color = kGreen},
                      {.place = {0, 0.15F, 0}, .color = kBlue}}),
              {0, 0.5F, 0, 0.5F});
}

TEST(JointBlend, LayersAreCompositedFarthestFirst) {
  const std::vector<Disc> near_and_far = {{.place = {0, 0, 1}, .color = kRed},
                                          {.place = {0, 0, -1}, .color = kGreen}};
  expect_near(middle(near_and_far), {0.5F, 0.25F, 0, 0.75F});
  expect_near(middle({near_and_far[1], near_and_far[0]}), {0.5F, 0.25F, 0, 0.75F});
}

TEST(JointBlend, TheSidesOfAThinBodyAreTwoLayers) {
  const Rgba both = middle({{.place = {0, 0, 0.001F}, .color = kRed},
                            {.place = {0, 0, 0}, .color = kGreen, .front = false}});
  expect_near(both, {0.5F, 0.25F, 0, 0.75F});
}

TEST(JointBlend, EnlargedDiscsFillHolesOfTheirGroup) {
  const std::vector<Disc> hole = {{.place = {0, 0, 0}, .color = kRed, .group = 0},
                                  {.place = {0.5F, 0, 0}, .color = kGreen, .group = 1}};
  expect_near(middle(hole), {0.25F, 0, 0, 0.25F});
  std::vector<Disc> filled = hole;
  filled[1].enlarged = 0.7F;
  expect_near(middle(filled), {0.25F, 0.25F, 0, 0.5F});
}

TEST(JointBlend, EnlargedDiscsMakeNoLayers) {
  // The large disc of group 1 hangs in front of the surface that group 0 shows.
  const std::vector<Disc> discs = {
      {.place = {0, 0, 0}, .color = kRed, .group = 0},
      {.place = {0.5F, 0, 1}, .color = kGreen, .group = 1, .enlarged = 0.7F}};
  expect_near(middle(discs), {0.25F, 0, 0, 0.25F});
  expect_near(middle(discs, LayersBy::kGroup), {0.25F, 0.25F, 0, 0.5F});
}

TEST(JointBlend, EnlargedDiscsDoNotTakeThePlaceOfOthers) {
  expect_near(middle({{.place = {0.25F, 0, 0}, .color = kRed},
                      {.place = {0.3F, 0, 0}, .color = kGreen, .enlarged = 0.9F}}),
              {0.5F, 0, 0, 0.5F});
}

TEST(JointBlend, EnlargedDiscsStayOnTheirSide) {
  const std::vector<Disc> discs = {
      {.place = {0, 0, 0}, .color = kRed, .group = 0},
      {.place = {0.5F, 0, 0}, .color = kGreen, .group = 1, .enlarged = 0.7F, .front = false}};
  expect_near(middle(discs), {0.25F, 0, 0, 0.25F});
}

TEST(JointBlend, CopiesOfADiscCoverOnce) {
  // A kernel that covers a part of its pixel alone covers no more of it for being there twice.
  Disc thin{.place = {0.1F, 0, 0}, .color = kRed, .group = 0, .area = 0.03F, .source = 7};
  const Disc other{.place = {2, 0, 0}, .color = kBlue, .group = 1};
  const Rgba one = middle({thin, other});
  ASSERT_GT(one.alpha, 0.01);
  ASSERT_LT(one.alpha, 0.2);
  Disc copy = thin;
  copy.group = 1;
  const Rgba two = middle({thin, copy, other});
  EXPECT_NEAR(two.alpha, 2 * one.alpha, 1e-5) << "the copy closes the hole of the second group";
  EXPECT_NEAR(middle({copy, other, thin}).alpha, two.alpha, 1e-6);
}

TEST(JointBlend, AnyNumberOfLayers) {
  constexpr int kLayers = 90;
  std::vector<Disc> discs;
  for (int i = 0; i < kLayers; ++i) {
    discs.push_back({.place = {0, 0, -1.0F * static_cast<float>(i)},
                     .color = kGreen,
                     .group = static_cast<std::uint16_t>(i % 2),
                     .alpha = 0.02F});
  }
  // Every layer has a disc of one group only.
  const auto half = 1 - std::pow(0.98, kLayers / 2);
  EXPECT_NEAR(middle(discs).alpha, half, 1e-4);
}

}  // namespace
}  // namespace surfel::test
