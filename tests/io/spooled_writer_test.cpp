#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/spooled_writer.h>

#include "render/scenes.h"
#include "support/run_tool.h"

namespace surfel::test {
namespace {

constexpr std::size_t kSpooled = 5000;
constexpr std::size_t kSpooledPart = 1000;

class SpooledWriters : public testing::Test {
 protected:
  void SetUp() override {
    write_cloud(cloud_, folder_ / "whole.ply");
    whole_ = read_text(folder_ / "whole.ply");
  }
  /// Appends the parts [0, end) that are not there. Returns how many were there.
  int append(SpooledWriter& writer, std::size_t end) const {
    writer.begin(cloud_.gathered({0}));
    int there = 0;
    for (std::size_t k = 0; k < end; ++k) {
      if (const auto state = writer.finished(k)) {
        EXPECT_EQ(*state, "state " + std::to_string(k));
        ++there;
        continue;
      }
      Array<std::uint32_t> rows;
      for (std::size_t i = 0; i < kSpooledPart; ++i) {
        rows.push_back(static_cast<std::uint32_t>(k * kSpooledPart + i));
      }
      writer.append(cloud_.gathered(rows));
      const RowSpan some{0, 1};
      writer.finish(k, {&some, 1}, "state " + std::to_string(k));
    }
    return there;
  }
  void run_to(std::size_t end) const {
    SpooledWriter writer(path_, {.job = "job"});
    append(writer, end);
  }
  void expect_taken_up(int there) const {
    SpooledWriter writer(path_, {.job = "job"});
    EXPECT_EQ(append(writer, kSpooled / kSpooledPart), there);
    EXPECT_EQ(writer.kept(), static_cast<std::size_t>(there) * kSpooledPart);
    EXPECT_EQ(writer.surfels(), kSpooled);
    writer.commit();
    EXPECT_TRUE(read_text(path_) == whole_);
    EXPECT_EQ(entries(folder_ / ""), (Words{"spooled.ply", "whole.ply"}));
  }

  SurfelCloud cloud_ = fibonacci_sphere(kSpooled, 1);
  TemporaryFolder folder_;
  std::string path_ = folder_ / "spooled.ply";
  std::string whole_;
};

TEST_F(SpooledWriters, HaveTheBytesOfTheWholeCloud) {
  SpooledWriter writer(path_);
  append(writer, kSpooled / kSpooledPart);
  EXPECT_FALSE(std::filesystem::exists(path_));
  writer.commit();
  EXPECT_TRUE(read_text(path_) == whole_);
}

TEST_F(SpooledWriters, ALaterRunGoesOn) {
  run_to(2);
  run_to(3);
  expect_taken_up(3);
}

TEST_F(SpooledWriters, PartsThatAreNotFinishedAreDropped) {
  {
    SpooledWriter writer(path_, {.job = "job"});
    append(writer, 2);
    writer.append(cloud_);
  }
  expect_taken_up(2);
}

TEST_F(SpooledWriters, DamagedPartsAndThoseBehindThemAreMadeAgain) {
  run_to(4);
  const std::string scratch = path_ + ".unfinished-scratch";
  const auto bytes = static_cast<std::streamoff>(std::filesystem::file_size(scratch));
  std::fstream(scratch, std::ios::in | std::ios::out | std::ios::binary).seekp(3 * bytes / 8)
      << '!';
  expect_taken_up(1);
}

TEST_F(SpooledWriters, AnotherJobBeginsAnew) {
  run_to(4);
  { SpooledWriter writer(path_, {.job = "another"}); }
  SpooledWriter writer(path_, {.job = "another"});
  EXPECT_EQ(append(writer, kSpooled / kSpooledPart), 0);
  writer.commit();
  EXPECT_TRUE(read_text(path_) == whole_);
}

}  // namespace
}  // namespace surfel::test
