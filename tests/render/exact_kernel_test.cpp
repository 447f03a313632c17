#include <gtest/gtest.h>
#include <surfel/render/exact_kernel.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

/// Where the ray through a picture coordinate meets the tangent plane: z, and plane coordinates in
/// standard deviations.
struct Hit {
  double z;
  Eigen::Vector2d u;
};

Hit hit(const SurfelInCamera& s, const Camera& camera, const Eigen::Vector2d& x) {
  const Eigen::Vector3d ray((x.x() - camera.center_x) / camera.focal_x,
                            (x.y() - camera.center_y) / camera.focal_y, 1);
  const double z = s.normal.dot(s.position) / s.normal.dot(ray);
  const Eigen::Vector3d offset = z * ray - s.position;
  return {z,
          {s.tangent.dot(offset) / std::sqrt(s.variance_u),
           s.normal.cross(s.tangent).dot(offset) / std::sqrt(s.variance_v)}};
}

/// Equation (8), its Jacobian by differences. Zero where beta >= cutoff; nothing within `doubt` of
/// the cutoff, where rounding decides.
std::optional<double> rho_of_equation_8(const SurfelInCamera& s, const Camera& camera,
                                        const Eigen::Vector2d& x, double lowpass, double cutoff) {
  const Hit h = hit(s, camera, x);
  if (!(h.z > camera.near)) return 0.0;
  constexpr double kStep = 1e-5;
  Eigen::Matrix2d J;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(i);
    J.col(i) = (hit(s, camera, x + step).u - hit(s, camera, x - step).u) / (2 * kStep);
  }
  const Eigen::Matrix2d M = Eigen::Matrix2d::Identity() + lowpass * lowpass * J * J.transpose();
  const double beta = 0.5 * h.u.dot(M.inverse() * h.u);
  if (std::abs(beta - cutoff) < 2e-3 * cutoff) return std::nullopt;
  if (!(beta < cutoff)) return 0.0;
  return s.area / (2 * M_PI * std::sqrt(s.variance_u * s.variance_v * M.determinant())) *
         std::exp(-beta);
}

/// Largest difference between the picture of one splat and equation (8), relative to the disc's
/// peak; and that something is seen at all.
double error_of_exact_splat(const SurfelCloud& cloud, const Camera& camera, double cutoff,
                            double lowpass) {
  RenderOptions options;
  options.cutoff = cutoff;
  options.lowpass = lowpass;
  options.kernel = Kernel::kPerspective;
  const Image image = render_unlit(cloud, camera, options);
  const SurfelInCamera surfel = in_camera(cloud, 0, camera);
  // Beyond its box a kernel is cut off: what (8) spreads from there to the plane's horizon is no
  // part of the disc.
  const auto kernel = make_exact_kernel(surfel, camera,
                                        {.cutoff = cutoff,
                                         .lowpass = lowpass,
                                         .x1 = static_cast<double>(image.width),
                                         .y1 = static_cast<double>(image.height)});
  EXPECT_TRUE(kernel);
  if (!kernel) return 1;
  double worst = 0;
  std::size_t seen = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const PixelBox& box = kernel->splat.box;
      if (x < box.x0 || x > box.x1 || y < box.y0 || y > box.y1) continue;
      const auto expected = rho_of_equation_8(surfel, camera, {x + 0.5, y + 0.5}, lowpass, cutoff);
      if (!expected) continue;
      seen += *expected > 0 ? 1 : 0;
      worst = std::max(worst, std::abs(*expected - image.pixel(x, y)[kSumOfRho]));
    }
  }
  EXPECT_GT(seen, 0U);
  return worst / (surfel.area / (2 * M_PI * std::sqrt(surfel.variance_u * surfel.variance_v)));
}

SurfelCloud disc(const Vec3f& position, const Vec3f& normal, float deviation) {
  SurfelCloud cloud;
  add_surfel(cloud, position, normal.normalized(), deviation * deviation, deviation * deviation,
             {1, 1, 1});
  return cloud;
}

constexpr double kTolerance = 2e-4;  // Of the peak; float arithmetic and the polynomial exp().

TEST(ExactKernel, MatchesEquation8) {
  const Camera camera = camera_at(2, 130);
  for (const Vec3f& normal : {Vec3f(0, 0, 1), Vec3f(0.5F, 0.2F, 1), Vec3f(3, -1, 1),
                              Vec3f(10, 4, 1), Vec3f(0.3F, 0, -1)}) {
    for (const float deviation : {0.003F, 0.05F, 0.4F}) {
      for (const double lowpass : {0.3, 1.0, 3.0}) {
        EXPECT_LT(error_of_exact_splat(disc({0.11F, -0.07F, 0.1F}, normal, deviation), camera, 2,
                                       lowpass),
                  kTolerance)
            << normal.transpose() << ", deviation " << deviation << ", low-pass " << lowpass;
      }
    }
  }
}

