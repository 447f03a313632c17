#pragma once

#include <cstddef>
#include <span>
#include <string>

#include <surfel/base/types.h>

namespace surfel {

/// The most that a byte of deflate's (gzip's) and of Zstandard's compressed data can stand for: two
/// bits for 258 bytes, and a block of four bytes for 128 KiB.
inline constexpr std::size_t kMostGzipRatio = 1032;
inline constexpr std::size_t kMostZstdRatio = std::size_t{1} << 15;

/// The first `size` bytes that data compressed by gzip or zlib stands for; the rest is not decoded,
/// so that no more memory is taken than is asked for. Throws Error(kInput) naming the file if the
/// data is damaged, differs from its checksum (where it ends with these bytes) or stands for fewer
/// bytes. Internal to the io module.
Array<std::byte> gunzip(std::span<const std::byte> data, std::size_t size, const std::string& file);

/// The bytes that a Zstandard frame stands for, which must be `size`. Throws Error(kInput) naming
/// the file if it is damaged or stands for another number of bytes. Internal to the io module.
Array<std::byte> unzstd(std::span<const std::byte> data, std::size_t size, const std::string& file);

}  // namespace surfel
