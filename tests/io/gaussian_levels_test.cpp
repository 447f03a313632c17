#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/gaussian_levels.h>
#include <surfel/lod/gaussian_hierarchy.h>

#include "gaussian/random_gaussians.h"
#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

class GaussianLevelFiles : public testing::Test {
 protected:
  void SetUp() override {
    GaussianCloud cloud = random_gaussians(1500, 3, 1);
    for (float& a : cloud.amplitude) a = std::max(a, 0.02F);
    cloud.rule = AmplitudeRule::kCompensated;
    cloud.up = Vec3d(0, 0, 1);
    levels_ = build_gaussian_hierarchy(cloud);
    write_gaussians(levels_, path_);
    std::ifstream file(path_, std::ios::binary);
    bytes_ = {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }

  /// The file with some text of it replaced; of the first place where it stands.
  std::string changed(const std::string& from, const std::string& to) const {
    std::string out = bytes_;
    const std::size_t at = out.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return out.replace(at, from.size(), to);
  }
  static std::string error_of(const std::string& bytes) {
    return message_of([&] {
      const GaussianLevels levels(
          InputFile("file.ply", std::as_bytes(std::span(bytes.data(), bytes.size()))));
      std::vector<std::uint32_t> all(levels.head().tree.size());
      std::iota(all.begin(), all.end(), 0U);
      levels.read(all);
    });
  }

  TemporaryFolder folder_;
  std::string path_ = folder_ / "levels.ply";
  GaussianCloud levels_;
  std::string bytes_;
};

TEST_F(GaussianLevelFiles, ClustersReadBackAsTheyWere) {
  EXPECT_TRUE(has_gaussian_levels(path_));
  const GaussianLevels file(path_);
  EXPECT_EQ(file.size(), levels_.size());
  const GaussianCloud& head = file.head();
  EXPECT_EQ(head.rule, AmplitudeRule::kCompensated);
  EXPECT_EQ(head.origin, levels_.origin);
  EXPECT_EQ(head.up, levels_.up);
  EXPECT_EQ(head.degree, 1);
  EXPECT_EQ(head.size(), 0U);
  ASSERT_EQ(head.tree.size(), levels_.tree.size());
  // One of each level, and out of order.
  std::vector<std::uint32_t> clusters{0};
  for (std::uint32_t c = 1; c < head.tree.size(); ++c) {
    EXPECT_EQ(head.tree[c].spacing, levels_.tree[c].spacing);
    EXPECT_EQ(head.tree[c].bounds.radius, levels_.tree[c].bounds.radius);
    EXPECT_LT((head.tree[c].bounds.center - levels_.tree[c].bounds.center).norm(), 1e-5F);
    if (head.tree[c].level != head.tree[c - 1].level) clusters.insert(clusters.begin(), c + 1);
  }
  const GaussianCloud part = file.read(clusters);
  std::size_t k = 0;
  for (const std::uint32_t c : clusters) {
    for (std::uint32_t i = levels_.tree[c].begin; i < levels_.tree[c].end; ++i, ++k) {
      EXPECT_EQ(part.position[k], levels_.position[i]);
      EXPECT_NEAR(part.amplitude[k], levels_.amplitude[i], 1e-5F);
      EXPECT_LT((part.scale[k] - levels_.scale[i]).norm(), 1e-5F * levels_.scale[i].norm());
      for (std::size_t h = 0; h < 12; ++h) {
        EXPECT_EQ(part.harmonics[12 * k + h], levels_.harmonics[12 * i + h]);
      }
    }
  }
  EXPECT_EQ(part.size(), k);
  EXPECT_EQ(file.read({}).size(), 0U);
}

TEST_F(GaussianLevelFiles, OtherReadersSeeTheFinestLevelAlone) {
  const GaussianCloud finest = read_gaussians(path_);
  EXPECT_EQ(finest.size(), 1500U);
  EXPECT_EQ(finest.coarser_skipped, levels_.size() - 1500);
  EXPECT_TRUE(finest.tree.empty());
  const std::size_t first = levels_.size() - 1500;
  for (std::size_t i = 0; i < 1500; ++i) {
    EXPECT_EQ(finest.position[i], levels_.position[first + i]);
  }
  // It is the first element, and in the layout that files without levels have.
  EXPECT_LT(bytes_.find("element vertex 1500\n"), bytes_.find("element surfel_merged"));
  EXPECT_EQ(message_of([&] { write_gaussians(levels_, folder_ / "a.splat"); }),
            folder_ / "a.splat" + ": .splat has no place for levels of detail; write PLY");
}

TEST_F(GaussianLevelFiles, FilesWithoutLevelsSayHowToMakeThem) {
  const std::string plain = folder_ / "plain.ply";
  write_gaussians(read_gaussians(path_), plain);
  EXPECT_FALSE(has_gaussian_levels(plain));
  EXPECT_EQ(message_of([&] { GaussianLevels levels(plain); }),
            plain + ": has no levels of detail; run surfel-lod on it");
}

TEST_F(GaussianLevelFiles, BrokenOnesAreRefused) {
  EXPECT_EQ(error_of(bytes_), "");
  EXPECT_TRUE(error_of(bytes_.substr(0, bytes_.size() - 3)).starts_with("file.ply: "));
  EXPECT_TRUE(error_of(bytes_.substr(0, bytes_.size() / 2)).starts_with("file.ply: "));
  // Lying counts, which move what follows.
  EXPECT_NE(error_of(changed("element vertex 1500", "element vertex 1499")), "");
  EXPECT_NE(error_of(changed("element vertex 1500", "element vertex 4294967295")), "");
  EXPECT_NE(error_of(changed("element surfel_merged ", "element surfel_merged 9")), "");
  // Another tree.
  const std::size_t tree = bytes_.size() - 1;
  std::string other = bytes_;
  other[tree - 1] = '\x7f';
  other[tree] = '\x7f';
  EXPECT_TRUE(error_of(other).starts_with("file.ply: ")) << error_of(other);
  // Properties that the two elements do not share.
  const std::size_t second = bytes_.find("element surfel_merged");
  std::string names = bytes_;
  names.replace(names.find("property float rot_3", second), 20, "property float rot_4");
  EXPECT_NE(error_of(names).find("no property 'rot_3'"), std::string::npos);
}

}  // namespace
}  // namespace surfel::test
