#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/scene/camera_path.h>

namespace surfel::test {
namespace {

PathKey key_at(double time, const Vec3d& eye, double turn = 0) {
  PathKey key;
  key.time = time;
  key.camera.eye = eye;
  key.camera.camera_from_world = Eigen::AngleAxisd(turn, Vec3d::UnitY()).toRotationMatrix();
  return key;
}

TEST(CameraPath, GoesThroughItsKeysAtTheirTimes) {
  std::vector<PathKey> keys{key_at(0, {0, 0, 0}, 0), key_at(1, {1, 2, 0}, 0.5),
                            key_at(3, {4, 0, 1}, -0.4), key_at(4, {5, 5, 5}, 2)};
  for (std::size_t k = 0; k < keys.size(); ++k) keys[k].camera.focal_x = k % 2 == 0 ? 100 : 150;
  const std::vector<Camera> path = camera_path(keys, 41, PathEase::kNone);
  ASSERT_EQ(path.size(), 41U);
  for (const PathKey& key : keys) {
    const Camera& camera = path[static_cast<std::size_t>(std::lround(10 * key.time))];
    EXPECT_LT((camera.eye - key.camera.eye).norm(), 1e-9);
    EXPECT_LT((camera.camera_from_world - key.camera.camera_from_world).norm(), 1e-9);
    EXPECT_NEAR(camera.focal_x, key.camera.focal_x, 1e-9);
  }
  for (const Camera& camera : path) {
    EXPECT_LT((camera.camera_from_world * camera.camera_from_world.transpose() -
               Eigen::Matrix3d::Identity())
                  .norm(),
              1e-12);
    EXPECT_GE(camera.focal_x, 100 - 1e-9);  // A zoom does not overshoot.
    EXPECT_LE(camera.focal_x, 150 + 1e-9);
  }
}

TEST(CameraPath, ParabolasAndEvenTurnsAreExact) {
  // Keys that are uneven in time, on a parabola, which a spline through three points keeps.
  const auto place = [](double t) { return Vec3d(t, t * t, 3 - t); };
  std::vector<PathKey> keys;
  for (const double t : {0.0, 1.0, 1.5, 3.0}) keys.push_back(key_at(t, place(t)));
  const std::vector<Camera> path = camera_path(keys, 31, PathEase::kNone);
  for (int i = 0; i <= 30; ++i) {
    EXPECT_LT((path[static_cast<std::size_t>(i)].eye - place(i / 10.0)).norm(), 1e-9);
  }
  std::vector<PathKey> turning;
  for (int k = 0; k < 4; ++k) turning.push_back(key_at(k, {0, 0, 0}, 1.2 * k));
  const std::vector<Camera> turns = camera_path(turning, 31, PathEase::kNone);
  for (int i = 0; i <= 30; ++i) {
    const Eigen::Matrix3d expected = Eigen::AngleAxisd(0.12 * i, Vec3d::UnitY()).toRotationMatrix();
    EXPECT_LT((turns[static_cast<std::size_t>(i)].camera_from_world - expected).norm(), 1e-9);
  }
}

TEST(CameraPath, SpeedAndTurningDoNotJump) {
  const std::vector<PathKey> keys{key_at(0, {0, 0, 0}, 0), key_at(1, {1, 2, 0}, 1),
                                  key_at(2, {4, 0, 1}, 0.2), key_at(3, {5, 5, 5}, 2)};
  constexpr int kSteps = 3000;
  const std::vector<Camera> path = camera_path(keys, kSteps + 1, PathEase::kNone);
  for (std::size_t i = 1; i + 1 < path.size(); ++i) {
    EXPECT_LT((path[i + 1].eye - 2 * path[i].eye + path[i - 1].eye).norm() * kSteps, 0.1);
    EXPECT_LT((path[i + 1].camera_from_world - 2 * path[i].camera_from_world +
               path[i - 1].camera_from_world)
                      .norm() *
                  kSteps,
              0.1);
  }
}

TEST(CameraPath, LooksAtTargetsAllAlong) {
  std::vector<PathKey> keys{key_at(0, {3, 0, 0}), key_at(1, {0, 1, 3}), key_at(2, {-3, 0, 0})};
  for (PathKey& key : keys) key.target = Vec3d(0.1, 0.2, 0.3);
  for (const Camera& camera : camera_path(keys, 21, PathEase::kNone)) {
    const Vec3d seen = camera.camera_from_world * (Vec3d(0.1, 0.2, 0.3) - camera.eye);
    EXPECT_LT(seen.head<2>().norm(), 1e-9);
    EXPECT_GT(seen.z(), 0);
    EXPECT_LT((camera.camera_from_world * Vec3d(0, 1, 0)).y(), 0);  // Up is up.
  }
}

TEST(CameraPath, EaseBeginsAndEndsAtRest) {
  const std::vector<PathKey> keys{key_at(0, {0, 0, 0}), key_at(2, {1, 0, 0})};
  const auto steps = [&](PathEase ease) {
    const std::vector<Camera> path = camera_path(keys, 101, ease);
    EXPECT_EQ(path.front().eye.x(), 0);
    EXPECT_NEAR(path.back().eye.x(), 1, 1e-12);
    return std::pair(path[1].eye.x() - path[0].eye.x(), path[100].eye.x() - path[99].eye.x());
  };
  EXPECT_NEAR(steps(PathEase::kNone).first, 0.01, 1e-9);
  EXPECT_LT(steps(PathEase::kIn).first, 0.001);
  EXPECT_GT(steps(PathEase::kIn).second, 0.015);
  EXPECT_LT(steps(PathEase::kOut).second, 0.001);
  EXPECT_LT(steps(PathEase::kBoth).first, 0.001);
  EXPECT_LT(steps(PathEase::kBoth).second, 0.001);
}

TEST(CameraPath, KeysThatMakeNoPathAreRefused) {
  const PathKey first = key_at(0, {0, 0, 0});
  EXPECT_FALSE(path_problems({first}).empty());
  EXPECT_FALSE(path_problems({first, first}).empty());
  PathKey second = key_at(1, {1, 0, 0});
  EXPECT_TRUE(path_problems({first, second}).empty());
  second.camera.width = 8;
  EXPECT_FALSE(path_problems({first, second}).empty());
  second = key_at(1, {1, 0, 0});
  second.camera.orthographic = true;
  EXPECT_FALSE(path_problems({first, second}).empty());
}

}  // namespace
}  // namespace surfel::test
