#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/truth/overdraw.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/source_ewa.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// Discs of radius 200 over each other whose middle is at `x`.
SurfelCloud stack_at(float x, int count) {
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    add_surfel(cloud, {x, 0, 0.001F * static_cast<float>(i)}, {0, 0, 1}, 4e4F, 1, {1, 1, 1});
  }
  return cloud;
}

double overdraw_of(const SurfelCloud& cloud, DiscHierarchy::Bound bound, double reach) {
  const RenderCloud surfels(cloud);
  return mean_overdraw(surfels, DiscHierarchy(surfels, reach, bound), reach, square_camera(64));
}

TEST(Overdraw, IsTheMeanNumberOfDiscsOverTheRays) {
  for (const auto bound : {DiscHierarchy::Bound::kDisc, DiscHierarchy::Bound::kBall}) {
    EXPECT_DOUBLE_EQ(overdraw_of(stack_at(0, 40), bound, 1), 40);
    // Half of the rays meet all discs that end in the picture's middle.
    EXPECT_DOUBLE_EQ(overdraw_of(stack_at(200, 40), bound, 1), 20);
    EXPECT_DOUBLE_EQ(overdraw_of(stack_at(900, 40), bound, 1), 0);
  }
  EXPECT_DOUBLE_EQ(overdraw_of({}, DiscHierarchy::Bound::kDisc, 1), 0);
}

TEST(Overdraw, LongThinDiscsDoNotCountBesideThemselves) {
  // Ellipses along the picture's diagonal, far thinner than the rays are apart: their boxes hold
  // the picture, and no ray meets them.
  SurfelCloud cloud;
  for (int i = 0; i < 40; ++i) {
    cloud.position.emplace_back(0.125F, 0.0F, 0.001F * static_cast<float>(i));
    cloud.normal.emplace_back(0.0F, 0.0F, 1.0F);
    cloud.tangent.push_back(Vec3f(1, 1, 0).normalized());
    cloud.variance_u.push_back(4);
    cloud.variance_v.push_back(1e-6F);
    cloud.area.push_back(1);
  }
  for (const auto bound : {DiscHierarchy::Bound::kDisc, DiscHierarchy::Bound::kBall}) {
    EXPECT_DOUBLE_EQ(overdraw_of(cloud, bound, 1), 0);
  }
}

TEST(Overdraw, IsBoundedByName) {
  const Scene scene;
  const RenderOptions options;
  const Camera camera = square_camera(8);
  const RenderCloud few(stack_at(0, 500));
  const RenderCloud many(stack_at(0, 520));
  EXPECT_NO_THROW(ReferenceRenderer(few, scene, options).require_bounded(camera, "a.ply"));
  EXPECT_NO_THROW(SourceEwaRenderer(few, scene, options).require_bounded(camera, "a.ply"));
  const auto expect_refused = [&](const auto& renderer) {
    try {
      renderer.require_bounded(camera, "a.ply");
      FAIL() << "is not refused";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      EXPECT_TRUE(std::string(error.what()).starts_with("a.ply: 520 surfels")) << error.what();
    }
  };
  expect_refused(ReferenceRenderer(many, scene, options));
  expect_refused(SourceEwaRenderer(many, scene, options));
}

}  // namespace
}  // namespace surfel::test
