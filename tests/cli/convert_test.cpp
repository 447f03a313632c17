// surfel-convert: formats, joined files, materials, places.

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <surfel/io/cloud_io.h>

#include "support/run_tool.h"

namespace surfel::test {
namespace {

class SurfelConvert : public testing::Test {
 protected:
  void SetUp() override {
    for (const auto& [kind, file] : {std::pair{"sphere", sphere_}, {"transparent", layers_}}) {
      ASSERT_EQ(
          run({tool("surfel-generate"), kind, "--count", "300", "-o", file, "--quiet"}).exit_code,
          0);
    }
  }
  RunResult convert(const Words& words, const std::string& output = "out.ply") const {
    Words command = {tool("surfel-convert"), "-o", folder_ / output};
    command.insert(command.end(), words.begin(), words.end());
    return run(command);
  }
  SurfelCloud converted(const Words& words, const std::string& output = "out.ply") const {
    const RunResult result = convert(words, output);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_cloud(folder_ / output);
  }

  TemporaryFolder folder_;
  std::string sphere_ = folder_ / "sphere.ply";
  std::string layers_ = folder_ / "layers.ply";
};

TEST_F(SurfelConvert, EveryFormatReadsBackTheSame) {
  const SurfelCloud cloud = read_cloud(sphere_);
  for (const auto& [output, options] :
       {std::pair{"a.ply", Words{}}, {"b.ply", {"--ascii"}}, {"c.pcd", {}}, {"d", {}}}) {
    Words words = options;
    words.push_back(sphere_);
    const SurfelCloud again = converted(words, output);
    EXPECT_EQ(again.position, cloud.position) << output;
    EXPECT_EQ(again.variance, cloud.variance) << output;
    EXPECT_EQ(again.color, cloud.color) << output;
    EXPECT_EQ(again.normal, cloud.normal) << output;
    EXPECT_EQ(again.provenance.size(), cloud.provenance.size() + 1) << output;
  }
  EXPECT_TRUE(contains(read_text(folder_ / "b.ply"), "format ascii"));
  EXPECT_TRUE(contains(read_text(folder_ / "c.pcd"), "DATA binary"));
  write_text(folder_ / "points.xyz", "0 0 1\n1 2 3\n");
  EXPECT_EQ(converted({folder_ / "points.xyz"}).position[1], Vec3f(1, 2, 3));
}

TEST_F(SurfelConvert, JoinsFilesWithMaterialsOfTheirOwn) {
  const std::string stats = folder_ / "stats.json";
  const SurfelCloud joined =
      converted({sphere_, layers_, "--material", "keep,3", "--stats", stats});
  ASSERT_EQ(joined.size(), 600U);
  EXPECT_EQ(joined.material[0], 0);
  EXPECT_EQ(joined.material[599], 3);
  EXPECT_EQ(joined.alpha[0], 1);
  EXPECT_LT(joined.alpha[599], 1);
  const auto report = nlohmann::json::parse(read_text(stats));
  EXPECT_EQ(report["surfels"], 600);
  EXPECT_EQ(report["inputs"][1]["surfels"], 300);
  EXPECT_TRUE(contains(report["filled"].dump(), "alpha"));

  const SurfelCloud apart = converted({sphere_, sphere_, layers_, "--separate-materials"});
  EXPECT_EQ(apart.material[299], 0);
  EXPECT_EQ(apart.material[300], 1);
  EXPECT_EQ(apart.material[899], 2);
  EXPECT_EQ(converted({sphere_, "--material", "7"}).material[5], 7);
  write_text(folder_ / "convert.toml", "material = \"1,2\"\n");
  EXPECT_EQ(converted({sphere_, layers_, "--config", folder_ / "convert.toml"}).material[300], 2);
}

TEST_F(SurfelConvert, SaysWhatItMadeUpAndLeftOut) {
  const std::string grouped = folder_ / "grouped_sphere.ply";
  ASSERT_EQ(run({tool("surfel-group"), sphere_, "-o", grouped, "--quiet"}).exit_code, 0);
  const RunResult result = convert({grouped, layers_});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_TRUE(contains(result.errors, "sphere.ply: has no alpha")) << result.errors;
  EXPECT_TRUE(contains(result.errors, "not all files have them: group")) << result.errors;
  EXPECT_FALSE(contains(result.errors, "rounded")) << result.errors;
  convert({layers_, "--translate", "1e9,0,0"}, "far.ply");
  const RunResult far = convert({sphere_, folder_ / "far.ply"});
  EXPECT_TRUE(contains(far.errors, "rounded")) << far.errors;
}

TEST_F(SurfelConvert, MovesFiles) {
  const SurfelCloud cloud = read_cloud(sphere_);
  const SurfelCloud moved =
      converted({sphere_, "--scale", "2", "--rotate=0,0,1,90", "--translate=1,0,-3"});
  for (std::size_t i = 0; i < 300; i += 37) {
    const Vec3f& p = cloud.position[i];
    const Vec3d expected(1 - 2 * static_cast<double>(p.y()), 2 * static_cast<double>(p.x()),
                         2 * static_cast<double>(p.z()) - 3);
    EXPECT_LT((moved.world(i) - expected).norm(), 1e-5);
    EXPECT_FLOAT_EQ(moved.variance[i], 4 * cloud.variance[i]);
  }
}

TEST_F(SurfelConvert, RefusesWhatMakesNoSense) {
  for (const Words& words : {Words{sphere_, "--material", "65536"},
                             {sphere_, "--material", "1,2"},
                             {sphere_, "--material", "-1"},
                             {sphere_, "--material", "a"},
                             {sphere_, "--material", "1,"},
                             {sphere_, "--material", "1", "--separate-materials"},
                             {sphere_, "--scale", "0"},
                             {sphere_, "--rotate=0,0,0,90"},
                             {sphere_, "--translate=1,2"},
                             {"-", "-"}}) {
    const RunResult result = convert(words);
    EXPECT_EQ(result.exit_code, 2) << words.back() << result.errors;
  }
  EXPECT_EQ(convert({sphere_}, "out.xyz").exit_code, 2);
  EXPECT_EQ(convert({sphere_, "--ascii"}, "out.pcd").exit_code, 2);
  write_text(folder_ / "points.xyz", "0 0 1\n1 2 3\n");
  const RunResult sizeless = convert({sphere_, folder_ / "points.xyz"});
  EXPECT_EQ(sizeless.exit_code, 1);
  EXPECT_TRUE(contains(sizeless.errors, "points.xyz: has no variance")) << sizeless.errors;
  EXPECT_EQ(entries(folder_ / ""), (Words{"layers.ply", "points.xyz", "sphere.ply"}));
}

TEST_F(SurfelConvert, AlignsOverlappingScansAndTellsTheirPoses) {
  const std::string first = folder_ / "first.ply";
  const std::string moved = folder_ / "moved.ply";
  ASSERT_EQ(run({tool("surfel-generate"), "terrain", "--count", "5000", "-o", first, "--quiet"})
                .exit_code,
            0);
  ASSERT_EQ(convert({first, "--rotate", "1,2,3,2", "--translate", "0.02,0.01,-0.02"}, "moved.ply")
                .exit_code,
            0);
  const std::string stats = folder_ / "stats.json";
  const RunResult result = convert({first, moved, "--align", "--stats", stats});
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(contains(result.errors, "first.ply: stays;")) << result.errors;
  EXPECT_TRUE(contains(result.errors, "moved.ply: turned by 2 degrees,")) << result.errors;
  const auto align = nlohmann::json::parse(read_text(stats))["align"];
  EXPECT_EQ(align["converged"], true);
  EXPECT_EQ(align["scans"][0]["rotation"], nlohmann::json({1.0, 0.0, 0.0, 0.0}));
  // Both files hold the same points: they are back in their places.
  const SurfelCloud joined = read_cloud(folder_ / "out.ply");
  ASSERT_EQ(joined.size(), 10000U);
  for (std::size_t i = 0; i < 5000; ++i) {
    EXPECT_LT((joined.position[i] - joined.position[5000 + i]).norm(), 1e-4F);
  }

  const auto refused = [&](const Words& words, int exit_code, const std::string& message) {
    const RunResult run = convert(words, "no.ply");
    EXPECT_EQ(run.exit_code, exit_code) << run.errors;
    EXPECT_TRUE(contains(run.errors, message)) << run.errors;
  };
  refused({first, "--align"}, 2, "--align needs two files or more");
  refused({first, moved, "--align-reach", "1"}, 2, "--align-reach has no effect without --align");
  refused({first, moved, "--align", "--align-reach", "-1"}, 2, "--align-reach is -1;");
  ASSERT_EQ(convert({first, "--translate", "9,0,0"}, "moved.ply").exit_code, 0);
  refused({first, moved, "--align"}, 1, "moved.ply: does not overlap");
}

}  // namespace
}  // namespace surfel::test
