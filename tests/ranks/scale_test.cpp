// The model of many processes: its queues by closed forms, its bytes against real exchanges.

#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/morton.h>
#include <surfel/io/cloud_io.h>
#include <surfel/lod/hierarchy.h>
#include <surfel/ranks/shared_renderer.h>
#include <surfel/sample/generate.h>
#include <surfel/scene/framing.h>

#include "ranks/scale_model.h"
#include "support/run_tool.h"
#include "support/thread_peers.h"

namespace surfel::test {
namespace {

SurfelCloud levels_of_terrain(std::size_t count) {
  const SurfelCloud cloud = generate_surfels(procedural_scene("terrain", 1), {.count = count});
  return build_hierarchy(cloud.gathered(morton_order(cloud.position)), {});
}

/// A camera that looks down on the middle of the tiles, from aside.
Camera camera_over(const TiledCloud& cloud, double height, int width, int rows) {
  CameraOptions options;
  options.target = cloud.over_middle(0, 0);
  options.eye = cloud.over_middle(-2 * height, height);
  options.up = Vec3d(Vec3d::Unit(cloud.up()));
  options.width = width;
  options.height = rows;
  return make_camera(options, {});
}

TEST(Delivery, OneMessageTakesItsTimeAndTheLatency) {
  const Delivery one = deliver({{0, 1, 1000}}, {0.5, 0}, 1e6, 1e-3);
  EXPECT_NEAR(one.seconds, 0.5 + 1e-3 + 1e-3, 1e-12);
  EXPECT_EQ(one.bytes, 1000);
  EXPECT_EQ(one.most_queued, 0U);
}

/// All send to one: its link is busy without a pause, and all but the first message wait.
TEST(Delivery, ManySendersToOneWaitForItsLink) {
  std::vector<Message> messages;
  for (int from = 1; from < 50; ++from) messages.push_back({from, 0, 2000});
  const Delivery all = deliver(messages, std::vector<double>(50), 1e6, 1e-3);
  EXPECT_NEAR(all.seconds, 1e-3 + 49 * 2e-3, 1e-9);
  EXPECT_EQ(all.most_queued, 48U);
  EXPECT_NEAR(all.longest_queue, 48 * 2000, 1e-6);
}

/// Each sends to the one after it first: nothing waits, and all links are busy all the time.
TEST(Delivery, TurnsKeepAllLinksBusy) {
  constexpr int kCount = 20;
  const auto time_of = [&](bool turns) {
    std::vector<Message> messages;
    for (int from = 0; from < kCount; ++from) {
      for (int step = 1; step < kCount; ++step) {
        const int to = turns ? (from + step) % kCount : (step <= from ? step - 1 : step);
        messages.push_back({from, to, 1000});
      }
    }
    return deliver(messages, std::vector<double>(kCount), 1e6, 1e-6);
  };
  const Delivery turns = time_of(true);
  EXPECT_NEAR(turns.seconds, 1e-6 + (kCount - 1) * 1e-3, 1e-9);
  EXPECT_LE(turns.most_queued, 1U);
  EXPECT_GT(time_of(false).seconds, turns.seconds);
  EXPECT_GT(time_of(false).most_queued, 10U);
}

/// No schedule is faster than the busiest link.
TEST(Delivery, IsNoFasterThanTheBusiestLink) {
  std::vector<Message> messages;
  std::vector<double> in(9);
  std::vector<double> out(9);
  for (int i = 0; i < 400; ++i) {
    const int from = i * i % 9;
    const int to = (from + 1 + i % 8) % 9;
    const double bytes = 100.0 * (1 + i % 13);
    messages.push_back({from, to, bytes});
    out[static_cast<std::size_t>(from)] += bytes;
    in[static_cast<std::size_t>(to)] += bytes;
  }
  const Delivery all = deliver(messages, std::vector<double>(9), 1e6, 1e-5);
  const double busiest =
      std::max(*std::max_element(in.begin(), in.end()), *std::max_element(out.begin(), out.end()));
  EXPECT_GE(all.seconds, busiest / 1e6);
  EXPECT_LT(all.seconds, 3 * busiest / 1e6);
}

/// A cut costs what the picture shows, not what there is: 4,096 times the surfels, hardly more
/// clusters.
TEST(TiledCut, FollowsThePixels) {
  const SurfelCloud levels = levels_of_terrain(20'000);
  const TiledCloud small{levels.tree, 2};
  const TiledCloud large{levels.tree, 8};
  EXPECT_EQ(large.surfels(), 4096 * small.surfels());
  const double height = small.side().maxCoeff() / 4;
  const auto drawn = [&](const TiledCloud& cloud) {
    const Camera camera = camera_over(cloud, height, 640, 480);
    return TiledCutter(cloud, camera, 1, 1.5, deal(cloud, 4)).cut().drawn.size();
  };
  EXPECT_GT(drawn(small), 20U);
  EXPECT_LT(drawn(large), 4 * drawn(small));
}

/// The model's bytes are what processes send, but for clusters whose spheres reach into rows that
/// their boxes do not.
TEST(SharePicture, SendsWhatProcessesSend) {
  const TemporaryFolder folder;
  const std::string path = folder / "levels.ply";
  write_cloud(levels_of_terrain(60'000), path);
  const LoadedCloud loaded(path, {.columns = {.levels = true}});
  const RenderCloud& cloud = loaded.surfels();
  CameraOptions options;
  options.from = Vec3d(0.3, 0.5, 1);
  options.width = 320;
  options.height = 320;
  const Camera camera = make_camera(options, cloud.extent());
  // The model has no origin of its own.
  Camera moved = camera;
  moved.eye -= cloud.origin();
  const Scene scene;
  for (const int processes : {2, 4}) {
    std::vector<FrameStatistics> statistics(static_cast<std::size_t>(processes));
    run_peers(processes, [&](ThreadPeers& self) {
      const auto rank = static_cast<std::size_t>(self.rank());
      const LoadedCloud part(
          path, {.columns = {.levels = true}, .peers = &self, .share = LevelShare::kPart});
      SharedRenderer renderer(part, self, scene, {});
      Camera mine = camera;
      mine.rows = RowBalance(processes).rows(mine.height)[rank];
      renderer.render(mine, &statistics[rank]);
    });
    const TiledCloud one{cloud.tree(), 0};
    const Dealing dealing = deal(one, processes);
    const RenderOptions defaults;
    const TiledCut cut =
        TiledCutter(one, moved, defaults.lod_pixels(), std::sqrt(2 * defaults.cutoff), dealing)
            .cut();
    const SharedPicture model = share_picture(one, moved, cut, dealing, processes);
    const auto clusters = static_cast<double>(statistics[0].clusters);
    EXPECT_NEAR(static_cast<double>(model.drawn_clusters), clusters, 0.1 * clusters);
    const auto sent = static_cast<double>(statistics[0].sent_bytes);
    EXPECT_GT(model.exchange.bytes, 0.8 * sent) << processes;
    EXPECT_LT(model.exchange.bytes, 1.5 * sent) << processes;
  }
}

/// What a near view shows are few neighbours along the curve.
TEST(SharePicture, TurnsSpreadNearViewsAndRangesDoNot) {
  const SurfelCloud levels = levels_of_terrain(20'000);
  const TiledCloud cloud{levels.tree, 6};
  constexpr int kProcesses = 64;
  const Dealing dealing = deal(cloud, kProcesses);
  EXPECT_EQ(dealing.subtrees, cloud.tiles());
  const Camera camera = camera_over(cloud, 2 * cloud.side().maxCoeff(), 640, 1024);
  const TiledCut cut = TiledCutter(cloud, camera, 1, 1.5, dealing).cut();
  const auto imbalance = [&](DealtBy by) {
    const SharedPicture picture =
        share_picture(cloud, camera, cut, dealing, kProcesses, {}, {}, by);
    return picture.most_sent / picture.mean_sent;
  };
  EXPECT_LT(imbalance(DealtBy::kTurns), 0.7 * imbalance(DealtBy::kRanges));
}

/// What a process holds, and what it is sent, become less the more there are.
TEST(SharePicture, MoreProcessesHoldLessEach) {
  const SurfelCloud levels = levels_of_terrain(20'000);
  const TiledCloud cloud{levels.tree, 6};
  const Camera camera = camera_over(cloud, 4 * cloud.side().maxCoeff(), 640, 1024);
  double held = 1e300;
  double flight = 1e300;
  for (const int processes : {1, 4, 16}) {
    const Dealing dealing = deal(cloud, processes);
    const TiledCut cut = TiledCutter(cloud, camera, 1, 1.5, dealing).cut();
    const SharedPicture picture = share_picture(cloud, camera, cut, dealing, processes);
    EXPECT_LT(picture.held_bytes, 0.5 * held);
    EXPECT_LT(picture.flight_bytes, flight);
    EXPECT_LE(picture.exchange.bytes, picture.mean_sent * processes);
    held = picture.held_bytes;
    flight = picture.flight_bytes;
  }
}

}  // namespace
}  // namespace surfel::test
