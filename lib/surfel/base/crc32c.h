#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <surfel/base/export.h>

namespace surfel {

/// CRC-32C of the bytes: the cyclic redundancy check with Castagnoli's polynomial 0x1EDC6F41, bits
/// reflected, all ones before and inverted after (RFC 3720, B.4). Eight bytes at a time by tables
/// [Kounavis, Berry 2005, "slicing-by-8"]. Callable from any thread.
SURFEL_API std::uint32_t crc32c(std::span<const std::byte> bytes);

}  // namespace surfel
