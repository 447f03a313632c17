#include <cmath>
#include <functional>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/random.h>
#include <surfel/sample/detail_tree.h>

namespace surfel {
namespace {

using Probes = std::vector<SurfaceProbe>;

/// Probes at the jittered centres of n x n cells of the unit square, moved and coloured by a
/// function of x and y.
Probes square(int n, const std::function<SurfaceProbe(float, float)>& at) {
  Probes probes;
  for (int i = 0; i < n * n; ++i) {
    const auto x = static_cast<float>((i % n + random_uniform(1, i, 0)) / n);
    const auto y = static_cast<float>((i / n + random_uniform(1, i, 1)) / n);
    probes.push_back(at(x, y));
  }
  return probes;
}

SurfaceProbe flat(float x, float y, float grey) {
  return {Vec3f(x, y, 0), Vec3f(0, 0, 1), Vec3f::Constant(grey)};
}

constexpr int kProbes = 128;
constexpr double kProbeSpacing = 1.0 / kProbes;

DetailTree tree_of(const Probes& probes, const std::vector<BorderPiece>& border = {},
                   double unit_deviation = 1) {
  return {probes, border, {1, kProbeSpacing, unit_deviation, 1}};
}

/// The error where all cells are as fine as they come: sigma = kProbeSpacing.
DetailTree::Cut finest(const DetailTree& tree) { return tree.cut(tree.lowest_price()); }

double spacing_at(const DetailTree::Cut& cut, const Vec3f& p) {
  return SizingField(cut.cells, 0.3, 1).at(p);
}

void expect_coarsest(const DetailTree& tree, const DetailTree::Cut& cut) {
  for (const SizingCell& cell : cut.cells) {
    EXPECT_EQ(cell.spacing, static_cast<float>(tree.largest_spacing()));
  }
}

TEST(DetailTree, RefusesBadOptions) {
  const Probes one{flat(0, 0, 0.5f)};
  const DetailTree::Options good{1, 1, 1, 1};
  EXPECT_TRUE(good.problems().empty());
  for (double DetailTree::Options::*field :
       {&DetailTree::Options::area, &DetailTree::Options::probe_spacing,
        &DetailTree::Options::unit_deviation, &DetailTree::Options::variance_scale}) {
    DetailTree::Options bad = good;
    bad.*field = 0;
    EXPECT_EQ(bad.problems().size(), 1u);
    EXPECT_THROW(DetailTree(one, {}, bad), Error);
  }
  EXPECT_THROW(DetailTree({}, {}, good), Error);
}

TEST(DetailTree, WhatIsLinearOnAPlaneNeedsOneCell) {
  const Probes probes = square(kProbes, [](float x, float y) { return flat(x, y, 0.3f * x + y); });
  const DetailTree tree = tree_of(probes);
  const DetailTree::Cut cut = tree.cut(1e-9);
  EXPECT_LT(cut.error(), 1e-4);
  expect_coarsest(tree, cut);
}

TEST(DetailTree, StepHasTheErrorOfABlur) {
  const Probes probes =
      square(kProbes, [](float x, float y) { return flat(x, y, x + 0.3f * y < 0.6f ? 0 : 1); });
  const DetailTree::Cut cut = finest(tree_of(probes));
  const double length = std::sqrt(1 + 0.3 * 0.3);
  const double expected = std::sqrt(0.25 * kProbeSpacing * length);
  EXPECT_NEAR(cut.color_error, expected, 0.15 * expected);
  EXPECT_LT(cut.shape_error, 1e-6);
}

TEST(DetailTree, SmoothColorHasTheErrorOfABlur) {
  // c'' = 8 along x everywhere, so that all cells are alike: 0.36 c''^2 sigma^4.
  const Probes probes = square(kProbes, [](float x, float y) { return flat(x, y, 4 * x * x); });
  const DetailTree::Cut cut = finest(tree_of(probes));
  const double expected = std::sqrt(0.36) * 8 * kProbeSpacing * kProbeSpacing;
  EXPECT_NEAR(cut.color_error, expected, 0.3 * expected);
}

TEST(DetailTree, CylinderDeviatesByItsCurvature) {
  constexpr double kRadius = 0.8;
  const Probes probes = square(kProbes, [](float x, float y) {
    const double angle = x / kRadius;
    const Vec3f normal(static_cast<float>(std::sin(angle)), 0, static_cast<float>(std::cos(angle)));
    Vec3f p = static_cast<float>(kRadius) * normal;
    p.y() = y;
    return SurfaceProbe{p, normal, Vec3f(0, 0, 0)};
  });
  const DetailTree::Cut cut = finest(tree_of(probes, {}, 0.001));
  const double expected = 0.6 * kProbeSpacing * kProbeSpacing / kRadius / 0.001;
  EXPECT_NEAR(cut.shape_error, expected, 0.35 * expected);
  EXPECT_EQ(cut.color_error, 0);
}

TEST(DetailTree, SidesOfAThinPlateAreFlat) {
  Probes probes = square(kProbes, [](float x, float y) { return flat(x, y, 0); });
  const Probes below = square(kProbes, [](float x, float y) {
    return SurfaceProbe{Vec3f(x, y, -0.01f), Vec3f(0, 0, -1), Vec3f(1, 1, 1)};
  });
  probes.insert(probes.end(), below.begin(), below.end());
  const DetailTree tree = tree_of(probes);
  const DetailTree::Cut cut = tree.cut(1e-9);
  EXPECT_LT(cut.error(), 1e-6);
  expect_coarsest(tree, cut);
}

TEST(DetailTree, SharpEdgesAndBordersAreFine) {
  const Probes roof = square(kProbes, [](float x, float y) {
    const float slope = x < 0.5f ? 1.0f : -1.0f;
    return SurfaceProbe{Vec3f(x, y, 0.5f - std::abs(x - 0.5f)), Vec3f(-slope, 0, 1).normalized(),
                        Vec3f(0, 0, 0)};
  });
  const DetailTree::Cut ridge = tree_of(roof).cut(1e-8);
  EXPECT_LT(4 * spacing_at(ridge, {0.49f, 0.3f, 0.48f}), spacing_at(ridge, {0.1f, 0.3f, 0.1f}));

  const Probes plain = square(kProbes, [](float x, float y) { return flat(x, y, 0); });
  std::vector<BorderPiece> border;
  for (int i = 0; i < 100; ++i) {
    border.push_back({Vec3f(0.01f, (static_cast<float>(i) + 0.5f) / 100, 0), 0.01f});
  }
  const DetailTree::Cut edge = tree_of(plain, border).cut(1e-8);
  EXPECT_LT(4 * spacing_at(edge, {0.011f, 0.5f, 0}), spacing_at(edge, {0.9f, 0.5f, 0}));
}

TEST(DetailTree, CheaperSamplesGiveMoreOfThemAndLessError) {
  const Probes probes = square(kProbes, [](float x, float y) {
    return flat(x, y, std::sin(40 * x * x) * (y > 0.5f ? 1.0f : 0.1f));
  });
  const DetailTree tree = tree_of(probes);
  DetailTree::Cut last = tree.cut(tree.highest_price());
  expect_coarsest(tree, last);
  for (double price = tree.highest_price() / 4; price > tree.lowest_price(); price /= 4) {
    DetailTree::Cut cut = tree.cut(price);
    EXPECT_GE(cut.samples, last.samples);
    EXPECT_LE(cut.error(), last.error() + 1e-12);
    // No cut has less of both: the last one's cost at this price is no less.
    EXPECT_LE(cut.error() * cut.error() + price * cut.samples,
              last.error() * last.error() + price * last.samples + 1e-12);
    last = std::move(cut);
  }
}

TEST(DetailTree, SingleProbe) {
  const DetailTree tree({flat(0, 0, 1)}, {}, {1, 1, 1, 1});
  EXPECT_EQ(tree.cut(1).cells.size(), 2u);  // One of each octree.
  EXPECT_EQ(tree.cut(1).error(), 0);
}

}  // namespace
}  // namespace surfel
