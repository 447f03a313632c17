// Geometry that makes a careless search or loop slow: every tool ends, with a sane result or with a
// message that names the file. What the work is bounded by is counted in the tests of the library.

#include <cmath>
#include <filesystem>
#include <utility>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>

#include "render/scenes.h"
#include "support/adversarial_clouds.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

constexpr std::size_t kCount = 1500;

/// A tool that makes surfels or a picture of surfels.
struct Job {
  Words command;
  std::string file = "cloud.ply";
};

std::vector<Job> cloud_jobs() {
  return {
      {{"surfel-info"}},
      {{"surfel-estimate", "--remove-outliers", "-o", "out.ply"}},
      {{"surfel-texture", "--from", "colors", "--fit", "render", "-o", "out.ply"}},
      {{"surfel-group", "--groups", "4", "--cover", "enlarge-each", "-o", "out.ply"}},
      {{"surfel-lod", "-o", "out.ply"}},
      {{"surfel-simplify", "--count", "100", "-o", "out.ply"}},
      {{"surfel-render", "--size", "48x48", "-o", "out.png"}},
      {{"surfel-render", "--size", "48x48", "-o", "out.png"}, "points.ply"},
      {{"surfel-render", "--method", "deferred", "--size", "48x48", "-o", "out.png"},
       "grouped.ply"},
      {{"surfel-convert", "cloud.ply", "--align", "-o", "out.ply"}},
  };
}

std::vector<Job> mesh_jobs() {
  return {{{"surfel-from-mesh", "--count", "1000", "-o", "out.ply"}, "mesh.obj"},
          {{"surfel-info"}, "mesh.obj"}};
}

/// The first problem of a cloud's values, or nothing.
std::string flaw_of(const SurfelCloud& cloud) {
  if (cloud.empty()) return "no surfel";
  for (std::size_t i = 0; i < cloud.variance.size(); ++i) {
    if (cloud.position[i].allFinite() && cloud.variance[i] < 0) return "a negative variance";
  }
  return {};
}

class Adversarial : public testing::TestWithParam<AdversarialCase> {
 protected:
  /// Runs a tool on a file in the folder.
  void expect_sane(const Job& job) const {
    Words command = job.command;
    command[0] = tool(command[0]);
    for (std::string& word : command) {
      if (word.starts_with("out.") || word == "cloud.ply") word = folder_ / word;
    }
    command.insert(command.begin() + 1, folder_ / job.file);
    command.insert(command.end(), {"--quiet", "--threads", "1"});
    const RunResult result = run(command);
    const std::string what = job.command[0] + " on " + GetParam().name + ": " + result.errors;
    ASSERT_TRUE(result.exit_code == 0 || result.exit_code == 1) << what;
    EXPECT_TRUE(result.exit_code == 0 || contains(result.errors, job.file)) << what;
    const bool surfels = std::filesystem::exists(folder_ / "out.ply");
    EXPECT_TRUE(result.exit_code == 0 || !surfels) << what;
    if (surfels) {
      EXPECT_EQ(flaw_of(read_cloud(folder_ / "out.ply")), "") << what;
      std::filesystem::remove(folder_ / "out.ply");
    }
  }

  TemporaryFolder folder_;
};

class AdversarialCloud : public Adversarial {};
class AdversarialMesh : public Adversarial {};

TEST_P(AdversarialCloud, EndsWithASaneResultOrAMessage) {
  const std::string& name = GetParam().name;
  write_text(folder_ / "cloud.ply", adversarial_cloud(name, kCount));
  write_text(folder_ / "grouped.ply", adversarial_cloud(name, kCount, true));
  write_text(folder_ / "points.ply", adversarial_points(name, kCount));
  for (const Job& job : cloud_jobs()) expect_sane(job);
}

TEST_P(AdversarialCloud, HasPicturesOfNumbers) {
  write_text(folder_ / "cloud.ply", adversarial_cloud(GetParam().name, kCount));
  SurfelCloud cloud;
  try {
    cloud = read_cloud(folder_ / "cloud.ply");
  } catch (const Error&) {
    GTEST_SKIP() << "is refused";
  }
  const Image image = render_unlit(cloud, camera_at(3, 48));
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int c = 0; c < 4; ++c) ASSERT_TRUE(std::isfinite(image.pixel(x, y)[c])) << x << " " << y;
    }
  }
}

TEST_P(AdversarialMesh, EndsWithASaneResultOrAMessage) {
  write_text(folder_ / "mesh.obj", adversarial_mesh(GetParam().name, kCount));
  for (const Job& job : mesh_jobs()) expect_sane(job);
}

TEST(AdversarialTruth, RefusesToDrawThousandsOfDiscsOverEachPlace) {
  const TemporaryFolder folder;
  write_text(folder / "sphere.ply", adversarial_cloud("benign", 3000));
  write_text(folder / "huge.ply", adversarial_cloud("all-huge", 3000));
  for (const Words& truth :
       {Words{"--reference", "--samples", "1"}, Words{"--filter", "ewa-source"}}) {
    for (const auto& [file, code] : {std::pair("sphere.ply", 0), std::pair("huge.ply", 1)}) {
      Words command{tool("surfel-render"), folder / file, "--size", "16x16", "--quiet", "-o",
                    folder / "out.png"};
      command.insert(command.end(), truth.begin(), truth.end());
      const RunResult result = run(command);
      EXPECT_EQ(result.exit_code, code) << file << " " << result.errors;
      EXPECT_EQ(std::filesystem::exists(folder / "out.png"), code == 0) << file;
      EXPECT_EQ(contains(result.errors, std::string(file) + ": "), code == 1) << result.errors;
      std::filesystem::remove(folder / "out.png");
    }
  }
}

std::string name_of(const testing::TestParamInfo<AdversarialCase>& info) {
  std::string name;
  for (const char c : info.param.name) name += std::isalnum(c) != 0 ? c : '_';
  return name;
}

INSTANTIATE_TEST_SUITE_P(Cases, AdversarialCloud, testing::ValuesIn(adversarial_clouds()), name_of);
INSTANTIATE_TEST_SUITE_P(Cases, AdversarialMesh, testing::ValuesIn(adversarial_meshes()), name_of);

}  // namespace
}  // namespace surfel::test
