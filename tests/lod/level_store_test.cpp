// Stores of levels of detail: what is added in parts has the bytes of what is made at once.

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <numeric>
#include <set>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/input_file.h>
#include <surfel/io/level_store.h>
#include <surfel/lod/level_store_writer.h>
#include <surfel/scene/join.h>
#include <sys/file.h>
#include <unistd.h>

#include "render/scenes.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBlockSurfels = 700;

LevelStoreOptions small_blocks() {
  LevelStoreOptions options;
  options.block_surfels = kBlockSurfels;
  return options;
}

/// A sphere about a place, all of whose surfels differ; several lie at one place.
SurfelCloud sphere_at(const Vec3d& place, int count = 4000, double radius = 1) {
  SurfelCloud cloud = fibonacci_sphere(count, radius);
  cloud.origin = place;
  ExtraProperty& extra = cloud.extra.emplace_back(ExtraProperty{"tag", ScalarType::kUint16, {}});
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    extra.data.push_back(static_cast<std::byte>(i & 0xff));
    extra.data.push_back(static_cast<std::byte>(i >> 8 & 0xff));
    if (i % 100 < 5) cloud.position[i] = cloud.position[i / 100 * 100];
  }
  cloud.double_positions = true;
  return cloud;
}

/// Some of a cloud's surfels, by a number of each that a seed decides on.
SurfelCloud part_of(const SurfelCloud& cloud, const std::function<bool(std::size_t)>& taken,
                    std::uint64_t seed = 0) {
  Array<std::uint32_t> order;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (taken(i)) order.push_back(static_cast<std::uint32_t>(i));
  }
  for (std::size_t i = order.size(); seed > 0 && i-- > 1;) {
    std::swap(order[i], order[random_bits(seed, i) % (i + 1)]);
  }
  return cloud.gathered(order);
}

/// Hands on a cloud in pieces of this size.
class Pieces {
 public:
  explicit Pieces(const SurfelCloud& cloud, std::size_t size = 1500) : cloud_(cloud), size_(size) {}
  void operator()(FunctionRef<void(SurfelCloud piece)> visit) const {
    for (std::size_t begin = 0; begin < cloud_.size(); begin += size_) {
      Array<std::uint32_t> order(std::min(size_, cloud_.size() - begin));
      std::iota(order.begin(), order.end(), static_cast<std::uint32_t>(begin));
      visit(cloud_.gathered(order));
    }
  }

 private:
  const SurfelCloud& cloud_;
  std::size_t size_;
};

void make(const std::string& folder, const SurfelCloud& cloud,
          const LevelStoreOptions& options = small_blocks()) {
  make_level_store(folder, Pieces(cloud), options, nullptr, "cloud.ply");
}
LevelStoreReport append(const std::string& folder, const SurfelCloud& cloud,
                        std::uint64_t memory = 0, std::size_t piece = 1500) {
  LevelStoreReport report;
  append_to_level_store(folder, Pieces(cloud, piece), memory, &report, "more.ply");
  return report;
}

/// The bytes of all files of a folder.
std::map<std::string, std::string> files_of(const std::string& folder) {
  std::map<std::string, std::string> files;
  for (const std::string& name : entries(folder)) files[name] = read_text(path_in(folder, name));
  return files;
}

/// Names of the files that differ.
std::set<std::string> differences(const std::map<std::string, std::string>& a,
                                  const std::map<std::string, std::string>& b) {
  std::set<std::string> names;
  for (const auto& [name, bytes] : a) {
    const auto other = b.find(name);
    if (other == b.end() || other->second != bytes) names.insert(name);
  }
  for (const auto& [name, bytes] : b) {
    if (!a.contains(name)) names.insert(name);
  }
  return names;
}

/// The file that a store stands for, as a file.
std::string whole_of(const std::string& folder) {
  const InputFile file(folder);
  return std::string(as_text(file.bytes()));
}

class LevelStore : public testing::Test {
 protected:
  TemporaryFolder folder_;
  std::string store_ = folder_ / "store/";
};

