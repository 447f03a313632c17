#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/elementary.h>
#include <surfel/render/clip_kernel.h>

#include "render/scenes.h"

namespace surfel::test {
namespace {

SurfelInCamera tilted(double degrees) {
  SurfelInCamera s;
  s.position = {0.3, -0.2, 2};
  const double a = degrees * M_PI / 180;
  s.normal = Eigen::Vector3d(std::sin(a), 0, -std::cos(a));
  s.tangent = Eigen::Vector3d(std::cos(a), 0, std::sin(a));
  s.variance_u = 4e-4;
  s.variance_v = 1e-4;
  return s;
}

ClipLine line_at(const SurfelInCamera& s, double angle, double distance) {
  const Eigen::Vector3d b = s.normal.cross(s.tangent);
  return {std::cos(angle) * s.tangent + std::sin(angle) * b, distance};
}

/// The share of the filtered kernel that lines leave at a pixel, by midpoints in the tangent plane:
/// of the Gaussian times the pixel filter's Gaussian, whose projection is linear.
double share_by_quadrature(const SurfelInCamera& s, const Camera& camera, double lowpass,
                           const Eigen::Vector2d& offset, const std::vector<ClipLine>& lines,
                           int steps) {
  const Eigen::Matrix2d J = screen_from_tangent_jacobian(s, camera);
  const Eigen::Vector3d b = s.normal.cross(s.tangent);
  const double reach = 7 * std::sqrt(std::max(s.variance_u, s.variance_v));
  double left = 0;
  double all = 0;
  for (int i = 0; i < steps; ++i) {
    for (int k = 0; k < steps; ++k) {
      const Eigen::Vector2d u(reach * ((2 * i + 1.0) / steps - 1),
                              reach * ((2 * k + 1.0) / steps - 1));
      const Eigen::Vector2d x = offset - J * u;
      const double value =
          std::exp(-0.5 * (u.x() * u.x() / s.variance_u + u.y() * u.y() / s.variance_v +
                           x.squaredNorm() / (lowpass * lowpass)));
      all += value;
      // The share of a cell that a line leaves is linear in its distance, nearly.
      double inside = 1;
      for (const ClipLine& line : lines) {
        const double to_line = line.distance - line.direction.dot(u.x() * s.tangent + u.y() * b);
        inside *= std::clamp(to_line * steps / (2 * reach) + 0.5, 0.0, 1.0);
      }
      left += inside * value;
    }
  }
  return left / all;
}

/// Volume, mean and variance of weighted places.
struct Moments {
  double volume = 0;
  Eigen::Vector2d first{0, 0};
  Eigen::Matrix2d second = Eigen::Matrix2d::Zero();

