#include <cstdint>
#include <numeric>

#include <gtest/gtest.h>
#include <surfel/base/types.h>

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

}  // namespace
}  // namespace surfel