TEST_F(LevelStore, HasTheSameFilesHoweverItsSurfelsCame) {
  for (const Vec3d& place : {Vec3d(0, 0, 0), Vec3d(455000.25, -5401000, 200)}) {
    const SurfelCloud all = sphere_at(place);
    make(folder_ / "whole", all);
    const auto expected = files_of(folder_ / "whole");
    EXPECT_GT(expected.size(), 8U);
    struct Split {
      std::function<bool(std::size_t)> first;
      std::uint64_t memory;
      int threads;
    };
    const std::vector<Split> splits = {
        {[](std::size_t i) { return i % 2 == 0; }, 0, 1},
        {[&](std::size_t i) { return all.position[i].x() > 0.2F; }, 1 << 20, 2},
        {[&](std::size_t i) { return all.position[i].z() < -0.97F; }, 1 << 20, 1},
        {[](std::size_t i) { return i % 997 != 0; }, 1 << 22, 2}};
    for (std::size_t k = 0; k < splits.size(); ++k) {
      const Split& split = splits[k];
      set_thread_count(split.threads);
      const std::string folder = folder_ / ("split" + std::to_string(k));
      const auto rest = [&](std::size_t i) { return !split.first(i); };
      make(folder, part_of(all, split.first, 7));
      append(folder, part_of(all, rest, 8), split.memory, 1 + 333 * k);
      EXPECT_EQ(differences(files_of(folder), expected), std::set<std::string>{}) << k;
      fs::remove_all(folder);
    }
    set_thread_count(0);
    // In five parts.
    make(folder_ / "parts", part_of(all, [](std::size_t i) { return i % 5 == 3; }));
    for (const std::size_t part : {0, 4, 1, 2}) {
      append(folder_ / "parts", part_of(all, [&](std::size_t i) { return i % 5 == part; }));
    }
    EXPECT_EQ(differences(files_of(folder_ / "parts"), expected), std::set<std::string>{});
    fs::remove_all(folder_ / "parts");
    fs::remove_all(folder_ / "whole");
  }
}

TEST_F(LevelStore, BlocksAreTheLargestCellsThatHoldFewEnough) {
  make(store_, sphere_at({0.3, -40, 1e6}, 6000));
  const LevelStoreIndex index = read_level_store(store_);
  std::set<std::string> names;
  for (const LevelStoreBlock& block : index.blocks) {
    EXPECT_LE(block.surfels.front(), kBlockSurfels);
    EXPECT_EQ(block.clusters.back(), 1U);
    EXPECT_TRUE(names.insert(block.cell.name()).second);
    const SurfelCloud surfels = read_cloud(path_in(store_, block.file));
    EXPECT_EQ(surfels.size(), block.surfels.front());
    for (std::size_t i = 0; i < surfels.size(); ++i) {
      ASSERT_TRUE(block.cell.contains(surfels.world(i)));
    }
    // The cell that is twice as large holds too many.
    std::size_t together = 0;
    const CurveCell above = cell_around(block.cell.center, block.cell.side + 1);
    for (const LevelStoreBlock& other : index.blocks) {
      if (above.contains(other.cell.center)) together += other.surfels.front();
    }
    EXPECT_GT(together, kBlockSurfels);
  }
  EXPECT_GT(names.size(), 9U);
}

TEST_F(LevelStore, KeepsSurfelsBitByBit) {
  const SurfelCloud all = sphere_at({12345.678, 0.1, -3});
  write_cloud(all, folder_ / "all.ply");
  const SurfelCloud cloud = read_cloud(folder_ / "all.ply");
  make(store_, part_of(cloud, [](std::size_t i) { return i % 3 > 0; }));
  append(store_, part_of(cloud, [](std::size_t i) { return i % 3 == 0; }));
  const SurfelCloud read = read_cloud(store_);
  ASSERT_EQ(read.size(), cloud.size());
  std::vector<std::size_t> of_tag(cloud.size());
  const auto tag = [](const SurfelCloud& c, std::size_t i) {
    std::uint16_t value = 0;
    std::memcpy(&value, c.extra.front().data.data() + 2 * i, 2);
    return std::size_t{value};
  };
  for (std::size_t i = 0; i < cloud.size(); ++i) of_tag[tag(cloud, i)] = i;
  for (std::size_t i = 0; i < read.size(); ++i) {
    const std::size_t k = of_tag[tag(read, i)];
    EXPECT_EQ(read.world(i), cloud.world(k));
    EXPECT_EQ(read.normal[i], cloud.normal[k]);
    EXPECT_EQ(read.coefficient[i], cloud.coefficient[k]);
    EXPECT_EQ(read.variance_u[i], cloud.variance[k]);
  }
}

