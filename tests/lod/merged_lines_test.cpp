#include <array>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/lod/merged_lines.h>

namespace surfel {
namespace {

const CutLine kNoLine{{0, 0, 0}, 0};

LinedSurfel at(float x, float y, const CutLine& first = kNoLine, const CutLine& second = kNoLine) {
  return {{x, y, 0}, 1, {first, second}, false};
}

/// A disc about the origin's neighbourhood, of standard deviation 2.
MergedPlace disc(float x, float y) { return {{x, y, 0}, {0, 0, 1}, {4, 0, 0, 4, 0, 0}}; }

std::array<CutLine, 2> lines_of(const MergedPlace& merged, const std::vector<LinedSurfel>& members,
                                const std::vector<LinedSurfel>& beside = {}) {
  std::vector<const LinedSurfel*> m;
  std::vector<const LinedSurfel*> b;
  for (const LinedSurfel& s : members) m.push_back(&s);
  for (const LinedSurfel& s : beside) b.push_back(&s);
  return merged_lines(merged, m, b);
}

const CutLine kRight{{1, 0, 0}, 2};  // x = 2
const CutLine kTop{{0, 1, 0}, 1};    // y = 1

TEST(MergedLines, MembersThatLieWithinALineNeedNotReachIt) {
  const auto lines = lines_of(disc(0.5F, 0), {at(1.5F, 0, kRight), at(0, 0), at(0.5F, 0.8F, kTop)});
  EXPECT_EQ(lines[0].direction, Vec3f(0, 1, 0)) << "the nearest line is first";
  EXPECT_NEAR(lines[0].offset, 1, 1e-6);
  EXPECT_EQ(lines[1].direction, Vec3f(1, 0, 0));
  EXPECT_NEAR(lines[1].offset, 2, 1e-6);
}

TEST(MergedLines, NoLineCutsOffAMember) {
  // The surface goes on around a reflex corner: beside the line, and beyond it.
  for (const float x : {1.7F, 2.5F}) {
    EXPECT_FALSE(lines_of(disc(1, 0), {at(1, 0, kRight), at(x, -3)})[0].cuts()) << x;
  }
  EXPECT_TRUE(lines_of(disc(1, 0), {at(1, 0, kRight), at(1.4F, -3)})[0].cuts());
}

TEST(MergedLines, OneEdgeIsOneLineThroughTheMeanOfItsPlaces) {
  // Tangents of a circle of radius 20 about (-18, 0).
  std::vector<LinedSurfel> members;
  double mean = 0;
  for (const double angle : {-0.07, -0.03, 0.03, 0.07}) {
    const Vec3f d(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)), 0);
    const Vec3f p = Vec3f(-18, 0, 0) + 19.5F * d;
    members.push_back({p, 1, {CutLine{d, d.dot(Vec3f(-18, 0, 0)) + 20}, kNoLine}, false});
    mean += (-18 + 20 * std::cos(angle)) / 4;
  }
  const auto lines = lines_of(disc(1.4F, 0), members);
  EXPECT_LT((lines[0].direction - Vec3f(1, 0, 0)).norm(), 1e-5F);
  EXPECT_NEAR(lines[0].offset, mean, 1e-4);
  EXPECT_FALSE(lines[1].cuts());
}

TEST(MergedLines, AreInTheMergedSurfelsPlane) {
  MergedPlace merged = disc(0, 0);
  merged.normal = Vec3f(0.1F, 0, 1).normalized();
  const CutLine line = lines_of(merged, {at(1, 0, kRight)})[0];
  EXPECT_NEAR(line.direction.dot(merged.normal), 0, 1e-6);
  EXPECT_NEAR(line.inside(Vec3f(2, 0, 0)), 0, 1e-6);
}

TEST(MergedLines, OfSurfelsBesideCutWhereTheyAreReached) {
  const std::vector<LinedSurfel> beside{at(5, 0, CutLine{{1, 0, 0}, 5.9F}),
                                        at(0, 6, CutLine{{0, 1, 0}, 6.1F})};
  const auto lines = lines_of(disc(0, 0), {at(0, 0)}, beside);
  EXPECT_EQ(lines[0].direction, Vec3f(1, 0, 0));
  EXPECT_FALSE(lines[1].cuts()) << "beyond three deviations";
}

TEST(MergedLines, AtMostTwoAndNotTwiceTheSameDirection) {
  const auto lines =
      lines_of(disc(0, 0), {at(0, 0)},
               {at(4, 0, CutLine{{1, 0, 0}, 4.5F}), at(3, 0, CutLine{{1, 0, 0}, 3.5F}),
                at(0, 2, CutLine{{0, 1, 0}, 2.5F}), at(-4, 0, CutLine{{-1, 0, 0}, 4})});
  EXPECT_EQ(lines[0].direction, Vec3f(0, 1, 0));
  EXPECT_EQ(lines[1].direction, Vec3f(1, 0, 0));
  EXPECT_NEAR(lines[1].offset, 3.5F, 1e-6);
}

}  // namespace
}  // namespace surfel
