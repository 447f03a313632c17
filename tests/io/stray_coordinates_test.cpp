#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/scene/transform.h>

#include "support/run_tool.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

constexpr int kPoints = 300;

/// Points within a cube of 10 units at a place, as millimetres.
std::vector<std::array<long, 3>> points_at(double place) {
  std::mt19937 engine(1);
  std::vector<std::array<long, 3>> points;
  const auto at = std::lround(1000 * place);
  const auto within = [&] { return static_cast<long>(engine() % 10000); };
  for (int i = 0; i < kPoints; ++i) {
    points.push_back({at + within(), 10 * at + within(), within()});
  }
  return points;
}

std::string line_of(const std::array<long, 3>& p) {
  return fmt::format("{:.3f} {:.3f} {:.3f}\n", static_cast<double>(p[0]) / 1000,
                     static_cast<double>(p[1]) / 1000, static_cast<double>(p[2]) / 1000);
}

void expect_points(const SurfelCloud& cloud, const std::vector<std::array<long, 3>>& points,
                   const std::string& what) {
  ASSERT_EQ(cloud.size(), points.size()) << what;
  double worst = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const double truth = static_cast<double>(points[i][static_cast<std::size_t>(axis)]) / 1000;
      worst = std::max(worst, std::abs(cloud.world(i)[axis] - truth));
    }
  }
  // Half a float's last digit of the 80 units that the origin and the cube may be apart; strays lie
  // further away, and are exact.
  EXPECT_LT(worst, 4e-6) << what;
}

TEST(StrayCoordinates, LeaveTheOthersTheirPrecision) {
  const TemporaryFolder folder;
  for (const double place : {100.0, 1e4, 5e5, 1e7}) {
    for (const int strays : {1, 50}) {
      std::vector<std::array<long, 3>> points = points_at(place);
      points.insert(points.begin() + 7, static_cast<std::size_t>(strays), {0, 0, 0});
      std::string text;
      for (const auto& p : points) text += line_of(p);
      std::ofstream(folder / "a.xyz") << text;
      const SurfelCloud cloud = read_cloud(folder / "a.xyz");
      const std::string what = fmt::format("{} strays, {} units away", strays, place);
      expect_points(cloud, points, what);
      // Through every format that has doubles or steps, and from each to the next.
      SurfelCloud passed = cloud;
      for (const char* name : {"b.las", "c.laz", "d.ply", "e.pcd", "f.csv", "g.laz", "h.xyz"}) {
        // LAS has 32 bits for all millimetres.
        if (place > 1e5 && std::string(name).find(".la") != std::string::npos) continue;
        write_cloud(passed, folder / name);
        passed = read_cloud(folder / name);
        expect_points(passed, points, what + ", " + name);
      }
      std::ifstream written(folder / "f.csv");
      std::string line;
      std::getline(written, line);
      for (const auto& p : points) {
        std::getline(written, line);
        std::replace(line.begin(), line.end(), ',', ' ');
        std::istringstream found(line);
        std::istringstream expected(line_of(p));
        double a = 0;
        double b = 0;
        while (expected >> b) {
          ASSERT_TRUE(found >> a) << what;
          EXPECT_EQ(a, b) << what;
        }
      }
    }
  }
}

/// Random doubles about a place, without decimals.
std::vector<Vec3d> doubles_at(double place, double extent) {
  std::mt19937_64 engine(2);
  std::uniform_real_distribution<double> within(place, place + extent);
  std::vector<Vec3d> points(kPoints);
  for (Vec3d& p : points) p = Vec3d(within(engine), 2 * within(engine), -within(engine));
  return points;
}

std::string shortest(double x) {
  std::array<char, 32> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), x).ptr};
}

TEST(StrayCoordinates, DoublesAndTextPassThroughToTheLastBit) {
  const TemporaryFolder folder;
  for (const double place : {0.0, 1.0, 1e3, 1e5, 1e7, 2.9e13}) {
    for (const bool stray : {false, true}) {
      std::vector<Vec3d> points = doubles_at(place, 3);
      if (stray) points[7] = Vec3d(-6.144, 0, 1.0 / 3);
      std::string text;
      for (const Vec3d& p : points) text += fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
      std::ofstream(folder / "a.xyz") << text;
      SurfelCloud passed = read_cloud(folder / "a.xyz");
      for (const char* name : {"b.ply", "c.pcd", "d.csv", "e.ply", "f.xyz"}) {
        write_cloud(passed, folder / name);
        passed = read_cloud(folder / name);
      }
      std::ifstream written(folder / "f.xyz");
      for (const Vec3d& p : points) {
        std::array<std::string, 3> words;
        std::string line;
        std::getline(written, line);
        std::istringstream(line) >> words[0] >> words[1] >> words[2];
        for (int axis = 0; axis < 3; ++axis) {
          EXPECT_EQ(words[static_cast<std::size_t>(axis)], shortest(p[axis]))
              << place << (stray ? ", stray" : "");
        }
      }
    }
  }
}

