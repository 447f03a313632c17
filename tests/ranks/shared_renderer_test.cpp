// Pictures of clouds of which each of several peers holds a part. The peers are threads here.

#include <algorithm>
#include <atomic>
#include <cstring>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/ranks/ranks.h>
#include <surfel/ranks/shared_renderer.h>
#include <surfel/sample/generate.h>
#include <surfel/scene/framing.h>
#include <surfel/scene/stray_points.h>

#include "support/run_tool.h"
#include "support/thread_peers.h"

namespace surfel::test {
namespace {

SurfelCloud scene_of(const std::string& kind, std::size_t count) {
  const SurfelCloud cloud = generate_surfels(procedural_scene(kind, 1), {.count = count});
  return cloud.gathered(morton_order(cloud.position));
}

Camera view_of(const SceneExtent& extent, double zoom) {
  CameraOptions options;
  options.from = Vec3d(0.3, 0.5, 1);
  options.width = 150;
  options.height = 130;
  options.zoom = zoom;
  return make_camera(options, extent);
}

class SharedLevels : public testing::Test {
 protected:
  void make(const std::string& kind, std::size_t count, float alpha = 1) {
    SurfelCloud cloud = scene_of(kind, count);
    if (alpha < 1) cloud.alpha.assign(cloud.size(), alpha);
    write_cloud(build_hierarchy(cloud, {}), path_);
  }
  CloudLoadOptions options() const { return {.columns = {.levels = true}, .memory = memory_}; }
  std::unique_ptr<LoadedCloud> load_part(Peers& peers) const {
    CloudLoadOptions part = options();
    part.peers = &peers;
    part.share = LevelShare::kPart;
    return std::make_unique<LoadedCloud>(path_, part);
  }

  /// Draws the same views by one and by so many peers, and compares all rows, bit for bit.
  void expect_same_pictures(int peers, const RenderOptions& render,
                            const std::vector<double>& zooms = {1, 6, 0.3}) {
    const LoadedCloud whole(path_, options());
    Renderer renderer(whole.store(), scene_, render);
    std::vector<Camera> cameras;
    std::vector<Image> expected;
    std::vector<FrameStatistics> statistics(zooms.size());
    for (std::size_t i = 0; i < zooms.size(); ++i) {
      cameras.push_back(view_of(whole.surfels().extent(), zooms[i]));
      expected.push_back(renderer.render(cameras[i], &statistics[i]));
    }
    run_peers(peers, [&](ThreadPeers& self) {
      const std::unique_ptr<LoadedCloud> part = load_part(self);
      SharedRenderer shared(*part, self, scene_, render);
      RowBalance balance(peers);
      for (std::size_t i = 0; i < zooms.size(); ++i) {
        const Camera framed = view_of(part->surfels().extent(), zooms[i]);
        EXPECT_EQ(framed.eye, cameras[i].eye);
        Camera mine = framed;
        mine.rows = balance.rows(mine.height)[static_cast<std::size_t>(self.rank())];
        FrameStatistics counted;
        const Image image = shared.render(mine, &counted);
        EXPECT_EQ(counted.clusters, statistics[i].clusters);
        const RowRange rows = mine.drawn_rows();
        if (rows.begin >= rows.end) continue;
        const auto bytes = static_cast<std::size_t>(expected[i].pixel(0, rows.end) -
                                                    expected[i].pixel(0, rows.begin)) *
                           sizeof(float);
        EXPECT_EQ(std::memcmp(expected[i].pixel(0, rows.begin), image.pixel(0, rows.begin), bytes),
                  0)
            << peers << " peers, zoom " << zooms[i] << ", rows " << rows.begin << " to "
            << rows.end;
      }
    });
  }

