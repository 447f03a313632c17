#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/orientation.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>

namespace surfel {
namespace {

struct Oriented {
  Array<Vec3f> normal;
  OrientationReport report;
  double wrong_share = 0;  ///< Of the true normals' sides.
};

/// Flips half of the normals at random, orients them and compares with the truth.
Oriented orient_these(const Array<Vec3f>& position, const Array<Vec3f>& normal,
                      const Array<Vec3f>& truth, const OrientationOptions& options,
                      const Array<Vec3f>& previous = {}, const Vec3d& origin = {0, 0, 0}) {
  const auto search = make_neighbor_search(position);
  Oriented out;
  out.normal = normal;
  for (std::size_t i = 0; i < out.normal.size(); ++i) {
    if (random_uniform(5, i) < 0.5) out.normal[i] = -out.normal[i];
  }
  out.report = orient_normals(position, origin, *search, previous, options, out.normal);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) wrong += out.normal[i].dot(truth[i]) < 0 ? 1 : 0;
  out.wrong_share = static_cast<double>(wrong) / static_cast<double>(truth.size());
  return out;
}

/// The same with normals estimated from the points.
Oriented orient(const Array<Vec3f>& position, const Array<Vec3f>& truth,
                const OrientationOptions& options, const Array<Vec3f>& previous = {},
                const Vec3d& origin = {0, 0, 0}) {
  const auto search = make_neighbor_search(position);
  const Array<Vec3f> normal = estimate_normals(position, *search).normal;
  return orient_these(position, normal, truth, options, previous, origin);
}

/// Normals that are 5 degrees off, in random directions.
Array<Vec3f> inexact(const Array<Vec3f>& truth) {
  constexpr float kOff = 5 * std::numbers::pi_v<float> / 180;
  Array<Vec3f> out = truth;
  for (std::size_t i = 0; i < out.size(); ++i) {
    Vec3f aside;
    for (int d = 0; d < 3; ++d) aside[d] = static_cast<float>(random_uniform(7, i, d) - 0.5);
    aside -= aside.dot(out[i]) * out[i];
    out[i] = std::cos(kOff) * out[i] + std::sin(kOff) * aside.normalized();
  }
  return out;
}

SurfelCloud surface(const std::string& kind, std::size_t count) {
  GenerateOptions options;
  options.count = count;
  return generate_surfels(procedural_scene(kind, 1), options);
}

OrientationOptions by(Orientation method) {
  OrientationOptions options;
  options.method = method;
  return options;
}

TEST(Orientation, ClosedSurfacesFaceOutward) {
  for (const char* kind : {"sphere", "torus", "head"}) {
    const SurfelCloud cloud = surface(kind, 20000);
    for (const Orientation method : {Orientation::kMst, Orientation::kOutward}) {
      const Oriented found = orient(cloud.position, cloud.normal, by(method));
      EXPECT_LT(found.wrong_share, 0.001) << kind;
      EXPECT_EQ(found.report.components, 1U) << kind;
      EXPECT_EQ(found.report.unknown, 0U) << kind;
      EXPECT_NEAR(static_cast<double>(found.report.flipped), 10000, 1000) << kind;
    }
  }
}

TEST(Orientation, NestedSpheresAreTwoParts) {
  SurfelCloud cloud = surface("sphere", 20000);
  Array<Vec3f> position = cloud.position;
  Array<Vec3f> truth = cloud.normal;
  const float gap = 3 * std::sqrt(4 * std::numbers::pi_v<float> / 20000);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    position.push_back((1 - gap) * cloud.position[i]);
    truth.push_back(cloud.normal[i]);
  }
  const Oriented found = orient(position, truth, by(Orientation::kOutward));
  EXPECT_EQ(found.report.components, 2U);
  EXPECT_LT(found.wrong_share, 0.001);
}

TEST(Orientation, SpreadsAroundSharpEdges) {
  Array<Vec3f> position;
  Array<Vec3f> truth;
  for (int face = 0; face < 6; ++face) {
    for (int i = 0; i < 1600; ++i) {
      const auto at = [&](int d) {
        return static_cast<float>(2 * random_uniform(9, 1600 * face + i, d) - 1);
      };
      Vec3f normal = Vec3f::Zero();
      normal[face / 2] = face % 2 == 0 ? 1 : -1;
      Vec3f p = normal;
      p[(face / 2 + 1) % 3] = at(0);
      p[(face / 2 + 2) % 3] = at(1);
      position.push_back(p);
      truth.push_back(normal);
    }
  }
  // Estimated normals are rounded off at the edges, exact ones change from point to point.
  const OrientationOptions options = by(Orientation::kOutward);
  for (const Oriented& found :
       {orient(position, truth, options), orient_these(position, inexact(truth), truth, options)}) {
    EXPECT_EQ(found.report.components, 1U);
    EXPECT_LT(found.wrong_share, 0.001);
  }
}

