#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/estimate/normals.h>
#include <surfel/estimate/orientation.h>
#include <surfel/estimate/point_sheets.h>
#include <surfel/estimate/winding_sides.h>
#include <surfel/sample/generate.h>
#include <surfel/sample/procedural_surface.h>

#include "support/side_scenes.h"

namespace surfel {
namespace {

using test::bowl;
using test::damaged;
using test::fins;
using test::furnished_room;
using test::SidedPoints;
using test::thin_plate;

struct Turned {
  Array<Vec3f> normal;
  Array<float> confidence;
  OrientationReport report;
};

/// Estimates normals and turns them.
Turned turned(const SidedPoints& points, Orientation method) {
  const auto search = make_neighbor_search(points.position);
  Turned out;
  out.normal = estimate_normals(points.position, *search).normal;
  // Whatever side they come on.
  for (std::size_t i = 0; i < out.normal.size(); ++i) {
    if (random_uniform(5, i) < 0.5) out.normal[i] = -out.normal[i];
  }
  OrientationOptions options;
  options.method = method;
  out.report =
      orient_normals(points.position, {0, 0, 0}, *search, {}, options, out.normal, &out.confidence);
  return out;
}

/// Share on the wrong side of the normals that are within 60 degrees of the true line.
double wrong_share(const Array<Vec3f>& normal, const SidedPoints& points) {
  double wrong = 0;
  double sided = 0;
  for (std::size_t i = 0; i < normal.size(); ++i) {
    const float product = normal[i].dot(points.truth[i]);
    if (!(std::abs(product) > 0.5F)) continue;
    ++sided;
    wrong += product < 0 ? 1 : 0;
  }
  return wrong / sided;
}

SidedPoints surface(const std::string& kind, std::size_t count) {
  GenerateOptions options;
  options.count = count;
  const SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), options);
  return {cloud.position, cloud.normal, 2 / std::sqrt(static_cast<double>(count))};
}

TEST(WindingSides, ClosedSurfacesFaceOutward) {
  for (const char* kind : {"sphere", "torus", "head"}) {
    const SidedPoints points = surface(kind, 20000);
    EXPECT_LT(wrong_share(turned(points, Orientation::kWinding).normal, points), 0.001) << kind;
    const SidedPoints noisy = damaged(points, {.noise = 0.4, .gaps = 10, .gap_size = 0.1});
    EXPECT_LT(wrong_share(turned(noisy, Orientation::kWinding).normal, noisy), 0.01) << kind;
  }
}

TEST(WindingSides, WallsThinnerThanTwoSpacingsHaveTwoSides) {
  for (const SidedPoints& points : {thin_plate(20000, 1), thin_plate(20000, 1.9), bowl(20000, 1),
                                    bowl(20000, 1.9), fins(80000, 1.5)}) {
    EXPECT_LT(wrong_share(turned(points, Orientation::kWinding).normal, points), 0.01);
  }
  // What all this is for: the tree leads from one side to the other.
  const SidedPoints plate = thin_plate(20000, 1.5);
  EXPECT_GT(wrong_share(turned(plate, Orientation::kMst).normal, plate), 0.1);
}

TEST(WindingSides, CavitiesFaceInward) {
  const SidedPoints sphere = surface("sphere", 10000);
  SidedPoints points = sphere;
  for (std::size_t i = 0; i < sphere.position.size(); ++i) {
    points.add(0.7 * sphere.position[i].cast<double>(), -sphere.truth[i].cast<double>());
    points.add(0.3 * sphere.position[i].cast<double>(), sphere.truth[i].cast<double>());
  }
  const Turned found = turned(points, Orientation::kWinding);
  EXPECT_EQ(wrong_share(found.normal, points), 0);
  EXPECT_EQ(found.report.components, 3U);
}

TEST(WindingSides, FurnitureAgreesWithItsRoom) {
  const SidedPoints room =
      damaged(furnished_room(60000, 2.5), {.noise = 0.1, .gaps = 30, .gap_size = 0.05});
  const double wrong = wrong_share(turned(room, Orientation::kWinding).normal, room);
  // Nothing says that the room is seen from inside.
  EXPECT_LT(std::min(wrong, 1 - wrong), 0.01);
}

TEST(WindingSides, OpenSurfacesLookUp) {
  SidedPoints terrain = damaged(surface("terrain", 40000), {.gaps = 20, .gap_size = 0.05});
  for (auto* column : {&terrain.position, &terrain.truth}) {
    for (Vec3f& v : *column) v = Vec3f(v.x(), -v.z(), v.y());
  }
  EXPECT_LT(wrong_share(turned(terrain, Orientation::kWinding).normal, terrain), 0.001);
}

/// Two squares of n x n points, with normals of their own, as two sheets.
struct TwoSquares {
  Array<Vec3f> position, normal;
  Array<float> area;
  PointSheets sheets;

  TwoSquares(int n, const Vec3f& offset, const Vec3f& second) {
    sheets.count = 2;
    for (std::uint32_t k = 0; k < 2; ++k) {
      for (int i = 0; i < n * n; ++i) {
        const Vec3f at(static_cast<float>(i % n), static_cast<float>(i / n), 0);
        position.push_back(k == 0 ? at : Vec3f(at + offset));
        normal.push_back(k == 0 ? Vec3f(0, 0, 1) : second);
        area.push_back(1);
        sheets.of.push_back(k);
      }
    }
  }
  WindingSides sides() const {
    WindingDipoles points(winding_grid(position.size(), position, area));
    points.add(position, normal, area, sheets);
    return winding_sides(points);
  }
};

