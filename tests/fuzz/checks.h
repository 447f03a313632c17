#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

#include "fuzz/fuzzers.h"

namespace surfel::fuzz {

/// What a fuzzer checks does not hold. Under libFuzzer nothing catches it, which ends the program.
struct Finding : std::logic_error {
  using std::logic_error::logic_error;
};

inline void require(bool holds, std::string_view what) {
  if (!holds) throw Finding(std::string(what));
}

/// Numbers made of the bytes of a run, one after another; zero when there are no more.
class Numbers {
 public:
  explicit Numbers(Bytes bytes) : bytes_(bytes) {}

  bool done() const { return next_ == bytes_.size(); }
  std::uint8_t byte() {
    return done() ? std::uint8_t{0} : std::to_integer<std::uint8_t>(bytes_[next_++]);
  }
  /// Any float, not finite ones among them.
  float any() {
    std::uint32_t bits = 0;
    for (int i = 0; i < 4; ++i) bits = bits << 8 | byte();
    return std::bit_cast<float>(bits);
  }
  /// -1 to 1, in 1/128.
  float unit() { return static_cast<float>(static_cast<std::int8_t>(byte())) / 128; }

 private:
  Bytes bytes_;
  std::size_t next_ = 0;
};

/// Is an input one of the sixteenth of all that three threads work on as well? They take most of
/// the time, on a machine that has other things to do.
inline bool on_three_threads(Bytes bytes) { return bytes.size() % 16 == 0; }

/// Numbers of a cloud: its first two bytes choose options, and whether coordinates are any floats
/// or lengths of one scale.
class CloudNumbers : public Numbers {
 public:
  explicit CloudNumbers(Bytes bytes)
      : Numbers(bytes),
        choice_(byte()),
        scale_(std::ldexp(1.0F, static_cast<int>(byte()) % 64 - 32)) {}

  /// For options: 0..63.
  int choice() const { return choice_ / 4; }
  bool are_any() const { return choice_ % 4 == 3; }
  float scale() const { return scale_; }
  float length() { return are_any() ? any() : scale_ * unit(); }
  /// A number without a unit.
  float number() { return are_any() ? any() : unit(); }

 private:
  std::uint8_t choice_;
  float scale_;
};

}  // namespace surfel::fuzz
