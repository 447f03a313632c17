#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/scene/surfel_ranges.h>
#include <surfel/simplify/simplify_blocks.h>

#include "support/interrupted.h"

namespace surfel {
namespace {

/// A square of discs, whose colours change fast in one half; without colours a bump is there.
SurfelCloud square(int n) {
  SurfelCloud cloud;
  const float h = 1 / static_cast<float>(n);
  for (int i = 0; i < n * n; ++i) {
    const float x = h * static_cast<float>(i % n);
    const float y = h * static_cast<float>(i / n);
    cloud.position.emplace_back(x, y, 0.0F);
    cloud.normal.push_back(Vec3f::UnitZ());
    cloud.variance.push_back(h * h);
    cloud.area.push_back(h * h);
    cloud.color.push_back(Vec3f::Constant(x < 0.5F ? 0.5F : 0.5F + 0.4F * std::sin(60 * x)));
  }
  return cloud.gathered(morton_order(cloud.position));
}

struct Simplified {
  std::vector<SurfelCloud> blocks;
  SimplifyReport report;
  std::size_t size() const {
    std::size_t sum = 0;
    for (const SurfelCloud& block : blocks) sum += block.size();
    return sum;
  }
};

class SimplifiedSink final : public SurfelSink {
 public:
  explicit SimplifiedSink(Simplified& to) : to_(to) {}
  void begin(const SurfelCloud& like, std::size_t /*count*/) override {
    EXPECT_EQ(like.size(), 1U);
    to_.blocks.clear();
  }
  void put(SurfelCloud surfels, std::size_t at) override {
    EXPECT_EQ(at, to_.size());
    to_.blocks.push_back(std::move(surfels));
  }

 private:
  Simplified& to_;
};

Simplified by_blocks(const SurfelCloud& cloud, const SimplifyOptions& options, std::size_t most) {
  Simplified out;
  SimplifiedSink sink(out);
  EXPECT_TRUE(simplify_by_blocks(OrderedCloud(cloud), options, sink, &out.report, "square",
                                 {.most = most}));
  return out;
}

TEST(SimplifyBlocks, BlocksShareACountByWhatTheyNeed) {
  const SurfelCloud cloud = square(80);
  SimplifyReport whole;
  simplify_surfels(cloud, {.count = 600}, &whole);
  const Simplified parts = by_blocks(cloud, {.count = 600}, 1600);
  EXPECT_GE(parts.blocks.size(), 4U);
  EXPECT_EQ(parts.size(), 600U);
  EXPECT_EQ(parts.report.result, 600U);
  EXPECT_TRUE(parts.report.reached);
  EXPECT_LT(parts.report.error.total(), 1.25 * whole.error.total());
  // Detail is on the right.
  std::size_t right = 0;
  for (const SurfelCloud& block : parts.blocks) {
    for (const Vec3f& p : block.position) right += p.x() > 0.5F ? 1 : 0;
  }
  EXPECT_GT(right, 400U);
}

TEST(SimplifyBlocks, AnErrorIsKept) {
  const SurfelCloud cloud = square(60);
  for (const double error : {0.02, 0.1}) {
    const Simplified parts = by_blocks(cloud, {.max_error = error}, 900);
    EXPECT_LE(parts.report.error.total(), error * (1 + 1e-9));
    EXPECT_TRUE(parts.report.reached);
    SimplifyReport whole;
    simplify_surfels(cloud, {.max_error = error}, &whole);
    EXPECT_LT(static_cast<double>(parts.size()), 1.6 * static_cast<double>(whole.result)) << error;
  }
}

TEST(SimplifyBlocks, AllBlocksHaveTheSameColumnsAndDependOnNoThreads) {
  const SurfelCloud cloud = square(60);
  // So many that some blocks keep all of their surfels.
  for (const std::size_t count : {std::size_t{300}, std::size_t{2500}, cloud.size() + 1}) {
    set_thread_count(1);
    const Simplified one = by_blocks(cloud, {.count = count}, 500);
    set_thread_count(3);
    const Simplified three = by_blocks(cloud, {.count = count}, 500);
    ASSERT_EQ(one.blocks.size(), three.blocks.size());
    for (std::size_t b = 0; b < one.blocks.size(); ++b) {
      EXPECT_TRUE(one.blocks[b].position == three.blocks[b].position);
      EXPECT_TRUE(one.blocks[b].coefficient == three.blocks[b].coefficient);
      EXPECT_EQ(one.blocks[b].coefficient.size(), one.blocks[b].size());
      EXPECT_EQ(one.blocks[b].area.size(), one.blocks[b].size());
      EXPECT_EQ(one.blocks[b].basis_cutoff, one.blocks[0].basis_cutoff);
    }
    EXPECT_EQ(one.size(), std::min(count, cloud.size()));
  }
  set_thread_count(0);
}

TEST(SimplifyBlocks, RefusesWhatHasNoSurface) {
  SurfelCloud cloud = square(20);
  for (float& variance : cloud.variance) variance = -1;
  EXPECT_THROW(by_blocks(cloud, {.count = 9}, 100), Error);
  cloud.variance.clear();
  EXPECT_THROW(by_blocks(cloud, {.count = 9}, 100), Error);
  EXPECT_THROW(by_blocks(square(20), {}, 100), Error);
}

TEST(SimplifyBlocks, GoOnWhereTheyWereInterrupted) {
  const SurfelCloud cloud = square(40);
  for (const SimplifyOptions& options : {SimplifyOptions{.count = 300}, {.max_error = 0.05}}) {
    const Simplified whole = by_blocks(cloud, options, 300);
    test::InterruptedWork work;
    SimplifyReport report;
    const int runs = work.complete([&] {
      simplify_by_blocks(OrderedCloud(cloud), options, work, &report, "square",
                         {.most = 300, .checkpoints = &work});
    });
    EXPECT_EQ(runs, 2 * static_cast<int>(whole.blocks.size()) + 1);
    ASSERT_EQ(work.blocks().size(), whole.blocks.size());
    std::size_t b = 0;
    std::size_t surfels = 0;
    for (const auto& [at, block] : work.blocks()) {
      EXPECT_EQ(at, surfels);
      EXPECT_TRUE(block.position == whole.blocks[b].position);
      EXPECT_TRUE(block.coefficient == whole.blocks[b++].coefficient);
      surfels += block.size();
    }
    EXPECT_EQ(report.result, whole.report.result);
    EXPECT_EQ(report.error.total(), whole.report.error.total());
    EXPECT_EQ(report.left_out, whole.report.left_out);
    EXPECT_EQ(report.rounds, whole.report.rounds);
  }
}

}  // namespace
}  // namespace surfel