TEST(Orientation, SheetsLessThanTwoSpacingsApartStayApart) {
  const SurfelCloud cloud = surface("sphere", 20000);
  Array<Vec3f> position = cloud.position;
  Array<Vec3f> truth = cloud.normal;
  const float gap = 1.5F * std::sqrt(4 * std::numbers::pi_v<float> / 20000);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    position.push_back((1 - gap) * cloud.position[i]);
    truth.push_back(cloud.normal[i]);
  }
  const Oriented found = orient_these(position, inexact(truth), truth, by(Orientation::kOutward));
  EXPECT_EQ(found.report.components, 2U);
  EXPECT_EQ(found.wrong_share, 0);
}

TEST(Orientation, ScanLinesAreOnePart) {
  // Lines of a sphere, ten times as far apart as their points.
  Array<Vec3f> position;
  Array<Vec3f> truth;
  for (int line = 1; line < 60; ++line) {
    const double polar = line * std::numbers::pi / 60;
    const int points = static_cast<int>(1200 * std::sin(polar)) + 1;
    for (int i = 0; i < points; ++i) {
      const double around = i * 2 * std::numbers::pi / points;
      truth.push_back(Vec3d(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around),
                            std::cos(polar))
                          .cast<float>());
      position.push_back(truth.back());
    }
  }
  const Oriented found = orient(position, truth, by(Orientation::kMst));
  EXPECT_LT(found.wrong_share, 0.001);
}

TEST(Orientation, PatchesAreOnePart) {
  // They are so far apart that no point has its nearest ones in another.
  Array<Vec3f> position, truth;
  for (std::size_t i = 0; i < 18 * 18 * 25; ++i) {
    const auto noise = [&](int d) { return 0.2 * random_uniform(13, i, d); };
    const std::size_t patch = i / 25;
    const double x = 12 * static_cast<double>(patch % 18) + static_cast<double>(i % 5);
    const double y = 12 * static_cast<double>(patch / 18) + static_cast<double>(i / 5 % 5);
    position.emplace_back(Vec3d(x + noise(0), y + noise(1), noise(2)).cast<float>());
    truth.push_back(Vec3f::UnitZ());
  }
  const Oriented found = orient(position, truth, by(Orientation::kMst));
  EXPECT_EQ(found.report.components, 1U);
  EXPECT_EQ(found.wrong_share, 0);
}

TEST(Orientation, TowardsViewpointAndUp) {
  const SurfelCloud cloud = surface("sphere", 5000);
  OrientationOptions options = by(Orientation::kViewpoint);
  const Vec3d origin(1000, 2000, 3000);
  options.viewpoint = origin + Vec3d(0, 0, 0.1);  // Inside: all look inward.
  EXPECT_EQ(orient(cloud.position, cloud.normal, options, {}, origin).wrong_share, 1);
  options = by(Orientation::kUp);
  options.up = Vec3d(0, -3, 0);
  for (const Vec3f& n : orient(cloud.position, cloud.normal, options).normal) EXPECT_LE(n.y(), 0);
}

TEST(Orientation, AutoLooksToTheViewpointWhereThereIsOne) {
  const SurfelCloud cloud = surface("sphere", 2000);
  OrientationOptions options = by(Orientation::kAuto);
  const Oriented out = orient(cloud.position, cloud.normal, options);
  EXPECT_EQ(out.report.method, Orientation::kWinding);
  EXPECT_EQ(out.wrong_share, 0);
  options.viewpoint = Vec3d(0, 0, 0);
  const Oriented seen = orient(cloud.position, cloud.normal, options);
  EXPECT_EQ(seen.report.method, Orientation::kViewpoint);
  EXPECT_EQ(seen.wrong_share, 1);
  Array<Vec3f> to_sensor = cloud.position;
  for (Vec3f& d : to_sensor) d = -d;
  EXPECT_EQ(orient(cloud.position, cloud.normal, by(Orientation::kAuto), to_sensor).wrong_share, 1);
}