  void add(const Eigen::Vector2d& place, double weight) {
    volume += weight;
    first += weight * place;
    second += weight * place * place.transpose();
  }
  Eigen::Vector2d mean() const { return first / volume; }
  Eigen::Matrix2d variance() const { return second / volume - mean() * mean().transpose(); }
};

TEST(ClipKernel, ShareOfOneLineIsExact) {
  const Camera camera = camera_at(1, 256);
  for (const double degrees : {0.0, 40.0, 80.0}) {
    const SurfelInCamera s = tilted(degrees);
    for (const double angle : {0.0, 1.0, 2.5}) {
      const ClipLine line = line_at(s, angle, 0.4 * std::sqrt(s.variance_u));
      const ClipShare share = clip_share(s, camera, 1, line);
      for (const Eigen::Vector2d& offset :
           {Eigen::Vector2d(0, 0), Eigen::Vector2d(1.5, -0.7), Eigen::Vector2d(-2, 2.5)}) {
        EXPECT_NEAR(share.at(offset, {0, 0}),
                    share_by_quadrature(s, camera, 1, offset, {line}, 300), 1e-3)
            << degrees << " degrees, line " << angle;
      }
    }
  }
}

/// Off by less than the header states.
TEST(ClipKernel, ShareOfTwoLinesIsNear) {
  const Camera camera = camera_at(1, 256);
  double error = 0;
  for (const double wedge : {0.5, 0.8, 1.6, 2.4, 2.9}) {
    SurfelInCamera s = tilted(30);
    s.clip[0] = line_at(s, 0, 0.1 * std::sqrt(s.variance_u));
    s.clip[1] = line_at(s, M_PI - wedge, 0);
    const double w = joint_share(s, camera, 1);
    for (double x = -3; x <= 3; x += 1.5) {
      for (double y = -3; y <= 3; y += 1.5) {
        const double share = joined(clip_share(s, camera, 1, s.clip[0]).at({x, y}, {0, 0}),
                                    clip_share(s, camera, 1, s.clip[1]).at({x, y}, {0, 0}), w);
        const double exact = share_by_quadrature(s, camera, 1, {x, y}, {s.clip[0], s.clip[1]}, 200);
        error = std::max(error, std::abs(share - exact));
      }
    }
  }
  EXPECT_LT(error, 0.035);
}

/// Both sides of a crease see its line at the same place, and outward vectors are opposite.
TEST(ClipKernel, SidesOfACreaseLookAtEachOther) {
  const Camera camera = camera_at(3, 256);
  SurfelInCamera top;
  top.position = {0.2, -0.1, 3};
  top.normal = Eigen::Vector3d(0, -1, -1).normalized();
  top.tangent = {1, 0, 0};
  top.clip[0] = {Eigen::Vector3d(0, 1, -1).normalized(), 0.1};
  const Eigen::Vector3d on_crease = top.position + 0.1 * top.clip[0].direction;
  SurfelInCamera side = top;
  side.normal = Eigen::Vector3d(0, 1, -1).normalized();
  side.clip[0] = {Eigen::Vector3d(0, -1, -1).normalized(), 0.1};
  side.position = on_crease + Eigen::Vector3d(-0.3, 0, 0) - 0.1 * side.clip[0].direction;
  const Eigen::Vector2d a = outward_on_screen(top, camera, top.clip[0]);
  const Eigen::Vector2d b = outward_on_screen(side, camera, side.clip[0]);
  EXPECT_NEAR(a.norm(), 1, 1e-12);
  EXPECT_LT((a + b).norm(), 1e-12);
  EXPECT_GT(a.y(), 0.9);  // Below the edge on the screen the side is seen.
}

/// The vectors that rasterisers make, of affine and of exact kernels, are the scalar form's.
TEST(ClipKernel, PicturesOfOneSurfelAreKernelTimesShare) {
  const Camera camera = camera_at(2, 64);
  SurfelCloud cloud;
  add_surfel(cloud, {0.02F, -0.05F, 0}, Vec3f(0.3F, 0.2F, 1).normalized(), 0.01F, 0.02F, {1, 1, 1});
  cloud.clip1 = {Vec3f(1, 0.4F, -0.3F)};
  cloud.clip1_distance = {0.06F};
  cloud.clip2 = {Vec3f(-0.2F, 1, 0)};
  cloud.clip2_distance = {-0.02F};
  SurfelCloud whole = cloud;
  whole.clip1 = whole.clip2 = {};
  whole.clip1_distance = whole.clip2_distance = {};
  for (const Kernel kernel : {Kernel::kAffine, Kernel::kPerspective}) {
    RenderOptions options;
    options.cutoff = 4;
    options.kernel = kernel;
    const Image cut = render_unlit(cloud, camera, options);
    const Image uncut = render_unlit(whole, camera, options);
    SurfelInCamera s = in_camera(cloud, 0, camera);
    const auto ewa = make_ewa_kernel(s, camera, options.lowpass);
    ASSERT_TRUE(ewa);
    double worst = 0;
    double most = 0;
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 64; ++x) {
        double shares[2];
        for (int j = 0; j < 2; ++j) {
          const Vec3f& direction = (j == 0 ? cloud.clip1 : cloud.clip2)[0];
          const Vec3f& n = cloud.normal[0];
          const Eigen::Vector3d in_plane =
              (direction - n * n.dot(direction)).normalized().cast<double>();
          const ClipLine line{camera.camera_from_world * in_plane,
                              (j == 0 ? cloud.clip1_distance : cloud.clip2_distance)[0]};
          s.clip[j] = line;
          shares[j] =
              clip_share(s, camera, options.lowpass, line).at({x + 0.5, y + 0.5}, ewa->center);
        }
        const double share = joined(shares[0], shares[1], joint_share(s, camera, options.lowpass));
        const double before = uncut.pixel(x, y)[kSumOfRho];
        most = std::max(most, before * share);
        if (share < 2 * kLeastClipShare) continue;
        worst = std::max(worst, std::abs(cut.pixel(x, y)[kSumOfRho] - before * share));
      }
    }
    EXPECT_GT(most, 0.05);
    // normal_cdf() is within 1e-5; the projection of the exact kernel is not linear.
    EXPECT_LT(worst, (kernel == Kernel::kAffine ? 3e-5 : 0.05) * most) << static_cast<int>(kernel);
  }
}

