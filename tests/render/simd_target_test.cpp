// Release builds choose their instruction set at run time: each of them must give the same picture.

#include <gtest/gtest.h>
#include <hwy/highway.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// Takes back what the test asked for, however it ends.
struct TargetsForTest {
  explicit TargetsForTest(std::int64_t targets) { hwy::SetSupportedTargetsForTest(targets); }
  ~TargetsForTest() { hwy::SetSupportedTargetsForTest(0); }
};

/// Surfels of two colours, translucent, so that fragments are merged, too.
SurfelCloud two_spheres() {
  SurfelCloud cloud = fibonacci_sphere(20000, 0.6, {0.9F, 0.4F, 0.1F});
  const SurfelCloud inner = fibonacci_sphere(8000, 0.4, {0.1F, 0.3F, 0.8F});
  for (std::size_t i = 0; i < inner.size(); ++i) {
    add_surfel(cloud, inner.position[i], inner.normal[i], inner.variance[i], inner.area[i],
               inner.coefficient[i]);
  }
  cloud.alpha.assign(cloud.size(), 0.6F);
  return cloud;
}

TEST(SimdTarget, EveryInstructionSetGivesTheSamePicture) {
  const SurfelCloud cloud = two_spheres();
  const Camera camera = camera_at(2, 150);
  RenderCloud surfels(cloud);
  const Scene scene;
  const auto picture = [&](std::int64_t target) {
    const TargetsForTest chosen(target);
    Image image = render_unlit(cloud, camera);
    const Image lit = Renderer(surfels, scene, {}).render(camera);
    image.data.insert(image.data.end(), lit.data.begin(), lit.data.end());
    return image;
  };
  // Those that the library has code made for (SURFEL_SIMD_DISABLED in lib/CMakeLists.txt).
  const Image baseline = picture(HWY_STATIC_TARGET);
  int compared = 0;
  for (const std::int64_t target : {HWY_AVX2, HWY_AVX3}) {
    if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
    const Image image = picture(target);
    EXPECT_TRUE(image.data == baseline.data) << hwy::TargetName(target);
    ++compared;
  }
  EXPECT_GT(compared, 0) << "no instruction set beyond the baseline";
}

}  // namespace
}  // namespace surfel::test
