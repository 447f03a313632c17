#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include <surfel/laz/range_coder.h>

namespace surfel::laz {

using Color = std::array<std::uint16_t, 3>;

/// The byte of a value, low or high.
inline unsigned byte_of(unsigned value, bool high) { return high ? value >> 8 : value & 0xFF; }

/// A byte as its difference from a prediction.
template <class Coder>
unsigned code_byte(Coder& coder, SymbolModel& model, unsigned prediction, unsigned value) {
  const unsigned difference = coder.symbol(model, [&] { return (value - prediction) & 0xFF; });
  return (prediction + difference) & 0xFF;
}

/// Colours of 16 bits a channel by their differences from the colour before, byte by byte: green
/// is predicted to change as red does, blue as the mean of both.
class ColorCoder {
 public:
  /// Makes the colour of `last` and, if it is encoded, of `now`; it is the new `last` as well.
  template <class Coder>
  Color code(Coder& coder, Color& last, Color now) {
    const unsigned changed = coder.symbol(changed_, [&] { return changes(last, now); });
    std::array<std::array<unsigned, 3>, 2> bytes{};
    for (const unsigned high : {0U, 1U}) {
      unsigned& red = bytes[high][0];
      red = byte_of(last[0], high != 0);
      if (changed & (1U << high)) {
        red = code_byte(coder, differences_[high], red, byte_of(now[0], high != 0));
      }
    }
    for (const unsigned high : {0U, 1U}) {
      auto& [red, green, blue] = bytes[high];
      if ((changed & kColored) == 0) {
        green = blue = red;
        continue;
      }
      const auto before = [&](std::size_t channel) {
        return static_cast<int>(byte_of(last[channel], high != 0));
      };
      const auto code_channel = [&](std::size_t channel, int shift, unsigned& byte) {
        const auto place = static_cast<unsigned>(2 * channel + high);
        byte = static_cast<unsigned>(before(channel));
        if ((changed & (1U << place)) == 0) return;
        const auto prediction = static_cast<unsigned>(std::clamp(before(channel) + shift, 0, 255));
        byte = code_byte(coder, differences_[place], prediction, byte_of(now[channel], high != 0));
      };
      const int shift = static_cast<int>(red) - before(0);
      code_channel(1, shift, green);
      code_channel(2, (shift + static_cast<int>(green) - before(1)) / 2, blue);
    }
    for (std::size_t k = 0; k < 3; ++k) {
      last[k] = static_cast<std::uint16_t>(bytes[1][k] << 8 | bytes[0][k]);
    }
    return last;
  }

 private:
  static constexpr unsigned kColored = 1U << 6;  ///< The channels differ from one another.

  static unsigned changes(const Color& last, const Color& now) {
    unsigned changed = now[0] != now[1] || now[0] != now[2] ? kColored : 0;
    for (std::size_t k = 0; k < 3; ++k) {
      for (const unsigned high : {0U, 1U}) {
        if (byte_of(last[k], high != 0) != byte_of(now[k], high != 0)) {
          changed |= 1U << (2 * k + high);
        }
      }
    }
    return changed;
  }

  SymbolModel changed_{128};
  /// Of the low and the high byte of each channel.
  std::array<SymbolModel, 6> differences_{SymbolModel(256), SymbolModel(256), SymbolModel(256),
                                          SymbolModel(256), SymbolModel(256), SymbolModel(256)};
};

/// Near infrared, as ColorCoder codes red.
class InfraredCoder {
 public:
  template <class Coder>
  std::uint16_t code(Coder& coder, std::uint16_t& last, std::uint16_t now) {
    const unsigned changed = coder.symbol(changed_, [&] {
      const unsigned bits = last ^ now;
      return (bits & 0xFF ? 1U : 0U) | (bits >> 8 ? 2U : 0U);
    });
    unsigned value = 0;
    for (const unsigned high : {0U, 1U}) {
      unsigned byte = byte_of(last, high != 0);
      if (changed & (1U << high)) {
        byte = code_byte(coder, differences_[high], byte, byte_of(now, high != 0));
      }
      value |= byte << (8 * high);
    }
    last = static_cast<std::uint16_t>(value);
    return last;
  }

 private:
  SymbolModel changed_{4};
  std::array<SymbolModel, 2> differences_{SymbolModel(256), SymbolModel(256)};
};

}  // namespace surfel::laz
