#include <algorithm>
#include <cmath>
#include <utility>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/texture/fit_blocks.h>

#include "support/interrupted.h"
#include "texture_support.h"

namespace surfel {
namespace {

using test::noise_image;
using test::one_map;

constexpr std::size_t kBlock = 600;  ///< Surfels of a block in these tests.

/// Jittered grid of n x n surfels, sigma = `kappa` spacings, on a bent surface that carries the
/// image once; along the curve.
SurfelCloud bent(int n, double kappa) {
  SurfelCloud cloud;
  const float h = 1.0F / static_cast<float>(n);
  for (int k = 0; k < n * n; ++k) {
    const auto jitter = [&](int axis) {
      return 0.6F *
             static_cast<float>(random_uniform(7, static_cast<std::uint64_t>(k), axis) - 0.5);
    };
    const Vec2f p((static_cast<float>(k % n) + 0.5F + jitter(0)) * h,
                  (static_cast<float>(k / n) + 0.5F + jitter(1)) * h);
    const float z = 0.1F * std::sin(3 * p.x());
    cloud.position.emplace_back(p.x(), p.y(), z);
    cloud.normal.push_back(Vec3f(-0.3F * std::cos(3 * p.x()), 0, 1).normalized());
    cloud.uv.push_back(p);
    cloud.dpdu.emplace_back(1.0F, 0.0F, 0.3F * std::cos(3 * p.x()));
    cloud.color.push_back(
        Vec3f::Constant(0.5F + 0.4F * std::sin(60 * p.x()) * std::cos(50 * p.y())));
  }
  cloud.dpdv.assign(cloud.size(), Vec3f(0, 1, 0));
  cloud.variance.assign(cloud.size(), static_cast<float>(kappa * kappa) * h * h);
  cloud.area.assign(cloud.size(), h * h);
  return cloud.gathered(morton_order(cloud.position));
}

TextureFitOptions options_by(TextureFitKind kind) {
  TextureFitOptions options;
  options.kind = kind;
  return options;
}

struct Fitted {
  Array<Vec3f> w;
  TextureFitReport report;
  std::size_t blocks = 0;
};

class FittedSink final : public SurfelSink {
 public:
  explicit FittedSink(Fitted& to) : to_(to) {}
  void begin(const SurfelCloud& like, std::size_t count) override {
    EXPECT_EQ(like.size(), 1U);
    EXPECT_FALSE(like.coefficient.empty());
    to_.w.resize(count);
    to_.blocks = 0;
  }
  void put(SurfelCloud surfels, std::size_t at) override {
    std::copy(surfels.coefficient.begin(), surfels.coefficient.end(),
              to_.w.begin() + static_cast<std::ptrdiff_t>(at));
    ++to_.blocks;
  }

 private:
  Fitted& to_;
};

Fitted by_blocks(const SurfelCloud& cloud, const FitSource& source,
                 const TextureFitOptions& options, const FitBlockOptions& blocks) {
  Fitted out;
  FittedSink sink(out);
  EXPECT_TRUE(
      fit_by_blocks(OrderedCloud(cloud), source, options, sink, &out.report, "surfels", blocks));
  return out;
}

double largest_difference(const Array<Vec3f>& a, const Array<Vec3f>& b) {
  double most = 0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    most = std::max(most, static_cast<double>((a[k] - b[k]).cwiseAbs().maxCoeff()));
  }
  return most;
}

TEST(FitBlocks, DifferFromTheWholeByLessThanPicturesShow) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  const SurfelCloud cloud = bent(46, 0.7);
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    for (const bool colors : {false, true}) {
      TextureFitOptions options = options_by(kind);
      // What the solver leaves of an ill-conditioned system would be larger.
      options.tolerance = 1e-9;
      // Texels are finer than surfels here: noise that no surfel holds would decide.
      options.reconstruction = 1;
      const FitSource source{.textures = colors ? nullptr : &textures};
      SurfelCloud whole = cloud;
      const TextureFitReport at_once = fit_coefficients(whole, source, options);
      const Fitted blocks = by_blocks(cloud, source, options, {.most = kBlock});
      EXPECT_GE(blocks.blocks, 4U);
      EXPECT_LT(largest_difference(blocks.w, whole.coefficient), 1.0 / 1024);
      ASSERT_TRUE(blocks.report.system && at_once.system);
      EXPECT_EQ(blocks.report.surfels, cloud.size());
      EXPECT_EQ(blocks.report.system->functions, at_once.system->functions);
      EXPECT_EQ(blocks.report.system->points, at_once.system->points);
      EXPECT_EQ(blocks.report.system->uncovered, at_once.system->uncovered);
      EXPECT_NEAR(blocks.report.system->error, at_once.system->error, 1e-3 * at_once.system->error);
      EXPECT_TRUE(blocks.report.system->converged);
    }
  }
}

TEST(FitBlocks, TheErrorFallsWithTheWidthOfTheHalo) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  const SurfelCloud cloud = bent(46, 0.7);
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    TextureFitOptions options = options_by(kind);
    options.tolerance = 1e-9;
    SurfelCloud whole = cloud;
    fit_texture(whole, textures, options);
    double before = HUGE_VAL;
    for (const double halo : {1, 4, 8}) {
      const Fitted blocks =
          by_blocks(cloud, {.textures = &textures}, options, {.most = kBlock, .halo = halo});
      const double error = largest_difference(blocks.w, whole.coefficient);
      EXPECT_LT(error, before / 2) << halo;
      before = error;
    }
  }
}

