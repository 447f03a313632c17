#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include <surfel/base/types.h>

namespace surfel {

/// What a member of gzip's data starts with.
inline constexpr std::string_view kGzipMagic = "\x1f\x8b";

/// The most that a byte of deflate's (gzip's) and of Zstandard's compressed data can stand for: two
/// bits for 258 bytes, and a block of four bytes for 128 KiB.
inline constexpr std::size_t kMostGzipRatio = 1032;
inline constexpr std::size_t kMostZstdRatio = std::size_t{1} << 15;

/// The bytes that data compressed by gzip (of one member or several) or zlib stands for, which must
/// be `size`: no more memory is taken than is asked for. Internal to the io module.
/// \param more  There may be more bytes, and anything behind them, which are not decoded.
///
/// Throws Error(kInput) naming the file if the data is damaged, differs from its checksum or its
/// length, stands for another number of bytes, or is followed by anything but zeros.
Array<std::byte> gunzip(std::span<const std::byte> data, std::size_t size, const std::string& file,
                        bool more = false);

/// The bytes that a Zstandard frame stands for, which must be `size`. Throws Error(kInput) naming
/// the file if it is damaged or stands for another number of bytes. Internal to the io module.
Array<std::byte> unzstd(std::span<const std::byte> data, std::size_t size, const std::string& file);

}  // namespace surfel
