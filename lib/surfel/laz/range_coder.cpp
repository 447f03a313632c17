// A. Said, Introduction to Arithmetic Coding: Theory and Practice, HP Labs HPL-2004-76.

#include <surfel/laz/range_coder.h>

namespace surfel::laz {
namespace {

/// The interval is made longer before it is shorter than this.
constexpr std::uint32_t kLeastLength = 1U << 24;
/// Even bits are coded so many at a time.
constexpr int kMostEvenBits = 19;
constexpr int kEvenPart = 16;
/// Some encoders leave out the zeros at the end.
constexpr int kMostMissing = 4;

}  // namespace

/// Adds to the base; a carry goes to the bytes that are written already.
void RangeEncoder::move(std::uint32_t by) {
  const std::uint32_t before = base_;
  base_ += by;
  if (base_ >= before) return;
  std::size_t i = bytes_.size();
  while (++bytes_[--i] == 0) {
  }
}

/// Writes the bytes of the base that no longer change.
void RangeEncoder::write_settled() {
  while (length_ < kLeastLength) {
    bytes_.push_back(static_cast<std::uint8_t>(base_ >> 24));
    base_ <<= 8;
    length_ <<= 8;
  }
}

unsigned RangeEncoder::encode(SymbolModel& model, unsigned symbol) {
  const std::uint32_t unit = length_ >> SymbolModel::kProbabilityBits;
  const std::uint32_t below = model.below(symbol) * unit;
  // The last symbol has the rest of the interval that no probability covers.
  const std::uint32_t end = symbol == model.last() ? length_ : model.below(symbol + 1) * unit;
  move(below);
  length_ = end - below;
  write_settled();
  model.count(symbol);
  return symbol;
}

unsigned RangeEncoder::encode(BitModel& model, unsigned bit) {
  const std::uint32_t zero = model.zero() * (length_ >> BitModel::kProbabilityBits);
  if (bit == 0) {
    length_ = zero;
  } else {
    move(zero);
    length_ -= zero;
  }
  write_settled();
  model.count(bit);
  return bit;
}

std::uint32_t RangeEncoder::encode_bits(int count, std::uint32_t bits) {
  std::uint32_t rest = bits;
  if (count > kMostEvenBits) {
    encode_bits(kEvenPart, bits & ((1U << kEvenPart) - 1));
    rest >>= kEvenPart;
    count -= kEvenPart;
  }
  length_ >>= count;
  move(rest * length_);
  write_settled();
  return bits;
}

void RangeEncoder::finish() {
  // Any number in the interval will do: the one with the fewest bytes that differ from zero.
  const bool wide = length_ > 2 * kLeastLength;
  move(wide ? kLeastLength : kLeastLength / 2);
  length_ = wide ? kLeastLength / 2 : kLeastLength / 512;
  write_settled();
  // Decoders read four bytes ahead, and look for the next chunk right behind them.
  bytes_.insert(bytes_.end(), wide ? 3 : 2, 0);
}

RangeDecoder::RangeDecoder(std::span<const std::byte> bytes)
    : at_(bytes.data()), end_(bytes.data() + bytes.size()) {
  for (int i = 0; i < 4; ++i) value_ = value_ << 8 | next_byte();
  if (value_ == length_) throw Damage();
}

std::uint32_t RangeDecoder::next_byte() {
  if (at_ < end_) return std::to_integer<std::uint32_t>(*at_++);
  if (++missing_ > kMostMissing) throw Damage();
  return 0;
}

inline void RangeDecoder::read_more() {
  while (length_ < kLeastLength) {
    value_ = value_ << 8 | next_byte();
    length_ <<= 8;
  }
}

unsigned RangeDecoder::decode(SymbolModel& model) {
  const std::uint32_t unit = length_ >> SymbolModel::kProbabilityBits;
  const unsigned symbol = model.find(value_ / unit);
  const std::uint32_t below = model.below(symbol) * unit;
  const std::uint32_t end = symbol == model.last() ? length_ : model.below(symbol + 1) * unit;
  value_ -= below;
  length_ = end - below;
  read_more();
  model.count(symbol);
  return symbol;
}

unsigned RangeDecoder::decode(BitModel& model) {
  const std::uint32_t zero = model.zero() * (length_ >> BitModel::kProbabilityBits);
  const unsigned bit = value_ >= zero ? 1 : 0;
  if (bit == 0) {
    length_ = zero;
  } else {
    value_ -= zero;
    length_ -= zero;
  }
  read_more();
  model.count(bit);
  return bit;
}

std::uint32_t RangeDecoder::decode_bits(int count) {
  std::uint32_t low = 0;
  int low_bits = 0;
  if (count > kMostEvenBits) {
    low = decode_bits(kEvenPart);
    low_bits = kEvenPart;
    count -= kEvenPart;
  }
  length_ >>= count;
  const std::uint32_t found = value_ / length_;
  value_ -= found * length_;
  read_more();
  // Bytes that no coder wrote may give one bit more.
  return (found & ((1U << count) - 1)) << low_bits | low;
}

}  // namespace surfel::laz