/// A surfel smaller than the pixel filter that lines cut is drawn as a Gaussian with the volume,
/// the mean and the variance of the cut one.
TEST(ClipKernel, SmallCutSurfelsKeepTheirMoments) {
  const Camera camera = camera_at(2, 64);
  const double pixels = camera.focal_x / 2;  // Of a unit at the surfel.
  const auto deviation = static_cast<float>(0.8 / pixels);
  const float half = deviation / 2;
  SurfelCloud cloud;
  add_surfel(cloud, {0, 0, 0}, {0, 0, 1}, deviation * deviation, deviation * deviation, {1, 1, 1});
  for (const bool two : {false, true}) {
    cloud.clip1 = {Vec3f(1, 0, 0)};
    cloud.clip1_distance = {half};
    if (two) {
      cloud.clip2 = {Vec3f(0.6F, 0.8F, 0)};
      cloud.clip2_distance = {-half};
    }
    Moments expected;
    constexpr int kSteps = 400;
    for (int i = 0; i < kSteps; ++i) {
      for (int k = 0; k < kSteps; ++k) {
        const Eigen::Vector2d u(10.0 * (i + 0.5) / kSteps - 5, 10.0 * (k + 0.5) / kSteps - 5);
        if (u.x() > 0.5 || (two && 0.6 * u.x() + 0.8 * u.y() > -0.5)) continue;
        expected.add(0.8 * u, std::exp(-u.squaredNorm() / 2) * 100 / (kSteps * kSteps) / 2 / M_PI);
      }
    }
    RenderOptions options;
    options.cutoff = 10;  // Next to nothing is cut off.
    const Image image = render_unlit(cloud, camera, options);
    Moments seen;
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 64; ++x) {
        seen.add({x + 0.5 - camera.center_x, camera.center_y - y - 0.5},
                 image.pixel(x, y)[kSumOfRho]);
      }
    }
    const double area = static_cast<double>(cloud.area[0]) * pixels * pixels;
    EXPECT_NEAR(seen.volume / area, expected.volume, 0.005) << two;
    EXPECT_LT((seen.mean() - expected.mean()).norm(), 0.02) << two;
    const Eigen::Matrix2d filter = Eigen::Matrix2d::Identity();
    // What one line leaves is no Gaussian for the second one to cut.
    EXPECT_LT((seen.variance() - expected.variance() - filter).norm(), two ? 0.12 : 0.02) << two;
  }
}

/// Unlit pictures of surfels in z = 0 whose half-planes alone differ.
Image picture_with_line(const Vec3f& direction, float distance) {
  SurfelCloud cloud = jittered_plane(12, 0.6, 0.3);
  cloud.clip1.assign(cloud.size(), direction);
  cloud.clip1_distance.assign(cloud.size(), distance);
  return render_unlit(cloud, camera_at(2, 64), {});
}

TEST(ClipKernel, LinesThatAreNoLinesCutNothing) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const Image whole = render_unlit(jittered_plane(12, 0.6, 0.3), camera_at(2, 64), {});
  EXPECT_NE(picture_with_line({1, 0, 0}, 0).data, whole.data);
  EXPECT_EQ(picture_with_line({kNan, 0, 0}, 0).data, whole.data);
  EXPECT_EQ(picture_with_line({1, kNan, 0}, 0).data, whole.data);
  EXPECT_EQ(picture_with_line({1, 0, 0}, kNan).data, whole.data);
  EXPECT_EQ(picture_with_line({1, 0, 0}, kInfinity).data, whole.data);
  EXPECT_EQ(picture_with_line({kInfinity, 0, 0}, 0).data, whole.data);
  EXPECT_EQ(picture_with_line({0, 0, 0}, -1).data, whole.data);
  EXPECT_EQ(picture_with_line({0, 0, 1}, -1).data, whole.data);  // Along the normal.
}

/// Lines beyond the kernel leave it as it is, and leave nothing where it lies beyond them.
TEST(ClipKernel, LinesFarAwayCutNothingOrAll) {
  const Image whole = render_unlit(jittered_plane(12, 0.6, 0.3), camera_at(2, 64), {});
  const Image uncut = picture_with_line({0.6F, 0.8F, 0}, 1);
  ASSERT_EQ(uncut.data.size(), whole.data.size());
  EXPECT_EQ(uncut.data, whole.data);
  for (const float value : picture_with_line({0.6F, 0.8F, 0}, -1).data) {
    ASSERT_TRUE(value == 0 || std::isinf(value));
  }
}

/// A surfel beyond its line does not change what a picture shows around the others.
TEST(ClipKernel, MirroredSurfelsAreNotFramed) {
  SurfelCloud cloud = jittered_plane(12, 0.6, 0.3);
  const RenderCloud others(cloud);
  const Bounds box = others.extent().box;
  cloud.clip1.assign(cloud.size(), {0, 0, 0});
  cloud.clip1_distance.assign(cloud.size(), 0);
  add_surfel(cloud, {3, 0, 0}, {0, 0, 1}, 0.01F, 0.01F, {1, 1, 1});
  cloud.clip1.push_back({1, 0, 0});
  cloud.clip1_distance.push_back(-2.4F);
  const RenderCloud with_mirrored(cloud);
  const SceneExtent after = with_mirrored.extent();
  EXPECT_LT((after.box.min - box.min).norm(), 1e-6);
  EXPECT_LT((after.box.max - box.max).norm(), 1e-6);
  EXPECT_LT(after.support(Vec3d(1, 0, 0), 1), 1);
  // Where there are no others they are framed.
  SurfelCloud alone;
  add_surfel(alone, {3, 0, 0}, {0, 0, 1}, 0.01F, 0.01F, {1, 1, 1});
  alone.clip1 = {{1, 0, 0}};
  alone.clip1_distance = {-2.4F};
  const RenderCloud framed(alone);
  EXPECT_NEAR(framed.extent().box.max.x(), 3.1, 1e-5);
}

}  // namespace
}  // namespace surfel::test
