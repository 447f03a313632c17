#include <gtest/gtest.h>
#include <surfel/simplify/shown_surface.h>

namespace surfel {
namespace {

/// A regular grid in z = slope x, whose colour is linear in x.
SurfelCloud slanted(float slope) {
  SurfelCloud cloud;
  for (int i = 0; i < 400; ++i) {
    const auto x = static_cast<float>(i % 20);
    cloud.position.emplace_back(x, static_cast<float>(i / 20), slope * x);
    cloud.normal.push_back(Vec3f(-slope, 0, 1).normalized());
    cloud.variance.push_back(0.6F);
    cloud.area.push_back(1);
    cloud.color.emplace_back(x / 20, 0.5F, 0.0F);
    cloud.alpha.push_back(0.25F);
  }
  return cloud;
}

TEST(ShownSurface, OfAPlaneIsThePlane) {
  const SurfelCloud cloud = slanted(0.3F);
  const SurfelBasis basis = make_basis(cloud);
  const Quadrature points = at_functions(basis);
  Array<Channels> w;
  for (const std::uint32_t k : basis.surfel) w.push_back(shown_color(cloud, k));
  const ShownSurface shown =
      shown_surface(cloud, basis, w, evaluate_basis(basis, points, 2), basis.surfel);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_NEAR(shown.height[i], 0, 1e-5);
    EXPECT_NEAR((shown.normal[i] - cloud.normal[i]).norm(), 0, 1e-5);
    EXPECT_NEAR(shown.color[i][1], 0.5, 1e-6);
    EXPECT_NEAR(shown.color[i][3], 0.25, 1e-6);
    const auto column = i % 20;
    if (column < 4 || column > 15 || i < 80 || i >= 320) continue;
    EXPECT_NEAR(shown.color[i][0], static_cast<double>(column) / 20, 1e-5);
    EXPECT_NEAR(shown.coverage[i], 0.86, 0.1);
  }
}

TEST(ShownSurface, HeightIsTheDistanceToTheSurface) {
  const SurfelCloud cloud = slanted(0);
  const SurfelBasis basis = make_basis(cloud);
  Quadrature points = at_functions(basis);
  const Array<Channels> w(basis.size(), Channels::Ones());
  SurfelCloud below = cloud;
  for (Vec3f& p : below.position) p.z() -= 0.125F;
  below.color[0] = Vec3f(9, 9, 9);
  Array<std::uint32_t> place = basis.surfel;
  EvaluatedBasis evaluated = evaluate_basis(basis, points, 1);
  const ShownSurface shown = shown_surface(below, basis, w, evaluated, place);
  for (std::size_t i = 0; i < cloud.size(); ++i) EXPECT_NEAR(shown.height[i], 0.125, 1e-6);
  const ShownSurface none = shown_surface(below, basis, w, evaluated, {});
  EXPECT_EQ(none.color[0][0], 9);
  EXPECT_EQ(none.height[7], 0);
  EXPECT_EQ(none.coverage[7], 0);
  EXPECT_EQ(none.normal[7], cloud.normal[7]);
}

}  // namespace
}  // namespace surfel