TEST(StrayCoordinates, CoordinatesBesideFarLargerOnesPassThrough) {
  const TemporaryFolder folder;
  for (const char* const text :
       {"29389297287168 1 1\n29389297287168 2 1\n29389297287168 3 1\n-6.144 0.001 5\n",
        "1.53063836e-18 1 1.53063836e-18\n1.53063836e-18 1 1.53063836e-18\n"
        "1.53063836e-18 1 1.53063836e-18\n0 0.643 5.4323e-312\n"}) {
    std::ofstream(folder / "a.xyz") << text;
    write_cloud(read_cloud(folder / "a.xyz"), folder / "b.ply");
    write_cloud(read_cloud(folder / "b.ply"), folder / "c.xyz");
    const std::string written = read_text(folder / "c.xyz");
    EXPECT_TRUE(written.ends_with(text)) << written;
  }
}

TEST(StrayCoordinates, FloatsInTextStayFloats) {
  const TemporaryFolder folder;
  std::ofstream(folder / "a.xyz") << "0.12345678 1.00000012 3.14159274\n0.100000001 2 1e-9\n";
  write_cloud(read_cloud(folder / "a.xyz"), folder / "b.ply");
  std::ifstream written(folder / "b.ply");
  std::stringstream all;
  all << written.rdbuf();
  EXPECT_NE(all.str().find("property float x"), std::string::npos);
  EXPECT_EQ(all.str().find("property double"), std::string::npos);
}

TEST(StrayCoordinates, LasKeepsItsIntegersOverAnyExtent) {
  const TemporaryFolder folder;
  std::mt19937 engine(3);
  // Integers of 32 bits in millimetres, over 100 km.
  std::vector<std::array<long, 3>> steps(kPoints);
  std::string text;
  for (auto& p : steps) {
    p = {static_cast<long>(engine() % 100000000), static_cast<long>(engine() % 90000000),
         static_cast<long>(engine() % 1000000)};
    text += line_of(p);
  }
  std::ofstream(folder / "a.xyz") << text;
  write_cloud(read_cloud(folder / "a.xyz"), folder / "b.las");
  write_cloud(read_cloud(folder / "b.las"), folder / "c.laz");
  const SurfelCloud laz = read_cloud(folder / "c.laz");
  EXPECT_EQ(laz.las->scale, Vec3d::Constant(1e-3));
  write_cloud(laz, folder / "d.csv");
  std::ifstream written(folder / "d.csv");
  std::string line;
  std::getline(written, line);
  for (const auto& p : steps) {
    std::getline(written, line);
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream found(line);
    for (const long step : p) {
      double x = 0;
      found >> x;
      EXPECT_EQ(x, static_cast<double>(step) / 1000);
    }
  }
}

TEST(StrayCoordinates, LasTakesTheFinestStepsThatReach) {
  const TemporaryFolder folder;
  std::ofstream(folder / "a.xyz") << "500000.123 5400000.456 100.789\n0 0 0\n"
                                  << "500001.234 5400001.567 100.891\n"
                                  << "500002.345 5400000.678 100.912\n";
  const std::vector<std::string> notes =
      write_cloud(read_cloud(folder / "a.xyz"), folder / "a.las");
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_NE(notes[0].find("rounded to steps of 0.01"), std::string::npos) << notes[0];
  const SurfelCloud read = read_cloud(folder / "a.las");
  // y extends over 5.4e6 units, which 2^32 millimetres are not.
  EXPECT_NEAR(read.world(2).x(), 500001.234, 1e-6);
  EXPECT_NEAR(read.world(2).y(), 5400001.57, 1e-6);
  EXPECT_NEAR(read.world(2).z(), 100.891, 1e-6);
  EXPECT_EQ(read.world(1), Vec3d::Zero());
}

TEST(StrayCoordinates, StayWhenACloudMoves) {
  std::vector<std::array<long, 3>> points = points_at(5e5);
  points.push_back({0, 0, 0});
  const TemporaryFolder folder;
  std::string text;
  for (const auto& p : points) text += line_of(p);
  std::ofstream(folder / "a.xyz") << text;
  SurfelCloud cloud = read_cloud(folder / "a.xyz");
  Similarity move;
  move.translation = Vec3d(1000, -2000, 0);
  transform_cloud(cloud, move);
  for (auto& p : points) {
    p[0] += 1000000;
    p[1] -= 2000000;
  }
  points.pop_back();
  Array<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < points.size(); ++i) rows.push_back(i);
  expect_points(cloud.gathered(rows), points, "moved");
}

}  // namespace
}  // namespace surfel::test