TEST_F(LevelStore, ReadsAsOneFileWithSoundLevels) {
  make(store_, sphere_at({0, 0, 0}));
  const std::string bytes = whole_of(store_);
  write_text(folder_ / "whole.ply", bytes);
  const SurfelCloud whole = read_cloud(folder_ / "whole.ply", {.levels = true});
  EXPECT_EQ(tree_problem(whole.tree, whole.size()), "");
  const LevelStoreIndex index = read_level_store(store_);
  const std::size_t levels = index.block_levels() + index.top.surfels.size() - 1;
  EXPECT_EQ(whole.tree.front().level, levels - 1);
  for (const TreeCluster& cluster : whole.tree) {
    for (std::uint32_t i = cluster.begin; i < cluster.end; ++i) {
      ASSERT_EQ(whole.level[i], cluster.level);
    }
    // What is below a cluster is within its bounds.
    for (std::uint32_t k = 0; k < cluster.child_count; ++k) {
      const TreeCluster& child = whole.tree[cluster.first_child + k];
      EXPECT_TRUE((child.reach_min.array() >= cluster.reach_min.array() - 1e-5F).all());
      EXPECT_TRUE((child.reach_max.array() <= cluster.reach_max.array() + 1e-5F).all());
      EXPECT_LE((child.bounds.center - cluster.bounds.center).norm(),
                cluster.bounds.radius + 1e-4F);
      EXPECT_LT(child.spacing, cluster.spacing);
    }
  }
  // Any bytes may be asked for, whichever files they are in.
  const InputFile file(store_);
  ASSERT_EQ(file.size(), bytes.size());
  Array<std::byte> scratch;
  for (std::uint64_t i = 0; i < 500; ++i) {
    const std::size_t offset = random_bits(1, i) % bytes.size();
    const std::size_t size = std::min<std::size_t>(random_bits(2, i) % 3000, bytes.size() - offset);
    const std::byte* const read = file.read_at(offset, size, scratch);
    ASSERT_EQ(std::memcmp(read, bytes.data() + offset, size), 0) << offset << ' ' << size;
  }
}

TEST_F(LevelStore, FilesOfOtherBlocksStayAsTheyAre) {
  const SurfelCloud all = sphere_at({0, 0, 0}, 6000);
  const auto near = [&](std::size_t i) { return all.position[i].x() > 0.9F && i % 3 == 0; };
  make(store_, part_of(all, [&](std::size_t i) { return !near(i); }));
  std::map<std::string, fs::file_time_type> times;
  for (const std::string& name : entries(store_)) times[name] = fs::last_write_time(store_ + name);
  const auto before = files_of(store_);
  const LevelStoreReport report = append(store_, part_of(all, near));
  EXPECT_LT(report.blocks_written * 2, report.blocks);
  std::size_t kept = 0;
  for (const auto& [name, bytes] : files_of(store_)) {
    if (!name.starts_with("block-") || !before.contains(name)) continue;
    ++kept;
    EXPECT_TRUE(before.at(name) == bytes) << name;
    EXPECT_EQ(fs::last_write_time(store_ + name), times[name]) << name;
  }
  EXPECT_EQ(kept, report.blocks - report.blocks_written);
}

TEST_F(LevelStore, ASingleBlockIsAllOfSpace) {
  const SurfelCloud few = sphere_at({5, 5, 5}, 300);
  make(store_, few);
  EXPECT_EQ(read_level_store(store_).blocks.front().cell.side, CurveCell::kAllSpace);
  EXPECT_EQ(read_cloud(store_).size(), few.size());
  // Far away on the other side of the origin.
  const SurfelCloud more = sphere_at({-5000, -5000, -5000}, 500);
  append(store_, more);
  make(folder_ / "other", more);
  append(folder_ / "other", few);
  EXPECT_EQ(differences(files_of(store_), files_of(folder_ / "other")), std::set<std::string>{});
  EXPECT_EQ(read_level_store(store_).blocks.size(), 2U);
}

TEST_F(LevelStore, SettingsAreTheStoresOwn) {
  LevelStoreOptions options = small_blocks();
  options.hierarchy.reduction = 2;
  options.hierarchy.sheets.normal_angle = 20;
  options.block_surfels = 512;
  const SurfelCloud all = sphere_at({0, 0, 0});
  make(folder_ / "whole", all, options);
  make(store_, part_of(all, [](std::size_t i) { return i % 2 == 0; }), options);
  append(store_, part_of(all, [](std::size_t i) { return i % 2 == 1; }));
  EXPECT_EQ(differences(files_of(store_), files_of(folder_ / "whole")), std::set<std::string>{});
}

