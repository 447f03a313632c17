#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/memory_limits.h>
#include <surfel/base/types.h>

#include "support/test_data.h"

namespace surfel {
namespace {

TEST(Array, BeginsAtACacheLineAndWhereItIsLargeAtAHugePage) {
  constexpr std::size_t kHugePage = std::size_t{2} << 20;
  for (const std::size_t bytes : {std::size_t{1}, std::size_t{100}, kHugePage - 1, kHugePage,
                                  kHugePage + 1, 5 * kHugePage + 12345}) {
    Array<std::uint8_t> array(bytes);
    const auto address = reinterpret_cast<std::uintptr_t>(array.data());
    EXPECT_EQ(address % (bytes < kHugePage ? 64 : kHugePage), 0U) << bytes;
    array.front() = 1;
    array.back() = 2;
  }
}

TEST(Array, KeepsItsValuesWhileItGrows) {
  Array<std::uint32_t> array;
  for (std::size_t size = 1; size < 3000000; size = 2 * size + 1) {
    const std::size_t before = array.size();
    array.resize(size);
    std::iota(array.begin() + static_cast<std::ptrdiff_t>(before), array.end(),
              static_cast<std::uint32_t>(before));
  }
  for (std::size_t i = 0; i < array.size(); ++i) ASSERT_EQ(array[i], i);
}

/// A made-up system's files.
class AvailableMemory : public testing::Test {
 protected:
  static constexpr std::uint64_t kUnlimited = std::numeric_limits<std::uint64_t>::max();

  void write(const std::string& path, const std::string& text) const {
    const std::filesystem::path file = root_ / path;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << text;
  }
  void write_group(const std::string& group, const std::string& limit,
                   const std::string& used) const {
    write("sys/fs/cgroup/" + group + "memory.max", limit + "\n");
    write("sys/fs/cgroup/" + group + "memory.current", used + "\n");
  }
  std::uint64_t available() const { return available_memory_below(root_ / ""); }

  test::TemporaryFolder root_;
};

/// Nobody who wants little is told that it is not there.
TEST(AvailableMemoryFor, IsEnoughForALittleAndTheMachinesForMore) {
  EXPECT_GE(available_memory_for(1000), 1000U);
  EXPECT_LT(available_memory_for(std::uint64_t{1} << 60), std::uint64_t{1} << 60);
}

TEST_F(AvailableMemory, IsUnlimitedWhereNothingIsTold) { EXPECT_EQ(available(), kUnlimited); }

TEST_F(AvailableMemory, IsWhatTheMachineHas) {
  write("proc/meminfo", "MemTotal:       2000 kB\nMemAvailable:   1000 kB\n");
  EXPECT_EQ(available(), 1000U << 10);
}

TEST_F(AvailableMemory, IsTheLeastOfAllControlGroupsAboveTheProcess) {
  write("proc/meminfo", "MemAvailable:   1000000 kB\n");
  write("proc/self/cgroup", "0::/outer/inner\n");
  write_group("outer/inner/", "max", "400000");
  EXPECT_EQ(available(), 1000000U << 10);
  write_group("outer/", "500000", "400000");
  EXPECT_EQ(available(), 100000U);
  write_group("outer/inner/", "430000", "400000");
  EXPECT_EQ(available(), 30000U);
  write_group("", "410000", "405000");
  EXPECT_EQ(available(), 5000U);
  write_group("", "410000", "420000");
  EXPECT_EQ(available(), 0U);
}

TEST_F(AvailableMemory, PagesOfFilesThatNobodyUsesAreFree) {
  write("proc/self/cgroup", "0::/\n");
  write_group("", "500000", "400000");
  write("sys/fs/cgroup/memory.stat", "anon 1\nactive_file 9\ninactive_file 250000\n");
  EXPECT_EQ(available(), 350000U);
}

TEST_F(AvailableMemory, ControlGroupsOfVersion1HaveTheirOwnFiles) {
  write("proc/self/cgroup", "5:cpu,cpuacct:/job\n4:memory:/job\n0::/\n");
  write("sys/fs/cgroup/memory/job/memory.limit_in_bytes", "9223372036854771712\n");
  write("sys/fs/cgroup/memory/job/memory.usage_in_bytes", "60000\n");
  EXPECT_EQ(available(), 9223372036854771712U - 60000U);
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "80000\n");
  write("sys/fs/cgroup/memory/memory.usage_in_bytes", "70000\n");
  write("sys/fs/cgroup/memory/memory.stat", "inactive_file 1\ntotal_inactive_file 5000\n");
  EXPECT_EQ(available(), 15000U);
}

TEST_F(AvailableMemory, AGroupThatAContainerDoesNotSeeIsThatOfTheMount) {
  write("proc/self/cgroup", "4:memory:/docker/0123\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "80000\n");
  write("sys/fs/cgroup/memory/memory.usage_in_bytes", "70000\n");
  EXPECT_EQ(available(), 10000U);
}

TEST_F(AvailableMemory, RespectsTheLimitOfTheAddressSpace) {
  write("proc/self/status", "Name:\tx\nVmSize:\t     100 kB\n");
  const std::string head =
      "Limit                     Soft Limit           Hard Limit           Units\n";
  write("proc/self/limits",
        head + "Max address space         unlimited            unlimited   bytes\n");
  EXPECT_EQ(available(), kUnlimited);
  write("proc/self/limits",
        head + "Max address space         202400               unlimited   bytes\n");
  EXPECT_EQ(available(), 100000U);
}

TEST_F(AvailableMemory, OfThisProcessIsTold) {
  EXPECT_GT(available_memory_bytes(), 0U);
  EXPECT_EQ(available_memory_below(root_ / ""), kUnlimited);
}

}  // namespace
}  // namespace surfel
