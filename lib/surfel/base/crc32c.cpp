#include <array>
#include <bit>
#include <cstring>

#include <surfel/base/crc32c.h>

// Kounavis, Berry 2005, "A Systematic Approach to Building High Performance, Software-based, CRC
// Generators".

namespace surfel {
namespace {

static_assert(std::endian::native == std::endian::little, "eight bytes are read as they are");

using Table = std::array<std::uint32_t, 256>;

/// Table k holds the remainders of a byte that k bytes follow.
constexpr std::array<Table, 8> make_tables() {
  constexpr std::uint32_t kReflected = 0x82F63B78;  // 0x1EDC6F41 with its bits in reverse order.
  std::array<Table, 8> tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t remainder = i;
    for (int bit = 0; bit < 8; ++bit) {
      remainder = (remainder >> 1) ^ ((remainder & 1) != 0 ? kReflected : 0);
    }
    tables[0][i] = remainder;
  }
  for (std::size_t k = 1; k < tables.size(); ++k) {
    for (std::size_t i = 0; i < 256; ++i) {
      const std::uint32_t before = tables[k - 1][i];
      tables[k][i] = (before >> 8) ^ tables[0][before & 255];
    }
  }
  return tables;
}

constexpr std::array<Table, 8> kTables = make_tables();

}  // namespace

std::uint32_t crc32c(std::span<const std::byte> bytes) {
  std::uint32_t remainder = ~std::uint32_t{0};
  while (bytes.size() >= 8) {
    std::uint64_t eight;
    std::memcpy(&eight, bytes.data(), sizeof(eight));
    eight ^= remainder;
    remainder = 0;
    for (std::size_t k = 0; k < 8; ++k) remainder ^= kTables[7 - k][(eight >> (8 * k)) & 255];
    bytes = bytes.subspan(8);
  }
  for (const std::byte byte : bytes) {
    const std::uint32_t low = (remainder ^ std::to_integer<std::uint32_t>(byte)) & 255;
    remainder = (remainder >> 8) ^ kTables[0][low];
  }
  return ~remainder;
}

}  // namespace surfel