TEST(WindingSides, SidesGoOnAcrossGapsAndTurnAroundRims) {
  const Vec3f up(0, 0, 1);
  const auto differ = [&](const Vec3f& offset, const Vec3f& second) {
    const WindingSides sides = TwoSquares(24, offset, second).sides();
    EXPECT_EQ(sides.part.size(), 1U) << offset.transpose();
    EXPECT_GT(sides.sheet[0].certainty, 0.5) << offset.transpose();
    return sides.sheet[0].turned != sides.sheet[1].turned;
  };
  for (const float gap : {1.0F, 4.0F, 10.0F}) {
    EXPECT_FALSE(differ(Vec3f(23 + gap, 0, 0), up)) << gap;
    EXPECT_TRUE(differ(Vec3f(23 + gap, 0, 0), -up)) << gap;
  }
  for (const float gap : {0.5F, 1.5F, 4.0F}) {
    EXPECT_TRUE(differ(Vec3f(0, 0, gap), up)) << gap;
    EXPECT_FALSE(differ(Vec3f(0, 0, gap), -up)) << gap;
  }
  const WindingSides far = TwoSquares(24, Vec3f(1e12F, 0, 0), up).sides();
  EXPECT_EQ(far.part.size(), 2U);
}

TEST(WindingSides, ConfidenceIsLowerWhereSidesAreWrong) {
  const SidedPoints points = damaged(fins(40000, 1), {.noise = 0.25});
  const Turned found = turned(points, Orientation::kWinding);
  double sum[2] = {0, 0};
  double count[2] = {0, 0};
  for (std::size_t i = 0; i < found.normal.size(); ++i) {
    ASSERT_GE(found.confidence[i], 0);
    ASSERT_LE(found.confidence[i], 1);
    const int right = found.normal[i].dot(points.truth[i]) > 0 ? 1 : 0;
    sum[right] += static_cast<double>(found.confidence[i]);
    ++count[right];
  }
  ASSERT_GT(count[0], 100);
  EXPECT_GT(sum[1] / count[1], sum[0] / count[0] + 0.1);
}

TEST(PointSheets, NoiseLeavesNoSmallSheetsAndNoneOfTwoSides) {
  // More points than one block has, in no order: sheets are joined within blocks and across them.
  const SidedPoints points = damaged(surface("sphere", 70000), {.noise = 0.5});
  const auto search = make_neighbor_search(points.position);
  Array<Vec3f> normal = estimate_normals(points.position, *search).normal;
  constexpr std::size_t kLeast = 40;
  const PointSheets sheets = cut_sheets(points.position, *search, kLeast, normal);
  EXPECT_GT(sheets.count, 1U);
  EXPECT_LE(sheets.count, points.position.size() / kLeast);
  std::vector<std::size_t> outward(sheets.count), inward(sheets.count);
  for (std::size_t i = 0; i < normal.size(); ++i) {
    if (sheets.of[i] == PointSheets::kNone) continue;
    ++(normal[i].dot(points.truth[i]) > 0 ? outward : inward)[sheets.of[i]];
  }
  for (std::uint32_t k = 0; k < sheets.count; ++k) {
    ASSERT_GE(outward[k] + inward[k], kLeast) << k;
    EXPECT_EQ(std::min(outward[k], inward[k]), 0U) << k;
  }
}

TEST(WindingSides, SameForAnyNumberOfThreads) {
  const SidedPoints points = damaged(fins(35000, 1.5), {.noise = 0.4});
  set_thread_count(1);
  const Turned one = turned(points, Orientation::kWinding);
  set_thread_count(3);
  const Turned three = turned(points, Orientation::kWinding);
  set_thread_count(0);
  EXPECT_EQ(one.normal, three.normal);
  EXPECT_EQ(one.confidence, three.confidence);
}

TEST(WindingSides, HardCloudsHaveSidesOrNone) {
  std::vector<SidedPoints> clouds(7);
  const SidedPoints sphere = surface("sphere", 5000);
  for (int i = 0; i < 2000; ++i) {
    const double t = random_uniform(1, static_cast<std::uint64_t>(i));
    clouds[1].add(Vec3d(1, 2, 3), Vec3d(0, 0, 1));       // Coincident.
    clouds[2].add(Vec3d(t, 2 * t, -t), Vec3d(0, 0, 1));  // A line.
    clouds[3].add(Vec3d(i % 2, 0, 0), Vec3d(0, 0, 1));   // Two places.
  }
  clouds[4] = sphere;
  clouds[4].add(Vec3d(1e15, -1e15, 0), Vec3d(0, 0, 1));  // A stray point.
  clouds[5] = sphere;
  for (Vec3f& p : clouds[5].position) p *= 1e-18F;
  clouds[6] = sphere;
  for (Vec3f& p : clouds[6].position) p *= 1e15F;
  for (std::size_t c = 0; c < clouds.size(); ++c) {
    const Turned found = turned(clouds[c], Orientation::kWinding);
    for (std::size_t i = 0; i < found.normal.size(); ++i) {
      ASSERT_TRUE(found.normal[i].allFinite() && std::isfinite(found.confidence[i])) << c;
      if (c >= 4 && i < sphere.position.size()) {
        ASSERT_GT(found.normal[i].dot(sphere.truth[i]), 0) << c << ' ' << i;
      }
    }
  }
}

}  // namespace
}  // namespace surfel
