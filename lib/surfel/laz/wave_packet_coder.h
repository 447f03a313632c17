#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include <surfel/laz/integer_coder.h>

namespace surfel::laz {

/// Where the waveform of a point is.
struct WavePacket {
  static constexpr std::size_t kBytes = 29;

  std::uint8_t index = 0;
  std::uint64_t offset = 0;
  std::uint32_t size = 0;
  std::array<std::uint32_t, 4> floats{};  ///< Bits: place of the return, and the direction.

  static WavePacket load(const std::byte* from) {
    WavePacket packet;
    std::memcpy(&packet.index, from, 1);
    std::memcpy(&packet.offset, from + 1, 8);
    std::memcpy(&packet.size, from + 9, 4);
    std::memcpy(packet.floats.data(), from + 13, 16);
    return packet;
  }
  void store(std::byte* to) const {
    std::memcpy(to, &index, 1);
    std::memcpy(to + 1, &offset, 8);
    std::memcpy(to + 9, &size, 4);
    std::memcpy(to + 13, floats.data(), 16);
  }
  bool operator==(const WavePacket&) const = default;
};

/// Wave packets: a scanner mostly writes one behind the other.
class WavePacketCoder {
 public:
  /// Makes the packet that follows `last`, and, if it is encoded, is `now`; it is the new `last`.
  template <class Coder>
  WavePacket code(Coder& coder, WavePacket& last, const WavePacket& now) {
    WavePacket made;
    made.index = static_cast<std::uint8_t>(coder.symbol(index_, [&] { return now.index; }));
    made.offset = code_offset(coder, last, now.offset);
    made.size = size_.code(coder, 0, last.size, [&] { return now.size; });
    made.floats[0] = place_.code(coder, 0, last.floats[0], [&] { return now.floats[0]; });
    for (unsigned k = 0; k < 3; ++k) {
      made.floats[k + 1] =
          direction_.code(coder, k, last.floats[k + 1], [&] { return now.floats[k + 1]; });
    }
    last = made;
    return made;
  }

 private:
  enum Step : unsigned { kNone, kSize, kOther, kFar };

  template <class Coder>
  std::uint64_t code_offset(Coder& coder, const WavePacket& last, std::uint64_t now) {
    const auto step = static_cast<std::int64_t>(now - last.offset);
    step_ = coder.symbol(steps_[step_], [&]() -> unsigned {
      if (step == 0) return kNone;
      if (step == std::int64_t{last.size}) return kSize;
      return step == static_cast<std::int32_t>(step) ? kOther : kFar;
    });
    switch (step_) {
      case kNone:
        return last.offset;
      case kSize:
        return last.offset + last.size;
      case kOther:
        other_step_ = step_size_.code(coder, 0, other_step_,
                                      [&] { return static_cast<std::uint32_t>(step); });
        return last.offset +
               static_cast<std::uint64_t>(std::int64_t{static_cast<std::int32_t>(other_step_)});
      default:
        break;
    }
    const std::uint64_t low = coder.bits(32, [&] { return static_cast<std::uint32_t>(now); });
    const std::uint64_t high =
        coder.bits(32, [&] { return static_cast<std::uint32_t>(now >> 32); });
    return high << 32 | low;
  }

  unsigned step_ = kNone;
  std::uint32_t other_step_ = 0;
  SymbolModel index_{256};
  std::array<SymbolModel, 4> steps_{SymbolModel(4), SymbolModel(4), SymbolModel(4), SymbolModel(4)};
  IntegerCoder step_size_{32};
  IntegerCoder size_{32};
  IntegerCoder place_{32};
  IntegerCoder direction_{32, 3};
};

}  // namespace surfel::laz
