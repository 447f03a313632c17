#include <Eigen/Geometry>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/texture/texel_kernel.h>

#include "texture_support.h"

namespace surfel {
namespace {

/// One surfel with its tangent plane turned in space.
SurfelCloud one_surfel(const Vec3f& dpdu, const Vec3f& dpdv, float variance) {
  SurfelCloud cloud;
  cloud.position = {Vec3f(0, 0, 0)};
  cloud.uv = {Vec2f(0.5F, 0.5F)};
  cloud.dpdu = {dpdu};
  cloud.dpdv = {dpdv};
  cloud.variance = {variance};
  return cloud;
}

void make_anisotropic(SurfelCloud& cloud, const Vec3f& tangent, float variance_u,
                      float variance_v) {
  cloud.tangent = {tangent};
  cloud.variance_u = {variance_u};
  cloud.variance_v = {variance_v};
}

Mat2d variance_of(const SurfelCloud& cloud, int width, int height) {
  const auto variance = texture_space_variance(cloud, 0, width, height);
  EXPECT_TRUE(variance.has_value());
  return variance.value_or(Mat2d::Zero());
}

TEST(TextureSpaceVariance, IsTheVarianceInTexelsWhereTheMapOnlyScales) {
  // A unit of u is 2 scene units long and 100 texels wide: 50 texels a unit. v: 200 / 4 = 50.
  const SurfelCloud cloud = one_surfel({2, 0, 0}, {0, 4, 0}, 0.01F);
  const Mat2d variance = variance_of(cloud, 100, 200);
  EXPECT_TRUE(variance.isApprox(0.01 * 2500 * Mat2d::Identity(), 1e-6)) << variance;
}

TEST(TextureSpaceVariance, DoesNotDependOnHowTheSurfaceLiesInSpace) {
  const Vec3f dpdu(2, 0.3F, 0);
  const Vec3f dpdv(-0.5F, 1.1F, 0);
  SurfelCloud flat = one_surfel(dpdu, dpdv, 0.02F);
  const Eigen::Matrix3f turn =
      Eigen::AngleAxisf(1.1F, Vec3f(1, 2, -1).normalized()).toRotationMatrix();
  SurfelCloud turned = one_surfel(turn * dpdu, turn * dpdv, 0.02F);
  EXPECT_TRUE(variance_of(flat, 64, 32).isApprox(variance_of(turned, 64, 32), 1e-5));

  const Vec3f tangent = Vec3f(1, 0.7F, 0).normalized();
  make_anisotropic(flat, tangent, 0.02F, 0.1F);
  make_anisotropic(turned, turn * tangent, 0.02F, 0.1F);
  EXPECT_TRUE(variance_of(flat, 64, 32).isApprox(variance_of(turned, 64, 32), 1e-5));
}

TEST(TextureSpaceVariance, PushesSurfacePointsForwardAsTheMapDoes) {
  // The variance of the linear image T^-1 e of a point e with variance V, summed over unit e.
  SurfelCloud cloud = one_surfel({2, 0.3F, 0}, {-0.5F, 1.1F, 0}, 1);
  const Vec3f t = Vec3f(1, 0.7F, 0).normalized();
  const Vec3f b(-t.y(), t.x(), 0);
  make_anisotropic(cloud, t, 0.02F, 0.1F);
  const double width = 64;
  const double height = 32;
  Mat2d uv_to_plane;
  uv_to_plane << 2, -0.5, 0.3, 1.1;
  const Mat2d to_uv = uv_to_plane.inverse();
  Mat2d expected = Mat2d::Zero();
  for (const auto& [axis, variance] : {std::pair(t, 0.02), std::pair(b, 0.1)}) {
    const Vec2d uv = to_uv * axis.head<2>().cast<double>();
    const Vec2d texel(uv.x() * width, -uv.y() * height);
    expected += variance * texel * texel.transpose();
  }
  EXPECT_TRUE(variance_of(cloud, 64, 32).isApprox(expected, 1e-5));
}

TEST(TextureSpaceVariance, EqualVariancesAreIsotropicWhateverTheTangent) {
  SurfelCloud cloud = one_surfel({2, 0.3F, 0.4F}, {-0.5F, 1.1F, 0}, 0.05F);
  const Mat2d isotropic = variance_of(cloud, 10, 10);
  for (const Vec3f& tangent : {Vec3f(1, 0, 0), Vec3f(0.6F, 0, 0.8F), Vec3f(0, 0, 1)}) {
    make_anisotropic(cloud, tangent, 0.05F, 0.05F);
    EXPECT_TRUE(variance_of(cloud, 10, 10).isApprox(isotropic, 1e-5));
  }
}

TEST(TextureSpaceVariance, MirroredFramesMirrorTheKernel) {
  const Mat2d a = variance_of(one_surfel({2, 1, 0}, {0, 1, 0}, 0.1F), 50, 50);
  const Mat2d b = variance_of(one_surfel({-2, -1, 0}, {0, 1, 0}, 0.1F), 50, 50);
  EXPECT_NEAR(a(0, 0), b(0, 0), 1e-5 * a(0, 0));
  EXPECT_NEAR(a(1, 1), b(1, 1), 1e-5 * a(1, 1));
  EXPECT_NEAR(a(0, 1), -b(0, 1), 1e-5 * std::abs(a(0, 1)));
  EXPECT_NE(a(0, 1), 0);
}

TEST(TextureSpaceVariance, HasNoneWhereTheMapHasNoAreaOrValuesAreUnusable) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto has = [](const SurfelCloud& cloud) {
    return texture_space_variance(cloud, 0, 8, 8).has_value();
  };
  EXPECT_TRUE(has(one_surfel({1, 0, 0}, {0, 1, 0}, 0)));
  EXPECT_FALSE(has(one_surfel({0, 0, 0}, {0, 1, 0}, 1)));
  EXPECT_FALSE(has(one_surfel({1, 1, 0}, {-2, -2, 0}, 1)));
  EXPECT_FALSE(has(one_surfel({nan, 0, 0}, {0, 1, 0}, 1)));
  EXPECT_FALSE(has(one_surfel({1, 0, 0}, {0, 1, 0}, nan)));
  EXPECT_FALSE(has(one_surfel({1, 0, 0}, {0, 1, 0}, -1)));
  EXPECT_FALSE(has(one_surfel({1, 0, 0}, {0, 1, 0}, std::numeric_limits<float>::infinity())));
}

TEST(TextureSpaceVariance, ScalesFromTinyToHuge) {
  for (const float scale : {1e-15F, 1e-6F, 1e6F, 1e15F}) {
    const SurfelCloud cloud =
        one_surfel(Vec3f(1, 0.2F, 0) * scale, Vec3f(0, 1, 0) * scale, 0.01F * scale * scale);
    const Mat2d unit = variance_of(one_surfel({1, 0.2F, 0}, {0, 1, 0}, 0.01F), 100, 100);
    EXPECT_TRUE(variance_of(cloud, 100, 100).isApprox(unit, 1e-5)) << scale;
  }
}

TEST(PrincipalVariances, AreTheEigenvaluesOfATurnedEllipse) {
  const auto axes = principal_variances(test::turned_kernel({0, 0}, 7, 0.002, 0.9).variance);
  EXPECT_NEAR(axes.major, 49, 1e-9);
  EXPECT_NEAR(axes.minor, 4e-6, 1e-12);
}

TEST(LimitKernel, WidensTheMinorAxisAlone) {
  const double angle = 0.9;
  Mat2d variance = test::turned_kernel({0, 0}, 100, 1, angle).variance;
  EXPECT_FALSE(limit_kernel(variance, 101));
  EXPECT_TRUE(limit_kernel(variance, 20));
  EXPECT_TRUE(variance.isApprox(test::turned_kernel({0, 0}, 100, 5, angle).variance, 1e-9));
}

TEST(LimitKernel, ShrinksKernelsBeyondAllMeasure) {
  Mat2d variance = 1e30 * Mat2d::Identity();
  EXPECT_FALSE(limit_kernel(variance, kMaxAspect));
  EXPECT_TRUE(variance.isApprox(0x1p48 * Mat2d::Identity(), 1e-9));
}

TEST(TexelPosition, HasTheImagesBottomAtVZero) {
  EXPECT_EQ(texel_position({0, 0}, 30, 20), Vec2d(0, 20));
  EXPECT_EQ(texel_position({1, 1}, 30, 20), Vec2d(30, 0));
}

TEST(LatticeSum, IsTheSumOverTheTexels) {
  for (const double sigma : {0.25, 0.4, 0.7, 1.0, 3.0}) {
    for (const double aspect : {1.0, 5.0}) {
      for (const Vec2d& center : {Vec2d(0.5, 0.5), Vec2d(-7.2, 1000.1), Vec2d(3, 4)}) {
        const TexelKernel kernel = test::turned_kernel(center, sigma, aspect * sigma, 0.6);
        const Mat2d conic = kernel.variance.inverse();
        const int reach = static_cast<int>(std::ceil(9 * aspect * sigma));
        double sum = 0;
        for (int y = -reach; y <= reach; ++y) {
          for (int x = -reach; x <= reach; ++x) {
            const Vec2d d =
                Vec2d(x + 0.5, y + 0.5) - (center.array() - center.array().floor()).matrix();
            sum += std::exp(-d.dot(conic * d) / 2);
          }
        }
        sum /= 2 * std::numbers::pi * std::sqrt(kernel.variance.determinant());
        EXPECT_NEAR(lattice_sum(kernel), sum, 2e-8) << sigma << ' ' << aspect;
      }
    }
  }
}

}  // namespace
}  // namespace surfel