TEST_F(LevelStore, SurfelsThatCannotBeDrawnAreLeftOutAndCounted) {
  SurfelCloud cloud = sphere_at({0, 0, 0}, 1000);
  make(folder_ / "right", part_of(cloud, [](std::size_t i) { return i != 3 && i != 900; }));
  cloud.position[3].x() = std::numeric_limits<float>::quiet_NaN();
  cloud.variance[900] = -1;
  LevelStoreReport report;
  make_level_store(store_, Pieces(cloud), small_blocks(), &report);
  EXPECT_EQ(report.dropped.total(), 2U);
  EXPECT_EQ(report.added, 998U);
  EXPECT_EQ(differences(files_of(store_), files_of(folder_ / "right")), std::set<std::string>{});
}

TEST_F(LevelStore, WrongOptionsAreRefused) {
  EXPECT_TRUE(LevelStoreOptions{}.problems().empty());
  LevelStoreOptions options;
  options.block_surfels = 1 << 20;
  EXPECT_EQ(options.problems().size(), 1U);
  EXPECT_TRUE(contains(message_of([&] {
                         make(store_, sphere_at({0, 0, 0}), options);
                       }),
                       "block_surfels"));
  EXPECT_FALSE(fs::exists(store_));
}

/// Damages a store, and expects a message of reading and of appending, which leaves it as it is.
TEST_F(LevelStore, DamagedFilesAreNamed) {
  const SurfelCloud all = sphere_at({0, 0, 0}, 3000);
  const SurfelCloud more = sphere_at({0.01, 0, 0}, 3000);
  make(store_, all);
  const auto whole = files_of(store_);
  const LevelStoreIndex index = read_level_store(store_);
  const std::string block = index.blocks.front().file;
  const std::string other = index.blocks.back().file;
  const auto expect_message = [&](const std::string& file, const std::string& what, bool read) {
    const auto damaged = files_of(store_);
    const std::string appended = message_of([&] { append(store_, more); });
    EXPECT_TRUE(contains(appended, file)) << appended;
    EXPECT_TRUE(contains(appended, what)) << appended;
    EXPECT_EQ(differences(files_of(store_), damaged), std::set<std::string>{}) << what;
    const std::string message = message_of([&] { read_cloud(store_, {.levels = true}); });
    EXPECT_EQ(contains(message, file) && contains(message, what), read) << message;
    for (const auto& [name, bytes] : whole) write_text(store_ + name, bytes);
    EXPECT_EQ(message_of([&] { read_cloud(store_, {.levels = true}); }), "");
  };
  fs::remove(store_ + block);
  expect_message(block, "is missing", true);
  write_text(store_ + block, whole.at(block).substr(0, whole.at(block).size() - 1));
  expect_message(block, "", true);
  write_text(store_ + block, "");
  expect_message(block, "", true);
  write_text(store_ + block, whole.at(other));
  expect_message(block, "older version", true);
  fs::remove(store_ + index.top.file);
  expect_message(index.top.file, "is missing", true);
  // What surfels are is seen where they are read to be merged.
  std::string changed = whole.at(block);
  changed[changed.size() / 2] = static_cast<char>(changed[changed.size() / 2] ^ 1);
  write_text(store_ + block, changed);
  expect_message(block, "checksum", false);
  const std::string text = whole.at(kLevelStoreIndex);
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, text.size() / 2}) {
    write_text(store_ + kLevelStoreIndex, text.substr(0, size));
    expect_message(kLevelStoreIndex, "", true);
  }
  // An index that names files elsewhere, or wrong numbers of surfels.
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"\"file\": \"", "\"file\": \"../"},
           {"\"surfels\": [", "\"surfels\": [1"},
           {"\"surfel_store\": 1", "\"surfel_store\": 2"},
           {"\"blocks\": [", "\"blocks\": [],\"b\": ["}}) {
    std::string wrong = text;
    wrong.replace(wrong.find(from), from.size(), to);
    write_text(store_ + kLevelStoreIndex, wrong);
    expect_message("", "", true);
  }
}