  TemporaryFolder folder_;
  std::string path_ = folder_ / "levels.ply";
  Scene scene_;
  std::optional<std::uint64_t> memory_;
  std::atomic<int> exchanges_ = 0;
};

TEST_F(SharedLevels, MakeTheSamePicturesByAnyNumberOfPeers) {
  make("terrain", 40'000);
  // With 9 peers of 130 rows some have none.
  for (const int peers : {1, 2, 3, 4, 9, 20}) expect_same_pictures(peers, {});
}

TEST_F(SharedLevels, MakeTheSamePicturesLitWithReliefAndChannels) {
  make("head", 30'000);
  RenderOptions options;
  options.lit = true;
  options.aovs = true;
  for (const Relief relief : {Relief::kNone, Relief::kOcclusion, Relief::kEyeDome}) {
    options.relief = relief;
    expect_same_pictures(3, options);
  }
}

TEST_F(SharedLevels, MakeTheSamePicturesOfTransparentSurfels) {
  make("torus", 30'000, 0.5F);
  expect_same_pictures(3, {});
  RenderOptions finest;
  finest.lod_error = 0.0;
  expect_same_pictures(4, finest);
}

/// More is seen than the memory of a peer holds: rows are drawn part by part.
TEST_F(SharedLevels, MakeTheSamePicturesPartByPart) {
  make("terrain", 120'000);
  RenderOptions finest;
  finest.lod_error = 0.0;
  const LoadedCloud whole(path_, options());
  Renderer renderer(whole.store(), scene_, finest);
  const Camera camera = view_of(whole.surfels().extent(), 1);
  const Image expected = renderer.render(camera);
  memory_ = std::uint64_t{12} << 20;  // 8,192 surfels of 120,000 in flight.
  run_peers(2, [&](ThreadPeers& self) {
    const std::unique_ptr<LoadedCloud> part = load_part(self);
    SharedRenderer shared(*part, self, scene_, finest);
    Camera mine = camera;
    mine.rows = RowBalance(2).rows(mine.height)[static_cast<std::size_t>(self.rank())];
    FrameStatistics counted;
    const Image image = shared.render(mine, &counted);
    exchanges_ = counted.exchanges;
    for (int y = mine.rows.begin; y < mine.rows.end; ++y) {
      EXPECT_EQ(std::memcmp(expected.pixel(0, y), image.pixel(0, y),
                            static_cast<std::size_t>(expected.width) * expected.channels.size() *
                                sizeof(float)),
                0)
          << y;
    }
  });
  EXPECT_GT(exchanges_, 1);
}

TEST_F(SharedLevels, EveryClusterIsDrawnByOnePeer) {
  make("terrain", 40'000);
  const LoadedCloud whole(path_, options());
  const ClusterTree& tree = whole.surfels().tree();
  for (const int peers : {1, 3, 8, 200}) {
    std::vector<int> drawn(tree.size(), 0);
    std::vector<std::size_t> held(static_cast<std::size_t>(peers));
    std::mutex mutex;
    run_peers(peers, [&](ThreadPeers& self) {
      const std::unique_ptr<LoadedCloud> loaded = load_part(self);
      const TreePart& part = *loaded->part();
      const std::lock_guard lock(mutex);
      held[static_cast<std::size_t>(self.rank())] = part.tree.size();
      EXPECT_EQ(loaded->surfels().size(), whole.surfels().size());
      EXPECT_EQ(loaded->surfels().first_finest(), whole.surfels().first_finest());
      std::size_t next_child = 1;
      for (std::size_t i = 0; i < part.tree.size(); ++i) {
        const TreeCluster& c = part.tree[i];
        const TreeCluster& same = tree[part.number[i]];
        EXPECT_EQ(c.begin, same.begin);
        EXPECT_EQ(c.bounds.center, same.bounds.center);
        EXPECT_EQ(c.level, same.level);
        if (c.child_count > 0) {
          EXPECT_EQ(c.first_child, next_child);
        }
        for (std::uint32_t k = 0; k < c.child_count; ++k) {
          const std::uint32_t child = part.number[c.first_child + k];
          EXPECT_GE(child, same.first_child);
          EXPECT_LT(child, same.first_child + same.child_count);
        }
        next_child += c.child_count;
        drawn[part.number[i]] += part.drawn[i] ? 1 : 0;
      }
    });
    EXPECT_EQ(std::count(drawn.begin(), drawn.end(), 1), static_cast<std::ptrdiff_t>(tree.size()))
        << peers;
    // The tree is small, so that its finest clusters are dealt one by one.
    const auto coarser = static_cast<double>(first_leaf(tree));
    const double finest = static_cast<double>(tree.size()) - coarser;
    EXPECT_LE(static_cast<double>(*std::max_element(held.begin(), held.end())),
              coarser + finest / peers + 1)
        << peers;
  }
}

/// Where one peer has too little memory for the whole tree, all hold parts.
TEST_F(SharedLevels, AreSharedWhereTheTreeDoesNotFit) {
  make("terrain", 150'000);
  const LoadedCloud whole(path_, options());
  // The tree takes 280 bytes a cluster, and the smallest batch of surfels 11.18 MB.
  const std::uint64_t little = 11'190'000 + whole.surfels().tree().size() * 200;
  EXPECT_THROW(LoadedCloud(path_, {.columns = {.levels = true}, .memory = little}), Error);
  for (const bool poor : {false, true}) {
    run_peers(2, [&](ThreadPeers& self) {
      CloudLoadOptions automatic = options();
      automatic.peers = &self;
      if (poor && self.rank() == 1) automatic.memory = little;
      EXPECT_EQ(LoadedCloud(path_, automatic).part() != nullptr, poor);
    });
  }
}

TEST_F(SharedLevels, BrokenTreesAreRefused) {
  make("terrain", 40'000);
  // The header says where the clusters are: damage a number of children in the middle of them.
  std::string bytes = read_text(path_);
  const LoadedCloud whole(path_, options());
  const std::size_t clusters = whole.surfels().tree().size();
  constexpr std::size_t kRecord = 4 * 4 + 1 + 9 * 8 + 7 * 4;
  const std::size_t begin = bytes.size() - clusters * kRecord;
  for (const std::size_t cluster : {std::size_t{0}, std::size_t{2}, clusters / 2, clusters - 1}) {
    for (const std::size_t field : {0, 4, 8, 12, 16}) {
      const bool leaf = whole.surfels().tree()[cluster].level == 0;
      if (leaf && field == 8) continue;  // A first child that there is none of.
      std::string damaged = bytes;
      damaged[begin + cluster * kRecord + field] ^= 0x15;
      write_text(folder_ / "damaged.ply", damaged);
      // One alone, which holds all, as a process that fails would leave the others waiting.
      run_peers(1, [&](ThreadPeers& self) {
        CloudLoadOptions part = options();
        part.peers = &self;
        part.share = LevelShare::kPart;
        EXPECT_THROW(LoadedCloud(folder_ / "damaged.ply", part), Error)
            << "cluster " << cluster << ", byte " << field;
      });
    }
  }
}

/// Strays are told alike by peers that hold some groups of the points each.
TEST(SharedCore, IsTheCoreOfAllPoints) {
  for (const std::size_t count : {std::size_t{300}, std::size_t{5000}}) {
    for (const double far : {0.0, 30.0, 1000.0}) {
      std::vector<PointGroup> groups;
      for (std::size_t i = 0; i < count; ++i) {
        const auto number = [&](std::uint64_t k) { return random_uniform(7, i, k) - 0.5; };
        groups.push_back({Vec3d(number(0), number(1), 0.2 * number(2)), 0, 20});
      }
      if (far > 0) {
        for (int i = 0; i < 5; ++i) groups.push_back({Vec3d(far + i, -far * i, far), 0, 1});
      }
      const auto points_of = [&](const std::vector<PointGroup>& of) {
        return [&of](std::size_t g, FunctionRef<void(const Vec3d&)> add) {
          for (std::uint64_t k = 0; k < of[g].count; ++k) add(of[g].center);
        };
      };
      const std::optional<CloudCore> expected = find_core(groups, points_of(groups));
      EXPECT_EQ(expected.has_value(), far > 0);
      run_peers(3, [&](ThreadPeers& self) {
        std::vector<PointGroup> mine;
        for (std::size_t i = 0; i < groups.size(); ++i) {
          if (static_cast<int>(i * i % 3) == self.rank()) mine.push_back(groups[i]);
        }
        const std::optional<CloudCore> found = find_core(mine, points_of(mine), &self);
        ASSERT_EQ(found.has_value(), expected.has_value());
        if (!found) return;
        EXPECT_EQ(found->stray, expected->stray);
        EXPECT_EQ(found->box.min, expected->box.min);
        EXPECT_EQ(found->box.max, expected->box.max);
      });
    }
  }
}

}  // namespace
}  // namespace surfel::test
