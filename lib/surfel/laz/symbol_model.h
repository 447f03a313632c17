#pragma once

#include <cstdint>
#include <vector>

namespace surfel::laz {

/// Adaptive probabilities of the symbols 0 to n - 1 (Said, Introduction to Arithmetic Coding,
/// 2004): counts of what was coded so far, from which cumulative probabilities of 15 bits are made
/// anew now and then, often at first. Coder and decoder make the same ones.
class SymbolModel {
 public:
  static constexpr int kProbabilityBits = 15;

  SymbolModel() = default;
  /// All symbols are as probable.
  /// \param symbols  2 to 1024.
  explicit SymbolModel(unsigned symbols) { reset(symbols); }
  void reset(unsigned symbols);
  bool empty() const { return symbols_ == 0; }
  unsigned last() const { return symbols_ - 1; }

  /// Probability of all symbols below this one, in units of 2^-15.
  std::uint32_t below(unsigned symbol) const { return values_[symbol]; }
  /// The symbol that a cumulative probability falls to.
  unsigned find(std::uint32_t probability) const {
    const std::uint16_t* steps = values_.data() + 2 * symbols_ + (probability >> step_shift_);
    unsigned low = steps[0];
    unsigned high = steps[1] + 1U;
    while (high > low + 1) {
      const unsigned middle = (low + high) / 2;
      (values_[middle] > probability ? high : low) = middle;
    }
    return low;
  }
  /// Counts a symbol that was coded.
  void count(unsigned symbol) {
    ++values_[symbols_ + symbol];
    if (--until_update_ == 0) update();
  }

 private:
  void update();

  unsigned symbols_ = 0;
  int step_shift_ = 0;
  std::uint32_t total_ = 0;
  std::uint32_t cycle_ = 0;
  std::uint32_t until_update_ = 0;
  /// Cumulative probabilities, then counts, then for every step of probability the symbol that
  /// it begins in.
  std::vector<std::uint16_t> values_;
};

/// Adaptive probability of a bit.
class BitModel {
 public:
  static constexpr int kProbabilityBits = 13;

  /// Probability of a zero, in units of 2^-13.
  std::uint32_t zero() const { return zero_; }
  /// Counts a bit that was coded.
  void count(unsigned bit) {
    zeros_ += 1 - bit;
    if (--until_update_ == 0) update();
  }

 private:
  void update();

  std::uint32_t zero_ = 1U << (kProbabilityBits - 1);
  std::uint32_t zeros_ = 1;
  std::uint32_t total_ = 2;
  std::uint32_t cycle_ = 4;
  std::uint32_t until_update_ = 4;
};

}  // namespace surfel::laz
