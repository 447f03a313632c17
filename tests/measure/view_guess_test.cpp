#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/measure/view_guess.h>

namespace surfel {
namespace {

using Rotation = Eigen::Matrix3d;

/// The 24 rotations that take axes to axes.
std::vector<Rotation> axis_rotations() {
  std::vector<Rotation> all;
  for (int x = 0; x < 6; ++x) {
    for (int y = 0; y < 6; ++y) {
      const Vec3d to_x = (x % 2 ? -1 : 1) * Vec3d::Unit(x / 2);
      const Vec3d to_y = (y % 2 ? -1 : 1) * Vec3d::Unit(y / 2);
      if (x / 2 == y / 2) continue;
      Rotation rotation;
      rotation << to_x, to_y, to_x.cross(to_y);
      all.push_back(rotation);
    }
  }
  return all;
}

/// A box; `inside` turns its faces inward.
void add_box(TriangleMesh& mesh, const Vec3d& min, const Vec3d& max, bool inside = false) {
  const auto first = static_cast<std::uint32_t>(mesh.position.size());
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d p(corner & 1 ? max.x() : min.x(), corner & 2 ? max.y() : min.y(),
                  corner & 4 ? max.z() : min.z());
    mesh.position.push_back(p.cast<float>());
  }
  constexpr std::uint32_t kQuads[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                          {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& q : kQuads) {
    const std::uint32_t a = first + q[0];
    const std::uint32_t b = first + q[1];
    const std::uint32_t c = first + q[2];
    const std::uint32_t d = first + q[3];
    mesh.face.push_back(inside ? std::array{a, c, b} : std::array{a, b, c});
    mesh.face.push_back(inside ? std::array{a, d, c} : std::array{a, c, d});
  }
}

void turn(TriangleMesh& mesh, const Rotation& rotation) {
  for (Vec3f& p : mesh.position) p = (rotation * p.cast<double>()).cast<float>();
}

// The shapes have z up.

TriangleMesh figure_on_plinth() {
  TriangleMesh mesh;
  add_box(mesh, {-1, -1, 0}, {1, 1, 0.5});
  add_box(mesh, {-0.35, -0.25, 0.5}, {0.35, 0.25, 2.2});  // Body.
  add_box(mesh, {-0.8, -0.15, 1.6}, {0.8, 0.15, 1.9});    // Arms.
  add_box(mesh, {-0.2, -0.3, 2.2}, {0.2, 0.2, 2.7});      // Head.
  return mesh;
}

/// A room from inside, with things on its floor and a lamp.
TriangleMesh room() {
  TriangleMesh mesh;
  add_box(mesh, {0, 0, 0}, {5, 4, 2.6}, true);
  add_box(mesh, {0.5, 0.4, 0}, {2, 1.2, 0.8});
  add_box(mesh, {3.4, 2.6, 0}, {4.4, 3.4, 1.1});
  add_box(mesh, {2.6, 0.3, 0}, {3, 0.7, 0.4});
  add_box(mesh, {1, 2.5, 0}, {1.8, 3.5, 0.5});
  add_box(mesh, {2.3, 1.9, 2.2}, {2.6, 2.2, 2.5});
  return mesh;
}

TriangleMesh terrain() {
  TriangleMesh mesh;
  constexpr int kSide = 60;
  for (int y = 0; y <= kSide; ++y) {
    for (int x = 0; x <= kSide; ++x) {
      const double h = 2.5 * std::sin(0.2 * x) * std::cos(0.13 * y) + 0.6 * std::sin(0.7 * x + y);
      mesh.position.push_back(Vec3d(x, y, h).cast<float>());
    }
  }
  for (std::uint32_t y = 0; y < kSide; ++y) {
    for (std::uint32_t x = 0; x < kSide; ++x) {
      const std::uint32_t i = y * (kSide + 1) + x;
      mesh.face.push_back({i, i + 1, i + kSide + 2});
      mesh.face.push_back({i, i + kSide + 2, i + kSide + 1});
    }
  }
  return mesh;
}

/// Symmetric about x = 0; its sides are flatter and larger than what its wheels make a base.
TriangleMesh car() {
  TriangleMesh mesh;
  add_box(mesh, {-0.85, -2.1, 0.35}, {0.85, 2.1, 0.95});
  add_box(mesh, {-0.8, -0.9, 0.95}, {0.8, 2, 1.45});
  for (std::size_t corner = 12; corner < 16; ++corner) {  // The roof is narrower.
    Vec3f& p = mesh.position[corner];
    p.x() *= 0.7F;
    p.y() = p.y() < 0 ? 0.1F : 1.4F;
  }
  for (const double y : {-1.4, 1.4}) {
    add_box(mesh, {-0.85, y - 0.33, 0}, {-0.6, y + 0.33, 0.66});
    add_box(mesh, {0.6, y - 0.33, 0}, {0.85, y + 0.33, 0.66});
  }
  return mesh;
}

ViewGuess guess_turned(TriangleMesh mesh, const Rotation& rotation) {
  turn(mesh, rotation);
  return guess_view(sample_surface(mesh));
}

/// The guess for each rotation has the shape's z up.
void expect_up_turns(const TriangleMesh& mesh,
                     const std::function<void(const ViewGuess&, const Rotation&)>& and_so = {}) {
  int turned = 0;
  for (const Rotation& rotation : axis_rotations()) {
    const ViewGuess guess = guess_turned(mesh, rotation);
    EXPECT_GT(guess.up.dot(rotation.col(2)), 0.999)
        << "rotation " << turned << ": " << guess.sentence();
    EXPECT_NEAR(guess.up.dot(guess.front), 0, 1e-12);
    EXPECT_NEAR(guess.front.norm(), 1, 1e-12);
    if (and_so) and_so(guess, rotation);
    ++turned;
  }
  EXPECT_EQ(turned, 24);
}

SurfelCloud cloud_of(const std::vector<Vec3d>& points, const std::vector<Vec3d>& normals = {}) {
  SurfelCloud cloud;
  for (const Vec3d& p : points) cloud.position.push_back(p.cast<float>());
  for (const Vec3d& n : normals) cloud.normal.push_back(n.cast<float>());
  return cloud;
}

/// What a sensor in the origin that looks along z sees of a ball.
std::vector<Vec3d> seen_cap() {
  std::vector<Vec3d> points;
  for (double x = -0.2; x <= 0.2; x += 0.01) {
    for (double y = -0.15; y <= 0.15; y += 0.01) {
      const Vec3d ray = Vec3d(x, y, 1).normalized();
      const Vec3d center(0, 0, 3);
      const double along = ray.dot(center);
      const double under = along * along - center.squaredNorm() + 1;
      points.push_back(ray * (under > 0 ? along - std::sqrt(under) : 5 / ray.z()));
    }
  }
  return points;
}

TEST(ViewGuess, FigureStandsOnItsPlinth) {
  expect_up_turns(figure_on_plinth(), [](const ViewGuess& guess, const Rotation&) {
    EXPECT_EQ(guess.reason, "largest flat support");
    EXPECT_GT(guess.margin, 0.3);
  });
}

TEST(ViewGuess, RoomHasItsThingsOnTheFloor) { expect_up_turns(room()); }

TEST(ViewGuess, TerrainIsSeenFromAbove) {
  expect_up_turns(terrain(), [](const ViewGuess& guess, const Rotation&) {
    EXPECT_EQ(guess.reason, "ground seen from above");
    EXPECT_GT(guess.elevation, 0.7);
  });
}

TEST(ViewGuess, CarStandsOnItsWheelsAndIsSeenFromItsPlaneOfSymmetry) {
  expect_up_turns(car(), [](const ViewGuess& guess, const Rotation& rotation) {
    EXPECT_GT(std::abs(guess.front.dot(rotation.col(1))), 0.999) << guess.sentence();
  });
}

TEST(ViewGuess, TiltedRoomIsSetUpright) {
  for (const Vec3d& axis : {Vec3d(1, 0, 0), Vec3d(1, 1, 0), Vec3d(-0.3, 1, 0.2)}) {
    const Rotation tilt =
        Eigen::AngleAxisd(20 * std::numbers::pi / 180, axis.normalized()).toRotationMatrix();
    const ViewGuess guess = guess_turned(room(), tilt);
    EXPECT_GT(guess.up.dot(tilt.col(2)), std::cos(2 * std::numbers::pi / 180)) << guess.sentence();
  }
}

TEST(ViewGuess, SlightTiltLeavesTheAxis) {
  const Rotation tilt = Eigen::AngleAxisd(0.05, Vec3d(1, 0, 0)).toRotationMatrix();
  EXPECT_EQ(guess_turned(room(), tilt).up, Vec3d(0, 0, 1));
}

TEST(ViewGuess, BallHasConventionAlone) {
  std::vector<Vec3d> points;
  for (int i = 0; i < 4000; ++i) {  // Fibonacci's lattice.
    const double z = 1 - (2 * i + 1) / 4000.0;
    const double turn = i * std::numbers::pi * (3 - std::sqrt(5.0));
    points.emplace_back(std::sqrt(1 - z * z) * std::cos(turn),
                        std::sqrt(1 - z * z) * std::sin(turn), z);
  }
  const ViewGuess guess = guess_view(sample_surface(cloud_of(points, points)));
  EXPECT_EQ(guess.reason, "by convention");
  EXPECT_EQ(guess.up, Vec3d(0, 1, 0));
  EXPECT_EQ(guess.front, Vec3d(0, 0, 1));
}

TEST(ViewGuess, TooFewPointsGiveTheConvention) {
  const auto expect_default = [](const std::vector<Vec3d>& points) {
    const ViewGuess guess = guess_view(sample_surface(cloud_of(points)));
    EXPECT_EQ(guess.up, Vec3d(0, 1, 0));
    EXPECT_TRUE(guess.from().allFinite());
    const ViewGuess given =
        guess_view(sample_surface(cloud_of(points)), {.up = Vec3d(0, 0, 2), .viewpoint = {}});
    EXPECT_EQ(given.up, Vec3d(0, 0, 1));
    EXPECT_EQ(given.front, Vec3d(0, -1, 0));
  };
  expect_default({});
  expect_default({{1, 2, 3}});
  expect_default(std::vector<Vec3d>(100, Vec3d(1, 2, 3)));
  expect_default(std::vector<Vec3d>(20, Vec3d(NAN, 0, 0)));
}

TEST(ViewGuess, CollinearAndFlatPointsAreNoTrouble) {
  std::vector<Vec3d> line;
  std::vector<Vec3d> plane;
  for (int i = 0; i < 400; ++i) {
    line.emplace_back(i, 0, 0);
    plane.emplace_back(i % 20, 0, i / 20);
  }
  EXPECT_TRUE(guess_view(sample_surface(cloud_of(line))).from().allFinite());
  const ViewGuess flat = guess_view(sample_surface(cloud_of(plane)));
  EXPECT_EQ(flat.up, Vec3d(0, 1, 0));
  EXPECT_EQ(flat.reason, "lies flat");
}

TEST(ViewGuess, CoordinatesOfMapsHaveZUp) {
  // A steep slope, as high as it is wide, at places that only maps have.
  TriangleMesh mesh = terrain();
  for (Vec3f& p : mesh.position) p.z() += 0.5F * p.x();
  mesh.origin = {512700, 5403547, 295};
  const ViewGuess guess = guess_view(sample_surface(mesh));
  EXPECT_EQ(guess.up, Vec3d(0, 0, 1));
  EXPECT_EQ(guess.reason, "coordinates of a map");
}

TEST(ViewGuess, PointsSeenFromTheOriginHaveCoordinatesOfACamera) {
  const ViewGuess guess = guess_view(sample_surface(cloud_of(seen_cap())));
  EXPECT_EQ(guess.up, Vec3d(0, -1, 0));
  EXPECT_EQ(guess.reason, "what a camera in the origin sees");
  EXPECT_GT(guess.from().z(), -1.01);
  EXPECT_LT(guess.front.z(), -0.99);
}

TEST(ViewGuess, NormalsTurnedToTheOriginInTheMiddleTellNoSide) {
  // The half of an upright ellipsoid that faces +z; normals look away from it, or to the origin.
  std::vector<Vec3d> points;
  std::vector<Vec3d> outward;
  std::vector<Vec3d> to_origin;
  for (int i = 0; i < 40; ++i) {
    for (int j = 1; j < 40; ++j) {
      const double longitude = std::numbers::pi * i / 39;
      const double latitude = std::numbers::pi * (j / 40.0 - 0.5);
      const Vec3d unit(std::cos(latitude) * std::cos(longitude), std::sin(latitude),
                       std::cos(latitude) * std::sin(longitude));
      points.emplace_back(unit.x(), 1.5 * unit.y(), unit.z());
      outward.emplace_back(Vec3d(unit.x(), unit.y() / 1.5, unit.z()).normalized());
      to_origin.emplace_back(-outward.back());
    }
  }
  const ViewGuess known = guess_view(sample_surface(cloud_of(points, outward)));
  const ViewGuess turned = guess_view(sample_surface(cloud_of(points, to_origin)));
  EXPECT_EQ(turned.up, known.up);
  EXPECT_EQ(turned.front, known.front);
  EXPECT_EQ(turned.reason, known.reason);
}

TEST(ViewGuess, SensorLooksAlongTheAxesThatSeeThePoints) {
  const std::vector<Vec3d> points = seen_cap();
  const auto seen = [&](const Vec4d& orientation, const Rotation& world) {
    std::vector<Vec3d> turned;
    for (const Vec3d& p : points) turned.emplace_back(world * p + Vec3d(1, 2, 3));
    return guess_view(sample_surface(cloud_of(turned)),
                      {.up = {}, .viewpoint = Viewpoint{{1, 2, 3}, orientation}});
  };
  // z forward, y down; then half a turn about x, where -z is forward and y up.
  for (const Vec4d& q : {Vec4d(1, 0, 0, 0), Vec4d(0, 1, 0, 0)}) {
    const ViewGuess guess = seen(q, Rotation::Identity());
    ASSERT_TRUE(guess.sensor);
    EXPECT_EQ(guess.sensor->eye, Vec3d(1, 2, 3));
    EXPECT_GT(guess.sensor->forward.z(), 0.999);
    EXPECT_LT((guess.up - Vec3d(0, -1, 0)).norm(), 1e-12);
    EXPECT_NEAR(guess.sensor->tan_x, 0.2, 0.01);
    EXPECT_NEAR(guess.sensor->tan_y, 0.15, 0.01);
  }
  // x forward, z up.
  Rotation ahead;
  ahead << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const ViewGuess guess = seen({1, 0, 0, 0}, ahead);
  ASSERT_TRUE(guess.sensor);
  EXPECT_GT(guess.sensor->forward.x(), 0.999);
  EXPECT_LT((guess.up - Vec3d(0, 0, 1)).norm(), 1e-12);
}

TEST(ViewGuess, ScannerThatLooksAroundHasNoPicture) {
  const ViewGuess guess = guess_view(
      sample_surface(room()), {.up = {}, .viewpoint = Viewpoint{{2.5, 2, 1.3}, {1, 0, 0, 0}}});
  EXPECT_FALSE(guess.sensor);
  EXPECT_EQ(guess.up, Vec3d(0, 0, 1));
}

TEST(ViewGuess, DoesNotDependOnOrderNorThreads) {
  std::mt19937 random(5);
  const SurfaceSample sample = sample_surface(figure_on_plinth());
  SurfelCloud cloud;
  std::normal_distribution<float> noise(0, 0.002F);
  for (int copy = 0; copy < 12; ++copy) {
    for (const SurfaceSample::Point& p : sample.points) {
      cloud.position.emplace_back(p.position + Vec3f(noise(random), noise(random), noise(random)));
      cloud.normal.push_back(p.normal);
      cloud.area.push_back(p.area);
    }
  }
  const ViewGuess first = guess_view(sample_surface(cloud));
  Array<std::uint32_t> order(cloud.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::shuffle(order.begin(), order.end(), random);
  const int threads = thread_count();
  for (const int count : {1, 3}) {
    set_thread_count(count);
    const SurfaceSample shuffled = sample_surface(cloud.gathered(order));
    EXPECT_GT(shuffled.points.size(), SurfaceSampler::kPoints * 9 / 10);
    EXPECT_LT(shuffled.points.size(), SurfaceSampler::kPoints * 11 / 10);
    const ViewGuess again = guess_view(shuffled);
    EXPECT_EQ(again.up, first.up);
    EXPECT_EQ(again.front, first.front);
    EXPECT_EQ(again.margin, first.margin);
  }
  set_thread_count(threads);
}

/// A guess with z up that is seen from -y.
ViewGuess guessed() {
  ViewGuess guess;
  guess.up = {0, 0, 1};
  guess.front = {0, -1, 0};
  guess.azimuth = 0.5;
  guess.elevation = 0.3;
  guess.reason = "largest flat support";
  return guess;
}

TEST(AimCamera, LooksFromTheFrontRight) {
  CameraOptions camera;
  ASSERT_TRUE(ViewChoice{}.needs_guess(camera));
  EXPECT_EQ(aim_camera(camera, {}, guessed()),
            "up z, seen from the front right (largest flat support)");
  EXPECT_EQ(camera.up, Vec3d(0, 0, 1));
  EXPECT_GT(camera.from->x(), 0);
  EXPECT_LT(camera.from->y(), 0);
  EXPECT_NEAR(camera.from->z(), std::sin(0.3), 1e-12);
}

TEST(AimCamera, NamedViewsShowTheirSides) {
  const auto aimed = [](NamedView view) {
    CameraOptions camera;
    aim_camera(camera, {.guess_up = false, .view = view}, guessed());
    return camera;
  };
  EXPECT_EQ(aimed(NamedView::kFront).from, Vec3d(0, -1, 0));
  EXPECT_EQ(aimed(NamedView::kBack).from, Vec3d(0, 1, 0));
  EXPECT_EQ(aimed(NamedView::kRight).from, Vec3d(1, 0, 0));
  EXPECT_EQ(aimed(NamedView::kLeft).from, Vec3d(-1, 0, 0));
  EXPECT_EQ(aimed(NamedView::kTop).from, Vec3d(0, 0, 1));
  EXPECT_EQ(aimed(NamedView::kTop).up, Vec3d(0, 1, 0));
  EXPECT_EQ(aimed(NamedView::kBottom).from, Vec3d(0, 0, -1));
  EXPECT_EQ(aimed(NamedView::kBottom).up, Vec3d(0, -1, 0));
  EXPECT_EQ(aimed(NamedView::kIso).from, Vec3d(1, -1, 1));
}

TEST(AimCamera, DirectionsThatAreGivenStay) {
  CameraOptions camera;
  camera.from = Vec3d(1, 0, 0);
  EXPECT_FALSE(ViewChoice{}.needs_guess(camera));
  EXPECT_THROW(aim_camera(camera, {.guess_up = false, .view = NamedView::kTop}, guessed()), Error);
  EXPECT_EQ(aim_camera(camera, {.guess_up = true, .view = {}}, guessed()),
            "up z (largest flat support)");
  EXPECT_EQ(camera.from, Vec3d(1, 0, 0));
  EXPECT_EQ(camera.up, Vec3d(0, 0, 1));
}

TEST(AimCamera, SensorsViewHasItsFieldOfView) {
  ViewGuess guess = guessed();
  CameraOptions camera;
  EXPECT_THROW(aim_camera(camera, {.guess_up = false, .view = NamedView::kSensor}, guess), Error);
  guess.sensor = SensorView{{0, -4, 1}, {0, 1, 0}, {0, 0, 1}, 0.5, 0.3};
  for (const ViewChoice& choice :
       {ViewChoice{}, ViewChoice{.guess_up = false, .view = NamedView::kSensor}}) {
    CameraOptions seen;
    seen.width = 800;
    seen.height = 400;
    aim_camera(seen, choice, guess);
    EXPECT_EQ(seen.eye, Vec3d(0, -4, 1));
    EXPECT_EQ(seen.target, Vec3d(0, -3, 1));
    EXPECT_NEAR(std::tan(seen.fov * std::numbers::pi / 360), 1.05 * 0.3, 1e-12);
  }
  camera.width = 400;
  camera.height = 800;
  aim_camera(camera, {}, guess);
  EXPECT_NEAR(std::tan(camera.fov * std::numbers::pi / 360), 1.05 * 1.0, 1e-12);
  CameraOptions narrow;
  narrow.fov = 10;
  aim_camera(narrow, {}, guess);
  EXPECT_EQ(narrow.fov, 10);
  CameraOptions elsewhere;
  elsewhere.target = Vec3d(1, 1, 1);
  aim_camera(elsewhere, {}, guess);
  EXPECT_FALSE(elsewhere.eye);
  EXPECT_EQ(elsewhere.from, Vec3d(0, -1, 0));
}

}  // namespace
}  // namespace surfel