TEST(Orientation, AlignKeepsGivenSidesAndSpreadsThem) {
  const SurfelCloud cloud = surface("torus", 10000);
  Array<Vec3f> previous(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    // Two thirds have none, or NaN; the others look inward.
    previous[i] = i % 3 == 0 ? Vec3f(-2 * cloud.normal[i]) : Vec3f(0, 0, 0);
    if (i % 3 == 1) previous[i].x() = std::nanf("");
  }
  const Oriented found = orient(cloud.position, cloud.normal, by(Orientation::kAlign), previous);
  EXPECT_GT(found.wrong_share, 0.999);
}

TEST(Orientation, AlignSpreadsFromTheNearestGiven) {
  // One half of a sphere is given outward, the other inward, by few points; a second sphere far
  // away has none.
  const SurfelCloud cloud = surface("sphere", 10000);
  Array<Vec3f> position = cloud.position;
  Array<Vec3f> previous;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float side = cloud.position[i].x() < 0 ? -1.0F : 1.0F;
    previous.push_back(i % 10 == 0 ? Vec3f(side * cloud.normal[i]) : Vec3f(0, 0, 0));
  }
  Array<Vec3f> truth = cloud.normal;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    position.push_back(cloud.position[i] + Vec3f(10, 0, 0));
    previous.emplace_back(0.0F, 0.0F, 0.0F);
    truth.push_back(cloud.normal[i]);
  }
  const Oriented found = orient(position, truth, by(Orientation::kAlign), previous);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float x = cloud.position[i].x();
    if (std::abs(x) > 0.2F) wrong += found.normal[i].dot(truth[i]) * x < 0 ? 1 : 0;
    if (i % 10 == 0) wrong += found.normal[i].dot(previous[i]) < 0 ? 1 : 0;
  }
  EXPECT_EQ(wrong, 0U);
  for (std::size_t i = cloud.size(); i < position.size(); ++i)
    wrong += found.normal[i].dot(truth[i]) < 0 ? 1 : 0;
  EXPECT_EQ(wrong, 0U);
  EXPECT_EQ(found.report.components, 2U);
}

TEST(Orientation, UnknownNormalsStayUnknown) {
  SurfelCloud cloud = surface("sphere", 2000);
  const auto search = make_neighbor_search(cloud.position);
  for (std::size_t i = 0; i < cloud.size(); i += 7) cloud.normal[i] = Vec3f(0, 0, 0);
  const OrientationReport report =
      orient_normals(cloud.position, {0, 0, 0}, *search, {}, by(Orientation::kMst), cloud.normal);
  EXPECT_EQ(report.unknown, 286U);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_NEAR(cloud.normal[i].norm(), i % 7 == 0 ? 0 : 1, 1e-5);
  }
}

TEST(Orientation, FewPointsAndBadOptions) {
  for (const int count : {0, 1, 2, 3}) {
    Array<Vec3f> position;
    Array<Vec3f> normal;
    for (int i = 0; i < count; ++i) {
      position.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
      normal.emplace_back(0.0F, 0.0F, -1.0F);
    }
    const auto search = make_neighbor_search(position);
    orient_normals(position, {0, 0, 0}, *search, {}, by(Orientation::kMst), normal);
    for (const Vec3f& n : normal) EXPECT_EQ(n.z(), 1);
  }
  Array<Vec3f> position(1, Vec3f(0, 0, 0));
  Array<Vec3f> normal(1, Vec3f(0, 0, 1));
  const auto search = make_neighbor_search(position);
  for (const OrientationOptions& bad :
       {OrientationOptions{.up = {0, 0, 0}},
        OrientationOptions{.viewpoint = Vec3d(std::numeric_limits<double>::infinity(), 0, 0)}}) {
    EXPECT_EQ(bad.problems().size(), 1U);
    EXPECT_THROW(orient_normals(position, {0, 0, 0}, *search, {}, bad, normal), Error);
  }
}

TEST(Orientation, SameForAnyNumberOfThreads) {
  const SurfelCloud cloud = surface("head", 20000);
  set_thread_count(1);
  const Oriented one = orient(cloud.position, cloud.normal, by(Orientation::kMst));
  set_thread_count(5);
  const Oriented five = orient(cloud.position, cloud.normal, by(Orientation::kMst));
  set_thread_count(0);
  EXPECT_EQ(one.normal, five.normal);
}

}  // namespace
}  // namespace surfel