TEST_F(LevelStore, SurfelsThatDoNotFitAreRefused) {
  const SurfelCloud all = sphere_at({0, 0, 0}, 2000);
  make(store_, all);
  const auto whole = files_of(store_);
  const auto refused = [&](const SurfelCloud& more, const std::string& what) {
    const std::string message = message_of([&] { append(store_, more); });
    EXPECT_TRUE(contains(message, what)) << message;
    EXPECT_EQ(differences(files_of(store_), whole), std::set<std::string>{}) << what;
  };
  SurfelCloud more = all;
  more.variance = {};
  refused(more, "surfel-estimate");
  more = all;
  more.normal = {};
  refused(more, "have no nx");
  more = all;
  more.alpha.assign(more.size(), 0.5F);
  refused(more, "column alpha");
  more = all;
  more.color_light = ColorLight::kMixed;
  refused(more, "another meaning");
  more = all;
  for (Vec3f& p : more.position) p = Vec3f(0.25F, 0, 0);
  refused(more, "lie at one place");
  for (Vec3f& p : more.position) p.x() = std::numeric_limits<float>::infinity();
  refused(more, "no surfel that can be drawn");
  EXPECT_TRUE(contains(message_of([&] { append(folder_ / "none", all); }), "is no store"));
  EXPECT_FALSE(fs::exists(folder_ / "none"));
}

TEST_F(LevelStore, OneProcessWritesAtATime) {
  const SurfelCloud all = sphere_at({0, 0, 0}, 1000);
  make(store_, all);
  const auto before = files_of(store_);
  const int other = open((store_ + "lock").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_EQ(flock(other, LOCK_EX), 0);
  EXPECT_TRUE(contains(message_of([&] { append(store_, all); }), "another process"));
  EXPECT_TRUE(contains(message_of([&] { make(store_, all); }), "another process"));
  EXPECT_EQ(differences(files_of(store_), before), std::set<std::string>{});
  close(other);
  append(store_, all);
}

TEST_F(LevelStore, WhatAnEarlierRunLeftIsRemovedAndFilesOfOthersAreNot) {
  const SurfelCloud all = sphere_at({0, 0, 0}, 1000);
  make(store_, all);
  write_text(store_ + "block-1_2_3_4-5-00000000.ply", "left");
  write_text(store_ + "sorted.ply", "left");
  write_text(store_ + "notes.txt", "mine");
  append(store_, sphere_at({1, 0, 0}, 200));
  EXPECT_FALSE(fs::exists(store_ + "block-1_2_3_4-5-00000000.ply"));
  EXPECT_FALSE(fs::exists(store_ + "sorted.ply"));
  EXPECT_EQ(read_text(store_ + "notes.txt"), "mine");
  const LevelStoreIndex index = read_level_store(store_);
  EXPECT_EQ(entries(store_).size(), index.blocks.size() + 4);  // Top, index, lock, notes.

  // A store that was never completed is no store; it is made again.
  fs::remove(store_ + kLevelStoreIndex);
  fs::remove(store_ + "notes.txt");
  EXPECT_TRUE(contains(message_of([&] { append(store_, all); }), "is no store"));
  make(store_, all);
  make(folder_ / "right", all);
  EXPECT_EQ(differences(files_of(store_), files_of(folder_ / "right")), std::set<std::string>{});
}

TEST_F(LevelStore, ReplacesAStoreButNoOtherFolder) {
  const SurfelCloud all = sphere_at({0, 0, 0}, 1500);
  make(store_, all);
  const auto before = files_of(store_);
  SurfelCloud broken = all;
  broken.variance = {};
  EXPECT_NE(message_of([&] { make(store_, broken); }), "");
  EXPECT_EQ(differences(files_of(store_), before), std::set<std::string>{});
  LevelStoreOptions options = small_blocks();
  options.no_clobber = true;
  EXPECT_TRUE(contains(message_of([&] { make(store_, all, options); }), "exists already"));
  // A run that fails leaves files that the new version shares with the older one.
  const Pieces pieces(all);
  int calls = 0;
  const auto failing = [&](FunctionRef<void(SurfelCloud piece)> visit) {
    pieces(visit);
    if (++calls == 2) throw_input("all.ply", "is gone");
  };
  EXPECT_TRUE(
      contains(message_of([&] { make_level_store(store_, failing, small_blocks()); }), "is gone"));
  EXPECT_EQ(differences(files_of(store_), before), std::set<std::string>{});
  make(store_, sphere_at({9, 9, 9}, 200));
  EXPECT_EQ(read_cloud(store_).size(), 200U);
  EXPECT_EQ(entries(store_).size(), 4U);

  fs::create_directory(folder_ / "mine");
  write_text(folder_ / "mine/photo.png", "mine");
  EXPECT_TRUE(contains(message_of([&] { make(folder_ / "mine", all); }), "other files"));
  EXPECT_EQ(entries(folder_ / "mine"), Words{"photo.png"});
  EXPECT_TRUE(contains(message_of([&] { make(folder_ / "no/where", all); }), "cannot be made"));
}

}  // namespace
}  // namespace surfel::test
