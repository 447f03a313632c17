#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <surfel/base/morton.h>
#include <surfel/base/random.h>
#include <surfel/scene/surfel_halo.h>

namespace surfel {
namespace {

/// Scattered surfels whose radii, a thousandth to a fifth, are the roots of their variances.
SurfelCloud scattered(std::size_t count) {
  SurfelCloud cloud;
  for (std::uint64_t k = 0; k < count; ++k) {
    const auto random = [&](int axis) { return static_cast<float>(random_uniform(3, k, axis)); };
    cloud.position.emplace_back(random(0), random(1), random(2));
    const float radius = 1e-3F * std::pow(200.0F, random(3));
    cloud.variance.push_back(radius * radius);
  }
  return cloud.gathered(morton_order(cloud.position));
}

/// Every seventh surfel meets no other.
float reach_of(const SurfelCloud& cloud, std::size_t k) {
  return std::fmod(cloud.position[k].x() * 1000, 7) < 1 ? -1 : std::sqrt(cloud.variance[k]);
}

TEST(SurfelHalo, HoldsAllSurfelsThatMeetTheBlockAndNoOthers) {
  const SurfelCloud cloud = scattered(10000);
  const OrderedCloud ranges(cloud);
  const SurfelHalo halo(ranges, {.reach = [](const SurfelCloud& of, std::size_t begin,
                                             std::size_t end, float* reach) {
                          for (std::size_t k = begin; k < end; ++k) {
                            reach[k - begin] = reach_of(of, k);
                          }
                        }});
  for (const float scale : {1.0F, 0.25F}) {
    for (const auto& [begin, end] :
         {std::pair{0, 700}, {1500, 1501}, {2000, 3100}, {6200, 6300}, {9990, 10000}}) {
      const SurfelHalo::Around around =
          halo.around(ranges.read(static_cast<std::size_t>(begin), static_cast<std::size_t>(end)),
                      static_cast<std::size_t>(begin), scale);
      std::vector<std::size_t> expected;
      for (int k = 0; k < static_cast<int>(cloud.size()); ++k) {
        bool found = k >= begin && k < end;
        const float reach = reach_of(cloud, static_cast<std::size_t>(k));
        for (int i = begin; i < end && !found && reach >= 0; ++i) {
          const float other = reach_of(cloud, static_cast<std::size_t>(i));
          const Vec3f d = cloud.position[static_cast<std::size_t>(k)] -
                          cloud.position[static_cast<std::size_t>(i)];
          found = other >= 0 && d.norm() <= scale * (reach + other);
        }
        if (found) expected.push_back(static_cast<std::size_t>(k));
      }
      EXPECT_EQ(around.number, expected);
      ASSERT_EQ(around.cloud.size(), expected.size());
      EXPECT_EQ(around.number[around.before], static_cast<std::size_t>(begin));
      for (std::size_t i = 0; i < expected.size(); ++i) {
        ASSERT_EQ(around.cloud.position[i], cloud.position[expected[i]]);
      }
    }
  }
}

}  // namespace
}  // namespace surfel