TEST(FitBlocks, AreTheSameForAnyNumberOfThreads) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  const SurfelCloud cloud = bent(40, 0.7);
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    set_thread_count(1);
    const Fitted one =
        by_blocks(cloud, {.textures = &textures}, options_by(kind), {.most = kBlock});
    set_thread_count(3);
    const Fitted three =
        by_blocks(cloud, {.textures = &textures}, options_by(kind), {.most = kBlock});
    set_thread_count(0);
    EXPECT_TRUE(one.w == three.w);
  }
}

TEST(FitBlocks, GramHasTheLambdaOfTheBlockThatNeedsMost) {
  // Two sheets that face alike in one corner of the plane make R singular there alone.
  SurfelCloud cloud = bent(40, 0.7);
  Array<std::uint32_t> twice;
  for (std::uint32_t k = 0; k < cloud.size(); ++k) {
    twice.push_back(k);
    const Vec3f& p = cloud.position[k];
    if (p.x() > 0.8F && p.y() > 0.8F) twice.push_back(k);
  }
  cloud = cloud.gathered(twice);
  cloud = cloud.gathered(morton_order(cloud.position));
  const TextureFitOptions options = options_by(TextureFitKind::kGram);
  SurfelCloud whole = cloud;
  const TextureFitReport at_once = fit_colors(whole, options);
  EXPECT_GT(at_once.system->lambda, 1e-6);
  const Fitted blocks = by_blocks(cloud, {}, options, {.most = kBlock});
  // Stretches of the curve tell it first, with a margin of a quarter.
  EXPECT_GT(blocks.report.system->lambda, 0.9 * at_once.system->lambda);
  EXPECT_LT(blocks.report.system->lambda, 1.4 * at_once.system->lambda);
}

TEST(FitBlocks, SurfelsWithoutAPlaceOrASizeStayFinite) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  SurfelCloud cloud = bent(40, 0.7);
  cloud.position[100].x() = NAN;
  cloud.variance[200] = -1;
  cloud.uv[300].x() = NAN;
  cloud = cloud.gathered(morton_order(cloud.position));
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    const Fitted blocks =
        by_blocks(cloud, {.textures = &textures}, options_by(kind), {.most = kBlock});
    EXPECT_EQ(blocks.report.surfels, cloud.size());
    EXPECT_EQ(blocks.report.without_uv, 1U);
    EXPECT_TRUE(std::all_of(blocks.w.begin(), blocks.w.end(),
                            [](const Vec3f& w) { return w.allFinite(); }));
  }
}

TEST(FitBlocks, WhatNeedsAllSurfelsIsRefused) {
  const SurfelCloud cloud = bent(20, 0.7);
  const auto problems = [](auto change) {
    TextureFitOptions options = options_by(TextureFitKind::kRender);
    change(options);
    return fit_block_problems(options).size();
  };
  EXPECT_EQ(problems([](TextureFitOptions&) {}), 0U);
  EXPECT_EQ(problems([](TextureFitOptions& o) { o.robust = true; }), 1U);
  EXPECT_EQ(problems([](TextureFitOptions& o) { o.refine_variance = true; }), 1U);
  EXPECT_EQ(problems([](TextureFitOptions& o) { o.solver = FitSolver::kCeres; }), 1U);
  EXPECT_EQ(problems([](TextureFitOptions& o) { o.bounds = {0, 1}; }), 0U);
  EXPECT_EQ(problems([](TextureFitOptions& o) {
              o.kind = TextureFitKind::kGram;
              o.bounds = {0, 1};
            }),
            1U);
  TextureFitOptions robust = options_by(TextureFitKind::kRender);
  robust.robust = true;
  EXPECT_THROW(by_blocks(cloud, {}, robust, {}), Error);
  SurfelCloud bare = cloud;
  bare.variance.clear();
  EXPECT_THROW(by_blocks(bare, {}, options_by(TextureFitKind::kRender), {}), Error);
}

TEST(FitBlocks, GoOnWhereTheyWereInterrupted) {
  TextureSet textures = one_map(noise_image(64, 64, 5));
  // Gram fits all blocks twice.
  SurfelCloud cloud = bent(28, 0.7);
  for (std::size_t k = 0; k < cloud.size(); k += 31) cloud.variance[k] *= 9;
  for (const TextureFitKind kind : {TextureFitKind::kGram, TextureFitKind::kRender}) {
    const Fitted at_once =
        by_blocks(cloud, {.textures = &textures}, options_by(kind), {.most = 300});
    test::InterruptedWork work;
    TextureFitReport report;
    const int runs = work.complete([&] {
      fit_by_blocks(OrderedCloud(cloud), {.textures = &textures}, options_by(kind), work, &report,
                    "surfels", {.most = 300, .checkpoints = &work});
    });
    EXPECT_GT(runs, static_cast<int>(at_once.blocks));
    ASSERT_EQ(work.blocks().size(), at_once.blocks);
    for (const auto& [at, block] : work.blocks()) {
      for (std::size_t i = 0; i < block.size(); ++i) {
        ASSERT_EQ(block.coefficient[i], at_once.w[at + i]);
      }
    }
    EXPECT_EQ(state_of(report), state_of(*kept_report(state_of(report))));
    EXPECT_EQ(report.system->functions, at_once.report.system->functions);
    EXPECT_EQ(report.system->lambda, at_once.report.system->lambda);
    EXPECT_EQ(report.system->error, at_once.report.system->error);
  }
  EXPECT_FALSE(kept_report("another work's"));
}

}  // namespace
}  // namespace surfel
