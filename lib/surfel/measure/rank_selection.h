#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <surfel/base/types.h>

namespace surfel {

/// Values of given ranks among floats, exactly, without keeping them: all values are handed on
/// twice, first to count() and, once the ranks are known, to look(). The upper halves of their bits
/// are counted in the first pass, the lower halves of the values that come into question in the
/// second one. Takes half a megabyte, and as much for each rank. No value is NaN.
class RankSelection {
 public:
  RankSelection() : upper_(kHalf, 0) {}

  void count(float value) {
    ++upper_[key(value) >> kBits];
    ++size_;
  }
  std::uint64_t size() const { return size_; }

  /// Ends the first pass.
  /// \param ranks  below size(), in any order.
  void choose(const std::vector<std::uint64_t>& ranks) {
    for (const std::uint64_t rank : ranks) {
      std::uint64_t before = 0;
      std::uint32_t half = 0;
      while (before + upper_[half] <= rank) before += upper_[half++];
      chosen_.emplace_back(half, rank - before);
      if (lower_of(half) == nullptr) lower_.emplace_back(half, std::vector<std::uint64_t>(kHalf));
    }
  }
  void look(float value) {
    const std::uint32_t bits = key(value);
    if (std::vector<std::uint64_t>* lower = lower_of(bits >> kBits)) ++(*lower)[bits % kHalf];
  }
  /// The value of the rank that choose() was given as its i-th one.
  float value(std::size_t i) {
    const auto& [half, rank] = chosen_[i];
    const std::vector<std::uint64_t>& lower = *lower_of(half);
    std::uint64_t before = 0;
    std::uint32_t rest = 0;
    while (before + lower[rest] <= rank) before += lower[rest++];
    return value_of((half << kBits) + rest);
  }

 private:
  static constexpr int kBits = 16;
  static constexpr std::uint32_t kHalf = std::uint32_t{1} << kBits;
  static constexpr std::uint32_t kSign = std::uint32_t{1} << 31;

  /// Ascending with the value.
  static std::uint32_t key(float value) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    return (bits & kSign) != 0 ? ~bits : bits | kSign;
  }
  static float value_of(std::uint32_t key) {
    return std::bit_cast<float>((key & kSign) != 0 ? key ^ kSign : ~key);
  }
  std::vector<std::uint64_t>* lower_of(std::uint32_t half) {
    const auto found = std::find_if(lower_.begin(), lower_.end(),
                                    [half](const auto& lower) { return lower.first == half; });
    return found == lower_.end() ? nullptr : &found->second;
  }

  std::uint64_t size_ = 0;
  std::vector<std::uint64_t> upper_;
  /// By upper half that comes into question.
  std::vector<std::pair<std::uint32_t, std::vector<std::uint64_t>>> lower_;
  std::vector<std::pair<std::uint32_t, std::uint64_t>> chosen_;  ///< Upper half, rank among these.
};

}  // namespace surfel
