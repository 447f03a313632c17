#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>

#include <surfel/laz/integer_coder.h>

namespace surfel::laz {

/// Times of points, as the bits of doubles: of up to four interleaved sequences in turn, each by
/// how many times its difference fits into the new one.
/// \tparam kRepeats  a symbol stands for the time of the point before (point formats up
///                   to 5); of other formats only times that differ are coded.
template <bool kRepeats>
class GpsTimeCoder {
 public:
  explicit GpsTimeCoder(std::uint64_t first) { times_[0] = first; }

  /// Codes the time that value() returns.
  template <class Coder, class Value>
  std::uint64_t code(Coder& coder, const Value& value) {
    // After one change of the sequence there is a time to code.
    if (!code_in_sequence(coder, value) && !code_in_sequence(coder, value)) throw Damage();
    return times_[now_];
  }

 private:
  static constexpr int kMostTimes = 500;   ///< Differences that fit into a new one.
  static constexpr int kLeastTimes = -10;  ///< The same for the other direction.
  static constexpr unsigned kRepeat = kMostTimes - kLeastTimes + 1;  ///< With kRepeats.
  static constexpr unsigned kWhole = kRepeat + (kRepeats ? 1 : 0);   ///< Then: other sequences.
  static constexpr unsigned kFirst = kRepeats ? 1 : 0;  ///< First symbol but the repetition.

  std::int32_t difference(std::uint64_t time, unsigned sequence) const {
    return static_cast<std::int32_t>(static_cast<std::uint32_t>(time - times_[sequence]));
  }
  /// Is the time so near to a sequence that 32 bits tell the difference?
  bool near(std::uint64_t time, unsigned sequence) const {
    return static_cast<std::int64_t>(time - times_[sequence]) == difference(time, sequence);
  }
  /// 0: code the whole time; 1 to 3: so many sequences further on it is near.
  unsigned way_to_near(std::uint64_t time) const {
    for (unsigned i = 1; i < 4; ++i) {
      if (near(time, (now_ + i) & 3)) return i;
    }
    return 0;
  }
  /// The symbol of a time that follows a difference other than zero.
  unsigned symbol_of(std::uint64_t time) const {
    if (kRepeats && time == times_[now_]) return kRepeat;
    if (!near(time, now_)) return kWhole + way_to_near(time);
    const float ratio =
        static_cast<float>(difference(time, now_)) / static_cast<float>(differences_[now_]);
    const auto times = static_cast<int>(
        std::lround(std::min(std::max(ratio, float{kLeastTimes}), float{kMostTimes})));
    return static_cast<unsigned>(times >= 0 ? times : kMostTimes - times);
  }
  unsigned symbol_without_difference(std::uint64_t time) const {
    if (kRepeats && time == times_[now_]) return 0;
    return near(time, now_) ? kFirst : kFirst + 1 + way_to_near(time);
  }

  template <class Coder, class Value>
  void code_whole(Coder& coder, const Value& value) {
    const auto high = static_cast<std::uint32_t>(times_[now_] >> 32);
    const std::uint64_t top =
        integers_.code(coder, 8, high, [&] { return static_cast<std::uint32_t>(value() >> 32); });
    const std::uint32_t low = coder.bits(32, [&] { return static_cast<std::uint32_t>(value()); });
    newest_ = (newest_ + 1) & 3;
    now_ = newest_;
    times_[now_] = top << 32 | low;
    differences_[now_] = 0;
    extremes_[now_] = 0;
  }

  template <class Coder, class Value>
  std::int32_t code_difference(Coder& coder, const Value& value, unsigned context,
                               std::uint32_t prediction) {
    const std::uint32_t bits = integers_.code(coder, context, prediction, [&] {
      return static_cast<std::uint32_t>(difference(value(), now_));
    });
    const auto found = static_cast<std::int32_t>(bits);
    times_[now_] += static_cast<std::uint64_t>(std::int64_t{found});
    return found;
  }

  /// Differences far from the sequence's own: after four of them it gets a new one.
  void note_extreme(std::int32_t found) {
    if (++extremes_[now_] <= 3) return;
    differences_[now_] = found;
    extremes_[now_] = 0;
  }

  /// False if the sequence was changed, and no time coded.
  template <class Coder, class Value>
  bool code_in_sequence(Coder& coder, const Value& value) {
    if (differences_[now_] == 0) return code_without_difference(coder, value);
    const unsigned symbol = coder.symbol(ratios_, [&] { return symbol_of(value()); });
    if (kRepeats && symbol == kRepeat) return true;
    if (symbol == kWhole) {
      code_whole(coder, value);
      return true;
    }
    if (symbol > kWhole) {
      now_ = (now_ + symbol - kWhole) & 3;
      return false;
    }
    const auto own = static_cast<std::uint32_t>(differences_[now_]);
    if (symbol == 0) {
      note_extreme(code_difference(coder, value, 7, 0));
    } else if (symbol == 1) {
      code_difference(coder, value, 1, own);
      extremes_[now_] = 0;
    } else if (symbol < kMostTimes) {
      code_difference(coder, value, symbol < 10 ? 2 : 3, symbol * own);
    } else if (symbol == kMostTimes) {
      note_extreme(code_difference(coder, value, 4, symbol * own));
    } else if (symbol < kMostTimes - kLeastTimes) {
      code_difference(coder, value, 5, (kMostTimes - symbol) * own);
    } else {
      note_extreme(code_difference(coder, value, 6, (kMostTimes - symbol) * own));
    }
    return true;
  }

  template <class Coder, class Value>
  bool code_without_difference(Coder& coder, const Value& value) {
    const unsigned symbol =
        coder.symbol(no_difference_, [&] { return symbol_without_difference(value()); });
    if (kRepeats && symbol == 0) return true;
    if (symbol == kFirst) {
      differences_[now_] = code_difference(coder, value, 0, 0);
      extremes_[now_] = 0;
    } else if (symbol == kFirst + 1) {
      code_whole(coder, value);
    } else {
      now_ = (now_ + symbol - kFirst - 1) & 3;
      return false;
    }
    return true;
  }

  unsigned now_ = 0;     ///< The sequence that goes on.
  unsigned newest_ = 0;  ///< The sequence that began last.
  std::array<std::uint64_t, 4> times_{};
  std::array<std::int32_t, 4> differences_{};
  std::array<int, 4> extremes_{};
  SymbolModel ratios_{kWhole + 4};
  SymbolModel no_difference_{kFirst + 5};
  IntegerCoder integers_{32, 9};
};

}  // namespace surfel::laz
