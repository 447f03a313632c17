// Stores of levels of detail, made by surfel-lod, added to by surfel-convert, and read by the other
// tools.

#include <filesystem>
#include <map>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>
#include <surfel/io/input_file.h>
#include <surfel/io/level_store.h>
#include <surfel/scene/image.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

std::map<std::string, std::string> store_files(const std::string& folder) {
  std::map<std::string, std::string> files;
  for (const std::string& name : entries(folder)) files[name] = read_text(path_in(folder, name));
  return files;
}

/// A terrain in two parts, which overlap in no surfel but in blocks, and stores of it, made once.
struct Parts {
  TemporaryFolder folder;
  std::string all = folder / "all.ply";
  std::string west = folder / "west.ply";
  std::string east = folder / "east.ply";
  std::string whole = folder / "whole/";

  Parts() {
    run({tool("surfel-generate"), "terrain", "--no-uv", "--count", "100000", "-o", all, "--quiet"});
    for (const auto& [part, bounds] :
         {std::pair{west, "-9,-9,-9,0.31,9,9"}, std::pair{east, "0.31,-9,-9,9,9,9"}}) {
      run({tool("surfel-convert"), all, "--bounds", bounds, "-o", part, "--quiet"});
    }
    run({tool("surfel-lod"), all, "-o", whole, "--quiet"});
  }
  static const Parts& get() {
    static const Parts parts;
    return parts;
  }
};

class SurfelStore : public testing::Test {
 protected:
  TemporaryFolder folder_;
  std::string store_ = folder_ / "store/";
  std::string stats_ = folder_ / "stats.json";
};

TEST_F(SurfelStore, AddingHasTheFilesOfMakingAtOnce) {
  const Parts& parts = Parts::get();
  ASSERT_EQ(run({tool("surfel-lod"), parts.east, "-o", store_}).exit_code, 0);
  const RunResult added = run({tool("surfel-convert"), parts.west, "--append", "-o",
                               folder_ / "store", "--memory", "6M", "--stats", stats_});
  ASSERT_EQ(added.exit_code, 0) << added.errors;
  EXPECT_TRUE(contains(added.errors, "100000 surfels in ")) << added.errors;
  EXPECT_FALSE(contains(added.errors, "filled in")) << added.errors;
  EXPECT_TRUE(store_files(store_) == store_files(parts.whole));
  const auto report = nlohmann::json::parse(read_text(stats_));
  EXPECT_EQ(report["levels"][0], 100000);
  EXPECT_EQ(report["added"], read_cloud(parts.west).size());
  EXPECT_GT(report["bytes_written"], 0);

  // Both at once, to a store of some others.
  ASSERT_EQ(run({tool("surfel-lod"), parts.all, "-o", store_, "--quiet"}).exit_code, 0);
  EXPECT_TRUE(store_files(store_) == store_files(parts.whole));
}

TEST_F(SurfelStore, CoordinatesOfLasStayMultiplesOfTheirSteps) {
  SurfelCloud cloud = read_cloud(Parts::get().all);
  cloud.origin = Vec3d(636000, 849000, 400);
  cloud.las = LasStorage{.scale = Vec3d(0.01, 0.01, 0.01), .records = {}};
  Array<std::uint32_t> west;
  Array<std::uint32_t> east;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    cloud.position[i] = (cloud.position[i] * 50000).array().round() / 100;
    cloud.variance[i] *= 250000;
    cloud.area[i] *= 250000;
    (cloud.position[i].x() < 100 ? west : east).push_back(i);
  }
  write_cloud(cloud, folder_ / "all.ply");
  write_cloud(cloud.gathered(west), folder_ / "west.ply");
  write_cloud(cloud.gathered(east), folder_ / "east.ply");
  const auto expect_done = [](const Words& command) {
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
  };
  expect_done({tool("surfel-lod"), folder_ / "all.ply", "-o", folder_ / "whole/"});
  expect_done({tool("surfel-lod"), folder_ / "east.ply", "-o", store_});
  expect_done({tool("surfel-convert"), folder_ / "west.ply", "--append", "-o", store_});
  EXPECT_TRUE(store_files(store_) == store_files(folder_ / "whole"));
}

