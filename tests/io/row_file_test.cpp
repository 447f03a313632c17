#include <filesystem>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/row_file.h>

#include "render/scenes.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

constexpr std::size_t kRows = 5000;
constexpr std::size_t kPart = 1000;

class RowFiles : public testing::Test {
 protected:
  void SetUp() override {
    write_cloud(cloud_, folder_ / "whole.ply");
    whole_ = read_text(folder_ / "whole.ply");
  }
  /// Writes the parts of a file that are not there, in this order. Returns how many were there.
  int write(RowFile& file, const std::vector<std::size_t>& parts) const {
    file.begin(cloud_, kRows);
    int there = 0;
    for (const std::size_t k : parts) {
      if (const auto state = file.finished(k)) {
        EXPECT_EQ(*state, "state " + std::to_string(k));
        ++there;
        continue;
      }
      const RowSpan rows{k * kPart, (k + 1) * kPart};
      file.put(cloud_, rows.begin, rows.end, rows.begin);
      file.finish(k, {&rows, 1}, "state " + std::to_string(k));
    }
    return there;
  }

  SurfelCloud cloud_ = fibonacci_sphere(kRows, 1);
  TemporaryFolder folder_;
  std::string path_ = folder_ / "rows.ply";
  std::string whole_;
};

TEST_F(RowFiles, HaveTheBytesOfTheWholeCloudInAnyOrder) {
  RowFile file(path_);
  EXPECT_EQ(write(file, {3, 0, 4, 1, 2}), 0);
  EXPECT_FALSE(std::filesystem::exists(path_));
  file.commit();
  EXPECT_TRUE(read_text(path_) == whole_);
}

TEST_F(RowFiles, ALaterRunGoesOn) {
  const RowFileOptions options{.job = "job"};
  {
    RowFile file(path_, options);
    write(file, {3, 0});
  }
  {
    RowFile file(path_, options);
    EXPECT_EQ(write(file, {0, 1, 3}), 2);
    EXPECT_EQ(file.rows_kept(), 2 * kPart);
  }
  RowFile file(path_, options);
  EXPECT_EQ(write(file, {0, 1, 2, 3, 4}), 3);
  file.commit();
  EXPECT_TRUE(read_text(path_) == whole_);
  EXPECT_FALSE(std::filesystem::exists(path_ + ".unfinished"));
  EXPECT_FALSE(std::filesystem::exists(path_ + ".unfinished-parts"));
}

TEST_F(RowFiles, ARunThatEndsBeforeAnyPartChangesNothing) {
  { RowFile(path_, {.job = "job"}); }
  EXPECT_EQ(entries(folder_ / "").size(), 1U);
  {
    RowFile file(path_, {.job = "job"});
    write(file, {3, 0});
  }
  { RowFile(path_, {.job = "another job"}); }
  RowFile file(path_, {.job = "job"});
  EXPECT_EQ(write(file, {0, 3}), 2);
}

TEST_F(RowFiles, RowsThatAreNotAsTheyWereAreMadeAgain) {
  const RowFileOptions options{.job = "job"};
  {
    RowFile file(path_, options);
    write(file, {0, 1, 2});
  }
  std::string bytes = read_text(path_ + ".unfinished");
  const std::size_t header = whole_.find("end_header\n") + 11;
  const std::size_t stride = (whole_.size() - header) / kRows;
  bytes[header + stride * (kPart + 17)] ^= 1;
  bytes.resize(header + stride * (3 * kPart - 1));
  write_text(path_ + ".unfinished", bytes);
  RowFile file(path_, options);
  EXPECT_EQ(write(file, {0, 1, 2, 3, 4}), 1);
  file.commit();
  EXPECT_TRUE(read_text(path_) == whole_);
}

TEST_F(RowFiles, AnotherJobBeginsAnew) {
  {
    RowFile file(path_, {.job = "job"});
    write(file, {0, 1, 2, 3, 4});
  }
  {
    RowFile file(path_, {.job = "another job"});
    EXPECT_EQ(write(file, {0}), 0);
  }
  // Other columns are another job as well, and what came before another begin() is void.
  RowFile file(path_, {.job = "another job"});
  SurfelCloud other = cloud_;
  other.coefficient = {};
  file.begin(other, kRows);
  EXPECT_FALSE(file.finished(0));
  EXPECT_EQ(write(file, {0, 1, 2, 3, 4}), 0);
  file.commit();
  EXPECT_TRUE(read_text(path_) == whole_);
}

TEST_F(RowFiles, PartsWithOtherColumnsAreRefused) {
  RowFile file(path_);
  file.begin(cloud_, kRows);
  SurfelCloud other = cloud_;
  other.normal = {};
  EXPECT_NE(message_of([&] { file.put(other, 0, 1, 0); }).find("differ in their columns"),
            std::string::npos);
  // So are columns of other names that take as many bytes.
  SurfelCloud named = cloud_;
  named.extra.push_back({"one", ScalarType::kUint8, Array<std::byte>(kRows)});
  file.begin(named, kRows);
  file.put(named, 0, 1, 0);
  named.extra.front().name = "other";
  EXPECT_NE(message_of([&] { file.put(named, 0, 1, 0); }).find("differ in their columns"),
            std::string::npos);
}

}  // namespace
}  // namespace surfel::test