TEST(ExactKernel, AnisotropicMatchesEquation8) {
  SurfelCloud cloud = disc({0.1F, 0, 0}, {0.4F, -0.3F, 1}, 0.1F);
  cloud.tangent.push_back(cloud.normal[0].unitOrthogonal());
  cloud.variance_u.push_back(0.16F);
  cloud.variance_v.push_back(0.0004F);
  EXPECT_LT(error_of_exact_splat(cloud, camera_at(2, 128), 3, 1), kTolerance);
}

/// A floor around and behind the eye: the disc's centre is behind the eye plane, in it, before it.
TEST(ExactKernel, ThroughTheEyePlaneMatchesEquation8) {
  for (const float z : {-0.4F, 0.0F, 0.4F}) {
    // The camera stands at (0, 0, 2) and looks along -z.
    const SurfelCloud floor = disc({0.2F, -0.5F, 2 - z}, {0.1F, 1, 0.05F}, 1.5F);
    for (const double near : {0.0, 0.8}) {
      Camera camera = camera_at(2, 100, 70);
      camera.near = near;
      EXPECT_LT(error_of_exact_splat(floor, camera, 1, 1), kTolerance)
          << "centre at depth " << z << ", near plane at " << near;
    }
  }
}

TEST(ExactKernel, SmallSplatsAreAlikeInBothKernels) {
  const SurfelCloud cloud = jittered_plane(60, 1, 0.3);
  Camera camera = camera_at(4, 64);
  RenderOptions options;
  options.kernel = Kernel::kAffine;
  const Image affine = render_unlit(cloud, camera, options);
  options.kernel = Kernel::kPerspective;
  FrameStatistics statistics;
  const Image exact = render_unlit(cloud, camera, options, &statistics);
  EXPECT_EQ(statistics.exact_splats, statistics.splats);
  EXPECT_GT(statistics.splats, 3000U);
  for (std::size_t i = 0; i < exact.data.size(); ++i) {
    if (!std::isfinite(affine.data[i])) continue;
    EXPECT_NEAR(exact.data[i], affine.data[i], 0.01);
  }
  options.kernel = Kernel::kAuto;
  const Image picked = render_unlit(cloud, camera, options, &statistics);
  EXPECT_EQ(statistics.exact_splats, 0U);
  EXPECT_EQ(picked.data, affine.data);
}

TEST(ExactKernel, AutoPicksWhatIsLargeAndSlanted) {
  const Camera camera = camera_at(2, 128);
  RenderOptions options;
  FrameStatistics statistics;
  const auto exact = [&](const Vec3f& normal, float deviation) {
    render_unlit(disc({0, 0, 0}, normal, deviation), camera, options, &statistics);
    EXPECT_EQ(statistics.splats, 1U);
    return statistics.exact_splats == 1;
  };
  EXPECT_FALSE(exact({0, 0, 1}, 0.3F)) << "without a depth extent the affine kernel is exact";
  EXPECT_TRUE(exact({1, 0, 1}, 0.3F));
  EXPECT_FALSE(exact({1, 0, 1}, 0.003F));
  options.kernel_tolerance = 1000;
  EXPECT_FALSE(exact({1, 0, 1}, 0.3F));
}

TEST(ExactKernel, NothingWhereNothingIsSeen) {
  const Camera camera = camera_at(2, 64);
  const ExactKernelView view{.cutoff = 1, .lowpass = 1, .x1 = 64, .y1 = 64};
  const auto seen = [&](const SurfelCloud& cloud) {
    return make_exact_kernel(in_camera(cloud, 0, camera), camera, view).has_value();
  };
  EXPECT_TRUE(seen(disc({0, 0, 0}, {0, 0, 1}, 0.1F)));
  EXPECT_FALSE(seen(disc({0, 0, 0}, {1, 0, 0}, 0.1F))) << "edge-on";
  EXPECT_FALSE(seen(disc({0, 0, 3}, {0, 0, 1}, 0.1F))) << "behind the eye";
  EXPECT_FALSE(seen(disc({5, 0, 0}, {0, 0, 1}, 0.1F))) << "beside the picture";
  EXPECT_FALSE(seen(disc({0, 0, 2}, {0, 0, 1}, 0.1F))) << "at the eye";
}

}  // namespace
}  // namespace surfel::test