TEST_F(SurfelStore, IsReadAsTheOneFileThatItStandsFor) {
  const Parts& parts = Parts::get();
  const std::string file = folder_ / "whole.ply";
  {
    const InputFile store(parts.whole);
    write_text(file, std::string(as_text(store.bytes())));
  }
  const auto picture = [&](const std::string& input, const Words& options) {
    const std::string path = folder_ / "picture.exr";
    Words command{
        tool("surfel-render"), input, "-o", path, "--size", "160x90", "--quiet", "--stats", stats_};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_image(path);
  };
  for (const Words& view : {Words{}, Words{"--from", "0.1,0.05,0.4"}, Words{"--lod", "off"}}) {
    for (const Words& more : {Words{}, Words{"--memory", "32M"}}) {
      Words options = view;
      options.insert(options.end(), more.begin(), more.end());
      const Image expected = picture(file, options);
      options.insert(options.end(), {"--threads", "1"});
      const Image seen = picture(parts.whole, options);
      ASSERT_EQ(seen.width, expected.width);
      EXPECT_TRUE(seen.data == expected.data);
    }
  }
  const RunResult of_store = run({tool("surfel-info"), parts.whole, "--json"});
  const RunResult of_file = run({tool("surfel-info"), file, "--json"});
  ASSERT_EQ(of_store.exit_code, 0) << of_store.errors;
  nlohmann::json a = nlohmann::json::parse(of_store.output);
  nlohmann::json b = nlohmann::json::parse(of_file.output);
  // What names the file.
  for (const char* named : {"file", "needs", "next"}) {
    a.erase(named);
    b.erase(named);
  }
  EXPECT_EQ(a, b);

  // The finest level as one file again, and every block by itself.
  ASSERT_EQ(run({tool("surfel-convert"), parts.whole, "-o", folder_ / "back.ply"}).exit_code, 0);
  EXPECT_EQ(read_cloud(folder_ / "back.ply").size(), 100000U);
  for (const LevelStoreBlock& block : read_level_store(parts.whole).blocks) {
    const RunResult info = run({tool("surfel-info"), parts.whole + block.file});
    EXPECT_EQ(info.exit_code, 0) << info.errors;
    EXPECT_TRUE(contains(info.output, std::to_string(block.surfels.front())));
  }
}

TEST_F(SurfelStore, WhatCannotBeAddedIsToldAndChangesNothing) {
  const Parts& parts = Parts::get();
  ASSERT_EQ(run({tool("surfel-lod"), parts.east, "-o", store_, "--quiet"}).exit_code, 0);
  const auto before = store_files(store_);
  const auto refused = [&](const Words& options, int exit_code, const std::string& message) {
    Words command{tool("surfel-convert")};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, exit_code) << result.errors;
    EXPECT_TRUE(contains(result.errors, message)) << result.errors;
    EXPECT_TRUE(store_files(store_) == before);
  };
  write_text(folder_ / "points.xyz", "0 0 0\n1 0 0\n0 1 0\n");
  refused({folder_ / "points.xyz", "--append", "-o", store_}, 1,
          "points.xyz: has no variances, which surfels need; make them first: surfel-estimate");
  refused({folder_ / "none.ply", "--append", "-o", store_}, 1, "none.ply");
  refused({parts.west, "--append", "-o", folder_ / "no/"}, 1, "surfel-lod surfels.ply -o");
  refused({parts.west, "--append", "-o", parts.east}, 1, "is no store");
  refused({parts.west, "-o", store_}, 2, "--append");
  refused({store_, "--append", "-o", store_}, 2, "has its own surfels already");
  refused({"-", "--append", "-o", store_}, 2, "standard input once only");
  for (const Words& option : {Words{"--sort", "curve"}, Words{"--ascii"}, Words{"--resume"},
                              Words{"--gaussians"}, Words{"--no-clobber"}}) {
    Words command{parts.west, "--append", "-o", store_};
    command.insert(command.end(), option.begin(), option.end());
    refused(command, 2, option.front() + " has no effect beside --append");
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "no"));
}

TEST_F(SurfelStore, WrongUseOfSurfelLodIsTold) {
  const Parts& parts = Parts::get();
  const auto refused = [&](const Words& options, int exit_code, const std::string& message) {
    Words command{tool("surfel-lod")};
    command.insert(command.end(), options.begin(), options.end());
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, exit_code) << result.errors;
    EXPECT_TRUE(contains(result.errors, message)) << result.errors;
  };
  refused({"-", "-o", store_}, 2, "standard input once only");
  refused({parts.east, "-o", store_, "--resume"}, 2, "--resume has no effect");
  refused({parts.east, "-o", parts.whole, "--no-clobber"}, 1, "exists already");
  std::filesystem::create_directory(folder_ / "mine");
  write_text(folder_ / "mine/photo.png", "mine");
  refused({parts.east, "-o", folder_ / "mine/"}, 1, "other files");
  write_text(folder_ / "points.xyz", "0 0 0\n1 0 0\n0 1 0\n");
  refused({folder_ / "points.xyz", "-o", store_}, 1, "surfel-estimate");
  EXPECT_FALSE(std::filesystem::exists(store_));
}

}  // namespace
}  // namespace surfel::test
