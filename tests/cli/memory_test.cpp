// Files that are larger than the memory: the same bytes as in memory, or a refusal that helps.

#include <algorithm>
#include <filesystem>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>

#include "support/run_tool.h"
#include "texture/texture_support.h"

namespace surfel::test {
namespace {

/// Files of surfels, each made where a test first asks for it: processes share the tests.
class Files {
 public:
  std::string sorted() const {
    return made("sorted.ply", [](const std::string& path) { generate("20000", path); });
  }
  std::string shuffled() const {
    return made("shuffled.ply",
                [&](const std::string& path) { write_cloud(shuffled_cloud(), path); });
  }
  /// The sorted surfels, moved far from the origin, as text.
  std::string text() const {
    return made("text.ply", [&](const std::string& path) {
      write_cloud(moved_cloud(), path, {.ascii = true});
    });
  }
  std::string far_away() const {
    return made("far.las", [&](const std::string& path) { write_cloud(moved_cloud(), path); });
  }
  std::string many() const {
    return made("many.ply", [](const std::string& path) { generate("270000", path); });
  }
  std::string image() const {
    return made("image.png",
                [](const std::string& path) { write_image(noise_image(64, 64, 3), path); });
  }
  /// A mesh with that image.
  std::string mesh() const {
    return made("m.obj", [&](const std::string& path) {
      image();
      write_text(path,
                 "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\n"
                 "vt 0 0\nvt 0.4 0\nvt 0.4 0.4\nvt 0 0.4\nvt 0.6 0\nvt 1 0\nvt 1 0.4\n"
                 "vt 0.6 0.4\n"
                 "usemtl m\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 2/5 5/6 6/7\nf 2/5 6/7 3/8\n");
      write_text(folder_ / "m.mtl", "newmtl m\nmap_Kd image.png\n");
    });
  }
  std::string sampled() const {
    return made("sampled.ply", [&](const std::string& path) {
      run({tool("surfel-from-mesh"), mesh(), "--spacing", "0.015", "-o", path, "--quiet"});
    });
  }

  static const Files& get() {
    static const Files files;
    return files;
  }

 private:
  template <class Make>
  std::string made(const std::string& name, const Make& make) const {
    const std::string path = folder_ / name;
    if (!std::filesystem::exists(path)) make(path);
    return path;
  }
  static void generate(const std::string& count, const std::string& path) {
    run({tool("surfel-generate"), "terrain", "--count", count, "-o", path, "--quiet"});
  }
  SurfelCloud shuffled_cloud() const {
    const SurfelCloud cloud = read_cloud(sorted());
    Array<std::uint32_t> order(cloud.size());
    for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i * 7919U % 20000U;
    return cloud.gathered(order);
  }
  SurfelCloud moved_cloud() const {
    SurfelCloud cloud = read_cloud(sorted());
    cloud.origin = {455000.5, 5401000, 200};
    cloud.double_positions = true;
    return cloud;
  }

  TemporaryFolder folder_;
};

class Memory : public testing::Test {
 protected:
  /// The bytes that a command writes to its standard output, or to `out` where it names that.
  std::string bytes(Words command, const Words& more) const {
    command.insert(command.end(), more.begin(), more.end());
    std::filesystem::remove(out_);
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return std::filesystem::exists(out_) ? read_text(out_) : result.output;
  }
  /// A command makes the same of any memory on any number of threads as of 1 GB on all processors.
  void expect_same(const Words& command, const Words& memories,
                   const Words& all_threads = {"1", "3"}) const {
    const std::string whole = bytes(command, {"--memory", "1G"});
    EXPECT_GT(whole.size(), 500U);
    for (const std::string& memory : memories) {
      for (const std::string& threads : all_threads) {
        EXPECT_TRUE(bytes(command, {"--memory", memory, "--threads", threads}) == whole)
            << command[0] << " " << memory << " " << threads;
      }
    }
  }
  void expect_refused(Words command, const std::string& memory, const std::string& says,
                      int code = 1) const {
    command.insert(command.end(), {"--memory", memory});
    const RunResult result = run(command);
    EXPECT_EQ(result.exit_code, code) << command[0];
    EXPECT_TRUE(contains(result.errors, says)) << result.errors;
    EXPECT_FALSE(std::filesystem::exists(out_));
  }

