#pragma once

#include <array>
#include <cstdint>

namespace surfel::laz {

/// About the median of the values that came last: five sorted values, of which a new one replaces
/// the largest or the smallest, so that the median follows what comes.
class RunningMedian {
 public:
  std::uint32_t median() const { return static_cast<std::uint32_t>(values_[2]); }
  void add(std::uint32_t bits) {
    const auto value = static_cast<std::int32_t>(bits);
    const std::int32_t before = values_[2];
    if (drop_largest_) {
      std::size_t i = 4;
      for (; i > 0 && value < values_[i - 1]; --i) values_[i] = values_[i - 1];
      values_[i] = value;
      drop_largest_ = value < before;
    } else {
      std::size_t i = 0;
      for (; i < 4 && values_[i + 1] < value; ++i) values_[i] = values_[i + 1];
      values_[i] = value;
      drop_largest_ = value <= before;
    }
  }

 private:
  std::array<std::int32_t, 5> values_{};
  bool drop_largest_ = true;
};

}  // namespace surfel::laz
