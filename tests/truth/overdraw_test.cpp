#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/truth/overdraw.h>
#include <surfel/truth/reference.h>
#include <surfel/truth/source_ewa.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// Discs over each other whose middle is at `x`, each of which covers the square [-1, 1]^2 around
/// it.
SurfelCloud stack_at(float x, int count) {
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    add_surfel(cloud, {x, 0, 0.001F * static_cast<float>(i)}, {0, 0, 1}, 4, 1, {1, 1, 1});
  }
  return cloud;
}

double overdraw_of(const SurfelCloud& cloud, DiscHierarchy::Bound bound, double reach) {
  const RenderCloud surfels(cloud);
  return mean_overdraw(DiscHierarchy(surfels, reach, bound), surfels.origin(), square_camera(64));
}

TEST(Overdraw, IsTheMeanNumberOfDiscsOverTheRays) {
  for (const auto bound : {DiscHierarchy::Bound::kDisc, DiscHierarchy::Bound::kBall}) {
    EXPECT_DOUBLE_EQ(overdraw_of(stack_at(0, 40), bound, 1), 40);
    // Of boxes that end in the picture's middle half of the rays meet all.
    EXPECT_DOUBLE_EQ(overdraw_of(stack_at(2, 40), bound, 1), 20);
    EXPECT_DOUBLE_EQ(overdraw_of(stack_at(9, 40), bound, 1), 0);
  }
  EXPECT_DOUBLE_EQ(overdraw_of({}, DiscHierarchy::Bound::kDisc, 1), 0);
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