  const Files& files_ = Files::get();
  TemporaryFolder folder_;
  std::string out_ = folder_ / "out.ply";
};

TEST_F(Memory, InfoTellsTheSameOfPieces) {
  for (const std::string& file : {files_.sorted(), files_.shuffled(), files_.far_away()}) {
    expect_same({tool("surfel-info"), file, "--json", "--samples", "300"}, {"1M", "1500K"});
  }
  expect_same({tool("surfel-info"), files_.sorted(), "--json", "--samples", "300", "--every", "3"},
              {"1M"});
}

TEST_F(Memory, InfoRefusesWhatItCannotReadInPieces) {
  expect_refused({tool("surfel-info"), files_.text()}, "1M",
                 "MB in memory or more, of which 1 MB are allowed (--memory); put it into order "
                 "first: surfel-convert --sort curve");
  expect_refused({tool("surfel-info"), files_.sorted()}, "1M", "lower --samples to 327", 2);
  expect_refused({tool("surfel-info"), files_.mesh()}, "1M", "--memory has no effect on meshes", 2);
}

TEST_F(Memory, TexturesAreTheSameByBlocks) {
  const auto texture = [&](const std::string& file, const Words& options) {
    Words command{tool("surfel-texture"), file, "-o", out_};
    command.insert(command.end(), options.begin(), options.end());
    expect_same(command, {"500K", "1M"});
  };
  texture(files_.sampled(), {"--image", files_.image()});
  texture(files_.sampled(), {"--mesh", files_.mesh()});
  texture(files_.sampled(), {"--mesh", files_.mesh(), "--normal-map", files_.image()});
  texture(files_.shuffled(), {"--solid", "marble:9"});
}

TEST_F(Memory, SystemsAreTheSameByBlocks) {
  expect_same({tool("surfel-texture"), files_.many(), "--solid", "checker:20", "--fit", "render",
               "--points", "1", "--cutoff", "0.3", "-o", out_},
              {"560M"}, {"3"});
}

TEST_F(Memory, TexturesRefuseSystemsThatDoNotFit) {
  const Words command{
      tool("surfel-texture"), files_.sampled(), "--image", files_.image(), "-o", out_};
  Words render = command;
  render.insert(render.end(), {"--fit", "render"});
  expect_refused(render, "500K", "--fit ewa needs no system");
  expect_refused({tool("surfel-texture"), files_.text(), "--solid", "wood", "-o", out_}, "500K",
                 "surfel-convert --sort curve");
  Words las = command;
  las.back() = folder_ / "out.las";
  expect_refused(las, "500K", "LAS files are not written before all surfels are known", 2);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.las"));
}

TEST_F(Memory, GroupsAreTheSameByBlocks) {
  expect_same({tool("surfel-group"), files_.many(), "-o", out_}, {"60M"});
}

TEST_F(Memory, GroupsRefuseWhatDoesNotFit) {
  const auto refused = [&](const std::string& file, const Words& options, const std::string& says) {
    Words command{tool("surfel-group"), file, "-o", out_};
    command.insert(command.end(), options.begin(), options.end());
    expect_refused(command, "2M", says);
  };
  refused(files_.many(), {}, " MB at least");
  refused(files_.many(), {"--groups", "4"}, "--groups needs all surfels at once");
  refused(files_.many(), {"--cover", "enlarge"}, "--cover needs all surfels at once");
  refused(files_.text(), {}, "surfel-convert --sort curve");
}

TEST_F(Memory, SimplifiedSurfelsAreTheSameByBlocks) {
  expect_same({tool("surfel-simplify"), files_.many(), "--count", "3000", "-o", out_}, {"100M"},
              {"3"});
}

TEST_F(Memory, SimplifyRefusesWhatDoesNotFit) {
  const auto refused = [&](const std::string& file, const std::string& memory,
                           const std::string& says) {
    expect_refused({tool("surfel-simplify"), file, "--factor", "3", "-o", out_}, memory, says);
  };
  refused(files_.many(), "2M", "are allowed (--memory): give as much");
  refused(files_.sorted(), "2M", "are allowed (--memory): give as much");
  refused(files_.text(), "2M", "surfel-convert --sort curve");
  expect_refused({tool("surfel-simplify"), files_.many(), "--factor", "3", "-o", folder_ / "o.pcd"},
                 "100M", "surfels that are made block by block are written as PLY", 2);
}

TEST_F(Memory, WhatFailsLeavesNothingBehind) {
  for (const Words& command :
       {Words{"surfel-texture", files_.shuffled(), "--solid", "wood", "--memory", "500K"},
        Words{"surfel-group", files_.many(), "--memory", "60M"},
        Words{"surfel-simplify", files_.many(), "--factor", "9", "--memory", "100M"}}) {
    // A limit on the size of files fails as a full disk does.
    std::string text = "ulimit -f 100; trap '' XFSZ; " + tool(command[0]);
    for (std::size_t i = 1; i < command.size(); ++i) text += " " + command[i];
    const RunResult result = run({"sh", "-c", text + " -o " + out_});
    EXPECT_EQ(result.exit_code, 1) << result.errors;
    EXPECT_TRUE(contains(result.errors, "out.ply")) << result.errors;
    EXPECT_TRUE(entries(folder_ / "").empty());
  }
}

}  // namespace
}  // namespace surfel::test
