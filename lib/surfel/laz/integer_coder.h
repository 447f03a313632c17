#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include <surfel/laz/range_coder.h>

namespace surfel::laz {

/// Integers as their differences from predictions: first how many bits the difference has, by a
/// model for each context, then the difference, of whose bits the highest eight have a model.
class IntegerCoder {
 public:
  /// \param bits  of the integers, 2 to 32; differences wrap around.
  explicit IntegerCoder(int bits, unsigned contexts = 1)
      : bits_(bits), lengths_(contexts, SymbolModel(static_cast<unsigned>(bits) + 1)) {}

  /// Codes the integer that value() returns.
  template <class Coder, class Value>
  std::uint32_t code(Coder& coder, unsigned context, std::uint32_t prediction, const Value& value) {
    std::int32_t difference = 0;
    if constexpr (!Coder::kDecodes) difference = wrapped(value() - prediction);
    length_ = coder.symbol(lengths_[context], [&] { return length_of(difference); });
    difference = code_difference(coder, difference);
    return (prediction + static_cast<std::uint32_t>(difference)) & mask();
  }
  /// Bits of the difference that was coded last.
  unsigned length() const { return length_; }

 private:
  static constexpr unsigned kModelled = 8;

  std::uint32_t mask() const { return ~std::uint32_t{0} >> (32 - bits_); }
  /// The difference of least size, for integers that wrap around.
  std::int32_t wrapped(std::uint32_t difference) const {
    return static_cast<std::int32_t>(difference << (32 - bits_)) >> (32 - bits_);
  }
  /// k for differences in -(2^k - 1) .. 2^k that are not in the interval of k - 1.
  static unsigned length_of(std::int32_t difference) {
    const auto bits = static_cast<std::uint32_t>(difference);
    return static_cast<unsigned>(std::bit_width(difference <= 0 ? 0U - bits : bits - 1));
  }

  template <class Coder>
  std::int32_t code_difference(Coder& coder, std::int32_t difference) {
    const unsigned k = length_;
    if (k == 0) {
      return static_cast<std::int32_t>(
          coder.bit(zero_or_one_, [&] { return static_cast<unsigned>(difference); }));
    }
    if (k == 32) return std::int32_t{1} << 31;  // There is one such difference alone.
    const std::uint32_t most = (std::uint32_t{1} << k) - 1;
    // The place in the interval: the negative differences come first.
    const auto place = [&] {
      return static_cast<std::uint32_t>(difference) + (difference < 0 ? most : ~std::uint32_t{0});
    };
    SymbolModel& model = places_[k];
    if (model.empty()) model.reset(1U << (k < kModelled ? k : kModelled));
    std::uint32_t at = 0;
    if (k <= kModelled) {
      at = coder.symbol(model, place);
    } else {
      const unsigned low = k - kModelled;
      at = coder.symbol(model, [&] { return place() >> low; }) << low;
      at |= coder.bits(static_cast<int>(low),
                       [&] { return place() & ((std::uint32_t{1} << low) - 1); });
    }
    return static_cast<std::int32_t>(at > most / 2 ? at + 1 : at - most);
  }

  int bits_;
  unsigned length_ = 0;
  std::vector<SymbolModel> lengths_;
  BitModel zero_or_one_;
  std::array<SymbolModel, 32> places_;  ///< Made when they are first needed.
};

/// The model at this place, which is made when it is first needed.
inline SymbolModel& made(SymbolModel& model, unsigned symbols) {
  if (model.empty()) model.reset(symbols);
  return model;
}

}  // namespace surfel::laz
