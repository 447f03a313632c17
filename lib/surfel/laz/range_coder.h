#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>
#include <span>
#include <vector>

#include <surfel/laz/symbol_model.h>

namespace surfel::laz {

/// Compressed bytes that no coder wrote.
struct Damage : std::exception {
  const char* what() const noexcept override { return "compressed points are damaged"; }
};

// An arithmetic coder with an interval of 32 bits (Said 2004). Encoder and decoder have the same
// calls, so that what is coded in which order is written down once for both: each call is given a
// function that returns the value to be encoded, which the decoder does not call, and returns the
// value that was coded.

class RangeEncoder {
 public:
  static constexpr bool kDecodes = false;

  template <class Value>
  unsigned symbol(SymbolModel& model, const Value& value) {
    return encode(model, static_cast<unsigned>(value()));
  }
  template <class Value>
  unsigned bit(BitModel& model, const Value& value) {
    return encode(model, static_cast<unsigned>(value()));
  }
  /// `count` bits of even probability, 1 to 32.
  template <class Value>
  std::uint32_t bits(int count, const Value& value) {
    return encode_bits(count, value());
  }
  /// Ends the code; the bytes are complete.
  void finish();
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  unsigned encode(SymbolModel& model, unsigned symbol);
  unsigned encode(BitModel& model, unsigned bit);
  std::uint32_t encode_bits(int count, std::uint32_t bits);
  void move(std::uint32_t by);
  void write_settled();

  std::uint32_t base_ = 0;
  std::uint32_t length_ = ~std::uint32_t{0};
  std::vector<std::uint8_t> bytes_;
};

class RangeDecoder {
 public:
  static constexpr bool kDecodes = true;

  /// Decodes nothing.
  RangeDecoder() = default;
  /// Keeps a reference to the bytes. Throws Damage, as all members do.
  explicit RangeDecoder(std::span<const std::byte> bytes);

  template <class Value>
  unsigned symbol(SymbolModel& model, const Value& /*value*/) {
    return decode(model);
  }
  template <class Value>
  unsigned bit(BitModel& model, const Value& /*value*/) {
    return decode(model);
  }
  template <class Value>
  std::uint32_t bits(int count, const Value& /*value*/) {
    return decode_bits(count);
  }

 private:
  unsigned decode(SymbolModel& model);
  unsigned decode(BitModel& model);
  std::uint32_t decode_bits(int count);
  void read_more();
  std::uint32_t next_byte();

  const std::byte* at_ = nullptr;
  const std::byte* end_ = nullptr;
  int missing_ = 0;  ///< Bytes read beyond the end.
  // The value is always less than the length, so that every symbol found is in its model.
  std::uint32_t value_ = 0;
  std::uint32_t length_ = ~std::uint32_t{0};
};

}  // namespace surfel::laz
